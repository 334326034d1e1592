"""How far the robot's own links are from each other, with derivatives, along a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.kinematics import closest_points
from robomirror_drake.robot import Robot

_MEETING = 1e-6  # axes nearer than this have no normal [m]


@dataclass(frozen=True)
class CapsulePairs:
    """Capsules that move with links, and which of them to keep apart.

    Attributes:
        owner: (C,) row of the links that carries each capsule.
        ends: (C, 2, 3) ends of its axis in the link's frame [m].
        radius: (C,) [m].
        pairs: (M, 2) indices of two capsules.
    """

    owner: npt.NDArray[np.int64]
    ends: Array
    radius: Array
    pairs: npt.NDArray[np.int64]

    @staticmethod
    def of(robot: Robot, links: list[int]) -> CapsulePairs:
        """The robot's capsules; ``links`` are Pinocchio ids of frames, all carriers among them."""
        names, capsules = list(robot.spec.collision), robot.spec.collision.values()
        return CapsulePairs(
            owner=np.array([links.index(robot.frame_id(capsule.link)) for capsule in capsules]),
            ends=np.array([capsule.ends for capsule in capsules]),
            radius=np.array([capsule.radius for capsule in capsules]),
            pairs=np.array(
                [[names.index(a), names.index(b)] for a, b in robot.spec.collision_pairs]
            ),
        )


class Gaps(NamedTuple):
    """Distances between the capsules of each pair.

    Attributes:
        distance: (T, M) signed [m].
        normal: (T, M, 3) from the second to the first.
        points: (T, M, 2, 3) points of the axes that are nearest to each other, in world [m].
    """

    distance: Array
    normal: Array
    points: Array


def gaps(capsules: CapsulePairs, links: Array) -> Gaps:
    """The gaps for link poses (T, L, 4, 4)."""
    carried = links[:, capsules.owner]
    ends = np.einsum("tcij,cej->tcei", carried[..., :3, :3], capsules.ends)
    ends += carried[..., None, :3, 3]
    return Gaps(*_gaps(ends, capsules.radius, capsules.pairs))


def gap_jacobians(capsules: CapsulePairs, at: Gaps, motion: Array, support: BoolArray) -> Array:
    """(T, M, 23) derivative of the distances by the joints; the base moves both sides alike.

    Args:
        capsules: The capsules.
        at: Their gaps.
        motion: (T, 6, 29) Jacobian in world, linear first, about the origin.
        support: (L, 29) which velocities move each link.
    """
    joints = motion[:, :, 6:]
    rows = np.zeros((*at.distance.shape, joints.shape[2]))
    for side, sign in enumerate((1.0, -1.0)):
        arm = np.cross(at.points[:, :, side], at.normal)
        mask = support[capsules.owner[capsules.pairs[:, side]], 6:]
        rows += sign * mask * (np.concatenate([at.normal, arm], axis=2) @ joints)
    return rows


@njit(cache=True)
def pair_gap(ends, radius, a, b, normal, on_a, on_b):  # type: ignore[no-untyped-def]
    """Distance of capsules a and b; what :class:`Gaps` has of them goes into the last three.

    Args:
        ends: (C, 2, 3) ends of all axes in world [m].
        radius: (C,) [m].
        a, b: Which two.
        normal, on_a, on_b: (3,) each.
    """
    apart = closest_points(ends[a, 0], ends[a, 1], ends[b, 0], ends[b, 1], on_a, on_b)
    way = on_a - on_b
    if apart < _MEETING:  # part the middles of axes that meet
        way = ends[a, 0] + ends[a, 1] - ends[b, 0] - ends[b, 1]
    normal[:] = way / (np.sqrt(np.sum(way**2)) + 1e-12)
    return apart - radius[a] - radius[b]


@njit(cache=True)
def _gaps(ends, radius, pairs):  # type: ignore[no-untyped-def]
    T, M = len(ends), len(pairs)
    distance, normal = np.empty((T, M)), np.empty((T, M, 3))
    points = np.empty((T, M, 2, 3))
    for t in range(T):
        for m in range(M):
            a, b = pairs[m]
            on_a, on_b = points[t, m, 0], points[t, m, 1]
            distance[t, m] = pair_gap(ends[t], radius, a, b, normal[t, m], on_a, on_b)
    return distance, normal, points
