"""Bones of the human skeleton: between joints, their lengths, joints from them, legs to a place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robomirror_drake.messages import Array
from robomirror_drake.motion.skeleton import INDEX, JOINTS, PARENTS

LEGS = np.array([[INDEX[f"{side}_{j}"] for j in ("hip", "knee", "ankle", "foot")]
                 for side in ("left", "right")])  # fmt: skip
"""(2, 4) joint indices: left and right leg, each hip, knee, ankle, toe."""

_MIRROR = [
    INDEX[n.replace("left", "?").replace("right", "left").replace("?", "right")] for n in JOINTS
]


def mirrored(positions: Array) -> Array:
    """Positions (T, 22, 3), z up, with left and right exchanged: y becomes −y."""
    mirror: Array = positions[:, _MIRROR] * [1.0, -1.0, 1.0]
    return mirror


def bones(positions: Array) -> Array:
    """(..., 21, 3) from its parent to each joint but the pelvis, of positions (..., 22, 3)."""
    vectors: Array = positions[..., 1:, :] - positions[..., PARENTS[1:], :]
    return vectors


def bone_lengths(positions: Array) -> Array:
    """(..., 21) distance of each joint but the pelvis from its parent [unit of positions]."""
    lengths: Array = np.linalg.norm(bones(positions), axis=-1)
    return lengths


def along_bones(pelvis: Array, vectors: Array) -> Array:
    """(..., 22, 3) positions with the pelvis at (..., 3) and bones (..., 21, 3)."""
    positions = np.empty((*vectors.shape[:-2], len(JOINTS), 3))
    positions[..., 0, :] = pelvis
    for j in range(1, len(JOINTS)):
        positions[..., j, :] = positions[..., PARENTS[j], :] + vectors[..., j - 1, :]
    return positions


def bring_ankles(
    positions: Array,
    legs: npt.NDArray[np.int64],
    ankles: Array,
    feet: Array,
    thigh: npt.ArrayLike,
    shank: npt.ArrayLike,
) -> None:
    """Bring ankles to a place in ``positions``, by the knees, which stay on their side.

    Where an ankle is out of reach, the leg stretches towards it.

    Args:
        positions: (..., 22, 3) joints [m].
        legs: (n, 4) rows of :data:`LEGS`.
        ankles: (..., n, 3) where their ankles are to be [m].
        feet: (..., n, 3) from ankle to toe [m].
        thigh: Length of each thigh, to broadcast with (n, 1) [m].
        shank: Length of each shank, likewise [m].
    """
    thigh, shank = np.asarray(thigh), np.asarray(shank)
    hip, knee, ankle, toe = legs.T
    reach = ankles - positions[..., hip, :]
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    axis = reach / distance
    distance = np.clip(distance, np.abs(thigh - shank) + 1e-3, 0.999 * (thigh + shank))
    bend = positions[..., knee, :] - positions[..., hip, :]
    bend -= (bend * axis).sum(axis=-1, keepdims=True) * axis
    bend /= np.maximum(np.linalg.norm(bend, axis=-1, keepdims=True), 1e-9)
    along = (thigh**2 - shank**2 + distance**2) / (2.0 * distance)
    side = np.sqrt(np.maximum(thigh**2 - along**2, 0.0))
    positions[..., knee, :] = positions[..., hip, :] + along * axis + side * bend
    positions[..., ankle, :] = positions[..., hip, :] + distance * axis
    positions[..., toe, :] = positions[..., ankle, :] + feet
