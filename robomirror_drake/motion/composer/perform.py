"""A score becomes joint positions: the body follows its feet, its balance and its reach."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from robomirror_drake.messages import Array
from robomirror_drake.motion.body import (
    HIP_DROP,
    LEG,
    MASS_WEIGHTS,
    MAX_LEG,
    SIDES,
    Pose,
    center_of_mass,
    joint_positions,
    leg_vectors,
    move_pelvis,
)
from robomirror_drake.motion.composer.balance import angular_moment, center_of_mass_path
from robomirror_drake.motion.composer.score import Score
from robomirror_drake.motion.ground import ANKLE_HEIGHT

NEUTRAL_PELVIS_HEIGHT = ANKLE_HEIGHT + 0.95 * LEG + HIP_DROP
"""Height of the pelvis in neutral stance [m]."""
SOLE_CENTER = np.array([0.038, 0.012])
"""Where a foot is loaded: ahead of the ankle, and inward of it [m]."""
REACH_WINDOW = 0.5
"""Time over which the pelvis gets out of the way of a leg that would be too long [s]."""
LOW_SWING = 0.15
"""A foot lifted higher than this does not draw the pelvis down [m]."""
PASSES = 8
"""Passes at most."""
SETTLED = 3e-4
"""Change of the pelvis from one pass to the next at which they end [m]."""


def perform(score: Score, fps: float) -> Array:
    """Joint positions (T, 22, 3) [m] of a score, starting with the pelvis at x = y = 0.

    The centre of mass follows :func:`center_of_mass_path` under the load that the score puts on
    each foot; the pelvis is placed so that the posed body has its centre of mass there, and sinks
    where a leg could not reach its foot. Each depends on the others a little, hence the passes.
    """
    time = np.arange(round(score.now * fps) + 1) / fps
    channel = score.sample(time)
    foot, foot_yaw = _feet(channel)
    zmp = _zmp_reference(foot, foot_yaw, channel["load"])
    pelvis_euler = _euler(channel, "pelvis")
    pelvis_euler[:, 0] += foot_yaw.mean(axis=1)
    pose = Pose(
        pelvis=np.column_stack([zmp, NEUTRAL_PELVIS_HEIGHT + channel["pelvis_z"]]),
        pelvis_euler=pelvis_euler,
        chest_euler=_euler(channel, "chest"),
        head_euler=_euler(channel, "head"),
        foot=foot,
        foot_yaw=foot_yaw,
        heel_rise=np.stack([channel[f"{s}_foot_heel"] for s in SIDES], axis=1),
        arm=np.stack(
            [
                np.stack(
                    [channel[f"{s}_{c}"] for c in ("flexion", "abduction", "rotation", "elbow")]
                )
                for s in SIDES
            ]
        ).transpose(2, 0, 1),
    )
    height = pose.pelvis[:, 2].copy()
    posed = joint_positions(pose)
    for _ in range(PASSES):
        before = pose.pelvis.copy()
        com = center_of_mass(posed)
        angular = angular_moment(posed, MASS_WEIGHTS, 1.0 / fps)
        offset = com - pose.pelvis
        pose.pelvis[:, 2] = height - channel["ballistic"] * (offset[:, 2] - offset[0, 2])
        pose.pelvis[:, 2] -= _sink(pose, fps)
        com_height = pose.pelvis[:, 2] + offset[:, 2]
        path = center_of_mass_path(zmp, com_height, angular, 1.0 / fps)
        pose.pelvis[:, :2] = path - offset[:, :2]
        move_pelvis(posed, pose, pose.pelvis - before)
        if np.abs(pose.pelvis - before).max() < SETTLED:
            break
    posed[..., :2] -= posed[0, 0, :2]
    return posed


def _euler(channel: dict[str, Array], part: str) -> Array:
    """(T, 3) yaw, pitch, roll."""
    return np.stack([channel[f"{part}_{c}"] for c in ("yaw", "pitch", "roll")], axis=1)


def _feet(channel: dict[str, Array]) -> tuple[Array, Array]:
    """(T, 2, 3) ankles with the heel down, (T, 2) headings."""
    foot = np.stack(
        [np.stack([channel[f"{s}_foot_{c}"] for c in "xyz"], axis=1) for s in SIDES], axis=1
    )
    foot[..., 2] += ANKLE_HEIGHT
    return foot, np.stack([channel[f"{s}_foot_yaw"] for s in SIDES], axis=1)


def _zmp_reference(foot: Array, yaw: Array, left_load: Array) -> Array:
    """(T, 2) point between the sole centres that the load of the feet stands for."""
    inward = SOLE_CENTER[1] * np.array([-1.0, 1.0])
    c, s = np.cos(yaw), np.sin(yaw)
    center = foot[..., :2] + np.stack(
        [c * SOLE_CENTER[0] - s * inward, s * SOLE_CENTER[0] + c * inward], axis=-1
    )
    share = np.stack([left_load, 1.0 - left_load], axis=1)
    point: Array = np.einsum("ts,tsk->tk", share, center)
    return point


def _sink(pose: Pose, fps: float) -> Array:
    """(T,) smooth lowering of the pelvis that brings both ankles within reach [m]."""
    reach = leg_vectors(pose)
    across = np.sum(reach[..., :2] ** 2, axis=-1)
    allowed = np.sqrt(np.maximum(MAX_LEG**2 - across, 0.0))
    on_floor = pose.foot[..., 2] < ANKLE_HEIGHT + LOW_SWING
    need: Array = np.where(on_floor, np.maximum(-reach[..., 2] - allowed, 0.0), 0.0).max(axis=1)
    if not need.any():
        return need
    return upper_envelope(need, 2 * round(0.5 * REACH_WINDOW * fps) + 1)


def upper_envelope(values: Array, frames: int) -> Array:
    """(T,) smooth curve on or above ``values`` (T,): sliding maximum, then a window as long."""
    highest = maximum_filter1d(values, frames, mode="nearest")
    # A Hann window, as scipy.signal has it, whose import takes a third of a second.
    window = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, frames + 2)[1:-1])
    padded = np.pad(highest, frames // 2, mode="edge")
    smooth: Array = np.convolve(padded, window / window.sum(), mode="valid")
    return smooth
