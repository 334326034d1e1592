"""Where a robot's feet stand, and when, for a human whose feet slide, pivot and roll."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from robomirror_drake.messages import Array, BoolArray

REACH, REACH_ALONE = 0.06, 0.12
"""How far a human foot may stray from its foothold, also where no other foot stands [m]."""

LANDED = 0.025
"""How near its foothold a human foot has to be to have landed, or not to have left [m]."""

_CUT, _SHORTEST = 2, 3  # samples on both sides of a cut that go, and that a foothold needs


def footholds(soles: Array, ends: BoolArray, corners: Array) -> tuple[BoolArray, Array]:
    """Where the feet stand, and when: a foot that pivots or slides on must let go between.

    Args:
        soles: (T, 2, 4, 3) corners of the soles as the human's feet have them [m].
        ends: (T, 2, 4) which of them touch the floor.
        corners: (2, 4, 3) corners in the frame of a foot [m].

    Returns:
        (T, 2, 4) which corners stand, (T, 2, 4, 3) and where; zero where the foot does not.
    """
    contact, anchor, miss = ends.copy(), np.zeros(soles.shape), np.zeros(ends.shape)
    speed = np.linalg.norm(np.gradient(soles[..., :2], axis=0), axis=-1)
    for f in (0, 1):
        todo = phases(np.asarray(ends[:, f].any(axis=1)))
        while todo:
            start, stop = todo.pop()
            run = slice(start, stop)
            stands = contact[run, f]
            at = _foothold(soles[run, f], stands, corners[f])
            stray = np.linalg.norm(soles[run, f, :, :2] - at[:, :2], axis=-1)
            reach = np.where(contact[run, 1 - f].any(axis=1), REACH, REACH_ALONE)
            if stop - start < _SHORTEST:
                contact[run, f] = False
            elif np.any((stray * stands).max(axis=1) > reach):
                cut = start + int((speed[run, f] * stands).max(axis=1).argmax())
                first, last = max(start, cut - _CUT), min(stop, cut + _CUT + 1)
                contact[first:last, f] = False
                todo += [(a, b) for a, b in ((start, first), (last, stop)) if b > a]
            else:
                miss[run, f] = stray
                anchor[run, f] = at
    return let_go(contact, miss, LANDED), anchor


def _foothold(sole: Array, stands: BoolArray, corners: Array) -> Array:
    """(4, 3) corners flat on the floor, nearest to where those that stand (T, 4, 3) are."""
    # The heading is best seen where the foot is flat, and of little worth on its toe.
    weight = np.where(stands.all(axis=1), 1.0, 0.05)
    forward = weight @ unit((sole[:, 0] - sole[:, 3])[:, :2])
    forward /= max(float(np.linalg.norm(forward)), 1e-9)
    turn = np.array([[forward[0], -forward[1]], [forward[1], forward[0]]])
    flat = corners[:, :2] @ turn.T
    share = weight[:, None] * stands
    center = np.einsum("tc,tci->i", share, sole[..., :2] - flat) / share.sum()
    return np.hstack([flat + center, np.zeros((4, 1))])


DIRE = 3.0
"""How many times worse a miss must be where letting go would leave the robot without a foot."""


def let_go(contact: BoolArray, miss: Array, most: float) -> BoolArray:
    """Ends contacts earlier, and begins them later, by the samples that miss their foothold.

    Where one foot takes over from the other, a sample on which nothing else stands must
    miss by more than :data:`DIRE` times as much.

    Args:
        contact: (T, 2, n) which parts of the feet stand.
        miss: (T, 2, n) how far they are from their foothold [m].
        most: How far is tolerated [m].

    Returns:
        (T, 2, n) the contacts that are left.
    """
    pieces = np.logical_and.accumulate
    feet, left = np.asarray(contact.any(axis=2)), contact.copy()
    for f, part in np.ndindex(contact.shape[1:]):
        other = feet[:, 1 - f]
        for start, stop in phases(contact[:, f, part]):
            wrong, dire = (miss[start:stop, f, part] > limit for limit in (most, DIRE * most))
            shared = other[start:stop]
            lands = wrong & (shared | ~other[max(start - 1, 0)]) | dire
            lifts = wrong & (shared | ~other[min(stop, len(other) - 1)]) | dire
            left[start:stop, f, part] = ~(pieces(lands) | pieces(lifts[::-1])[::-1])
    return left


def phases(active: BoolArray) -> list[tuple[int, int]]:
    """Maximal runs of True as (start, stop)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def unit(x: Array) -> Array:
    """(…, n) vectors of length 1, zero where there is no length."""
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9))


def support_planes(anchor: Array, ends: BoolArray, margin: float) -> Array:
    """(T, 8, 3) half planes n · x ≤ b of the hull of the standing corners, shrunk by a margin."""
    support = np.zeros((len(anchor), 8, 3))
    keys = np.concatenate([anchor[..., :2].reshape(len(anchor), -1), ends.reshape(-1, 8)], axis=1)
    changes = np.flatnonzero(np.any(np.diff(keys, axis=0) != 0.0, axis=1)) + 1
    for start, stop in zip([0, *changes], [*changes, len(anchor)], strict=True):
        corners = anchor[start, ends[start], :2]
        if len(corners) >= 4:
            planes = np.unique(ConvexHull(corners).equations.round(9), axis=0)
            support[start:stop, : len(planes)] = planes * [1, 1, -1] - [0, 0, margin]
    return support
