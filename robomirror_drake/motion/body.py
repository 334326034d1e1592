"""The human body of the parametric actions: its measures, its pose, its centre of mass.

Measures and masses are those of a person 1.70 m tall, from segment lengths and masses as
fractions of stature and body mass in D. A. Winter, "Biomechanics and Motor Control of Human
Movement", 4th ed., Wiley 2009, tables 4.1 and figure 4.1. Frames: x forward, y left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.motion.skeleton import INDEX, JOINTS, PARENTS

SIDES: tuple[str, str] = ("left", "right")

THIGH = 0.4165
SHANK = 0.4182
UPPER_ARM = 0.316
FOREARM = 0.248
ANKLE_HEIGHT = 0.08
TOE_HEIGHT = 0.02
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


def bone_lengths(positions: Array) -> Array:
    """(..., 21) distance of each joint but the pelvis from its parent [m]."""
    lengths: Array = np.linalg.norm(positions[..., 1:, :] - positions[..., PARENTS[1:], :], axis=-1)
    return lengths


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
    so that bone lengths hold always.
    """
    points = np.empty((len(pose.pelvis), len(JOINTS), 3))
    points[:, 0] = pose.pelvis
    pelvis = rotation(pose.pelvis_euler)
    third = rotation(pose.chest_euler / 3.0)
    frames = {"pelvis": pelvis}
    for name, below in (("spine1", "pelvis"), ("spine2", "spine1"), ("spine3", "spine2")):
        frames[name] = frames[below] @ third
    chest = frames["spine3"]
    frames["neck"] = chest @ rotation(pose.head_euler)
    for name, offset in _TRUNK.items():
        parent = JOINTS[PARENTS[INDEX[name]]]
        points[:, INDEX[name]] = points[:, INDEX[parent]] + frames.get(parent, chest) @ offset
    for i, side in enumerate(SIDES):
        _pose_arm(points, side, chest, pose.arm[:, i])
        _pose_leg(points, side, pelvis, pose, i)
    return points


def about(axis: int, angle: Array) -> Array:
    """(T, 3, 3) rotations by (T,) angles [rad] about axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.zeros((len(angle), 3, 3))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, axis, axis] = 1.0
    matrix[:, j, j] = matrix[:, k, k] = c
    matrix[:, k, j], matrix[:, j, k] = s, -s
    return matrix


def rotation(euler: Array) -> Array:
    """(T, 3, 3) rotations of (T, 3) yaw, pitch, roll [rad]."""
    turned: Array = about(2, euler[:, 0]) @ about(1, euler[:, 1]) @ about(0, euler[:, 2])
    return turned


def _pose_arm(points: Array, side: str, chest: Array, angles: Array) -> None:
    outward = 1.0 if side == "left" else -1.0
    flexion, abduction, turned, elbow = angles.T
    raised = chest @ about(1, -flexion) @ about(0, outward * abduction)
    upper = raised @ about(2, outward * turned)
    lower = upper @ about(1, -elbow)
    upper_end = points[:, INDEX[f"{side}_shoulder"]] - UPPER_ARM * upper[..., 2]
    points[:, INDEX[f"{side}_elbow"]] = upper_end
    points[:, INDEX[f"{side}_wrist"]] = upper_end - FOREARM * lower[..., 2]


def _pose_leg(points: Array, side: str, pelvis: Array, pose: Pose, i: int) -> None:
    """Ankle from the foot's pose, knee in the plane that looks between pelvis and foot."""
    hip, reach, flat, heading = _leg(pelvis, pose, i)
    distance = np.linalg.norm(reach, axis=1, keepdims=True)
    axis = reach / distance
    distance = np.clip(distance, abs(THIGH - SHANK) + 1e-3, 0.998 * LEG)
    ankle = hip + distance * axis
    forward = pelvis[..., 0] + flat[..., 0]
    # The knee bends forward and, when the thigh points forward, up.
    forward[:, 2] += 0.5
    forward -= np.sum(forward * axis, axis=1, keepdims=True) * axis
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    along = (THIGH**2 - SHANK**2 + distance**2) / (2.0 * distance)
    knee = hip + along * axis + np.sqrt(THIGH**2 - along**2) * forward
    points[:, INDEX[f"{side}_hip"]] = hip
    points[:, INDEX[f"{side}_knee"]] = knee
    points[:, INDEX[f"{side}_ankle"]] = ankle
    points[:, INDEX[f"{side}_foot"]] = ankle + heading @ ANKLE_TO_TOE


def _leg(pelvis: Array, pose: Pose, i: int) -> tuple[Array, Array, Array, Array]:
    """Hip (T, 3), vector from it to the ankle (T, 3), frames of the foot flat and as it is."""
    hip = pose.pelvis + pelvis @ _HIPS[i]
    flat = about(2, pose.foot_yaw[:, i])
    heading = flat @ about(1, pose.heel_rise[:, i])
    return hip, pose.foot[:, i] + (flat - heading) @ ANKLE_TO_TOE - hip, flat, heading


def leg_vectors(pose: Pose) -> Array:
    """(T, 2, 3) from each hip to where its ankle is wanted, whether in reach or not [m]."""
    pelvis = rotation(pose.pelvis_euler)
    return np.stack([_leg(pelvis, pose, i)[1] for i in range(2)], axis=1)
