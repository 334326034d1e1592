"""A motion of the robot as a strip of stick figures in inline SVG."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from robomirror_drake.messages import Array
from robomirror_drake.optimization.kinematics import body_poses, make_points, positions
from robomirror_drake.optimization.retargeting.retarget import robot_tables
from robomirror_drake.report.stick_figures import Shape, chains, figure
from robomirror_drake.robot import FEET, Robot, rotation_matrix

MOMENTS = 10
"""Figures in a strip."""

_SCALE = 72.0  # [px/m]
_SLOT, _GROUND, _HEIGHT = 118.0, 128.0, 148.0  # width of a figure's place, and heights [px]
_HEAD = 0.11  # radius [m]

_CHAINS = chains(("pelvis", "neck"), ("hip", "knee", "ankle"))


def strip(
    robot: Robot,
    time: Array,
    q: Array,
    meant: Array,
    fall: float | None = None,
    moments: int = MOMENTS,
) -> Markup:
    """The robot at evenly spaced moments, from its right; and, fainter, where it is meant to be.

    Left limbs have the class ``l``, right ones ``r``, the trunk ``t``; a group has the class
    ``meant``, ``done`` or, after the fall, ``fallen``. Every figure has a place of its own, in
    whose middle the pelvis is meant to be.

    Args:
        robot: The robot.
        time: (T,) [s].
        q: (T, 30) what it did, Drake order.
        meant: (T, 30) what it was told.
        fall: When it fell [s]; None where it did not.
        moments: How many figures.
    """
    rows = np.linspace(0, len(time) - 1, moments).round().astype(np.int64)
    yaw = _yaw(meant[0])
    parts = [f'<path class="floor" d="M0 {_GROUND:g}H{moments * _SLOT:g}"/>']
    told, done = _points(robot, meant[rows]), _points(robot, q[rows])
    for place, row in enumerate(rows):
        middle = (place + 0.5) * _SLOT
        origin = meant[row, 4:7] * [1.0, 1.0, 0.0]
        kind = "fallen" if fall is not None and time[row] >= fall else "done"
        for name, points in (("meant", told), (kind, done)):
            here = {key: value[place] - origin for key, value in points.items()}
            parts.append(f'<g class="{name}">{_figure(here, middle, yaw)}</g>')
        label = f"{time[row]:.1f} s"
        parts.append(f'<text x="{middle:g}" y="{_HEIGHT - 4:g}">{label}</text>')
    box = f"0 0 {moments * _SLOT:g} {_HEIGHT:g}"
    return Markup(f'<svg class="strip" viewBox="{box}" role="img">' + "".join(parts) + "</svg>")


def _yaw(q: Array) -> float:
    """Where the pelvis faces [rad]."""
    R = rotation_matrix(q[:4])
    return float(np.arctan2(-R[0, 1], R[1, 1]))


def _points(robot: Robot, q: Array) -> dict[str, Array]:
    """Keypoints (n, 3), and soles ``left_sole`` … (n, 4, 3), of configurations (n, 30)."""
    tables, spec = robot_tables(robot), robot.spec.keypoints
    names = sorted({name for _, chain in _CHAINS for name in chain})
    points = make_points(robot, [(spec[name].link, spec[name].point) for name in names])
    R, p = body_poses(
        tables.tree,
        rotation_matrix(q[:, :4]),
        np.hstack([q[:, 4:7], np.zeros((len(q), 3)), q[:, 7:]]),
    )
    placed = dict(zip(names, positions(points, R, p).swapaxes(0, 1), strict=True))
    soles = positions(tables.corners, R, p).reshape(len(q), 2, 4, 3)
    return placed | {f"{side}_sole": soles[:, foot] for foot, side in enumerate(FEET)}


def _figure(points: dict[str, Array], middle: float, yaw: float) -> str:
    """One figure, from what :func:`_points` gives of it."""
    shapes = [Shape(kind, np.stack([points[name] for name in names])) for kind, names in _CHAINS]
    shapes += [
        Shape(f"{side[0]} sole", points[f"{side}_sole"], points[f"{side}_ankle"]) for side in FEET
    ]
    trunk = points["neck"] - points["pelvis"]
    head = points["neck"] + 1.3 * _HEAD * trunk / np.linalg.norm(trunk)
    return figure(shapes, head, _HEAD, (middle, _GROUND), _SCALE, yaw)
