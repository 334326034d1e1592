"""The motion capture clips that the ``pybullet`` package ships, as human motions.

The format is DeepMimic's: JSON whose ``Frames`` are rows of 44 numbers, y up,
metres, quaternions wxyz: time step, root position, root orientation, then the
joints in the order of :data:`_CHANNELS`, a quaternion each, or one angle where
the joint is a hinge. The time step leads to the *next* frame; the last is unused.

Source: X. B. Peng et al., "DeepMimic", ACM TOG 2018.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet_data
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.checks import checked_motion, read_text
from robomirror_drake.motion.ground import ANKLE_HEIGHT, TOE_HEIGHT
from robomirror_drake.motion.resample import spline
from robomirror_drake.motion.skeleton import JOINTS

FEET_ONLY_CLIPS: tuple[str, ...] = (
    "walk", "run", "jump", "kick", "punch", "spin", "spinkick", "dance_a", "dance_b",
    "walk_forward", "turn_left0", "turn_left1", "turn_right0", "turn_right1",
)  # fmt: skip
"""Clips in which nothing but the feet touches the ground."""

# Joint and how many numbers it takes in a frame.
_CHANNELS = (
    ("chest", 4), ("neck", 4), ("right_hip", 4), ("right_knee", 1), ("right_ankle", 4),
    ("right_shoulder", 4), ("right_elbow", 1), ("left_hip", 4), ("left_knee", 1),
    ("left_ankle", 4), ("left_shoulder", 4), ("left_elbow", 1),
)  # fmt: skip
_FRAME_WIDTH = 8 + sum(width for _, width in _CHANNELS)

_URDF_SCALE = 4.0  # the shipped model is four times life size
_FOOT = np.array([0.13, TOE_HEIGHT - ANKLE_HEIGHT, 0.0])  # ankle to ball of the foot [m]
_HEAD = np.array([0.0, 0.12, 0.0])  # neck to base of the skull [m]
_COLLAR = 0.35  # where between neck and shoulder the collar joint sits


def _directory() -> Path:
    return Path(pybullet_data.getDataPath()) / "data" / "motions"


def _clip_files() -> dict[str, Path]:
    """Every humanoid clip by name; the package's quadruped is left out."""
    files = {
        p.stem.removeprefix("humanoid3d_"): p for p in _directory().glob("humanoid3d_*.txt")
    } | {p.stem.lstrip("0"): p for p in _directory().glob("walker/*.txt")}
    return dict(sorted(files.items()))


def list_clips() -> tuple[str, ...]:
    """Names of all clips, in alphabetical order."""
    return tuple(_clip_files())


def load_clip(name: str) -> HumanMotion:
    """A shipped clip by name, once through (it does not loop), initially facing +x.

    Raises:
        MotionFileError: There is no clip of that name.
    """
    files = _clip_files()
    if name not in files:
        raise MotionFileError(name, f"no such clip; there are {', '.join(files)}")
    return load_mocap(files[name], source=f"pybullet:{name}")


def load_mocap(path: Path | str, source: str | None = None) -> HumanMotion:
    """A file in DeepMimic's format, on the skeleton of pybullet's humanoid.

    Frames of uneven length are resampled to their median rate.

    Raises:
        MotionFileError: The file is missing, malformed or not a humanoid's motion.
    """
    frames = _frames(path, read_text(path))
    steps = frames[:-1, 0]
    if not (len(steps) and steps.min() > 0):
        raise MotionFileError(path, "needs two frames at least, with positive time steps")
    norms = np.linalg.norm(_quaternions(frames), axis=2)
    if np.abs(norms - 1.0).max() > 0.5:  # the shipped kick strays to 0.58
        frame = int(np.abs(norms - 1.0).max(axis=1).argmax())
        raise MotionFileError(path, f"frame {frame}: a quaternion is not of unit length")
    positions = _forward_kinematics(frames)
    fps = 1.0 / float(np.median(steps))
    time = np.concatenate([[0.0], np.cumsum(steps)])
    if np.abs(time * fps - np.arange(len(time))).max() > 0.1 and time[-1] * fps < 1e6:
        even = np.arange(int(time[-1] * fps + 1e-6) + 1) / fps
        positions = spline(time, positions)(even)
    return checked_motion(path, positions, fps, source)


def _frames(path: Path | str, text: str) -> Array:
    """(T, 44) rows of the file."""
    try:
        rows = json.loads(text)["Frames"]
    except json.JSONDecodeError as error:
        raise MotionFileError(path, f"line {error.lineno}: not JSON: {error.msg}") from error
    except RecursionError as error:
        raise MotionFileError(path, "not JSON: nested too deeply") from error
    except (KeyError, TypeError) as error:
        raise MotionFileError(path, "no list of Frames: not a DeepMimic motion") from error
    if not isinstance(rows, list) or not rows:
        raise MotionFileError(path, "Frames is not a list, or is empty")
    for i, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != _FRAME_WIDTH:
            have = len(row) if isinstance(row, list) else "no"
            raise MotionFileError(
                path, f"frame {i} has {have} numbers, a humanoid's has {_FRAME_WIDTH}"
            )
        if not all(type(x) in (int, float) and abs(x) < 1e9 for x in row):
            raise MotionFileError(path, f"frame {i} holds something that is no sensible number")
    return np.array(rows, dtype=float)


def _quaternions(frames: Array) -> Array:
    """(T, 9, 4) root orientation and ball joints, wxyz."""
    starts, at = [4], 8
    for _, width in _CHANNELS:
        starts += [at] if width == 4 else []
        at += width
    return np.stack([frames[:, s : s + 4] for s in starts], axis=1)


@cache
def _skeleton() -> dict[str, tuple[str, Array]]:
    """Parent and offset in it [m] of each joint of pybullet's humanoid."""
    path = Path(pybullet_data.getDataPath()) / "humanoid" / "humanoid.urdf"
    tree = ElementTree.fromstring(path.read_text().rstrip("\0\n "))  # it ends in a stray NUL
    return {
        str(joint.get("name")): (
            str(joint.find("parent").get("link")),  # type: ignore[union-attr]
            np.array(joint.find("origin").get("xyz").split(), float) / _URDF_SCALE,  # type: ignore[union-attr]
        )
        for joint in tree.iter("joint")
    }


def _forward_kinematics(frames: Array) -> Array:
    """(T, 22, 3) joint positions [m], z up, of frames (T, 44)."""
    skeleton = _skeleton()
    turn = {"root": Rotation.from_quat(frames[:, 4:8], scalar_first=True)}
    at = {"root": frames[:, 1:4]}
    column = 8
    for joint, width in _CHANNELS:
        parent, offset = skeleton[joint]
        values = frames[:, column : column + width]
        local = (
            Rotation.from_quat(values, scalar_first=True)
            if width == 4
            else Rotation.from_rotvec(values * np.array([0.0, 0.0, 1.0]))
        )
        turn[joint] = turn[parent] * local
        at[joint] = at[parent] + turn[parent].apply(offset)
        column += width

    # HumanML3D has joints that this skeleton lacks: each is fixed to one of its bodies.
    chest, neck = skeleton["chest"][1], skeleton["neck"][1]
    body = {
        "pelvis": at["root"],
        "spine1": at["root"] + turn["root"].apply(chest / 2.0),
        "spine2": at["chest"],
        "spine3": at["chest"] + turn["chest"].apply(neck / 3.0),
        "neck": at["neck"],
        "head": at["neck"] + turn["neck"].apply(_HEAD),
    }
    for side in ("left", "right"):
        for part in ("hip", "knee", "ankle", "shoulder", "elbow"):
            body[f"{side}_{part}"] = at[f"{side}_{part}"]
        shoulder = at[f"{side}_shoulder"]
        body[f"{side}_collar"] = at["neck"] + _COLLAR * (shoulder - at["neck"])
        wrist = skeleton[f"{side}_wrist"][1]
        body[f"{side}_wrist"] = at[f"{side}_elbow"] + turn[f"{side}_elbow"].apply(wrist)
        body[f"{side}_foot"] = at[f"{side}_ankle"] + turn[f"{side}_ankle"].apply(_FOOT)
    x, y, z = np.moveaxis(np.stack([body[name] for name in JOINTS], axis=1), -1, 0)
    return np.stack([x, -z, y], axis=-1)  # y up to z up; +x stays forward
