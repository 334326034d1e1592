"""When the feet stand: contact schedules mended, extended and read between their frames."""

from __future__ import annotations

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.contact_schedule import runs

_SAME_PLACE = 0.05  # a foot that comes down nearer than this has not stepped [m]
_FALLING = -5.0  # a body without contact that accelerates downwards more is in flight [m/s²],
_OFF_GROUND = 0.03  # and so is one whose feet rise above this [m]


def steady(contact: BoolArray, corners: Array, fall: Array, shortest: int) -> BoolArray:
    """The schedule without what no robot could do.

    * A body that neither falls nor leaves the ground does not fly: the foot stands that stands
      before or after, or both do, or else the lower one.
    * Support passes from one foot to the other while both stand.
    * A foot that leaves the ground for less than ``shortest`` frames, and comes down where it
      was, stays on it; so does one whose swing is cut that short by either end.
    * A foot that touches the ground for less, while the other stands, does not.

    Args:
        contact: (T, 2, 4) schedule.
        corners: (T, 2, 4, 3) sole corners in world [m].
        fall: (T,) vertical acceleration of the base [m/s²].
        shortest: Length of a phase from which on it is believed [frames].
    """
    mended, last = _exchanges(_grounded(contact, corners, fall), shortest), len(contact)
    for foot in range(2):
        for start, end in runs(np.asarray(~mended[:, foot].any(axis=1))):
            inside = start > 0 and end < last
            if end - start < shortest and (not inside or _stays(corners, foot, start, end)):
                before, after = mended[max(start - 1, 0), foot], mended[min(end, last - 1), foot]
                mended[start:end, foot] = before | after
    for foot in range(2):
        for start, end in runs(np.asarray(mended[:, foot].any(axis=1))):
            other = mended[start:end, 1 - foot].any(axis=1)
            if start > 0 and end < last and end - start < shortest and other.all():
                mended[start:end, foot] = False
    return mended


def _grounded(contact: BoolArray, corners: Array, fall: Array) -> BoolArray:
    """A schedule with contact wherever the body is not in flight."""
    mended, last = contact.copy(), len(contact)
    for start, end in runs(np.asarray(~contact.any(axis=(1, 2)))):
        height = corners[start:end, ..., 2].min(axis=2).mean(axis=0)
        lower = corners[start:end, ..., 2].min(axis=(1, 2))
        if fall[start:end].mean() < _FALLING or lower.max() > _OFF_GROUND:
            continue
        before = contact[start - 1] if start > 0 else np.zeros((2, 4), np.bool_)
        after = contact[end] if end < last else np.zeros((2, 4), np.bool_)
        beside = before.any(axis=1).astype(int) + after.any(axis=1)
        if before.any() and after.any() and beside.max() == 1:
            mended[start:end] = before | after
        else:
            foot = int(np.argmax(beside - height))  # heights are below 1 m
            own = before[foot] | after[foot]
            mended[start:end, foot] = own if own.any() else True
    return mended


def _exchanges(contact: BoolArray, shortest: int) -> BoolArray:
    """A schedule in which both feet stand for some frames where one takes over from the other."""
    lapped, half = contact.copy(), (shortest - 1) // 2
    starts = [[start for start, _ in runs(np.asarray(contact[:, f].any(axis=1)))] for f in (0, 1)]
    for foot in range(2):
        for begin, end in runs(np.asarray(contact[:, foot].any(axis=1))):
            for start in starts[1 - foot]:
                if begin < start and end < len(contact) and -2 * half < start - end < shortest:
                    first, last = max((start + end) // 2 - half, 0), -(-(start + end) // 2) + half
                    lapped[end:last, foot] |= contact[end - 1, foot]
                    lapped[first:start, 1 - foot] |= contact[start, 1 - foot]
    return lapped


def _stays(corners: Array, foot: int, start: int, end: int) -> bool:
    way = corners[end, foot, :, :2] - corners[start - 1, foot, :, :2]
    return bool(np.linalg.norm(way, axis=1).max() < _SAME_PLACE)


def standing_end(contact: BoolArray, frames: int) -> BoolArray:
    """(frames, 2, 4) schedule that leads from a cut, given as (2, 4) corners, to rest on both feet.

    A foot that is in the air at the cut comes down after half of the time, and both at once
    if both are.
    """
    added = np.ones((frames, 2, 4), dtype=np.bool_)
    swings = ~contact.any(axis=1)
    if not swings.all():
        added[: frames // 2, swings] = False
    return added


def loaded_corners(contact: BoolArray, frames: Array, reach: float) -> BoolArray:
    """(S, 2, 4) corners that may bear load at samples between the frames of a schedule.

    Around a switch only the intersection of both support sets may bear load, so that
    forces ramp. Where two sets follow each other without sharing a corner and without
    flight between them, their union may.

    Args:
        contact: (T, 2, 4) schedule.
        frames: (S,) samples, in units of its frames.
        reach: How far around a sample the schedule is looked at [frames].
    """
    last = len(contact) - 1
    before = np.clip(np.floor(frames - reach + 1e-9).astype(int), 0, last)
    after = np.clip(np.ceil(frames + reach - 1e-9).astype(int), 0, last)
    every = np.ones((len(frames), 2, 4), dtype=np.bool_)
    some = ~every
    flight = np.zeros(len(frames), dtype=np.bool_)
    for offset in range(int(np.max(after - before)) + 1):
        at = contact[np.minimum(before + offset, after)]
        every &= at
        some |= at
        flight |= ~at.any(axis=(1, 2))
    alone = ~every.any(axis=(1, 2)) & ~flight
    every[alone] = some[alone]
    return every
