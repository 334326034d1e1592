"""Axes, floor and heading: one convention, kept by every loader.

World is z up. The floor is z = 0 and lies under the *soles*: in flat stance the
toe joint (the ball of the foot) stands :data:`TOE_HEIGHT` above it and the ankle
:data:`ANKLE_HEIGHT`, as in a shod adult. HumanML3D itself puts the lowest joint
at 0, 2 cm lower; its files are lifted here like all others.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.skeleton import INDEX

ANKLE_HEIGHT = 0.08
"""Height of the ankle joint above the sole of a flat foot [m]."""
TOE_HEIGHT = 0.02
"""Height of the toe joint above the sole of a flat foot [m]."""

FEET = np.array(
    [[INDEX["left_ankle"], INDEX["left_foot"]], [INDEX["right_ankle"], INDEX["right_foot"]]]
)
"""(2, 2) joint indices: left and right foot, each ankle then toe."""

Axis = Literal["x", "y", "z"]
"""Name of a coordinate axis."""

_STANCE_BAND = 0.08  # how far above the lowest frames a foot may still be in stance [m]
_UP: dict[Axis, tuple[int, int, int]] = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}


def clearance(positions: Array) -> Array:
    """(T, 2, 2) height of heel and toe of each foot above the floor [m].

    Measured at the joints less their height in flat stance, so a flat foot on the
    floor reads 0 at both ends. Feet are (left, right), ends are (heel, toe).
    """
    heights: Array = positions[:, FEET, 2] - np.array([ANKLE_HEIGHT, TOE_HEIGHT])
    return heights


def ground(positions: Array) -> Array:
    """Positions (T, 22, 3), z up, shifted in z until the feet in stance stand on the floor.

    The floor is the median clearance of the lowest end of a foot, over the slower half of
    the frames in which one is low. Flight, swing and single bad frames do not move it.
    """
    heights = clearance(positions).reshape(len(positions), 4)
    end = heights.argmin(axis=1)
    lowest = heights.min(axis=1)
    feet = positions[:, FEET.ravel()]
    speed = np.linalg.norm(np.gradient(feet, axis=0), axis=2)[np.arange(len(feet)), end]
    low = lowest <= np.percentile(lowest, 5) + _STANCE_BAND
    stance = low & (speed <= np.median(speed[low]))
    shifted: Array = positions - np.array([0.0, 0.0, np.median(lowest[stance])])
    return shifted


def z_up(positions: Array, up: Axis) -> Array:
    """Positions (…, 3) turned, without mirroring, from the axis ``up`` (x, y or z) to z up.

    From y up, (x, y, z) becomes (z, x, y): what faced +z, as HumanML3D does, faces +x.
    """
    return np.ascontiguousarray(positions[..., list(_UP[up])])


def heading(positions: Array) -> Array:
    """(T,) yaw of the body [rad]: 0 faces +x, positive to the left.

    Taken from the line across hips and shoulders, which stays level where a bowed
    trunk does not.
    """
    across = positions[:, [INDEX["left_hip"], INDEX["left_shoulder"]]].sum(axis=1) - positions[
        :, [INDEX["right_hip"], INDEX["right_shoulder"]]
    ].sum(axis=1)
    yaw: Array = np.arctan2(-across[:, 0], across[:, 1])
    return yaw


def face_forward(motion: HumanMotion) -> HumanMotion:
    """The motion turned and shifted so that it starts at x = y = 0 and faces +x."""
    yaw = -heading(motion.positions[:1])[0]
    turn = np.array(
        [[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
    origin = motion.positions[0, INDEX["pelvis"]] * np.array([1.0, 1.0, 0.0])
    return replace(motion, positions=(motion.positions - origin) @ turn.T)
