"""How human a motion moves: feet, floor, bones, joints and jerk, from joint positions alone.

Each figure is defined so that recorded motion can be held to it as well. Joint positions are
(T, 22, 3) [m], z up.
"""

from __future__ import annotations

import numpy as np

from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.bones import LEGS, bone_lengths
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.ground import FEET, clearance
from robomirror_drake.motion.learned.metrics import foot_skate
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.skeleton import INDEX

RATE = 20.0
"""Frames per second of which all derivatives are taken: HumanML3D's, the lowest in use [1/s]."""
TOLERANCE = 20.0
"""By how much people and skeletons may go beyond the ranges of :data:`RANGES` [°]."""

RANGES: dict[str, tuple[float, float]] = {
    "knee flexion": (0.0, 135.0),
    "elbow flexion": (0.0, 150.0),
    "hip flexion": (-30.0, 120.0),
    "hip adduction": (-180.0, 30.0),
    "ankle dorsiflexion": (-50.0, 20.0),
    "trunk flexion": (-25.0, 80.0),
    "trunk side bend": (-35.0, 35.0),
    "trunk twist": (-45.0, 45.0),
    "shoulder extension": (-180.0, 60.0),
    "shoulder adduction": (-180.0, 45.0),
}
"""Ranges of motion [°]: American Academy of Orthopaedic Surgeons, "Joint Motion: Method of
Measuring and Recording", 1965; those that positions tell apart. Shoulder extension is how far the
upper arm points backward of the chest, adduction how far across it, hip adduction likewise."""

_FOOT_SLOPE = 23.2  # of the line from ankle to toe in flat stance [°]: 0.14 m ahead, 0.06 m down
_BENT = 10.0  # from this angle on, a knee's direction can be told [°]
_TRUNK_RADIUS, _HEAD_RADIUS, _THIGH_RADIUS, _ARM_RADIUS = 0.10, 0.08, 0.06, 0.035  # [m]
_HAND = 0.4  # how far the palm is beyond the wrist, over the forearm's length
_SAMPLES = np.linspace(0.3, 1.0 + _HAND, 6)  # of forearm and hand, from the elbow


def figures(motion: HumanMotion) -> dict[str, float]:
    """All figures of one motion, by their name and unit."""
    coarse = resample(motion, RATE)
    positions = coarse.positions
    excess = beyond_ranges(positions)
    return {
        "skating_frames_percent": 100.0 * foot_skate(positions[..., [1, 2, 0]], RATE),
        "stance_drift_mm": 1e3 * stance_drift(motion),
        "penetration_mm": 1e3 * penetration(motion.positions),
        "bone_drift_percent": 100.0 * bone_drift(motion.positions),
        "beyond_range_frames_percent": 100.0 * float((excess.max(axis=1) > 0.0).mean()),
        "beyond_range_deg": float(excess.max()),
        "arm_in_body_mm": 1e3 * float(arm_in_body(positions).max()),
        "jerk_m_s3": jerk(positions, RATE),
        "peak_acceleration_m_s2": peak_acceleration(positions, RATE),
    }


def stance_drift(motion: HumanMotion) -> float:
    """Mean over contact phases of how far the bearing toe or heel strays from its middle [m].

    The phases are those of :func:`~robomirror_drake.motion.contacts.foot_contacts`; their first
    and last 50 ms, in which a foot is put down and lifted, are left out.
    """
    edge = round(0.05 * motion.fps)
    contact = foot_contacts(motion)
    strays = []
    for side, end in np.ndindex(2, 2):
        path = motion.positions[:, FEET[side, end], :2]
        change = np.flatnonzero(np.diff(contact[:, side, end], prepend=False, append=False))
        for start, stop in zip(change[::2] + edge, change[1::2] - edge, strict=True):
            if stop - start >= 2:
                stance = path[start:stop]
                strays.append(np.linalg.norm(stance - np.median(stance, axis=0), axis=1).max())
    return float(np.mean(strays)) if strays else 0.0


def penetration(positions: Array) -> float:
    """How deep a sole, or another joint, comes under the floor [m]; 0 where none does."""
    return float(max(0.0, -clearance(positions).min(), -positions[..., 2].min()))


def bone_drift(positions: Array) -> float:
    """Largest standard deviation of a bone's length over its mean; bones under 2 cm left out."""
    lengths = bone_lengths(positions)
    mean = lengths.mean(axis=0)
    long = mean > 0.02
    return float((lengths.std(axis=0)[long] / mean[long]).max())


def jerk(positions: Array, fps: float) -> float:
    """Root mean square over time and joints of the third derivative of positions [m/s³]."""
    if len(positions) < 4:
        return 0.0
    third = np.diff(positions, n=3, axis=0) * fps**3
    return float(np.sqrt((third**2).sum(axis=-1).mean()))


def peak_acceleration(positions: Array, fps: float) -> float:
    """Largest acceleration of any joint [m/s²]: where a motion pops."""
    if len(positions) < 3:
        return 0.0
    second = np.diff(positions, n=2, axis=0) * fps**2
    return float(np.linalg.norm(second, axis=-1).max())


def beyond_ranges(positions: Array) -> Array:
    """(T, angles) by how much each angle is beyond its range and the tolerance [°], or 0."""
    angles = joint_angles(positions)
    columns = []
    for name, (low, high) in RANGES.items():
        value = angles[name]
        over = np.maximum(value - high, low - value) - TOLERANCE
        columns.append(np.maximum(over, 0.0).reshape(len(value), -1).max(axis=1))
    return np.stack(columns, axis=1)


def joint_angles(positions: Array) -> dict[str, Array]:
    """The angles of :data:`RANGES` of positions (T, 22, 3) [°]: (T, 2) left and right, or (T,).

    A knee bends towards the toes; one that bends the other way has a negative angle.
    """
    at = {name: positions[:, i] for name, i in INDEX.items()}
    pelvis = _frame(at["left_hip"] - at["right_hip"], at["spine1"] - at["pelvis"])
    chest = _frame(at["left_shoulder"] - at["right_shoulder"], at["neck"] - at["spine3"])
    spine = _local(pelvis, at["neck"] - at["spine1"])
    across = _local(pelvis, at["left_shoulder"] - at["right_shoulder"])
    found = {
        "trunk flexion": _degrees(np.arctan2(spine[:, 0], spine[:, 2])),
        "trunk side bend": _degrees(np.arctan2(spine[:, 1], np.hypot(spine[:, 0], spine[:, 2]))),
        "trunk twist": _degrees(np.arctan2(-across[:, 0], across[:, 1])),
    }
    both: dict[str, list[Array]] = {name: [] for name in RANGES if name not in found}
    for side, outward in (("left", 1.0), ("right", -1.0)):
        hip, knee, ankle, toe, shoulder, elbow, wrist = (
            at[f"{side}_{j}"]
            for j in ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")
        )
        bend = _between(knee - hip, ankle - knee)
        shin, foot = _unit(ankle - knee), toe - ankle
        ahead = foot - (foot * shin).sum(axis=1, keepdims=True) * shin
        towards = ((knee - hip) * ahead).sum(axis=1) > 0.0
        both["knee flexion"].append(np.where((bend < _BENT) | towards, bend, -bend))
        both["elbow flexion"].append(_between(elbow - shoulder, wrist - elbow))
        dorsiflexion = 90.0 + _FOOT_SLOPE - _between(foot, knee - ankle)
        both["ankle dorsiflexion"].append(dorsiflexion)
        thigh = _local(pelvis, _unit(knee - hip))
        both["hip flexion"].append(_swing(thigh))
        both["hip adduction"].append(_degrees(np.arcsin(np.clip(-outward * thigh[:, 1], -1, 1))))
        arm = _local(chest, _unit(elbow - shoulder))
        both["shoulder extension"].append(_degrees(np.arcsin(np.clip(-arm[:, 0], -1, 1))))
        both["shoulder adduction"].append(_degrees(np.arcsin(np.clip(-outward * arm[:, 1], -1, 1))))
    return found | {name: np.stack(sides, axis=1) for name, sides in both.items()}


def _swing(limb: Array) -> Array:
    """(T,) how far a unit vector points ahead of straight down [°], −90 to 270.

    Of a limb that points sideways, the part ahead of or behind the body counts alone.
    """
    angle = np.arctan2(limb[:, 0], np.maximum(-limb[:, 2], 0.0) + np.abs(limb[:, 1]))
    above = (limb[:, 2] > 0.0) & (limb[:, 0] > 0.0)
    high = np.pi - np.arctan2(limb[:, 0], limb[:, 2])
    return _degrees(np.where(above & (np.abs(limb[:, 1]) < 0.5), high, angle))


def arm_in_body(positions: Array) -> Array:
    """(T,) how deep a forearm or hand is in trunk, head or a thigh, as round bodies [m]."""
    at = {name: positions[:, i] for name, i in INDEX.items()}
    deepest = np.zeros(len(positions))
    crown = at["head"] + 0.08 * _unit(at["head"] - at["neck"])
    solids = [
        (at["pelvis"], at["neck"], _TRUNK_RADIUS),
        (at["head"], crown, _HEAD_RADIUS),
        *((positions[:, leg[0]], positions[:, leg[1]], _THIGH_RADIUS) for leg in LEGS),
    ]
    for side in ("left", "right"):
        elbow, forearm = at[f"{side}_elbow"], at[f"{side}_wrist"] - at[f"{side}_elbow"]
        points = elbow[:, None] + _SAMPLES[:, None] * forearm[:, None]
        for start, end, radius in solids:
            depth = radius + _ARM_RADIUS - _distance(points, start, end)
            deepest = np.maximum(deepest, depth.max(axis=1))
    return deepest


def _distance(points: Array, start: Array, end: Array) -> Array:
    """(T, n) distance of points (T, n, 3) from the line between start and end (T, 3)."""
    line = (end - start)[:, None]
    along = ((points - start[:, None]) * line).sum(axis=-1, keepdims=True)
    along = np.clip(along / np.maximum((line**2).sum(axis=-1, keepdims=True), 1e-12), 0.0, 1.0)
    distance: Array = np.linalg.norm(points - start[:, None] - along * line, axis=-1)
    return distance


def _frame(left: Array, up: Array) -> Array:
    """(T, 3, 3) rows forward, left and up of a part of the body, as unit vectors."""
    y = _unit(left)
    x = _unit(np.cross(y, up))
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _local(frame: Array, vector: Array) -> Array:
    """(T, 3) vectors in a frame of :func:`_frame`."""
    turned: Array = np.einsum("tij,tj->ti", frame, vector)
    return turned


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)
    return unit


def _between(a: Array, b: Array) -> Array:
    return _degrees(np.arccos(np.clip((_unit(a) * _unit(b)).sum(axis=-1), -1.0, 1.0)))


def _degrees(angle: Array) -> Array:
    return np.asarray(np.rad2deg(angle))
