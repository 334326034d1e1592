"""Recorded motions as actions: on the body of the parametric ones, from neutral stance and back."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.body import SHANK, THIGH
from robomirror_drake.motion.bones import (
    LEGS,
    along_bones,
    bone_lengths,
    bones,
    bring_ankles,
    mirrored,
)
from robomirror_drake.motion.composer.cue import Cue
from robomirror_drake.motion.composer.perform import perform, upper_envelope
from robomirror_drake.motion.composer.score import MINIMUM_JERK, Score
from robomirror_drake.motion.ground import clearance, face_forward, ground, heading
from robomirror_drake.motion.mocap import load_clip

APPROACH = 1.2
"""Time from neutral stance to the first frame, and from the last back [s]."""
EASE = 0.4
"""Time over which the recording gathers speed from rest, and loses it [s]."""
STEP_LIFT = 0.06
"""How high the free foot is lifted between neutral stance and the recording [m]."""
FLOOR_WINDOW = 0.3
"""Time over which the body makes way where a recorded foot is below the floor [s]."""


def play(name: str, cue: Cue, fps: float) -> Array:
    """Joint positions (T, 22, 3) [m] of a recorded clip, at rest in neutral stance at both ends.

    Starts facing +x with the pelvis at x = y = 0. Tempo and mirroring follow the cue; the size of
    a recording is what it is.
    """
    motion = _clip(name)
    positions = _eased(motion.positions, motion.fps * cue.tempo, fps)
    if cue.style.mirrored:
        positions = mirrored(positions)
    positions = ground(_on_our_bones(positions))
    there = _approach(positions[0], fps)
    back = _approach(positions[-1], fps)[::-1]
    rest = 2 * round(0.5 * FLOOR_WINDOW * fps) + 1
    whole = np.concatenate([there, positions[1:], back[1:]])
    whole = np.pad(whole, ((rest, rest), (0, 0), (0, 0)), mode="edge")
    below = np.maximum(-clearance(whole).min(axis=(1, 2)), 0.0)
    whole[..., 2] += upper_envelope(below, rest)[:, None]
    return face_forward(replace(motion, positions=whole, fps=fps)).positions


@cache
def _clip(name: str) -> HumanMotion:
    """A clip that faces +x; candidates of one command share it."""
    return face_forward(load_clip(name))


@cache
def neutral(fps: float) -> Array:
    """(22, 3) the neutral stance [m], facing +x."""
    frame: Array = perform(Score(now=1.0), fps)[0]
    return frame


def _eased(positions: Array, recorded_fps: float, fps: float) -> Array:
    """The clip sampled at ``fps`` from rest to rest: its clock starts and stops smoothly."""
    length = (len(positions) - 1) / recorded_fps
    ease = min(EASE, 0.5 * length)
    # The integral of a smooth rise of the rate from 0 to 1 takes half the time it lasts.
    t = np.arange(round((length + ease) * fps) + 1) / fps
    u = np.clip(t / ease, 0.0, 1.0)
    v = np.clip((length + ease - t) / ease, 0.0, 1.0)
    begin = ease * (u**4 * (2.5 - 3.0 * u + u**2)) + np.maximum(t - ease, 0.0)
    left = ease * (v**4 * (2.5 - 3.0 * v + v**2))
    clock = np.where(t < length, begin, length - left)
    spline = CubicSpline(np.arange(len(positions)) / recorded_fps, positions, axis=0)
    eased: Array = spline(np.clip(clock, 0.0, length))
    return eased


def _directions(positions: Array) -> Array:
    """(..., 21, 3) unit vector of each bone."""
    vectors = bones(positions)
    unit: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def _chain(pelvis: Array, directions: Array) -> Array:
    """(..., 22, 3) joints of our body with its bones along ``directions`` (..., 21, 3)."""
    return along_bones(pelvis, directions * bone_lengths(neutral(60.0))[:, None])


def _on_our_bones(positions: Array) -> Array:
    return _chain(positions[:, 0], _directions(positions))


def _approach(frame: Array, fps: float) -> Array:
    """(T, 22, 3) from neutral stance to a frame: on one foot, while the other takes a step.

    The foot that is lower in the frame stays where it is, and that is where the neutral stance
    has it. Bones turn on great circles in minimum-jerk time.
    """
    u = np.arange(round(APPROACH * fps) + 1) / round(APPROACH * fps)
    s = np.asarray(np.polynomial.polynomial.polyval(u, MINIMUM_JERK), dtype=np.float64)
    yaw = heading(frame[None])[0]
    c, sn = np.cos(yaw), np.sin(yaw)
    start = neutral(fps) @ np.array([[c, sn, 0.0], [-sn, c, 0.0], [0.0, 0.0, 1.0]])
    foot = int(clearance(frame[None])[0].mean(axis=1).argmin())
    leg = LEGS[[1 - foot]]
    stance, free, toe = LEGS[foot, 2], leg[0, 2], leg[0, 3]
    start = start + (frame[stance] - start[stance]) * [1.0, 1.0, 0.0]
    directions = _slerp(_directions(start), _directions(frame), s)
    points = _chain(np.zeros((len(s), 3)), directions)
    ankle = start[stance] + s[:, None] * (frame[stance] - start[stance])
    points += (ankle - points[:, stance])[:, None]
    # Up before across: the step's way over the floor is done in the middle of the time.
    across = np.polynomial.polynomial.polyval(np.clip((u - 0.2) / 0.6, 0.0, 1.0), MINIMUM_JERK)
    target = start[free] + np.column_stack([across, across, s]) * (frame[free] - start[free])
    target[:, 2] += STEP_LIFT * 64.0 * (u * (1.0 - u)) ** 3
    bring_ankles(
        points, leg, target[:, None], (points[:, toe] - points[:, free])[:, None], THIGH, SHANK
    )
    return points


def _slerp(start: Array, end: Array, s: Array) -> Array:
    """(T, 21, 3) unit vectors on the great circles from start to end (21, 3)."""
    angle = np.arccos(np.clip(np.sum(start * end, axis=-1), -1.0, 1.0))[None, :, None]
    sine = np.maximum(np.sin(angle), 1e-9)
    t = s[:, None, None]
    turned = (np.sin((1.0 - t) * angle) * start + np.sin(t * angle) * end) / sine
    between = np.where(angle > 1e-6, turned, start)
    unit: Array = between / np.linalg.norm(between, axis=-1, keepdims=True)
    return unit
