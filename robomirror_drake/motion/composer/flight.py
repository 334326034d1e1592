"""Actions that leave the floor: jumps, hops, leaps, skips, runs.

In flight the height of the centre of mass is a parabola under gravity; before and after, quintics
join it with its velocity and acceleration, so that the legs do what a ballistic flight asks for.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robomirror_drake.motion.composer.balance import GRAVITY
from robomirror_drake.motion.composer.cue import Cue, other
from robomirror_drake.motion.composer.score import (
    STANCE_WIDTH,
    Footprint,
    Score,
    ahead,
    quintic,
)

Knot = tuple[float, float, float, float]
"""Time [s], height over neutral [m], its velocity [m/s] and acceleration [m/s²]."""
TIP_OFF = -0.035
"""Height of the centre of mass over neutral when the feet leave and meet the floor [m]."""
SHIFT = 0.7
"""Time to bring the weight over one foot [s]."""


def _heights(score: Score, knots: list[Knot]) -> None:
    """Quintics through the knots, as the height of the centre of mass."""
    score.move("ballistic", 1.0, knots[0][0], knots[1][0])
    for (t0, *start), (t1, *end) in pairwise(knots):
        curve = quintic((start[0], start[1], start[2]), (end[0], end[1], end[2]), t1 - t0)
        curve[0] -= start[0]
        score.curve("pelvis_z", curve, t0, t1)
    score.move("ballistic", -1.0, knots[-2][0], knots[-1][0])


def _flight_time(rise: float) -> tuple[float, float]:
    """Duration [s] and speed of take-off [m/s] of a flight that rises by ``rise`` [m]."""
    speed = float(np.sqrt(2.0 * GRAVITY * rise))
    return 2.0 * speed / GRAVITY, speed


def jump(score: Score, cue: Cue) -> None:
    """Jump with both feet: on the spot, by a distance, or to a side."""
    count = cue.count or 1
    aside = {"left": 0.25, "right": -0.25}.get(cue.side, 0.0) * cue.amplitude
    for i in range(count):
        if aside:
            _jump_once(score, cue, 0.0, aside if cue.distance is None
                       else np.sign(aside) * cue.distance / count)  # fmt: skip
        else:
            _jump_once(score, cue, (cue.distance or 0.0) / count, 0.0)
        if i < count - 1:
            score.now += 0.15


def _jump_once(score: Score, cue: Cue, distance: float, aside: float) -> None:
    way = float(np.hypot(distance, aside))
    rise = min(max(0.10 * cue.amplitude**1.8, 0.05 + 0.10 * way), 0.40)
    crouch = -min(0.24 + 0.4 * max(rise - 0.13, 0.0), 0.32)
    flight, speed = _flight_time(rise)
    t0 = score.now
    bottom = t0 + 0.75 / np.sqrt(cue.tempo)
    off = bottom + 0.34
    down = off + flight
    absorbed = down + 0.38
    up = absorbed + 0.8 / np.sqrt(cue.tempo)
    _heights(
        score,
        [
            (t0, 0.0, 0.0, 0.0), (bottom, crouch, 0.0, 0.0), (off, TIP_OFF, speed, -GRAVITY),
            (down, TIP_OFF, -speed, -GRAVITY), (absorbed, crouch, 0.0, 0.0), (up, 0.0, 0.0, 0.0),
        ],
    )  # fmt: skip
    top = 0.5 * (off + down)
    for side in ("left", "right"):
        score.pulse(f"{side}_foot_z", 1.35 * rise, off, top, down)
        score.carry(side, ahead(score.feet[side], distance, aside), off, down)
    _throw_arms(score, cue, t0, bottom, off, top, absorbed)
    for part, lean in (("chest_pitch", 0.35), ("pelvis_pitch", 0.30)):
        score.move(part, lean, t0, bottom)
        score.move(part, -lean, bottom, off)
        score.pulse(part, 0.8 * lean, down - 0.05, absorbed, up)
    score.now = up


def _throw_arms(
    score: Score, cue: Cue, t0: float, bottom: float, off: float, top: float, absorbed: float
) -> None:
    """Back in the crouch, up with the push, down in the landing."""
    for side in cue.free_arms:
        swing = 0.7 * cue.style.arms
        score.move(f"{side}_flexion", -swing, t0, bottom)
        score.move(f"{side}_flexion", 2.4 * swing, bottom, off + 0.05)
        score.move(f"{side}_flexion", -1.4 * swing, top, absorbed + 0.2)
        score.pulse(f"{side}_elbow", 0.5, bottom, off, absorbed)


def jumping_jack(score: Score, cue: Cue) -> None:
    """Jump with the feet apart and the arms up, and back together; 2 times."""
    rise = 0.035 * min(cue.amplitude, 2.0)
    wide = 0.13 * min(cue.amplitude, 1.6)
    flight, speed = _flight_time(rise)
    dip, push = -0.09 * cue.style.spring, 0.26 / np.sqrt(cue.tempo)
    t = score.now
    knots: list[Knot] = [(t, 0.0, 0.0, 0.0), (t + 0.5, dip, 0.0, 0.0)]
    t += 0.5
    for i in range(2 * (cue.count or 2)):
        off, down = t + push, t + push + flight
        knots += [(off, TIP_OFF, speed, -GRAVITY), (down, TIP_OFF, -speed, -GRAVITY),
                  (down + push, dip, 0.0, 0.0)]  # fmt: skip
        out = 1.0 if i % 2 == 0 else -1.0
        for side, sign in (("left", 1.0), ("right", -1.0)):
            score.pulse(f"{side}_foot_z", 0.05, off, 0.5 * (off + down), down)
            there = ahead(score.feet[side], 0.0, sign * out * wide)
            score.carry(side, there, off, down)
            if side not in cue.busy_arms:
                score.move(f"{side}_abduction", 2.1 * out, t, down + 0.5 * push)
        t = down + push
    knots.append((t + 0.6, 0.0, 0.0, 0.0))
    _heights(score, knots)
    score.now = t + 0.6


@dataclass(frozen=True)
class Bound:
    """A footfall of a gait with flights: the foot, where, and how long the flight before it is."""

    side: str
    to: Footprint
    flight: float


def _bounds(
    score: Score, cue: Cue, bounds: list[Bound], stance: float, lift: float, dip: float, heel: float
) -> None:
    """Write a gait of single stances with flights between, from rest to rest.

    The first footfall is the foot that is pushed off from, where it stands.
    """
    first, spring = bounds[0].side, cue.style.spring
    dip, tip_off = dip * spring, TIP_OFF * spring
    t = score.now
    pushing = t + SHIFT
    score.shift_load(1.0 if first == "left" else 0.0, t, pushing)
    knots: list[Knot] = [(t, 0.0, 0.0, 0.0), (pushing, -dip, 0.0, 0.0)]
    lifted = {other(first): pushing - 0.1, first: pushing}
    t = pushing + 0.32 + 0.5 * stance
    speed = 0.0
    for bound in bounds[1:]:
        standing = bounds[bounds.index(bound) - 1].side
        hops = bound.side == standing
        speed = 0.5 * GRAVITY * bound.flight
        land = t + bound.flight
        knots += [(t, tip_off, speed, -GRAVITY), (land, tip_off, -speed, -GRAVITY)]
        lifted[standing] = t
        score.swing(bound.side, bound.to, lifted[bound.side], land,
                    0.25 * spring * lift if hops else lift, 0.0 if hops else heel)  # fmt: skip
        share = 1.0 if bound.side == "left" else 0.0
        if share != score.load:
            score.shift_load(share, t, land)
        t = land + stance
    knots[-1] = (t - stance, tip_off, -speed, -GRAVITY)
    absorbed = t - stance + 0.36
    knots.append((absorbed, -dip, 0.0, 0.0))
    last = bounds[-1].side
    beside = ahead(score.feet[last], 0.0, STANCE_WIDTH * (1.0 if last == "right" else -1.0))
    landed = max(absorbed, lifted[other(last)] + 0.55)
    score.swing(other(last), beside, lifted[other(last)], landed, lift, heel)
    score.shift_load(0.5, landed, landed + SHIFT)
    score.now = landed + SHIFT
    knots.append((score.now, 0.0, 0.0, 0.0))
    _heights(score, knots)


def hop(score: Score, cue: Cue) -> None:
    """Hop on one leg, 2 times, on the spot or by a distance."""
    count = cue.count or 2
    rise = 0.02 * min(cue.amplitude, 2.5) ** 2
    each = (cue.distance or 0.0) / count
    # The foot is carried in the flight, if it is to get anywhere.
    flight = _flight_time(rise)[0] * (1.0 if each else cue.style.spring)
    at = score.feet[cue.side]
    bounds = [Bound(cue.side, at, 0.0)]
    bounds += [Bound(cue.side, ahead(at, each * (i + 1), 0.0), flight) for i in range(count)]
    begin = score.now
    _bounds(score, cue, bounds, stance=0.42 / np.sqrt(cue.tempo), lift=0.10, dip=0.09, heel=0.1)
    for arm in cue.free_arms:
        score.pulse(f"{arm}_abduction", 0.6, begin, begin + 0.9, score.now)
        score.pulse(f"{arm}_elbow", 0.4, begin, begin + 0.9, score.now)


def leap(score: Score, cue: Cue) -> None:
    """Bound from one foot to the other, 0.55 m."""
    count = cue.count or 1
    length = cue.distance / count if cue.distance else 0.55 * cue.amplitude**1.5
    flight = (0.10 + 0.14 * length) * cue.style.spring
    for _ in range(count):
        lead, push = cue.side, other(cue.side)
        at = score.feet[push]
        across = STANCE_WIDTH * (1.0 if lead == "left" else -1.0)
        bounds = [Bound(push, at, 0.0), Bound(lead, ahead(at, length, across), flight)]
        begin = score.now
        _bounds(score, cue, bounds, stance=0.3, lift=0.12, dip=0.12, heel=0.3)
        for arm, sign in ((lead, -0.5), (push, 0.9)):
            if arm in cue.free_arms:
                score.pulse(f"{arm}_flexion", sign * cue.style.arms, begin + 0.4, begin + 1.1,
                            score.now - 0.4)  # fmt: skip
                score.pulse(f"{arm}_elbow", 0.5, begin + 0.4, begin + 1.1, score.now - 0.4)


def skip(score: Score, cue: Cue) -> None:
    """Skip ahead: a hop on each foot in turn, 4 times."""
    step = 0.22 * cue.style.step_length * cue.amplitude
    side, count = cue.side, cue.count or 4
    half = 0.5 * STANCE_WIDTH
    start = score.center()
    bounds, x = [Bound(side, score.feet[side], 0.0)], 0.0
    for _ in range(count):
        for foot, flight in ((side, 0.09), (other(side), 0.05 * cue.style.spring)):
            x += step * (0.35 if foot == side else 1.3)
            y = half if foot == "left" else -half
            bounds.append(Bound(foot, ahead(start, x, y), flight))
        side = other(side)
    begin = score.now
    _bounds(score, cue, bounds, stance=0.24 / np.sqrt(cue.tempo), lift=0.15, dip=0.07, heel=0.2)
    for arm in cue.free_arms:
        score.pulse(f"{arm}_elbow", 0.7, begin, begin + 0.8, score.now)


def run(score: Score, cue: Cue) -> None:
    """Run 6 footfalls with flights between, at 1.7 m/s."""
    speed = cue.speed or 1.7 * cue.tempo
    stance = float(np.clip(0.36 / np.sqrt(speed), 0.14, 0.34))
    flight = float(np.clip(0.05 + 0.035 * speed, 0.06, 0.20)) * min(cue.amplitude, 1.3)
    flight *= cue.style.spring
    longest = speed * (stance + flight) * cue.style.step_length
    footfalls = cue.count or 6
    if cue.distance is not None:
        footfalls = max(3, round(cue.distance / longest) + 2)
    # It takes a few steps to gather speed, and to lose it.
    ramp = np.minimum(np.minimum(np.arange(1, footfalls), np.arange(footfalls - 1, 0, -1)) / 3, 1.0)
    lengths = longest * ramp
    if cue.distance is not None:
        lengths *= cue.distance / lengths.sum()
    side, start, half = cue.side, score.center(), 0.4 * STANCE_WIDTH
    bounds, x = [Bound(side, score.feet[side], 0.0)], 0.0
    for length in lengths:
        side = other(side)
        x += length
        bounds.append(Bound(side, ahead(start, x, half if side == "left" else -half), flight))
    begin = score.now
    _bounds(score, cue, bounds, stance, lift=0.14 + 0.04 * speed, dip=0.07, heel=0.9)
    _pump_arms(score, cue, bounds, begin, stance + flight)


def _pump_arms(score: Score, cue: Cue, bounds: list[Bound], begin: float, step: float) -> None:
    """Bent elbows, each arm ahead with the opposite foot; the trunk leans into the run."""
    for arm in cue.free_arms:
        score.pulse(f"{arm}_elbow", 1.2, begin, begin + SHIFT, score.now)
    score.pulse("chest_pitch", 0.12, begin, begin + SHIFT, score.now)
    score.pulse("pelvis_pitch", 0.10, begin, begin + SHIFT, score.now)
    t = begin + SHIFT + 0.1
    for bound in bounds[1:]:
        for arm, sign in ((bound.side, -0.45), (other(bound.side), 0.55)):
            if arm in cue.free_arms:
                score.pulse(f"{arm}_flexion", sign * cue.style.arms, t, t + step, t + 2.0 * step)
        t += step
