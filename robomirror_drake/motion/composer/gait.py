"""Locomotion: actions that are plans of footsteps.

Every plan ends with the feet side by side, so that a gait of n footfalls covers n - 1 steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robomirror_drake.motion.composer.cue import Cue, other
from robomirror_drake.motion.composer.score import STANCE_WIDTH, Score, ahead
from robomirror_drake.motion.composer.steps import (
    DOUBLE_SUPPORT,
    FIRST_SHIFT,
    PLAIN,
    Manner,
    Step,
    take_steps,
)


@dataclass(frozen=True)
class Gait:
    """A way of going straight.

    Attributes:
        step: Usual length of a step [m], negative for backward.
        speed: Usual speed [m/s].
        longest: Longest step [m].
        footfalls: How many where the words say nothing.
        lift: Height of the swings [m]; None for the style's.
        manner: Bearing.
        hurt: Factor on the time of the acting side's stance, 1 for an even gait.
        unsteady: How far steps stray from the line, as a share of their length.
    """

    step: float
    speed: float
    longest: float
    footfalls: int = 4
    lift: float | None = None
    manner: Manner = PLAIN
    hurt: float = 1.0
    unsteady: float = 0.0


WALK = Gait(step=0.34, speed=0.40, longest=0.62)
BACKWARD = Gait(step=-0.18, speed=0.25, longest=0.34)
STRIDE = Gait(step=0.52, speed=0.55, longest=0.75, manner=Manner(swing=1.2, crouch=0.02))
SNEAK = Gait(
    step=0.26, speed=0.24, longest=0.42, footfalls=5, lift=0.13,
    manner=Manner(crouch=0.09, lean=0.35, elbows=0.7, swing=0.5, heel=0.35, look_down=0.1),
)  # fmt: skip
LIMP = Gait(
    step=0.24, speed=0.28, longest=0.36, footfalls=5, hurt=0.78,
    manner=Manner(lean=0.12, swing=0.5, roll=0.07, look_down=0.12),
)  # fmt: skip
STAGGER = Gait(
    step=0.24, speed=0.30, longest=0.36, footfalls=6, unsteady=0.28,
    manner=Manner(lean=0.10, swing=1.8, roll=0.10, crouch=0.03),
)  # fmt: skip
JOG = Gait(
    step=0.34, speed=0.9, longest=0.60, footfalls=8, lift=0.10,
    manner=Manner(elbows=1.15, lean=0.10, heel=0.45, crouch=0.04, bob=0.015, swing=0.9),
)  # fmt: skip
STEP_OVER = Gait(step=0.44, speed=0.30, longest=0.62, footfalls=2, lift=0.24,
                 manner=Manner(swing=0.6, heel=0.3, look_down=0.25))  # fmt: skip
CLIMB = Gait(step=0.24, speed=0.22, longest=0.34, footfalls=3, lift=0.22,
             manner=Manner(lean=0.16, swing=0.7, heel=0.25, bob=0.02, look_down=0.15))  # fmt: skip
# The deviations of an unsteady gait, the same each time: lateral, then along the way.
_STRAY = ((0.6, -0.4), (-1.0, 0.3), (0.2, 0.7), (1.0, -0.8), (-0.5, 0.2), (-0.2, -0.5))


def _straight(score: Score, cue: Cue, gait: Gait) -> None:
    """Go along the heading."""
    direction = float(np.sign(gait.step))
    length = abs(gait.step) * cue.style.step_length * cue.amplitude
    pace = (cue.speed or gait.speed) * (cue.tempo if cue.speed is None else 1.0)
    # People lengthen and quicken their steps together: length grows with the root of speed.
    length = min(length * np.sqrt(pace / gait.speed), gait.longest)
    footfalls = cue.count + (cue.count < 2) if cue.count else gait.footfalls
    if cue.distance is not None:
        if not cue.count:
            footfalls = max(2, int(np.ceil(cue.distance / length)) + 1)
        length = cue.distance / (footfalls - 1)
    start, side = score.center(), cue.side
    steps = []
    for i in range(footfalls):
        last = i == footfalls - 1
        x = direction * length * (i if last else i + 1)
        half = 0.5 * (STANCE_WIDTH if last else cue.style.step_width)
        if last and i:
            half += 0.5 * (STANCE_WIDTH - cue.style.step_width)
        y = half if side == "left" else -half
        if gait.unsteady and i < footfalls - 2:  # the last two find their feet
            aside, along = _STRAY[i % len(_STRAY)]
            outward = 1.0 if side == "left" else -1.0  # never across the other foot
            y += outward * gait.unsteady * length * abs(aside)
            x += 0.5 * gait.unsteady * length * along
        advance = direction * length * (1.0 if i == 0 or last else 2.0)
        time = gait.hurt if side != cue.side else 2.0 - gait.hurt
        steps.append(Step(side, ahead(start, x, y), advance, time=time, lift=gait.lift))
        side = other(side)
    lean = 0.08 * max(pace - 0.6, 0.0)  # the faster, the farther forward
    manner = replace(gait.manner, lean=gait.manner.lean + direction * lean)
    take_steps(score, steps, length / pace, cue, manner)


def walk(score: Score, cue: Cue) -> None:
    """Walk ahead: 4 footfalls, steps of 0.34 m at 0.4 m/s."""
    _straight(score, cue, WALK)


def walk_backward(score: Score, cue: Cue) -> None:
    """Walk back: 4 footfalls, steps of 0.18 m at 0.25 m/s."""
    _straight(score, cue, BACKWARD)


def stride(score: Score, cue: Cue) -> None:
    """Walk with long steps of 0.52 m."""
    _straight(score, cue, STRIDE)


def sneak(score: Score, cue: Cue) -> None:
    """Creep ahead, knees bent, feet lifted high and set down softly."""
    _straight(score, cue, SNEAK)


def limp(score: Score, cue: Cue) -> None:
    """Walk with short stances on the leg that hurts, leaning over the other."""
    _straight(score, cue, LIMP)


def stagger(score: Score, cue: Cue) -> None:
    """Walk unsteadily, with wide, uneven steps."""
    _straight(score, cue, STAGGER)


def step_over(score: Score, cue: Cue) -> None:
    """Lift one foot high over something low and bring the other after it."""
    for _ in range(cue.count or 1):
        _straight(score, replace(cue, count=2), STEP_OVER)


def climb_step(score: Score, cue: Cue) -> None:
    """Go up steps that are not there: the knee high, the body pulled after it."""
    count = (cue.count or CLIMB.footfalls - 1) + 1
    _straight(score, replace(cue, count=count), CLIMB)


def side_step(score: Score, cue: Cue) -> None:
    """Step aside and close, 3 times, 0.18 m each."""
    width = 0.18 * cue.style.step_length * min(cue.amplitude, 1.6)
    pairs = cue.count or 3
    if cue.distance is not None:
        if not cue.count:
            pairs = max(1, int(np.ceil(cue.distance / width)))
        width = cue.distance / pairs
    sign = 1.0 if cue.side == "left" else -1.0
    start, half = score.center(), 0.5 * STANCE_WIDTH
    steps = []
    for i in range(1, pairs + 1):
        steps.append(Step(cue.side, ahead(start, 0.0, sign * (i * width + half))))
        steps.append(Step(other(cue.side), ahead(start, 0.0, sign * (i * width - half))))
    step_time = 0.7 / cue.tempo if cue.speed is None else 0.5 * width / cue.speed
    take_steps(score, steps, step_time, cue)


def cross_step(score: Score, cue: Cue) -> None:
    """Go aside by crossing the far foot in front: a grapevine of 2 crossings."""
    width = 0.20 * cue.style.step_length * min(cue.amplitude, 1.4)
    sign = 1.0 if cue.side == "left" else -1.0
    far = other(cue.side)
    start, half = score.center(), 0.5 * STANCE_WIDTH
    steps, at = [], 0.0
    for _ in range(cue.count or 2):
        # The far foot goes in front of the near one, then the near one moves on from behind it.
        steps.append(Step(far, ahead(start, 0.25, sign * (at + half - 0.03))))
        at += width
        steps.append(Step(cue.side, ahead(start, 0.0, sign * (at + half))))
    steps.append(Step(far, ahead(start, 0.0, sign * (at - half))))
    take_steps(score, steps, 0.85 / cue.tempo, cue, Manner(swing=0.4, look_down=0.12))


def turn(score: Score, cue: Cue) -> None:
    """Turn on the spot by 90° with pairs of steps of 35° at most; the inner foot goes first."""
    angle = np.pi / 2 if cue.angle is None else cue.angle
    angle *= cue.count or 1
    pairs = max(1, int(np.ceil(angle / np.deg2rad(35.0) - 1e-9)))
    sign = 1.0 if cue.side == "left" else -1.0
    start, half = score.center(), 0.5 * STANCE_WIDTH
    steps = []
    for i in range(1, pairs + 1):
        facing = ahead(start, 0.0, 0.0, sign * angle * i / pairs)
        steps.append(Step(cue.side, ahead(facing, 0.0, sign * half)))
        steps.append(Step(other(cue.side), ahead(facing, 0.0, -sign * half)))
    begin = score.now
    take_steps(score, steps, 0.6 / cue.tempo, cue)
    # The head looks where the body is going to be.
    look = sign * min(0.5, 0.4 * angle)
    score.pulse("head_yaw", look, begin, begin + 0.3 * (score.now - begin), score.now)


def march(score: Score, cue: Cue) -> None:
    """Lift the knees in place, 4 times, arms swinging from the shoulder."""
    _march(score, cue, height=0.18, forward=0.10, step_time=0.9, manner=PLAIN)


def jog_in_place(score: Score, cue: Cue) -> None:
    """Lift the feet quickly in place, elbows bent, 8 times."""
    cue = replace(cue, count=cue.count or 8)
    _march(score, cue, height=0.10, forward=-0.04, step_time=0.5,
           manner=Manner(elbows=1.1, lean=0.08, crouch=0.04))  # fmt: skip


def _march(
    score: Score, cue: Cue, height: float, forward: float, step_time: float, manner: Manner
) -> None:
    side, steps = cue.side, []
    height *= cue.amplitude
    swing = 0.25 * cue.amplitude
    for _ in range(cue.count or 4):
        steps.append(Step(side, score.feet[side], lift=height))
        side = other(side)
    begin, step_time = score.now, step_time / cue.tempo
    take_steps(score, steps, step_time, cue, replace(manner, heel=0.35))
    # The shin hangs from the knee: the foot comes forward as it rises.
    first = begin + max(FIRST_SHIFT / cue.haste, DOUBLE_SUPPORT * step_time)
    for i, step in enumerate(steps):
        lifted = first + i * step_time
        top, landed = lifted + 0.375 * step_time, lifted + 0.75 * step_time
        for axis, part in (("x", np.cos), ("y", np.sin)):
            across = forward * cue.amplitude * part(score.feet[step.side].yaw)
            score.pulse(f"{step.side}_foot_{axis}", across, lifted + 0.1 * step_time, top,
                        landed - 0.1 * step_time)  # fmt: skip
        for arm, sign in ((step.side, -1.0), (other(step.side), 2.0)):
            if arm not in cue.busy_arms:
                angle = sign * swing * cue.style.arms
                score.pulse(f"{arm}_flexion", angle, lifted, top, landed)
                score.pulse(f"{arm}_elbow", 0.5 * abs(angle), lifted, top, landed)


def jog(score: Score, cue: Cue) -> None:
    """Jog ahead without leaving the floor, elbows bent: 8 footfalls at 0.9 m/s."""
    _straight(score, cue, JOG)
