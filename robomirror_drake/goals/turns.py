"""When each clause of a command has its turn, in the command's own motion and in any other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from robomirror_drake.goals.probes import smoothed
from robomirror_drake.goals.trace import Trace
from robomirror_drake.messages import Array
from robomirror_drake.motion.composer.compose import REST, compose
from robomirror_drake.motion.composer.cue import Style
from robomirror_drake.motion.text import Clause

STRIDE = 6
"""Samples of a trace from one sample of its outline to the next."""

_LEAST = np.array([0.1, 0.2, 0.05, 0.1, 0.1, 0.1, 0.05, 0.2])  # range that is not blown up


class Turns(NamedTuple):
    """The turns of a command's clauses in its own motion.

    Attributes:
        bounds: (C, 2) first sample and the one after the last of each clause.
        outline: (S, 8) what happens in the motion, see :func:`outline`.
    """

    bounds: npt.NDArray[np.intp]
    outline: Array


def make_turns(clauses: tuple[Clause, ...], nominal: Trace) -> Turns:
    """The turns of clauses in the nominal motion of their command.

    What goes along with a clause has the same turn. They are as long as the composer makes
    them; a motion from elsewhere that lasts longer or shorter is divided in proportion.
    """
    length = len(nominal.place)
    if all(clause.accompanies for clause in clauses[1:]):
        whole = np.tile(np.array([0, length], dtype=np.intp), (len(clauses), 1))
        return Turns(whole, outline(nominal))
    ends = _ends(clauses)
    stops = np.rint(np.array(ends) / (ends[-1] + REST) * length).astype(np.intp)
    stops[-1] = length
    starts = np.concatenate([[0], stops[:-1]])
    own = np.cumsum([not clause.accompanies for clause in clauses]) - 1
    return Turns(np.stack([starts, stops], axis=1)[own], outline(nominal))


def find_turns(turns: Turns, trace: Trace) -> npt.NDArray[np.intp]:
    """(C, 2) first sample and the one after the last of each clause in another motion.

    Where there are several, both motions are aligned in time: what is done out of its turn
    finds no time of its own, and is then missing.
    """
    length = len(trace.place)
    if (turns.bounds == turns.bounds[0]).all():
        return np.tile(np.array([0, length], dtype=np.intp), (len(turns.bounds), 1))
    other = outline(trace)
    begin, end = aligned(turns.outline, other)
    rows = np.minimum(turns.bounds // STRIDE, len(begin))
    last = len(begin) - 1
    start = np.where(rows[:, 0] == 0, 0, begin[np.minimum(rows[:, 0], last)] * STRIDE)
    stop = np.where(rows[:, 1] > last, length, (end[np.minimum(rows[:, 1], last)] + 1) * STRIDE)
    start = np.minimum(start, length - 1)
    return np.stack([start, np.clip(stop, start + 1, length)], axis=1)


def outline(trace: Trace) -> Array:
    """(S, 8) what happens in a motion, whichever side does it and however large.

    Shares of the way and of the turning so far, height, the greatest and the least height and
    the greatest reach of a hand, the greatest lift of a foot, lean; each scaled by its range.
    """

    def so_far(signal: Array) -> Array:
        steps = np.linalg.norm(np.diff(smoothed(signal), axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    features = np.stack(
        [
            so_far(trace.place),
            so_far(trace.heading),
            trace.height[:, 0],
            trace.hands[..., 2].max(axis=1),
            trace.hands[..., 2].min(axis=1),
            np.linalg.norm(trace.hands[..., :2], axis=2).max(axis=1),
            trace.feet[..., 2].max(axis=1),
            np.linalg.norm(trace.trunk, axis=1),
        ],
        axis=1,
    )
    return np.asarray(features / np.maximum(np.ptp(features, axis=0), _LEAST))[::STRIDE]


def aligned(a: Array, b: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """(S,), (S,) first and last sample of ``b`` (U, F) that belongs to each of ``a`` (S, F).

    Dynamic time warping. Source: H. Sakoe, S. Chiba, "Dynamic programming algorithm
    optimization for spoken word recognition", IEEE Trans. ASSP 26(1), 1978.
    """
    first, last = _aligned(np.ascontiguousarray(a), np.ascontiguousarray(b))
    return np.asarray(first), np.asarray(last)


def _ends(clauses: tuple[Clause, ...]) -> list[float]:
    """When each clause that goes along with none is done, as the composer has it [s]."""
    carriers = [i for i, clause in enumerate(clauses) if not clause.accompanies]
    fps = 20.0
    parts = [clauses[:i] for i in [*carriers[1:], len(clauses)]]
    return [(len(compose(part, Style(), fps)) - 1) / fps - REST for part in parts]


@njit(cache=True)
def _aligned(a, b):  # type: ignore[no-untyped-def]
    rows, columns = len(a), len(b)
    cost = np.full((rows + 1, columns + 1), np.inf)
    cost[0, 0] = 0.0
    for i in range(rows):
        for j in range(columns):
            gap = 0.0
            for k in range(a.shape[1]):
                gap += abs(a[i, k] - b[j, k])
            cost[i + 1, j + 1] = gap + min(cost[i, j], cost[i, j + 1], cost[i + 1, j])
    first, last = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
    i, j = rows, columns
    last[i - 1] = first[i - 1] = j - 1
    while i > 1 or j > 1:
        step = min(cost[i - 1, j - 1], cost[i - 1, j], cost[i, j - 1])
        if cost[i - 1, j - 1] == step:
            i, j = i - 1, j - 1
            last[i - 1] = first[i - 1] = j - 1
        elif cost[i - 1, j] == step:
            i -= 1
            last[i - 1] = first[i - 1] = j - 1
        else:
            j -= 1
            first[i - 1] = j - 1
    return first, last
