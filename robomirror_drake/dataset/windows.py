"""From an episode to what a predictor learns: does the robot fall soon, and how well does it track.

A window begins at a frame, the last one observed, and looks ahead over a horizon: its
labels are means over the frames after that one, up to the fall if there is one. A window
that neither reaches its horizon nor a fall has no label, and there is none after a fall.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.outcome import tracking_errors

ERRORS: Final = ("A_q", "A_qd", "A_qdd", "A_p", "A_theta")
"""Columns of :attr:`Labels.errors`, as in :class:`~robomirror_drake.messages.Outcome`."""


class Track(NamedTuple):
    """What a robot did and what it is compared with.

    Attributes:
        time: (N,) at a constant rate [s].
        q, v: (N, 30), (N, 29) of the robot, Drake order.
        q_ref, v_ref: (N, 30), (N, 29) of the reference: the plan, or the commanded motion.
    """

    time: Array
    q: Array
    v: Array
    q_ref: Array
    v_ref: Array


class Labels(NamedTuple):
    """Labels of M windows that begin at consecutive frames.

    Attributes:
        start: (M,) frame at which each begins.
        end: (M,) its last frame: at the horizon, or at the fall.
        fall: (M,) whether the robot falls within it.
        time_to_fall: (M,) from its beginning [s], +inf where the execution has no fall.
        errors: (M, 5) mean errors, in the order of :data:`ERRORS` and the units of an Outcome.
        foreseeable: (M,) whether nothing pushes the robot within it, since that can be told
            neither from the reference nor from the state.
    """

    start: npt.NDArray[np.int64]
    end: npt.NDArray[np.int64]
    fall: BoolArray
    time_to_fall: Array
    errors: Array
    foreseeable: BoolArray


def label_windows(
    track: Track,
    horizon: float,
    fall_time: float | None = None,
    pushes: Sequence[float] = (),
    until: float = math.inf,
) -> Labels:
    """Labels of all windows of an episode that have one.

    Args:
        track: At least two frames.
        horizon: How far ahead is looked [s].
        fall_time: When the robot fell [s], None if it did not.
        pushes: When pushes began [s].
        until: When the execution would have ended without a fall [s]. Windows that reach
            beyond it have no label, be there a fall or not: else that there is one would tell.
    """
    time = np.asarray(track.time, dtype=np.float64)
    step = (time[-1] - time[0]) / (len(time) - 1)
    ahead = max(1, round(horizon / step))
    fallen = None if fall_time is None else int(np.argmin(np.abs(time - fall_time)))
    count = len(time) - ahead if fallen is None else fallen
    if not math.isinf(until):
        count = min(count, round((until - time[0]) / step) + 1 - ahead)
    start = np.arange(max(count, 0))
    end = start + ahead
    if fallen is not None:
        end = np.minimum(end, fallen)
    to_fall = np.full(len(start), np.inf) if fallen is None else (fallen - start) * step
    pushed = np.sort(np.asarray(pushes, dtype=np.float64))
    before, within = (np.searchsorted(pushed, time[at], side="right") for at in (start, end))
    return Labels(
        start=start,
        end=end,
        fall=np.zeros(len(start), np.bool_) if fallen is None else end == fallen,
        time_to_fall=to_fall,
        errors=_mean_errors(track, start, end),
        foreseeable=before == within,
    )


def _mean_errors(track: Track, start: npt.NDArray[np.int64], end: npt.NDArray[np.int64]) -> Array:
    """(M, 5) means over the frames after ``start`` up to and including ``end``."""
    errors = tracking_errors(Track(*(np.asarray(part, dtype=np.float64) for part in track)))
    means = []
    for name, error in errors._asdict().items():
        total = np.concatenate([[0.0], np.cumsum(error)])
        # An acceleration is a difference of two frames, and belongs to the later one.
        first = 0 if name == "qdd" else 1
        means.append((total[end + first] - total[start + first]) / (end - start))
    return np.stack(means, axis=1)
