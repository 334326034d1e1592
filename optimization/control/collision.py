"""Keeping the robot's own links apart, as bounds on joint accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.control.pinocchio_kernels import cross
from robomirror_drake.optimization.control.pinocchio_memory import Memory
from robomirror_drake.optimization.kinematics import act
from robomirror_drake.optimization.planning.collision import CapsulePairs, pair_gap
from robomirror_drake.robot import Robot


class CollisionOptions(BaseModel):
    """How links keep apart."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    distance: float = Field(0.005, ge=0.0, le=0.1, description="that is kept between links [m]")
    influence: float = Field(0.06, ge=0.0, le=0.5, description="from which on pairs count [m]")
    response: float = Field(0.03, gt=0.0, le=1.0, description="time constant of braking [s]")
    strongest: float = Field(300.0, gt=0.0, description="most braking asked for [m/s²]")


@dataclass(frozen=True)
class CollisionModel:
    """Capsules of a robot and the links that carry them.

    Attributes:
        links: Pinocchio ids of the links' frames.
        support: (L, 29) which velocities move each link.
        capsules: Capsules and their pairs.
    """

    links: tuple[int, ...]
    support: BoolArray
    capsules: CapsulePairs

    @staticmethod
    def of(robot: Robot) -> CollisionModel:
        """The capsules in the robot's YAML."""
        links = sorted({robot.frame_id(capsule.link) for capsule in robot.spec.collision.values()})
        return CollisionModel(
            links=tuple(links),
            support=centroidal.frame_support(robot.model, links),
            capsules=CapsulePairs.of(robot, links),
        )


class ApartRows(NamedTuple):
    """Bounds ``A q̈_j ≥ b`` on the joint accelerations, one row for each pair that is near.

    Attributes:
        A: (k, 23) derivatives of the distances.
        b: (k,) least acceleration of the distances [m/s²].
    """

    A: Array
    b: Array


def apart_rows(
    model: CollisionModel, memory: Memory, rates: Array, options: CollisionOptions
) -> ApartRows:
    """Bounds that let no distance fall below the one that is kept.

    A distance d obeys d̈ ≥ −(2/T) ḋ − (d − d_min)/T², the exponential control barrier function
    (Q. Nguyen and K. Sreenath, ACC 2016) with both poles at −1/T. The bias J̇ q̇ of d̈ is left
    out: where links pass each other it is positive.

    Args:
        model: The capsules.
        memory: Pinocchio's, after :func:`.dynamics_terms.dynamics_terms`.
        rates: (23,) joint velocities.
        options: How links keep apart.
    """
    capsules = model.capsules
    limits = (options.influence, options.distance, options.response, options.strongest)
    return ApartRows(
        *_near(
            (capsules.owner, capsules.ends, capsules.radius, capsules.pairs),
            *memory.links,
            memory.dynamics.J,
            model.support,
            rates,
            limits,
        )
    )


@njit(cache=True)
def _near(capsules, R, p, J, support, rates, limits):  # type: ignore[no-untyped-def]
    """A and b of the pairs that are near."""
    (owner, ends, radius, pairs), (influence, least, T, strongest) = capsules, limits
    world, joints = np.empty_like(ends), len(rates)
    middle, reach = np.empty((len(owner), 3)), np.empty(len(owner))
    for c in range(len(owner)):
        for side in range(2):
            act(R[owner[c]], p[owner[c]], ends[c, side], world[c, side])
        square = 0.0
        for i in range(3):
            middle[c, i] = 0.5 * (world[c, 0, i] + world[c, 1, i])
            square += (world[c, 0, i] - middle[c, i]) ** 2
        reach[c] = np.sqrt(square) + radius[c]
    A, b = np.zeros((len(pairs), joints)), np.empty(len(pairs))
    normal, arm, points = np.empty(3), np.empty(3), np.empty((2, 3))
    count = 0
    for pair in range(len(pairs)):
        first, second = pairs[pair]
        square = 0.0
        for i in range(3):
            square += (middle[first, i] - middle[second, i]) ** 2
        if square > (reach[first] + reach[second] + influence) ** 2:
            continue  # balls around the capsules are far from each other already
        gap = pair_gap(world, radius, first, second, normal, points[0], points[1])
        if gap >= influence:
            continue
        closing = 0.0
        for side in range(2):
            link = owner[first] if side == 0 else owner[second]
            cross(points[side], normal, arm)
            for joint in range(joints):
                if support[link, 6 + joint]:
                    along = 0.0
                    for i in range(3):
                        along += normal[i] * J[i, 6 + joint] + arm[i] * J[3 + i, 6 + joint]
                    along *= 1.0 - 2.0 * side
                    A[count, joint] += along
                    closing += along * rates[joint]
        b[count] = min(-2.0 / T * closing - (gap - least) / T**2, strongest)
        count += 1
    return A[:count], b[:count]
