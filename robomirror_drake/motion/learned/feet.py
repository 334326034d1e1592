"""Make a generated body whole: bones of constant length, and feet that stand where they stand.

Source: L. Kovar, J. Schreiner, M. Gleicher, "Footskate Cleanup for Motion Capture Editing",
SCA 2002: feet are held in place while they are planted, what that moves them by fades out in
between, and the legs follow by inverse kinematics.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.motion.bones import LEGS, bring_ankles
from robomirror_drake.motion.humanml_features import with_lengths

PLANTED_HEIGHT = 0.06
"""Highest toe of a planted foot above the floor of the motion [m]."""
PLANTED_SPEED = 0.35
"""Fastest toe of a planted foot, along the floor [m/s]."""
CLEARANCE = 0.06
"""Least height of a toe that moves faster than :data:`CLEAR_SPEED` [m]."""
CLEAR_SPEED = 0.5
"""Speed along the floor that only a lifted foot has [m/s]."""

_FLOOR_PERCENTILE = 5.0  # of the toes' heights
_SHORTEST_STANCE, _LONGEST_GAP = 0.15, 0.05  # [s]
_LIFT_SMOOTHING = 0.04  # of what lifts a moving foot, standard deviation [s]
_BODY_SMOOTHING = 0.25  # of the part that moves the whole body, standard deviation [s]


def make_whole(positions: Array, lengths: Array, fps: float) -> Array:
    """Positions (B, T, 22, 3), y up, on bones of ``lengths`` (21,) [m], feet that do not skate.

    Feet come to rest at the mean place of each stance, and clear the floor where they move. Half
    of what both need together moves the whole body along the floor, smoothly; the legs do the
    rest. The floor of each motion comes to y = 0.
    """
    toes = positions[:, :, LEGS[:, 3]]
    floor = np.percentile(toes[..., 1], _FLOOR_PERCENTILE, axis=(1, 2))
    positions = positions - floor[:, None, None, None] * [0.0, 1.0, 0.0]
    toes = positions[:, :, LEGS[:, 3]]
    speed = np.linalg.norm(np.gradient(toes[..., [0, 2]], axis=1), axis=-1) * fps
    contact = (toes[..., 1] < PLANTED_HEIGHT) & (speed < PLANTED_SPEED)
    frames = positions.shape[1]
    shift = _to_anchors(
        np.ascontiguousarray(toes.transpose(0, 2, 1, 3)).reshape(-1, frames, 3),
        np.ascontiguousarray(contact.transpose(0, 2, 1)).reshape(-1, frames),
        round(_SHORTEST_STANCE * fps),
        round(_LONGEST_GAP * fps),
    )
    shift = shift.reshape(len(positions), 2, frames, 3).transpose(0, 2, 1, 3)
    shift[..., 1] += _lift(toes + shift, fps)
    along = shift.mean(axis=2) * [1.0, 0.0, 1.0]
    body = gaussian_filter1d(along, _BODY_SMOOTHING * fps, axis=1, mode="nearest")
    ankles = positions[:, :, LEGS[:, 2]] + shift
    whole = with_lengths(positions, lengths) + body[:, :, None]
    feet = toes + shift - ankles  # keep their direction and get their length
    thigh, shank, foot = (lengths[joint - 1][:, None] for joint in LEGS.T[1:])
    feet = foot * (feet / np.linalg.norm(feet, axis=-1, keepdims=True))
    bring_ankles(whole, LEGS, ankles, feet, thigh, shank)
    return whole


def _lift(toes: Array, fps: float) -> Array:
    """(B, T, 2) what brings toes (B, T, 2, 3) that move along the floor to their clearance [m]."""
    step = np.linalg.norm(np.diff(toes[..., [0, 2]], axis=1), axis=-1) * fps
    speed = np.zeros(toes.shape[:3])
    speed[:, 1:] = step
    speed[:, :-1] = np.maximum(speed[:, :-1], step)
    wanted = CLEARANCE * np.clip(2.0 * speed / CLEAR_SPEED - 1.0, 0.0, 1.0)
    missing = maximum_filter1d(np.maximum(wanted - toes[..., 1], 0.0), 3, axis=1)
    lift: Array = gaussian_filter1d(missing, _LIFT_SMOOTHING * fps, axis=1, mode="nearest")
    return lift


@numba.njit(cache=True)
def _to_anchors(feet: Array, contact: BoolArray, shortest: int, gap: int) -> Array:
    """(R, T, 3) what brings each foot (R, T, 3) to its stances' mean places.

    Between two stances it fades from one to the other. A stance is ``shortest`` frames at least,
    and gaps of up to ``gap`` frames are part of it.
    """
    shift = np.zeros_like(feet)
    for r in range(len(feet)):
        last = -1  # frame of the stance before, its last one
        t = 0
        while t < feet.shape[1]:
            end = _stance_end(contact[r], t, gap)
            if end - t < shortest:
                t = max(end, t + 1)
                continue
            for k in range(3):
                shift[r, t:end, k] = feet[r, t:end, k].mean() - feet[r, t:end, k]
            if last < 0:
                shift[r, :t] = shift[r, t]
            else:
                for s in range(last + 1, t):
                    u = (s - last) / (t - last)
                    u = u * u * (3.0 - 2.0 * u)
                    shift[r, s] = (1.0 - u) * shift[r, last] + u * shift[r, t]
            last = end - 1
            t = end
        if last >= 0:
            shift[r, last + 1 :] = shift[r, last]
    return shift


@numba.njit(cache=True)
def _stance_end(contact: BoolArray, start: int, gap: int) -> int:
    """Frame after the stance that begins at ``start``, which is none where it is there already."""
    end = start
    t = start
    while t < len(contact) and t - end <= gap:
        if contact[t]:
            end = t + 1
        elif end == start:
            return start
        t += 1
    return end
