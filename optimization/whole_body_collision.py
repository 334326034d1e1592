"""Keeping the robot's own links apart, as bounds on joint accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.plan_collision import CapsulePairs, pair_gap
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
    model: CollisionModel, data: pin.Data, rates: Array, options: CollisionOptions
) -> ApartRows:
    """Bounds that let no distance fall below the one that is kept.

    A distance d obeys d̈ ≥ −(2/T) ḋ − (d − d_min)/T², the exponential control barrier function
    (Q. Nguyen and K. Sreenath, ACC 2016) with both poles at −1/T. The bias J̇ q̇ of d̈ is left
    out: where links pass each other it is positive.

    Args:
        model: The capsules.
        data: Pinocchio's, after ``computeAllTerms`` and ``updateFramePlacements``.
        rates: (23,) joint velocities.
        options: How links keep apart.
    """
    poses = [data.oMf[link] for link in model.links]
    capsules, T = model.capsules, options.response
    distance, A = _near(
        capsules.owner,
        capsules.ends,
        capsules.radius,
        capsules.pairs,
        np.array([pose.rotation for pose in poses]),
        np.array([pose.translation for pose in poses]),
        data.J,
        model.support,
        options.influence,
    )
    b = -2.0 / T * (A @ rates) - (distance - options.distance) / T**2
    return ApartRows(A, np.minimum(b, options.strongest))


@njit(cache=True)
def _near(owner, ends, radius, pairs, R, p, J, support, influence):  # type: ignore[no-untyped-def]
    """Distances of the pairs that are near, and their derivatives by the joints."""
    joints = J.shape[1] - 6
    world = np.empty_like(ends)
    for c in range(len(owner)):
        for side in range(2):
            world[c, side] = R[owner[c]] @ ends[c, side] + p[owner[c]]
    distance, A = np.empty(len(pairs)), np.zeros((len(pairs), joints))
    normal, on_a, on_b = np.empty(3), np.empty(3), np.empty(3)
    linear, angular = J[:3, 6:], J[3:, 6:]
    count = 0
    for a, b in pairs:
        gap = pair_gap(world, radius, a, b, normal, on_a, on_b)
        if gap >= influence:
            continue
        distance[count] = gap
        for link, point, sign in ((owner[a], on_a, 1.0), (owner[b], on_b, -1.0)):
            arm = np.cross(point, normal)
            for joint in range(joints):
                if support[link, 6 + joint]:
                    along = np.sum(normal * linear[:, joint]) + np.sum(arm * angular[:, joint])
                    A[count, joint] += sign * along
        count += 1
    return distance[:count], A[:count]
