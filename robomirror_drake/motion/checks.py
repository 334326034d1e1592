"""What every loader demands of a file before it becomes a HumanMotion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.ground import FEET, ground, heading
from robomirror_drake.motion.skeleton import INDEX

MIN_DURATION = 0.5
"""Shortest motion accepted [s]."""
FPS_RANGE = (5.0, 1000.0)
"""Frame rates accepted [1/s]."""
STATURE_RANGE = (1.0, 2.3)
"""Body heights accepted [m]."""

_LEG_SHARE = 0.49  # thigh and shank over stature: D. A. Winter, Biomechanics, 4th ed., fig. 4.1
_MAX_SPEED = 40.0  # of any joint [m/s]; a fast kick's foot reaches 15
_MAX_STRETCH = 0.2  # standard deviation of a limb bone's length over its mean
_LIMBS = [INDEX[f"{side}_{part}"] for side in ("left", "right")
          for part in ("knee", "ankle", "elbow", "wrist")]  # fmt: skip


def existing_file(path: Path | str) -> Path:
    """The path, if there is a readable file with something in it; else MotionFileError."""
    path = Path(path)
    try:
        if not path.exists():
            raise MotionFileError(path, "no such file")
        if not path.is_file():
            raise MotionFileError(path, "not a file")
        if path.stat().st_size == 0:
            raise MotionFileError(path, "the file is empty")
    except (OSError, ValueError) as error:  # a name too long, or with a NUL in it
        raise MotionFileError(path, f"cannot be read: {error}") from error
    return path


def read_text(path: Path | str) -> str:
    """Text of a file; bytes that are not UTF-8 are replaced, for the parser to trip over."""
    path = existing_file(path)
    try:
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise MotionFileError(path, f"cannot be read: {error}") from error


def stature(positions: Array) -> float:
    """Body height in the unit of positions (T, 22, 3), from the legs: free of the pose."""
    legs = bone_lengths(positions)[:, [INDEX[j] - 1 for j in (
        "left_knee", "left_ankle", "right_knee", "right_ankle")]]  # fmt: skip
    return float(np.median(legs, axis=0).sum() / 2.0 / _LEG_SHARE)


def checked_motion(
    path: Path | str, positions: Array, fps: float, source: str | None = None
) -> HumanMotion:
    """A HumanMotion from positions (T, 22, 3) [m], z up, re-grounded.

    Raises:
        MotionFileError: Not finite, too short, an absurd rate, size or speed, bones
            that change length, or feet that point backwards.
    """
    if positions.ndim != 3 or positions.shape[1:] != (22, 3):
        raise MotionFileError(path, f"joint positions have shape {positions.shape}, "
                              "expected (frames, 22, 3)")  # fmt: skip
    if not (np.isfinite(fps) and FPS_RANGE[0] <= fps <= FPS_RANGE[1]):
        raise MotionFileError(path, f"{fps:.4g} frames per second; expected "
                              f"{FPS_RANGE[0]:g} to {FPS_RANGE[1]:g}")  # fmt: skip
    duration = (len(positions) - 1) / fps
    if duration < MIN_DURATION - 0.5 / fps:
        raise MotionFileError(
            path,
            f"{len(positions)} frames at {fps:.4g} fps last {max(duration, 0.0):.2f} s; "
            f"at least {MIN_DURATION} s are needed",
        )
    if not np.isfinite(positions).all():
        frame = int(np.argwhere(~np.isfinite(positions))[0, 0])
        raise MotionFileError(path, f"frame {frame} holds NaN or infinity")
    if np.abs(positions).max() > 1e6:
        raise MotionFileError(path, f"positions reach {np.abs(positions).max():.3g} m")
    height = stature(positions)
    if not STATURE_RANGE[0] <= height <= STATURE_RANGE[1]:
        raise MotionFileError(
            path,
            f"the person is {height:.3g} m tall; are the positions in metres, "
            "and the joints those of HumanML3D?",
        )
    _check_skeleton(path, positions)
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=2).max(axis=1) * fps
    if speed.max() > _MAX_SPEED:
        raise MotionFileError(path, f"a joint moves at {speed.max():.3g} m/s after frame "
                              f"{int(speed.argmax())}: the motion jumps")  # fmt: skip
    return HumanMotion(ground(positions), float(fps), source=source or str(path))


def _check_skeleton(path: Path | str, positions: Array) -> None:
    limbs = bone_lengths(positions)[:, np.array(_LIMBS) - 1]
    stretch = limbs.std(axis=0) / np.maximum(limbs.mean(axis=0), 1e-9)
    if stretch.max() > _MAX_STRETCH or limbs.mean(axis=0).min() < 0.05:
        raise MotionFileError(path, "the bones of the limbs change length or have none: "
                              "not a human in the joint order of HumanML3D")  # fmt: skip
    trunk = positions[:, INDEX["neck"]] - positions[:, INDEX["pelvis"]]
    upright = trunk[:, 2] > 0.8 * np.linalg.norm(trunk, axis=1)
    yaw = heading(positions[upright])
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)[:, None]
    feet = (positions[upright][:, FEET[:, 1]] - positions[upright][:, FEET[:, 0]])[..., :2]
    if upright.any() and np.median((feet * forward).sum(axis=2)) < -0.02:
        raise MotionFileError(path, "the feet point backwards: left and right are swapped, "
                              "or the axes are left-handed")  # fmt: skip
