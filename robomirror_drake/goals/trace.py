"""A robot motion as a command talks of it: where pelvis, trunk, hands and feet go.

Everything is told from the standing robot: hands and feet as they are seen from the pelvis,
in the direction that it faces, with heights over the floor.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization.kinematics import (
    Points,
    body_point,
    body_poses,
    make_points,
    positions,
)
from robomirror_drake.optimization.retargeting.retarget import robot_tables
from robomirror_drake.robot import FEET, Robot, rotation_matrix

RATE = 60.0
"""Samples per second of the motions that are measured."""

_ACROSS = np.array([1.0, -1.0, 1.0])  # left and right exchanged, of a vector


class Trace(NamedTuple):
    """A motion of T samples.

    Attributes:
        place: (T, 2) pelvis over the floor [m]; a window's begins at 0, facing +x.
        heading: (T, 1) where the pelvis faces, without jumps [rad], positive to the left.
        height: (T, 1) of the pelvis over that of the standing robot [m].
        trunk: (T, 3) chest: lean to the right, lean forward, turned left of the pelvis [rad].
        hands: (T, 2, 3) wrists (left, right) from where they hang [m].
        feet: (T, 2, 3) middles of the soles from where they stand [m].
        clearance: (T, 2) lowest corner of each sole over the floor [m].
    """

    place: Array
    heading: Array
    height: Array
    trunk: Array
    hands: Array
    feet: Array
    clearance: Array

    def window(self, start: int, stop: int) -> Trace:
        """Samples from ``start`` to ``stop``, exclusive, seen from where they begin."""
        cut = Trace(*(part[start:stop] for part in self))
        yaw = cut.heading[0, 0]
        c, s = np.cos(yaw), np.sin(yaw)
        place = (cut.place - cut.place[0]) @ np.array([[c, -s], [s, c]])
        return cut._replace(place=place, heading=cut.heading - yaw)

    def mirrored(self) -> Trace:
        """The same with left and right exchanged."""
        return Trace(
            place=self.place * [1.0, -1.0],
            heading=-self.heading,
            height=self.height,
            trunk=self.trunk * [-1.0, 1.0, -1.0],
            hands=self.hands[:, ::-1] * _ACROSS,
            feet=self.feet[:, ::-1] * _ACROSS,
            clearance=self.clearance[:, ::-1],
        )


def make_trace(robot: Robot, q: Array) -> Trace:
    """The trace of positions (T, 30) at :data:`RATE`, Drake order.

    Raises:
        ValueError: ``q`` has another shape, or no sample.
    """
    return from_standing(robot, q).window(0, len(q))


def from_standing(robot: Robot, q: Array) -> Trace:
    """A trace whose place and heading are the world's; arguments are those of :func:`make_trace`.

    Each sample depends on its own configuration only, up to whole turns of the heading.
    """
    q = np.asarray(q, dtype=np.float64)
    if q.ndim != 2 or q.shape[1] != len(robot.standing) or len(q) == 0:
        raise ValueError(f"q has shape {q.shape}, expected (T, {len(robot.standing)}), T >= 1")
    rest, moved = _standing(robot), _seen(robot, q)
    return moved._replace(
        height=moved.height - rest.height,
        trunk=moved.trunk - rest.trunk,
        hands=moved.hands - rest.hands,
        feet=moved.feet - rest.feet,
    )


@lru_cache(maxsize=8)
def _standing(robot: Robot) -> Trace:
    return _seen(robot, robot.standing[None])


@lru_cache(maxsize=8)
def _points(robot: Robot) -> tuple[Points, int]:
    """Both wrists, and the body that the chest is."""
    keypoints = robot.spec.keypoints
    wrists = [keypoints[f"{side}_wrist"] for side in FEET]
    chest, _ = body_point(robot, keypoints["neck"].link, keypoints["neck"].point)
    return make_points(robot, [(wrist.link, wrist.point) for wrist in wrists]), chest


def _seen(robot: Robot, q: Array) -> Trace:
    """A trace that is not yet told from the standing robot."""
    tables = robot_tables(robot)
    wrists, chest = _points(robot)
    base = rotation_matrix(q[:, :4])
    # Without an offset the frame's orientation is the reference's.
    R, p = body_poses(tables.tree, base, np.hstack([q[:, 4:7], np.zeros((len(q), 3)), q[:, 7:]]))
    corners = positions(tables.corners, R, p).reshape(len(q), 2, 4, 3)
    yaw = _yaw(base)
    turned = np.einsum("tji,tjk->tik", _about_z(yaw), R[:, chest])
    roll = np.arctan2(turned[:, 2, 1], turned[:, 2, 2])
    pitch = np.arcsin(np.clip(-turned[:, 2, 0], -1.0, 1.0))
    twist = np.arctan2(turned[:, 1, 0], turned[:, 0, 0])
    return Trace(
        place=q[:, 4:6],
        heading=np.unwrap(yaw)[:, None],
        height=q[:, 6:7],
        trunk=np.stack([roll, pitch, twist], axis=1),
        hands=_from_pelvis(positions(wrists, R, p), q[:, 4:6], yaw),
        feet=_from_pelvis(corners.mean(axis=2), q[:, 4:6], yaw),
        clearance=corners[..., 2].min(axis=2),
    )


def headings(q: Array) -> Array:
    """(T, 1) headings of configurations (T, 30) in the world [rad], each from itself alone."""
    return _yaw(rotation_matrix(q[:, :4]))[:, None]


def _yaw(base: Array) -> Array:
    """(T,) from the lateral axis of a base (T, 3, 3), which is level where the pelvis is bowed."""
    return np.asarray(np.arctan2(-base[:, 0, 1], base[:, 1, 1]))


def _about_z(yaw: Array) -> Array:
    """(T, 3, 3) rotations about the vertical."""
    c, s, nought, one = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw), np.ones_like(yaw)
    rows = [[c, -s, nought], [s, c, nought], [nought, nought, one]]
    return np.moveaxis(np.array(rows), -1, 0)


def _from_pelvis(points: Array, place: Array, yaw: Array) -> Array:
    """(T, P, 3) points seen from over the pelvis (T, 2), in the direction that it faces."""
    away = points.copy()
    away[..., :2] -= place[:, None]
    return np.asarray(np.einsum("tji,tpj->tpi", _about_z(yaw), away))
