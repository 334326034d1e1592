"""BVH text to arrays, and their forward kinematics.

Format: M. Meredith and S. Maddock, "Motion Capture File Formats Explained",
University of Sheffield, CS-01-11. Read leniently (braces anywhere, blanks in names,
any number and order of channels) and refused with the line of the first fault.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array

_AXES = {"x": 0, "y": 1, "z": 2}


@dataclass
class Joint:
    """A joint of a BVH hierarchy.

    Attributes:
        name: As written.
        parent: Index of its parent; -1 for the root.
        offset: (3,) from the parent in the zero pose [file's unit].
        channels: ``(kind, axis)`` of each, kind ``position`` or ``rotation``, in file order.
        end_site: (3,) where its bone ends, if the file says so.
    """

    name: str
    parent: int
    offset: Array | None = None
    channels: list[tuple[str, int]] = field(default_factory=list)
    end_site: Array | None = None


@dataclass(frozen=True)
class Bvh:
    """A parsed file: joints, parents first; values (T, C) of all channels; frame time [s]."""

    joints: list[Joint]
    values: Array
    frame_time: float

    def forward_kinematics(self, zero_pose: bool = False) -> tuple[Array, Array]:
        """Positions (T, J, 3) of all joints, and of their end sites (NaN without one).

        Position channels replace the offset, as every common exporter means them.
        With ``zero_pose`` the one frame (T = 1) in which all channels are zero and
        all offsets hold.
        """
        frames = 1 if zero_pose else len(self.values)
        at = np.empty((frames, len(self.joints), 3))
        ends = np.full_like(at, np.nan)
        turns: list[Rotation] = []
        column = 0
        for i, joint in enumerate(self.joints):
            local = np.tile(np.zeros(3) if joint.offset is None else joint.offset, (frames, 1))
            turn = Rotation.identity(frames)
            for kind, axis in joint.channels:
                if not zero_pose and kind == "position":
                    local[:, axis] = self.values[:, column]
                elif not zero_pose:
                    angle = np.radians(self.values[:, column : column + 1])
                    turn = turn * Rotation.from_rotvec(angle * np.eye(3)[axis])
                column += 1
            if joint.parent >= 0:
                local = at[:, joint.parent] + turns[joint.parent].apply(local)
                turn = turns[joint.parent] * turn
            at[:, i] = local
            turns.append(turn)
            if joint.end_site is not None:
                ends[:, i] = local + turn.apply(joint.end_site)
        return at, ends


def parse_bvh(path: Path | str, text: str) -> Bvh:
    """Parse BVH text; ``path`` is for the error messages only.

    Raises:
        MotionFileError: With the number of the line at fault.
    """
    lines = text.splitlines()
    joints, motion_line = _parse_hierarchy(path, lines)
    width = sum(len(joint.channels) for joint in joints)
    values, frame_time = _parse_motion(path, lines, motion_line, width)
    return Bvh(joints, values, frame_time)


def _parse_hierarchy(path: Path | str, lines: list[str]) -> tuple[list[Joint], int]:
    """All joints, and the index of the line after MOTION."""
    joints: list[Joint] = []
    stack: list[int] = []  # open braces: a joint's index, or _END
    opened: int | None = None  # what the next brace opens
    for n, line in enumerate(lines):

        def fault(what: str, n: int = n) -> MotionFileError:
            return MotionFileError(path, f"line {n + 1}: {what}")

        for statement in filter(None, map(str.strip, re.split(r"([{}])", line))):
            word, _, rest = statement.replace("\t", " ").partition(" ")
            key = word.upper()
            if n == 0 and not joints and key not in ("HIERARCHY", "ROOT"):
                raise fault("not a BVH file: it does not begin with HIERARCHY")
            if key == "HIERARCHY":
                continue
            if key == "MOTION":
                if stack or opened is not None or not joints:
                    raise fault("MOTION before the hierarchy is complete")
                return joints, n + 1
            if key == "{":
                if opened is None:
                    raise fault("a brace opens nothing")
                stack.append(opened)
                opened = None
            elif key == "}":
                if not stack or opened is not None:
                    raise fault("a brace closes nothing")
                stack.pop()
            elif opened is not None:
                raise fault(f"expected '{{', found {statement[:40]!r}")
            elif key in ("ROOT", "JOINT"):
                if (key == "ROOT") == bool(stack or joints) or (stack and stack[-1] == _END):
                    raise fault(f"{key} does not belong here")
                joints.append(Joint(rest.strip(), stack[-1] if stack else -1))
                opened = len(joints) - 1
            elif key == "END" and stack and stack[-1] != _END:
                opened = _END
            elif key == "OFFSET" and stack:
                vector = _offset(rest)
                if vector is None:
                    raise fault("OFFSET needs three numbers")
                if stack[-1] != _END:
                    joints[stack[-1]].offset = vector
                else:
                    joints[stack[-2]].end_site = vector
            elif key == "CHANNELS" and stack and stack[-1] != _END:
                channels = _channels(rest)
                if channels is None:
                    raise fault(f"cannot read CHANNELS {rest[:80]!r}")
                joints[stack[-1]].channels = channels
            else:
                raise fault(f"cannot read {statement[:40]!r}")
    raise MotionFileError(path, f"line {len(lines)}: the file ends before MOTION")


_END = -1


def _offset(text: str) -> Array | None:
    try:
        vector = np.array(text.split(), float)
    except ValueError:
        return None
    return vector if vector.shape == (3,) and np.abs(vector).max() < 1e9 else None


def _channels(text: str) -> list[tuple[str, int]] | None:
    count, *names = text.split() or [""]
    found = [re.fullmatch(r"([xyz])(position|rotation)", name.lower()) for name in names]
    if count != str(len(names)) or not all(found):
        return None
    return [(match[2], _AXES[match[1]]) for match in found if match]


def _parse_motion(
    path: Path | str, lines: list[str], start: int, width: int
) -> tuple[Array, float]:
    """(T, width) channel values and the frame time [s]."""
    rest = ((n, line.strip()) for n, line in enumerate(lines[start:], start + 1))
    body = [(n, line) for n, line in rest if line]
    header = [
        re.fullmatch(pattern, line, re.IGNORECASE)
        for pattern, (_, line) in zip(
            (r"Frames\s*:?\s*(\d+)", r"Frame\s*Time\s*:?\s*(\S+)"), body[:2], strict=False
        )
    ]
    if len(header) < 2 or header[0] is None or header[1] is None:
        line = body[header.index(None)][0] if None in header else len(lines)
        raise MotionFileError(path, f"line {line}: expected 'Frames:' and 'Frame Time:'")
    try:
        frame_time = float(header[1][1])
    except ValueError:
        frame_time = float("nan")
    if not 1e-4 <= frame_time <= 1.0:
        raise MotionFileError(
            path, f"line {body[1][0]}: the frame time is {header[1][1]} s, which cannot be"
        )
    rows = body[2:]
    for n, row in rows:
        if (have := len(row.split())) != width:
            raise MotionFileError(path, f"line {n}: {have} numbers, the channels are {width}")
    if header[0][1].lstrip("0") != (str(len(rows)) if rows else ""):
        raise MotionFileError(
            path, f"line {body[-1][0]}: the file has {len(rows)} frames, "
            f"its header says {header[0][1][:20]}",
        )  # fmt: skip
    values = np.empty((len(rows), width))
    for i, (n, row) in enumerate(rows):
        try:
            values[i] = row.split()
        except ValueError:
            raise MotionFileError(path, f"line {n}: something is not a number") from None
        if not (np.abs(values[i]) < 1e9).all():
            raise MotionFileError(path, f"line {n}: a number is NaN or absurdly large")
    return values, frame_time
