"""The predicates of a command as functions with gradients, for an optimisation to keep them.

A margin is not negative where its predicate is met, and 1 is about all that is meant. Where a
predicate counts samples or bumps, its margin tells by how much the last one that is needed
stands out, and the first one too many stays below.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.signal import find_peaks, peak_prominences

from robomirror_drake.goals.predicates import Goals, Predicate
from robomirror_drake.goals.probes import STANDSTILL, SWAY, Probe, channel, smoothed
from robomirror_drake.goals.satisfaction import Judged, judge
from robomirror_drake.goals.trace import RATE, Trace, from_standing, headings
from robomirror_drake.messages import Array
from robomirror_drake.robot import Robot

Margin = Callable[[Array], tuple[float, Array]]

_STEP = 1e-6  # of the central differences over one sample's coordinates

Reading = tuple[float, Array]  # a figure, and its derivative by the signal (T, k)


def margins(
    robot: Robot, goals: Goals, rate: float = 20.0, cushion: float = 0.0
) -> tuple[tuple[str, Margin], ...]:
    """A sentence and a function for each predicate.

    A function takes a motion q (N, 30) at ``rate`` and returns its margin and the plain partial
    derivatives (N, 30) by the 30 numbers of each sample, for the times and the side at which
    the motion itself does each clause. Which sample is the farthest, and which bump the least,
    is held as it is: at a change from one to another the derivative is that of either.

    Args:
        robot: The robot.
        goals: What the command means.
        rate: Samples per second, a divisor of 60.
        cushion: Taken off every margin, so that what just does is not at the very edge.

    Raises:
        ValueError: The rate is no divisor of 60.
    """
    held = round(RATE / rate)
    if held < 1 or not math.isclose(held * rate, RATE):
        raise ValueError(f"rate is {rate}; give a divisor of {RATE:.0f}")

    @lru_cache(maxsize=1)  # a motion is asked for all its margins in a row
    def judged(motion: bytes, rows: int) -> tuple[Trace, list[Judged]]:
        world = from_standing(robot, np.frombuffer(motion).reshape(rows, -1))
        trace = Trace(*(np.repeat(part, held, axis=0) for part in world)).window(0, held * rows)
        return trace, judge(goals, trace)

    def make(predicate: Predicate) -> Margin:
        def margin(q: Array) -> tuple[float, Array]:
            trace, clauses = judged(np.asarray(q, dtype=np.float64).tobytes(), len(q))
            value, gradient = _margin(robot, predicate, q, trace, clauses[predicate.clause], held)
            return value - cushion, gradient

        return margin

    return tuple((p.sentence, make(p)) for p in goals.predicates)


def _margin(
    robot: Robot, predicate: Predicate, q: Array, trace: Trace, judged: Judged, held: int
) -> tuple[float, Array]:
    _, start, stop, mirror = judged
    seen = trace.mirrored() if mirror else trace
    window = seen.window(start, stop)
    value, by_signal = margin_of(predicate, channel(window, predicate.probe.channel))
    by_window = np.zeros((held * len(q), by_signal.shape[1]))
    by_window[start:stop] = by_signal
    by_sample = by_window.reshape(len(q), held, -1).sum(axis=1)
    return value, _by_q(robot, q, predicate.probe, by_sample, start // held, mirror)


def margin_of(predicate: Predicate, signal: Array) -> Reading:
    """The margin of a predicate in a channel (T, k), and its derivative by that."""
    probe, least, most = predicate.probe, predicate.least, predicate.most
    if probe.kind == "count":
        return _bump_margin(probe, signal, round(least), math.isfinite(most))
    if probe.kind == "time":
        return _time_margin(probe, signal, math.ceil(least * RATE - 1e-9))
    value, by_signal = probe.figure(signal), _SLOPES[probe.kind](probe, signal)
    scale = predicate.wanted if predicate.wanted > 0.0 else most
    if most - value < value - least or predicate.wanted <= least:
        return (most - value) / scale, -by_signal / scale
    return (value - least) / scale, by_signal / scale


def _by_q(
    robot: Robot, q: Array, probe: Probe, by_sample: Array, first: int, mirror: bool
) -> Array:
    """(N, 30) from the derivative by the channel as it is seen from its first sample (N, k)."""
    begins, side = q[first : first + 1], -1.0 if mirror else 1.0

    def read(rows: Array, name: str) -> Array:
        trace = from_standing(robot, rows)
        return channel(trace.mirrored() if mirror else trace, name)  # type: ignore[arg-type]

    by_world = by_sample.copy()
    by_yaw = 0.0  # of the first sample
    if probe.channel == "heading":
        by_yaw = -side * float(by_sample.sum())
    elif probe.channel == "place":
        yaw = side * float(headings(begins)[0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, s], [-s, c]])  # from the world to where it begins
        seen = ((q[:, 4:6] - begins[:, 4:6]) * [1.0, side]) @ turn.T
        by_world = by_sample @ turn
        by_world[first] -= by_world.sum(axis=0)
        by_yaw = side * float(np.sum(by_sample * np.stack([seen[:, 1], -seen[:, 0]], axis=1)))
    gradient = np.zeros_like(q)
    touched = np.flatnonzero(by_world.any(axis=1))
    if probe.channel == "place":  # two of the coordinates themselves
        gradient[:, 4:6] = by_world * [1.0, side]
    elif probe.channel == "heading":
        slope = _differences(headings, q[touched])
        gradient[touched] = side * np.einsum("tk,tkj->tj", by_world[touched], slope)
    elif len(touched):
        slope = _differences(lambda rows: read(rows, probe.channel), q[touched])
        gradient[touched] = np.einsum("tk,tkj->tj", by_world[touched], slope)
    if by_yaw != 0.0:
        gradient[first] += by_yaw * _differences(headings, begins)[0, 0]
    return gradient


def _differences(read: Callable[[Array], Array], q: Array) -> Array:
    """(T, k, 30) central differences of a channel that depends on its own sample only."""
    moves = _STEP * np.concatenate([np.eye(q.shape[1]), -np.eye(q.shape[1])])
    both = read((q[:, None] + moves).reshape(-1, q.shape[1])).reshape(len(q), 2, q.shape[1], -1)
    rise = both[:, 0] - both[:, 1]
    rise = rise - 2 * np.pi * np.rint(rise / (2 * np.pi))  # headings may have been unwrapped
    return np.moveaxis(rise, 1, 2) / (2 * _STEP)


def _bump_margin(probe: Probe, signal: Array, number: int, exactly: bool) -> Reading:
    along = signal @ probe.axis
    peaks, _ = find_peaks(along)
    sizes, left, right = peak_prominences(along, peaks)
    order = np.argsort(-sizes, kind="stable")
    wanted, surplus = (number - 1, 1.0), (number, -1.0)
    best: Reading = (math.inf, np.zeros_like(signal))
    for place, sign in (wanted, surplus) if exactly else (wanted,):
        if place >= len(order):
            value, by_signal = -sign, np.zeros_like(signal)  # none at all is as small as can be
        else:
            rank = int(order[place])
            base = left[rank] if along[left[rank]] >= along[right[rank]] else right[rank]
            value = sign * (sizes[rank] - probe.level) / probe.level
            by_signal = np.zeros_like(signal)
            by_signal[peaks[rank]] += sign / probe.level * probe.axis
            by_signal[base] -= sign / probe.level * probe.axis
        if value < best[0]:
            best = float(value), by_signal
    return best


def _time_margin(probe: Probe, signal: Array, samples: int) -> Reading:
    along, by_signal = signal @ probe.axis, np.zeros_like(signal)
    if samples > len(along):
        return -1.0, by_signal
    least = int(np.argsort(-along, kind="stable")[samples - 1])
    by_signal[least] = probe.axis / (2 * probe.level)
    return float((along[least] - probe.level) / (2 * probe.level)), by_signal


def _near(probe: Probe, signal: Array) -> Array:
    away = signal - probe.level * probe.axis
    lengths = np.linalg.norm(away, axis=1)
    i, by_signal = int(np.argmin(lengths)), np.zeros_like(signal)
    if lengths[i] > 0.0:
        by_signal[i] = -away[i] / lengths[i]
    return by_signal


def _reach(probe: Probe, signal: Array) -> Array:
    by_signal = np.zeros_like(signal)
    by_signal[int(np.argmax(signal @ probe.axis))] = probe.axis
    return by_signal


def _net(probe: Probe, signal: Array) -> Array:
    by_signal = np.zeros_like(signal)
    by_signal[-1] += probe.axis
    by_signal[0] -= probe.axis
    return by_signal


def _aside(probe: Probe, signal: Array) -> Array:
    way, by_signal = signal[-1] - signal[0], np.zeros_like(signal)
    length = float(np.linalg.norm(way))
    if length < STANDSTILL:
        return by_signal
    cosine = float(np.clip(way @ probe.axis / length, -1.0, 1.0))
    sine = math.sqrt(1.0 - cosine**2)
    if sine > 0.0:
        by_signal[-1] = -(probe.axis - cosine * way / length) / (length * sine)
        by_signal[0] -= by_signal[-1]
    return by_signal


def _total(_: Probe, signal: Array) -> Array:
    steps = np.diff(smoothed(signal), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = steps / np.maximum(lengths, 1e-300)[:, None]
    by_smooth = np.zeros_like(signal)
    by_smooth[1:] += units
    by_smooth[:-1] -= units
    width, last = round(SWAY * RATE), len(signal) - 1
    by_signal = np.zeros_like(signal)
    for shift in range(-(width // 2), width - width // 2):
        np.add.at(by_signal, np.clip(np.arange(last + 1) + shift, 0, last), by_smooth / width)
    return by_signal


def _span(probe: Probe, signal: Array) -> Array:
    along, by_signal = signal @ probe.axis, np.zeros_like(signal)
    by_signal[int(np.argmax(along))] += probe.axis
    by_signal[int(np.argmin(along))] -= probe.axis
    return by_signal


def _still(_: Probe, signal: Array) -> Array:
    away = signal - signal[0]
    lengths = np.linalg.norm(away, axis=1)
    i, by_signal = int(np.argmax(lengths)), np.zeros_like(signal)
    if lengths[i] > 0.0:
        by_signal[i] += away[i] / lengths[i]
        by_signal[0] -= away[i] / lengths[i]
    return by_signal


_SLOPES: dict[str, Callable[[Probe, Array], Array]] = {
    "near": _near,
    "reach": _reach,
    "net": _net,
    "aside": _aside,
    "total": _total,
    "span": _span,
    "still": _still,
}
"""By kind of probe, the derivative of its figure by the channel."""
