"""How one figure of a motion is read off its trace.

A probe looks at some channels of a trace, at most along one direction, which comes from the
command's own motion: a kick is measured the way this kick goes, a wave where this hand waves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import find_peaks, peak_prominences

from robomirror_drake.goals.trace import RATE, Trace
from robomirror_drake.messages import Array

Kind = Literal["near", "reach", "net", "aside", "total", "span", "count", "time", "still"]
Channel = Literal[
    "place", "heading", "height", "trunk", "hands", "left_hand", "right_hand", "left_foot",
    "right_foot", "left_lift", "right_lift", "feet", "lifts", "apart", "flight", "hands_in_turn",
]  # fmt: skip

SWAY = 0.5
"""Time over which a path is smoothed, so that the sway of a step is not counted as way [s]."""
STANDSTILL = 0.05
"""Way from which on there is a direction to speak of [m]."""
CLEAR = 2.0
"""How much more than the next smaller bump the least beat has to stand out, to be counted."""
HALF = (0.35, 0.5)
"""Least and most share of its nominal size from which on a bump counts as a beat."""
SMALLEST_BEAT = 0.01
"""Bump that is worth counting in the command's own motion [m] or [rad]."""


class Probe(NamedTuple):
    """How to read a figure.

    Attributes:
        kind: ``near``: how much of the way to ``level`` · ``axis`` is done where the motion
            comes nearest to it; ``reach``: farthest way out along ``axis``; ``net``: from
            begin to end along ``axis``; ``aside``: angle between that way and ``axis`` [rad];
            ``total``: length of the whole path; ``span``: from least to most; ``count``:
            bumps along ``axis`` that stand out by ``level``; ``time``: spent beyond
            ``level`` along ``axis`` [s]; ``still``: farthest away from the beginning.
        channel: Which part of the trace.
        axis: (k,) unit vector in the channel.
        level: Of ``near``, ``count`` and ``time``, in the channel's unit.
    """

    kind: Kind
    channel: Channel
    axis: Array
    level: float = 0.0

    def read(self, trace: Trace) -> float:
        """The figure of a motion."""
        return self.figure(channel(trace, self.channel))

    def figure(self, signal: Array) -> float:
        """The figure of what is in the channel, (T, k)."""
        return _READERS[self.kind](self, signal)


def channel(trace: Trace, name: Channel) -> Array:
    """(T, k) a part of a trace."""
    hands, feet = trace.hands, trace.feet
    made: dict[Channel, Callable[[], Array]] = {
        "place": lambda: trace.place,
        "heading": lambda: trace.heading,
        "height": lambda: trace.height,
        "trunk": lambda: trace.trunk,
        "hands": lambda: hands.reshape(-1, 6),
        "left_hand": lambda: hands[:, 0],
        "right_hand": lambda: hands[:, 1],
        "left_foot": lambda: feet[:, 0],
        "right_foot": lambda: feet[:, 1],
        "left_lift": lambda: feet[:, 0, 2:],
        "right_lift": lambda: feet[:, 1, 2:],
        "feet": lambda: feet.reshape(-1, 6),
        # Bumps of either side, one after the other.
        "lifts": lambda: feet[..., 2].sum(axis=1, keepdims=True),
        "apart": lambda: np.linalg.norm(np.diff(feet[..., :2], axis=1), axis=2),
        "flight": lambda: trace.clearance.min(axis=1, keepdims=True),
        "hands_in_turn": lambda: (hands * [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]).sum(axis=1),
    }
    return made[name]()


def extreme(signal: Array) -> Array:
    """(k,) the sample of (T, k) that is farthest from nought."""
    return np.asarray(signal[np.argmax(np.linalg.norm(signal, axis=1))])


def along(kind: Kind, name: Channel, nominal: Trace) -> Probe:
    """A probe along the direction that the command's own motion takes."""
    signal = channel(nominal, name)
    way = signal[-1] - signal[0] if kind in ("net", "aside") else extreme(signal)
    length = float(np.linalg.norm(way))
    axis = way / length if length > 0.0 else np.eye(len(way))[0]
    return Probe(kind, name, axis, length if kind == "near" else 0.5 * length)


def beats(nominal: Trace, names: tuple[Channel, ...], number: int) -> Probe | None:
    """What shows ``number`` beats most clearly in the command's own motion; None if nothing does.

    Every coordinate of the channels is tried, upwards and downwards: the least of the
    ``number`` largest bumps has to stand out from the next one :data:`CLEAR` times.
    """
    best: tuple[float, Probe] | None = None
    for name in names:
        signal = channel(nominal, name)
        for axis in (sign * unit for unit in np.eye(signal.shape[1]) for sign in (1.0, -1.0)):
            sizes = np.sort(_bumps(signal @ axis))[::-1]
            if len(sizes) < number or sizes[number - 1] < SMALLEST_BEAT:
                continue
            least, after = sizes[number - 1], sizes[number] if len(sizes) > number else 0.0
            gap = least / max(after, 0.1 * SMALLEST_BEAT)
            if gap >= CLEAR and (best is None or gap > best[0]):
                level = float(np.clip(np.sqrt(least * after), HALF[0] * least, HALF[1] * least))
                best = gap, Probe("count", name, axis, level)
    return None if best is None else best[1]


def smoothed(signal: Array) -> Array:
    """(T, k) means over :data:`SWAY`; outside, the first and the last sample go on."""
    width = round(SWAY * RATE)
    return np.asarray(uniform_filter1d(signal, width, axis=0, mode="nearest"))


def _bumps(signal: Array) -> Array:
    """Prominences of the maxima of (T,)."""
    peaks, _ = find_peaks(signal)
    return np.asarray(peak_prominences(signal, peaks)[0])


def _near(probe: Probe, signal: Array) -> float:
    left = np.linalg.norm(signal - probe.level * probe.axis, axis=1).min()
    return probe.level - float(left)


def _reach(probe: Probe, signal: Array) -> float:
    return float(np.max(signal @ probe.axis))


def _net(probe: Probe, signal: Array) -> float:
    return float((signal[-1] - signal[0]) @ probe.axis)


def _aside(probe: Probe, signal: Array) -> float:
    way = signal[-1] - signal[0]
    length = float(np.linalg.norm(way))
    if length < STANDSTILL:
        return np.pi  # nowhere at all is as wrong as the opposite way
    return float(np.arccos(np.clip(way @ probe.axis / length, -1.0, 1.0)))


def _total(_: Probe, signal: Array) -> float:
    return float(np.linalg.norm(np.diff(smoothed(signal), axis=0), axis=1).sum())


def _span(probe: Probe, signal: Array) -> float:
    return float(np.ptp(signal @ probe.axis))


def _count(probe: Probe, signal: Array) -> float:
    return float(np.sum(_bumps(signal @ probe.axis) > probe.level))


def _time(probe: Probe, signal: Array) -> float:
    return float(np.sum(signal @ probe.axis > probe.level) / RATE)


def _still(_: Probe, signal: Array) -> float:
    return float(np.linalg.norm(signal - signal[0], axis=1).max())


_READERS: dict[Kind, Callable[[Probe, Array], float]] = {
    "near": _near,
    "reach": _reach,
    "net": _net,
    "aside": _aside,
    "total": _total,
    "span": _span,
    "count": _count,
    "time": _time,
    "still": _still,
}
