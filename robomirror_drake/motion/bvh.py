"""BVH files of any common dialect as human motions: names, unit, axes, floor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.bvh_names import match_joints, split_name
from robomirror_drake.motion.bvh_parser import Bvh, Joint, parse_bvh
from robomirror_drake.motion.checks import checked_motion, read_text, stature
from robomirror_drake.motion.ground import Axis, z_up
from robomirror_drake.motion.skeleton import INDEX, JOINTS

UNITS: tuple[tuple[str, float], ...] = (
    ("metre", 1.0),
    ("centimetre", 0.01),
    ("millimetre", 0.001),
    ("inch", 0.0254),
    ("CMU unit of 1/0.45 inch", 0.0254 / 0.45),
)
"""Units that a file may be in, and each in metres; the first that gives a human wins."""

_GUESSED_STATURE = (1.2, 2.2)  # body height that settles the unit [m]
_UPRIGHT = 0.7  # cosine between body and axis from which the axis is up
_TOE_REACH = 0.145  # ankle to ball of the foot [m], where a file only says where the foot ends
_STUB = 0.15  # toe offset over shank below which the toe joint is no ball of the foot
_COLLAR = 0.35  # where between neck and shoulder the collar sits, where a file has none
_SPINE = {"spine1": 0.25, "spine2": 0.5, "spine3": 0.62}  # share of the way from pelvis to neck
_OPTIONAL = ("spine1", "spine2", "spine3", "left_collar", "right_collar")
# A joint that a file may leave out, if it says where its parent's bone ends.
_END_SITES = {"head": "neck", "left_foot": "left_ankle", "right_foot": "right_ankle",
              "left_wrist": "left_elbow", "right_wrist": "right_elbow"}  # fmt: skip


def load_bvh(
    path: Path | str, *, metres_per_unit: float | None = None, up: Axis | None = None
) -> HumanMotion:
    """A BVH file as a human motion: z up, metres, on the floor.

    Args:
        path: The file.
        metres_per_unit: Unit of the file; guessed from the length of the legs if None.
        up: ``y`` or ``z`` (or ``x``); guessed from where the head is over the feet if None.

    Raises:
        MotionFileError: Missing or malformed file (with the line), a skeleton that lacks
            a joint (with the names it has), a size that is no human's.
    """
    bvh = parse_bvh(path, read_text(path))
    found, ends = _required_joints(path, bvh.joints)
    rest = _human_joints(bvh, found, ends, zero_pose=True)
    if metres_per_unit is None:
        metres_per_unit = _guess_unit(path, stature(rest))
    positions = _without_calibration_frame(_human_joints(bvh, found, ends))
    positions *= metres_per_unit
    _shorten_feet(positions, ends)
    if up is None:
        up = _guess_up(positions) or _guess_up(rest) or "y"
    return checked_motion(path, z_up(positions, up), 1.0 / bvh.frame_time)


def _required_joints(
    path: Path | str, joints: list[Joint]
) -> tuple[dict[str, int], dict[str, int]]:
    """Which joint of the file each human joint is, or else whose end site it is."""
    found = match_joints(["" if _is_doubled_neck(joint) else joint.name for joint in joints])
    ends = {
        name: found[parent]
        for name, parent in _END_SITES.items()
        if name not in found and parent in found and joints[found[parent]].end_site is not None
    }
    for foot in ("left_foot", "right_foot"):
        if foot in found and _is_stub(joints, found[foot]):
            ends[foot] = found.pop(foot)
    missing = [n for n in JOINTS if n not in found and n not in ends and n not in _OPTIONAL]
    if missing:
        names = ", ".join(joint.name for joint in joints)
        raise MotionFileError(
            path, f"not a human skeleton that we know: nothing stands for {', '.join(missing)}; "
            f"the file's joints are {names[:1500]}",
        )  # fmt: skip
    return found, ends


def _is_doubled_neck(joint: Joint) -> bool:
    """Whether a neck coincides with the spine below it, as CMU's does: Neck1 is the real one."""
    at_parent = joint.offset is None or not joint.offset.any()
    return at_parent and joint.parent >= 0 and split_name(joint.name) == ("", "neck")


def _is_stub(joints: list[Joint], foot: int) -> bool:
    """Whether a toe joint sits right below the ankle, with the toes at its own end site."""
    toe, ankle = joints[foot], joints[joints[foot].parent]
    if toe.end_site is None or toe.offset is None or ankle.offset is None:
        return False
    return bool(np.linalg.norm(toe.offset) < _STUB * np.linalg.norm(ankle.offset))


def _human_joints(
    bvh: Bvh, found: dict[str, int], ends: dict[str, int], zero_pose: bool = False
) -> Array:
    """(T, 22, 3) joints in the file's unit and axes."""
    at, tips = bvh.forward_kinematics(zero_pose)
    human = {name: at[:, i] for name, i in found.items()}
    human |= {name: tips[:, i] for name, i in ends.items()}
    for side in ("left", "right"):
        neck, shoulder = human["neck"], human[f"{side}_shoulder"]
        human.setdefault(f"{side}_collar", neck + _COLLAR * (shoulder - neck))
    chain = [found["neck"]]
    while chain[0] not in (found["pelvis"], 0):
        chain.insert(0, bvh.joints[chain[0]].parent)
    human |= _along(at[:, chain], _SPINE)
    return np.stack([human[name] for name in JOINTS], axis=1)


def _along(chain: Array, shares: dict[str, float]) -> dict[str, Array]:
    """Points at shares of the length of a chain (T, n, 3) of rigid bones."""
    lengths = np.linalg.norm(np.diff(chain[0], axis=0), axis=1)
    reach = np.concatenate([[0.0], np.cumsum(lengths)])
    points = {}
    for name, share in shares.items():
        s = share * reach[-1]
        i = int(np.clip(np.searchsorted(reach, s) - 1, 0, max(len(lengths) - 1, 0)))
        t = (s - reach[i]) / max(lengths[i], 1e-12) if len(lengths) else 0.0
        points[name] = chain[:, i] + t * (chain[:, min(i + 1, len(lengths))] - chain[:, i])
    return points


def _shorten_feet(positions: Array, ends: dict[str, int]) -> None:
    """Where the toe joint is the tip of the foot instead, bring it back to the ball."""
    for side in ("left", "right"):
        if f"{side}_foot" not in ends:
            continue
        ankle = positions[:, INDEX[f"{side}_ankle"]]
        foot = positions[:, INDEX[f"{side}_foot"]] - ankle
        length = np.maximum(np.linalg.norm(foot, axis=1, keepdims=True), 1e-9)
        positions[:, INDEX[f"{side}_foot"]] = ankle + foot * np.minimum(1.0, _TOE_REACH / length)


def _without_calibration_frame(positions: Array) -> Array:
    """Drop the T-pose that many files open with: a first frame the rest does not follow."""
    if len(positions) < 3:
        return positions
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2).max(axis=1)
    leaps = steps[0] > 3.0 * steps[1:].max() and steps[0] > 0.1 * stature(positions)
    return positions[1:] if leaps else positions


def _guess_unit(path: Path | str, units_tall: float) -> float:
    for _, metres in UNITS:
        if _GUESSED_STATURE[0] <= units_tall * metres <= _GUESSED_STATURE[1]:
            return metres
    raise MotionFileError(
        path, f"the skeleton is {units_tall:.4g} units tall, which is no human in "
        f"{', '.join(name for name, _ in UNITS)}; scale it, or give metres_per_unit",
    )  # fmt: skip


def _guess_up(positions: Array) -> Axis | None:
    """The axis along which the neck is over the ankles, or None if the body lies."""
    ankles = positions[:, [INDEX["left_ankle"], INDEX["right_ankle"]]].mean(axis=1)
    body = positions[:, INDEX["neck"]] - ankles
    mean = (body / np.maximum(np.linalg.norm(body, axis=1, keepdims=True), 1e-9)).mean(axis=0)
    axes: tuple[Axis, ...] = ("x", "y", "z")
    return axes[int(mean.argmax())] if mean.max() > _UPRIGHT else None
