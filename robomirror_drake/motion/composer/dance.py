"""Dances that travel: figures of footsteps, with the bearing that goes with them."""

from __future__ import annotations

import numpy as np

from robomirror_drake.motion.composer.cue import Cue, other
from robomirror_drake.motion.composer.score import STANCE_WIDTH, Score, ahead
from robomirror_drake.motion.composer.steps import Manner, Step, take_steps


def _hold(score: Score, cue: Cue, begin: float, angles: dict[str, float]) -> None:
    """Keep the free arms in a pose from ``begin`` to now."""
    for arm in cue.free_arms:
        for angle, value in angles.items():
            score.move(f"{arm}_{angle}", value, begin, begin + 0.8)
            score.move(f"{arm}_{angle}", -value, score.now - 0.8, score.now)


def waltz(score: Score, cue: Cue) -> None:
    """Box steps: ahead, aside, close; back, aside, close; rising and falling; twice."""
    size = 0.22 * min(cue.amplitude * cue.style.step_length, 1.5)
    begin, lead = score.now, cue.side
    follow = other(lead)
    sign = 1.0 if lead == "left" else -1.0
    start, half = score.center(), 0.5 * STANCE_WIDTH
    steps = []
    for _ in range(cue.count or 2):
        for side, x, y in (
            (lead, size, 0.0), (follow, size, -size), (lead, size, -size),
            (follow, 0.0, -size), (lead, 0.0, 0.0), (follow, 0.0, 0.0),
        ):  # fmt: skip
            foot = half if side == "left" else -half
            steps.append(Step(side, ahead(start, x, sign * y + foot)))
    manner = Manner(bob=0.015, crouch=0.02, roll=0.03)
    take_steps(score, steps, 0.62 / cue.tempo, cue, manner)
    _hold(score, cue, begin, {"flexion": 0.75, "abduction": 0.45, "elbow": 0.95})


def salsa(score: Score, cue: Cue) -> None:
    """Rock ahead and back in turn, hips and shoulders against each other, 4 times."""
    size = 0.17 * min(cue.amplitude * cue.style.step_length, 1.6)
    begin, side = score.now, cue.side
    steps, beats = [], cue.count or 4
    for k in range(beats):
        home = score.feet[side]
        out = size if k % 2 == 0 else -size
        steps += [Step(side, ahead(home, out, 0.0), out), Step(side, home, -out)]
        side = other(side)
    step_time = 0.55 / cue.tempo
    take_steps(score, steps, step_time, cue, Manner(crouch=0.04, swing=0.0))
    time = begin + 0.6
    while time + 2.0 * step_time < score.now:
        for sign, t in ((1.0, time), (-1.0, time + step_time)):
            score.pulse("pelvis_roll", 0.06 * sign, t, t + 0.5 * step_time, t + step_time)
            score.pulse("chest_yaw", 0.14 * sign, t, t + 0.5 * step_time, t + step_time)
        time += 2.0 * step_time
    _hold(score, cue, begin, {"flexion": 0.2, "elbow": 1.25, "abduction": 0.15})
    _roll_arms(score, cue, begin + 0.8, score.now - 0.8, 2.0 * step_time)


def _roll_arms(score: Score, cue: Cue, start: float, end: float, period: float) -> None:
    """The forearms go to and fro in turn."""
    for arm, sign in (("left", 1.0), ("right", -1.0)):
        if arm not in cue.busy_arms:
            for t in np.arange(start, end - period, period):
                score.pulse(f"{arm}_flexion", 0.25 * sign, t, t + 0.5 * period, t + period)
