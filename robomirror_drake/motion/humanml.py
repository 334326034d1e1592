"""HumanML3D ``.npy`` files as human motions: joint positions or the 263 features.

Source: C. Guo et al., "Generating Diverse and Natural 3D Human Motions from Text",
CVPR 2022; the features are those of :mod:`~robomirror_drake.motion.humanml_features`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.checks import STATURE_RANGE, checked_motion, existing_file, stature
from robomirror_drake.motion.ground import z_up
from robomirror_drake.motion.humanml_features import FEATURES, FPS, recover_from_ric
from robomirror_drake.motion.skeleton import INDEX


def load_humanml(path: Path | str) -> HumanMotion:
    """A ``.npy`` with positions (T, 22, 3) or features (T, 263), y up, 20 fps.

    Features must be denormalised, that is multiplied by Std and added to Mean.

    Raises:
        MotionFileError: Missing, malformed, of another shape, or no human's.
    """
    data = _load_array(path)
    if data.ndim == 2 and data.shape[1] == FEATURES:
        positions = recover_from_ric(data)
        height = stature(positions) if len(data) else 0.0
        if len(data) and not STATURE_RANGE[0] <= height <= STATURE_RANGE[1]:
            raise MotionFileError(
                path,
                f"these features make a person {height:.3g} m tall; if they are normalised, "
                "multiply them by the data set's Std and add its Mean",
            )
    elif data.ndim == 3 and data.shape[1:] == (22, 3):
        positions = data
    else:
        raise MotionFileError(
            path, f"the array has shape {data.shape}, expected (frames, 22, 3) or (frames, 263)"
        )
    motion = checked_motion(path, z_up(positions, "y"), FPS)
    if _lies_stretched(motion.positions):
        raise MotionFileError(
            path,
            "in every frame the body lies stretched out; y must be up, and here z seems to be",
        )
    return motion


def _lies_stretched(positions: Array) -> bool:
    """Whether a body (T, 22, 3), z up, is level and as long as it is tall in every frame."""
    ankles = positions[:, [INDEX["left_ankle"], INDEX["right_ankle"]]].mean(axis=1)
    body = positions[:, INDEX["head"]] - ankles
    length = np.linalg.norm(body, axis=1)
    level = np.abs(body[:, 2]) < 0.3 * length
    return bool((level & (length > 0.7 * stature(positions))).all())


def _load_array(path: Path | str) -> Array:
    path = existing_file(path)
    try:
        # Mapped, so that a header which promises more than the file holds allocates nothing.
        data = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # numpy raises half a dozen types on a damaged file
        raise MotionFileError(path, "not a .npy array of numbers, or a damaged one") from error
    if not isinstance(data, np.ndarray):
        data.close()
        raise MotionFileError(path, "an archive of arrays, not a .npy array")
    if data.dtype.kind not in "fiu":
        raise MotionFileError(path, f"the array holds {data.dtype}, expected numbers")
    with np.errstate(over="ignore"):
        numbers = np.array(data, dtype=float)
    if not np.isfinite(numbers).all():
        frame = int(np.argwhere(~np.isfinite(numbers))[0, 0]) if numbers.ndim else 0
        raise MotionFileError(path, f"frame {frame} holds NaN or infinity")
    if numbers.size and np.abs(numbers).max() > 1e9:
        raise MotionFileError(path, f"numbers reach {np.abs(numbers).max():.3g}")
    return numbers
