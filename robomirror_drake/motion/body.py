"""The human body of the parametric actions: its measures, its pose, its centre of mass.

Measures and masses are those of a person 1.70 m tall, from segment lengths and masses as
fractions of stature and body mass in D. A. Winter, "Biomechanics and Motor Control of Human
Movement", 4th ed., Wiley 2009, tables 4.1 and figure 4.1. Frames: x forward, y left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.motion.ground import ANKLE_HEIGHT, TOE_HEIGHT
from robomirror_drake.motion.skeleton import INDEX, JOINTS

SIDES: tuple[str, str] = ("left", "right")

THIGH = 0.4165
SHANK = 0.4182
UPPER_ARM = 0.316
FOREARM = 0.248
ANKLE_TO_TOE = np.array([0.14, 0.0, TOE_HEIGHT - ANKLE_HEIGHT])
HIP_HALF_WIDTH = 0.09
HIP_DROP = 0.06
LEG = THIGH + SHANK
"""Hip to ankle with the knee straight [m]."""
MAX_LEG = 0.965 * LEG
"""Longest hip-ankle distance in use [m]: the knee never locks."""

_TRUNK: dict[str, tuple[float, float, float]] = {
    "spine1": (0.0, 0.0, 0.10),
    "spine2": (0.0, 0.0, 0.12),
    "spine3": (0.0, 0.0, 0.06),
    "neck": (0.0, 0.0, 0.20),
    "head": (0.02, 0.0, 0.15),
    "left_collar": (0.0, 0.07, 0.12),
    "right_collar": (0.0, -0.07, 0.12),
    "left_shoulder": (0.0, 0.12, 0.02),
    "right_shoulder": (0.0, -0.12, 0.02),
}
"""Offset of each joint of the trunk from its parent, in the parent's frame [m]."""

_OFFSETS = np.array([_TRUNK.get(name, (0.0, 0.0, 0.0)) for name in JOINTS])
SPINE1, SPINE2, SPINE3, NECK, HEAD = (
    INDEX[name] for name in ("spine1", "spine2", "spine3", "neck", "head")
)
_COLLARS, _SHOULDERS, _ELBOWS, _WRISTS, _HIP_JOINTS, _KNEES, _ANKLES, _TOES = (
    (INDEX[f"left_{part}"], INDEX[f"right_{part}"])
    for part in ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
)
_HIPS = np.array([[0.0, HIP_HALF_WIDTH, -HIP_DROP], [0.0, -HIP_HALF_WIDTH, -HIP_DROP]])

_SEGMENTS: tuple[tuple[str, str, float, float], ...] = (
    ("neck", "head", 0.081, 1.0),
    ("spine3", "neck", 0.216, 0.35),
    ("spine1", "spine3", 0.139, 0.5),
    ("pelvis", "spine1", 0.142, 0.2),
    *((f"{s}_shoulder", f"{s}_elbow", 0.028, 0.436) for s in SIDES),
    *((f"{s}_elbow", f"{s}_wrist", 0.022, 0.682) for s in SIDES),
    *((f"{s}_hip", f"{s}_knee", 0.100, 0.433) for s in SIDES),
    *((f"{s}_knee", f"{s}_ankle", 0.0465, 0.433) for s in SIDES),
    *((f"{s}_ankle", f"{s}_foot", 0.0145, 0.5) for s in SIDES),
)
"""Proximal joint, distal joint, share of body mass, centre of mass from the proximal end."""


def _mass_weights() -> Array:
    """(22,) share of body mass that each joint's position stands for."""
    weights = np.zeros(len(JOINTS))
    for proximal, distal, mass, fraction in _SEGMENTS:
        weights[INDEX[proximal]] += mass * (1.0 - fraction)
        weights[INDEX[distal]] += mass * fraction
    weights /= weights.sum()
    return weights


MASS_WEIGHTS: Array = _mass_weights()


def center_of_mass(positions: Array) -> Array:
    """(..., 3) centre of mass of a body with joints at ``positions`` (..., 22, 3) [m]."""
    com: Array = np.einsum("j,...jk->...k", MASS_WEIGHTS, positions)
    return com


@dataclass(frozen=True)
class Pose:
    """What determines the joint positions of T frames; arrays of (T, ...), metres and radians.

    Attributes:
        pelvis: (T, 3) position of the pelvis in world.
        pelvis_euler: (T, 3) yaw, pitch, roll of the pelvis; positive pitch leans forward.
        chest_euler: (T, 3) the same for the chest relative to the pelvis.
        head_euler: (T, 3) the same for the head relative to the chest.
        foot: (T, 2, 3) where each ankle would be with the heel down, in world.
        foot_yaw: (T, 2) heading of each foot.
        heel_rise: (T, 2) rotation of each foot about its toe; positive lifts the heel.
        arm: (T, 2, 4) shoulder flexion, abduction, outward rotation, elbow flexion.
    """

    pelvis: Array
    pelvis_euler: Array
    chest_euler: Array
    head_euler: Array
    foot: Array
    foot_yaw: Array
    heel_rise: Array
    arm: Array


def joint_positions(pose: Pose) -> Array:
    """(T, 22, 3) joint positions by forward kinematics, with the legs by inverse kinematics.

    Where a foot is out of reach the leg stretches towards it and the ankle stays short of it,
    so that bone lengths hold always. The knee bends in the plane that looks between pelvis and
    foot, forward and, where the thigh points forward, up.
    """
    points = np.empty((len(pose.pelvis), len(JOINTS), 3))
    _pose_body(
        pose.pelvis, pose.pelvis_euler, pose.chest_euler, pose.head_euler, pose.foot,
        pose.foot_yaw, pose.heel_rise, np.ascontiguousarray(pose.arm), _OFFSETS, points,
    )  # fmt: skip
    return points


def move_pelvis(positions: Array, pose: Pose, step: Array) -> None:
    """Bring joint positions (T, 22, 3) to a pose whose pelvis alone has moved, by ``step`` (T, 3).

    The trunk goes along and the legs are solved again: as :func:`joint_positions`, in less time.
    """
    positions += step[:, None]
    _pose_legs(pose.pelvis, pose.pelvis_euler, pose.foot, pose.foot_yaw, pose.heel_rise, positions)


def about(axis: int, angle: Array) -> Array:
    """(T, 3, 3) rotations by (T,) angles [rad] about axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.zeros((len(angle), 3, 3))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, axis, axis] = 1.0
    matrix[:, j, j] = matrix[:, k, k] = c
    matrix[:, k, j], matrix[:, j, k] = s, -s
    return matrix


def leg_vectors(pose: Pose) -> Array:
    """(T, 2, 3) from each hip to where its ankle is wanted, whether in reach or not [m]."""
    reach = np.empty((len(pose.pelvis), 2, 3))
    _reach(pose.pelvis, pose.pelvis_euler, pose.foot, pose.foot_yaw, pose.heel_rise, reach)
    return reach


@numba.njit(cache=True)
def _turn(yaw: float, pitch: float, roll: float, out: Array) -> None:
    """Rotation about z, then y, then x of the turned frame."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    out[0, 0], out[0, 1], out[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    out[1, 0], out[1, 1], out[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    out[2, 0], out[2, 1], out[2, 2] = -sp, cp * sr, cp * cr


@numba.njit(cache=True)
def _times(a: Array, b: Array, out: Array) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@numba.njit(cache=True)
def _place(points: Array, joint: int, parent: int, frame: Array, offset: Array) -> None:
    for i in range(3):
        points[joint, i] = points[parent, i] + (
            frame[i, 0] * offset[0] + frame[i, 1] * offset[1] + frame[i, 2] * offset[2]
        )


@numba.njit(cache=True)
def _ankle(foot: Array, yaw: float, rise: float, out: Array) -> None:
    """Where the ankle is once the heel has risen about the toe."""
    x, z = ANKLE_TO_TOE[0], ANKLE_TO_TOE[2]
    ahead = x - (np.cos(rise) * x + np.sin(rise) * z)
    out[0] = foot[0] + np.cos(yaw) * ahead
    out[1] = foot[1] + np.sin(yaw) * ahead
    out[2] = foot[2] + z - (np.cos(rise) * z - np.sin(rise) * x)


@numba.njit(cache=True)
def _reach(pelvis: Array, euler: Array, foot: Array, yaw: Array, rise: Array, out: Array) -> None:
    frame, ankle = np.empty((3, 3)), np.empty(3)
    for t in range(len(pelvis)):
        _turn(euler[t, 0], euler[t, 1], euler[t, 2], frame)
        for side in range(2):
            _ankle(foot[t, side], yaw[t, side], rise[t, side], ankle)
            for i in range(3):
                hip = frame[i, 1] * _HIPS[side, 1] + frame[i, 2] * _HIPS[side, 2]
                out[t, side, i] = ankle[i] - pelvis[t, i] - hip


@numba.njit(cache=True)
def _pose_body(
    pelvis: Array, pelvis_euler: Array, chest_euler: Array, head_euler: Array, foot: Array,
    foot_yaw: Array, heel_rise: Array, arm: Array, offsets: Array, out: Array,
) -> None:  # fmt: skip
    base, third, low, mid = (np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)))
    chest, neck, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    ankle = np.empty(3)
    for t in range(len(pelvis)):
        points = out[t]
        points[0] = pelvis[t]
        _turn(pelvis_euler[t, 0], pelvis_euler[t, 1], pelvis_euler[t, 2], base)
        e = chest_euler[t]
        _turn(e[0] / 3.0, e[1] / 3.0, e[2] / 3.0, third)
        _times(base, third, low)
        _times(low, third, mid)
        _times(mid, third, chest)
        _turn(head_euler[t, 0], head_euler[t, 1], head_euler[t, 2], third)
        _times(chest, third, neck)
        _place(points, SPINE1, 0, base, offsets[SPINE1])
        _place(points, SPINE2, SPINE1, low, offsets[SPINE2])
        _place(points, SPINE3, SPINE2, mid, offsets[SPINE3])
        _place(points, NECK, SPINE3, chest, offsets[NECK])
        _place(points, HEAD, NECK, neck, offsets[HEAD])
        for side in range(2):
            _place(points, _COLLARS[side], SPINE3, chest, offsets[_COLLARS[side]])
            _place(points, _SHOULDERS[side], _COLLARS[side], chest, offsets[_SHOULDERS[side]])
            _pose_arm(points, side, chest, arm[t, side], third, turned, low)
            _ankle(foot[t, side], foot_yaw[t, side], heel_rise[t, side], ankle)
            _pose_leg(points, side, base, ankle, foot_yaw[t, side], heel_rise[t, side])


@numba.njit(cache=True)
def _pose_legs(
    pelvis: Array, pelvis_euler: Array, foot: Array, foot_yaw: Array, heel_rise: Array, out: Array
) -> None:
    base, ankle = np.empty((3, 3)), np.empty(3)
    for t in range(len(pelvis)):
        out[t, 0] = pelvis[t]
        _turn(pelvis_euler[t, 0], pelvis_euler[t, 1], pelvis_euler[t, 2], base)
        for side in range(2):
            _ankle(foot[t, side], foot_yaw[t, side], heel_rise[t, side], ankle)
            _pose_leg(out[t], side, base, ankle, foot_yaw[t, side], heel_rise[t, side])


@numba.njit(cache=True)
def _pose_arm(
    points: Array, side: int, chest: Array, angles: Array, a: Array, b: Array, c: Array
) -> None:
    outward = 1.0 if side == 0 else -1.0
    _turn(0.0, -angles[0], outward * angles[1], a)
    _times(chest, a, b)
    _turn(outward * angles[2], 0.0, 0.0, a)
    _times(b, a, c)
    _turn(0.0, -angles[3], 0.0, a)
    _times(c, a, b)
    for i in range(3):
        elbow = points[_SHOULDERS[side], i] - UPPER_ARM * c[i, 2]
        points[_ELBOWS[side], i] = elbow
        points[_WRISTS[side], i] = elbow - FOREARM * b[i, 2]


@numba.njit(cache=True)
def _pose_leg(points: Array, side: int, base: Array, ankle: Array, yaw: float, rise: float) -> None:
    hip, axis, bend = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        hip[i] = points[0, i] + base[i, 1] * _HIPS[side, 1] + base[i, 2] * _HIPS[side, 2]
        axis[i] = ankle[i] - hip[i]
    distance = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    axis /= distance
    distance = min(max(distance, abs(THIGH - SHANK) + 1e-3), 0.998 * LEG)
    bend[0] = base[0, 0] + np.cos(yaw)
    bend[1] = base[1, 0] + np.sin(yaw)
    bend[2] = base[2, 0] + 0.5
    along = bend[0] * axis[0] + bend[1] * axis[1] + bend[2] * axis[2]
    bend -= along * axis
    bend /= np.sqrt(bend[0] ** 2 + bend[1] ** 2 + bend[2] ** 2)
    down = (THIGH**2 - SHANK**2 + distance**2) / (2.0 * distance)
    out = np.sqrt(THIGH**2 - down**2)
    x, z = ANKLE_TO_TOE[0], ANKLE_TO_TOE[2]
    ahead = np.cos(rise) * x + np.sin(rise) * z
    for i in range(3):
        points[_HIP_JOINTS[side], i] = hip[i]
        points[_KNEES[side], i] = hip[i] + down * axis[i] + out * bend[i]
        points[_ANKLES[side], i] = hip[i] + distance * axis[i]
    points[_TOES[side], 0] = points[_ANKLES[side], 0] + np.cos(yaw) * ahead
    points[_TOES[side], 1] = points[_ANKLES[side], 1] + np.sin(yaw) * ahead
    points[_TOES[side], 2] = points[_ANKLES[side], 2] + np.cos(rise) * z - np.sin(rise) * x
