"""Where a robot's feet stand, and when, for a human whose feet slide, pivot and roll."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d
from scipy.spatial import ConvexHull

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.contact_schedule import runs

REACH = 0.06
"""How far a human foot may stray from its foothold where another foot stands [m]."""

LANDED = 0.03
"""How near its foothold a human foot has to be to have landed, or not to have left [m]."""

LOW, LOW_ALONE = 0.07, 0.16
"""To what height a heel or toe hangs low, also where no other foot stands [m]."""

TURNS = 0.6
"""By how much a human foot has to turn while it stands for the robot's to turn with it [rad]."""

_LONG = 9  # samples from which on a heel or toe hangs low for long
_GRACE = 2  # by how much contacts may begin later after a flight, or end earlier [samples]
_STEADY = 3.0  # standard deviation of the filter on such a foot's heading [samples]
_CUT, _SHORTEST = 2, 3  # samples on both sides of a cut that go, and that a foothold needs


def footholds(
    soles: Array, ends: BoolArray, corners: Array, facing: Array, turnable: Array
) -> tuple[BoolArray, Array]:
    """Where the feet stand, and when.

    A foot stands still, or pivots with the human's about the middle of what stands of it. One
    that strays from there all the same lets go in between, if the other stands meanwhile.

    Args:
        soles: (T, 2, 4, 3) corners of the soles as the human's feet have them [m].
        ends: (T, 2, 4) which of them touch the floor.
        corners: (2, 4, 3) corners in the frame of a foot [m].
        facing: (T,) heading of the pelvis [rad].
        turnable: (2, 2) how far the robot's feet turn from there, rightwards and leftwards [rad].

    Returns:
        (T, 2, 4) which corners stand, (T, 2, 4, 3) and where; zero where the foot does not.
    """
    contact, anchor, miss = _settled(soles, ends), np.zeros(soles.shape), np.zeros(ends.shape)
    speed = np.linalg.norm(np.gradient(soles[..., :2], axis=0), axis=-1)
    for f in (0, 1):
        todo = runs(np.asarray(ends[:, f].any(axis=1)))
        while todo:
            start, stop = todo.pop()
            run = slice(start, stop)
            stands, shared = ends[run, f], np.asarray(contact[run, 1 - f].any(axis=1))
            reach = facing[run, None] + turnable[f]
            at = _foothold(soles[run, f], stands, corners[f], reach)
            stray = np.linalg.norm(soles[run, f, :, :2] - at[..., :2], axis=-1)
            far = np.where(shared, (stray * stands).max(axis=1) > REACH, False)
            if stop - start < _SHORTEST and shared.all():
                contact[run, f] = False
            elif far.any():
                quick = np.where(shared, (speed[run, f] * stands).max(axis=1), -1.0)
                cut = start + int(quick.argmax())
                first, last = max(start, cut - _CUT), min(stop, cut + _CUT + 1)
                contact[first:last, f] &= ~shared[first - start : last - start, None]
                left = runs(np.asarray(contact[run, f].any(axis=1)))
                todo += [(start + a, start + b) for a, b in left]
            else:
                height = (soles[run, f, :, 2] * stands).sum(axis=1) / stands.sum(axis=1)
                miss[run, f] = np.hypot(stray, height[:, None]) * stands
                anchor[run, f] = at
    return let_go(contact, miss, LANDED, _GRACE), anchor


def _settled(soles: Array, ends: BoolArray) -> BoolArray:
    """Contacts in which a foot whose heel or toe hangs low, and for long, is down altogether.

    A robot balances badly on an edge, so that this goes for higher ones where it has no other.
    """
    contact, feet = ends.copy(), np.asarray(ends.any(axis=2))
    for f in (0, 1):
        low = soles[:, f, :, 2].max(axis=1) < np.where(feet[:, 1 - f], LOW, LOW_ALONE)
        for start, stop in runs(feet[:, f] & ~ends[:, f].all(axis=1) & low):
            if stop - start >= _LONG:
                contact[start:stop, f] = True
    return contact


def _foothold(sole: Array, stands: BoolArray, corners: Array, reach: Array) -> Array:
    """(T, 4, 3) corners flat on the floor, nearest to where those that stand (T, 4, 3) are."""
    # The heading is best seen where the foot is flat, and of little worth on its toe.
    weight = np.where(stands.all(axis=1), 1.0, 0.05)
    yaw = np.unwrap(heading(sole))
    around = (yaw - reach.mean(axis=1)).mean()  # the two may have been counted from other turns
    reach = reach + 2.0 * np.pi * np.round(around / (2.0 * np.pi))
    turned = held(yaw, reach, weight @ yaw / weight.sum())
    turned = gaussian_filter1d(turned, _STEADY, mode="nearest")
    flat = pivot(turned, stands, corners)
    share = weight[:, None] * stands
    center = np.einsum("tc,tci->i", share, sole[..., :2] - flat) / share.sum()
    return np.concatenate([flat + center, np.zeros((*flat.shape[:2], 1))], axis=-1)


def held(yaw: Array, reach: Array, at: float) -> Array:
    """(T,) headings of a foot that turns no more than it has to.

    Args:
        yaw: (T,) what they keep to within TURNS [rad].
        reach: (T, 2) least and greatest that the leg can give it, which goes before [rad].
        at: The first one, where it is near enough [rad].
    """
    low, high = np.minimum(reach[:, 0], yaw), np.maximum(reach[:, 1], yaw)
    least, most = np.clip(np.stack([yaw - TURNS, yaw + TURNS]), low, high)
    kept = np.empty_like(yaw)
    for t in range(len(yaw)):
        at = min(max(at, least[t]), most[t])
        kept[t] = at
    return kept


def heading(sole: Array) -> Array:
    """(T,) yaw of soles with corners (T, 4, 3), seen from their lateral axes [rad]."""
    across = (sole[:, [0, 3], :2] - sole[:, [1, 2], :2]).sum(axis=1)
    return np.asarray(np.arctan2(-across[:, 0], across[:, 1]))


def planar_rotation(yaw: Array | float) -> Array:
    """(…, 2, 2) rotations about the vertical axis."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def pivot(yaw: Array, stands: BoolArray, corners: Array) -> Array:
    """(T, 4, 2) corners of a flat foot that turns about the middle of those that stand [m].

    Args:
        yaw: (T,) heading [rad].
        stands: (T, 4) which corners stand; about their mean the foot turns to its next sample.
        corners: (4, 3) corners in the frame of the foot [m].
    """
    turn = planar_rotation(yaw)
    both = stands[1:] & stands[:-1]
    both = np.where(both.any(axis=1, keepdims=True), both, stands[:-1])
    middle = both @ corners[:, :2] / np.maximum(both.sum(axis=1, keepdims=True), 1)
    step = np.einsum("tij,tj->ti", turn[:-1] - turn[1:], middle)
    moved = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    return np.asarray(corners[:, :2] @ np.swapaxes(turn, 1, 2) + moved[:, None])


def let_go(contact: BoolArray, miss: Array, most: float, grace: int = 0) -> BoolArray:
    """Ends contacts earlier, and begins them later, by the samples that miss their foothold.

    Samples on which nothing else stands are kept, lest the robot fly, but for a few of them
    next to a flight that there is already. So is what stands at the first or the last sample.

    Args:
        contact: (T, 2, n) which parts of the feet stand.
        miss: (T, 2, n) how far they are from their foothold [m].
        most: How far is tolerated [m].
        grace: By how many samples a flight may begin earlier, and end later.

    Returns:
        (T, 2, n) the contacts that are left.
    """
    left, last = contact.copy(), len(contact)
    flight = np.pad(~contact.any(axis=(1, 2)), 1)
    beside = binary_dilation(flight, iterations=grace)[1:-1] if grace else flight[1:-1]
    for f, part in np.ndindex(contact.shape[1:]):
        for start, stop in runs(left[:, f, part]):
            shared = left[start:stop, 1 - f].any(axis=1)
            off = (miss[start:stop, f, part] > most) & (shared | beside[start:stop])
            late = np.logical_and.accumulate(off) & (start > 0)
            early = np.logical_and.accumulate(off[::-1])[::-1] & (stop < last)
            left[start:stop, f, part] &= ~(late | early)
    return left


def unit(x: Array) -> Array:
    """(…, n) vectors of length 1, zero where there is no length."""
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9))


def support_planes(anchor: Array, ends: BoolArray, margin: float) -> Array:
    """Support polygons: the hull of the corners that stand, shrunk by a margin.

    Args:
        anchor: (T, 2, 4, 3) where corners stand [m].
        ends: (T, 2, 4) which of them do.
        margin: By how much they are shrunk [m].

    Returns:
        (T, 8, 3) half planes n · x ≤ b as (n_x, n_y, b), padded with zeros, which hold always.
    """
    support = np.zeros((len(anchor), 8, 3))
    keys = np.concatenate([anchor[..., :2].reshape(len(anchor), -1), ends.reshape(-1, 8)], axis=1)
    changes = np.flatnonzero(np.any(np.diff(keys, axis=0) != 0.0, axis=1)) + 1
    for start, stop in zip([0, *changes], [*changes, len(anchor)], strict=True):
        corners = anchor[start, ends[start], :2]
        if len(corners) >= 4:
            planes = np.unique(ConvexHull(corners).equations.round(9), axis=0)
            support[start:stop, : len(planes)] = planes * [1, 1, -1] - [0, 0, margin]
    return support
