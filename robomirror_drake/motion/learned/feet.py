"""Make a generated body whole: bones of constant length, and feet that stand where they stand.

Source: L. Kovar, J. Schreiner, M. Gleicher, "Footskate Cleanup for Motion Capture Editing",
SCA 2002: feet are held in place while they are planted, what that moves them by fades out in
between, and the legs follow by inverse kinematics.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.motion.humanml_features import with_lengths
from robomirror_drake.motion.skeleton import INDEX

PLANTED_HEIGHT = 0.06
"""Highest toe of a planted foot above the lowest of the motion [m]."""
PLANTED_SPEED = 0.35
"""Fastest toe of a planted foot, along the floor [m/s]."""

_LEGS = np.array([[INDEX[f"{side}_{j}"] for j in ("hip", "knee", "ankle", "foot")]
                  for side in ("left", "right")])  # fmt: skip
_SHORTEST_STANCE = 3  # frames
_BODY_SMOOTHING = 0.25  # of the part that moves the whole body, standard deviation [s]


def planted(positions: Array, fps: float) -> BoolArray:
    """(…, T, 2) whether the left and the right toe of (…, T, 22, 3), y up, stand."""
    toes = positions[..., _LEGS[:, 3], :]
    speed = np.linalg.norm(np.gradient(toes[..., [0, 2]], axis=-3), axis=-1) * fps
    height = toes[..., 1] - toes[..., 1].min(axis=(-2, -1), keepdims=True)
    contact: BoolArray = (height < PLANTED_HEIGHT) & (speed < PLANTED_SPEED)
    return contact


def make_whole(positions: Array, lengths: Array, fps: float) -> Array:
    """Positions (B, T, 22, 3), y up, on bones of ``lengths`` (21,) [m], feet that do not skate.

    Feet come to rest at the mean place of each stance. Half of what both need together moves the
    whole body, smoothly; the legs make up for the rest.
    """
    contact = planted(positions, fps)
    toes = positions[:, :, _LEGS[:, 3]]
    shift = np.zeros_like(toes)
    rows = toes[..., [0, 2]].transpose(0, 2, 1, 3).reshape(-1, positions.shape[1], 2)
    shift[..., [0, 2]] = (
        _to_anchors(np.ascontiguousarray(rows), _rows(contact), _SHORTEST_STANCE)
        .reshape(len(positions), 2, -1, 2)
        .transpose(0, 2, 1, 3)
    )
    body = gaussian_filter1d(shift.mean(axis=2), _BODY_SMOOTHING * fps, axis=1, mode="nearest")
    ankles = positions[:, :, _LEGS[:, 2]] + shift
    feet = toes + shift
    whole = with_lengths(positions, lengths) + body[:, :, None]
    _reach(whole, ankles, feet - ankles, lengths)
    return whole


def _rows(contact: BoolArray) -> BoolArray:
    rows: BoolArray = np.ascontiguousarray(contact.transpose(0, 2, 1)).reshape(-1, contact.shape[1])
    return rows


@numba.njit(cache=True)
def _to_anchors(feet: Array, contact: BoolArray, shortest: int) -> Array:
    """(R, T, 2) what brings each foot (R, T, 2) to its stance's mean place; faded in between."""
    shift = np.zeros_like(feet)
    rows, frames, _ = feet.shape
    for r in range(rows):
        before = -1  # last frame of the stance before
        t = 0
        while t < frames:
            if not contact[r, t]:
                t += 1
                continue
            end = t
            while end < frames and contact[r, end]:
                end += 1
            if end - t >= shortest:
                for k in range(2):
                    anchor = feet[r, t:end, k].mean()
                    shift[r, t:end, k] = anchor - feet[r, t:end, k]
                    for s in range(before + 1, t):
                        u = (s - before) / (t - before)
                        u = u * u * (3.0 - 2.0 * u) if before >= 0 else 1.0
                        start = shift[r, before, k] if before >= 0 else 0.0
                        shift[r, s, k] = (1.0 - u) * start + u * shift[r, t, k]
                before = end - 1
            t = end
        for s in range(before + 1, frames):
            if before >= 0:
                shift[r, s] = shift[r, before]
    return shift


def _reach(body: Array, ankles: Array, feet: Array, lengths: Array) -> None:
    """Bring the ankles of bodies (B, T, 22, 3) to (B, T, 2, 3), knees on the side where they are.

    Feet (B, T, 2, 3), from ankle to toe, keep their direction and get their length.
    """
    hip, knee, ankle, toe = _LEGS.T
    thigh, shank, foot = (lengths[joint - 1][:, None] for joint in (knee, ankle, toe))
    reach = ankles - body[:, :, hip]
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    axis = reach / distance
    distance = np.clip(distance, np.abs(thigh - shank) + 1e-3, 0.999 * (thigh + shank))
    bend = body[:, :, knee] - body[:, :, hip]
    bend -= (bend * axis).sum(axis=-1, keepdims=True) * axis
    bend /= np.maximum(np.linalg.norm(bend, axis=-1, keepdims=True), 1e-9)
    along = (thigh**2 - shank**2 + distance**2) / (2.0 * distance)
    side = np.sqrt(np.maximum(thigh**2 - along**2, 0.0))
    body[:, :, knee] = body[:, :, hip] + along * axis + side * bend
    body[:, :, ankle] = body[:, :, hip] + distance * axis
    direction = feet / np.linalg.norm(feet, axis=-1, keepdims=True)
    body[:, :, toe] = body[:, :, ankle] + foot * direction
