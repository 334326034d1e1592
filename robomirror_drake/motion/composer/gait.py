"""Locomotion: actions that are plans of footsteps.

Every plan ends with the feet side by side, so that a gait of n footfalls covers n - 1 steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robomirror_drake.motion.composer.cue import Cue, other
from robomirror_drake.motion.composer.score import STANCE_WIDTH, Footprint, Score, ahead

DOUBLE_SUPPORT = 0.25
"""Share of a step during which both feet bear weight (J. Perry, "Gait Analysis", 1992: 0.2)."""
FIRST_SHIFT = 0.6
"""Time to bring the weight over the first stance foot, and back at the end [s]."""
ARM_SWING = 0.45
"""Shoulder flexion per metre between the feet [rad/m], each way."""


@dataclass(frozen=True)
class Step:
    """One swing: the foot, where it goes, and how much farther ahead of the other it gets [m]."""

    side: str
    to: Footprint
    advance: float = 0.0


def take_steps(score: Score, steps: list[Step], step_time: float, cue: Cue) -> None:
    """Write a plan of steps, one every ``step_time`` [s], with weight shifts and arm swing."""
    transfer = DOUBLE_SUPPORT * step_time
    lift = cue.style.step_height
    shift = max(FIRST_SHIFT, transfer)
    lifted = score.now + shift
    score.shift_load(_stance_share(steps[0].side), score.now, lifted)
    for i, step in enumerate(steps):
        if i:
            score.shift_load(_stance_share(step.side), lifted, lifted + transfer)
            lifted += transfer
        landed = lifted + step_time - transfer
        score.swing(step.side, step.to, lifted, landed, lift)
        swing = cue.style.arms * ARM_SWING * step.advance
        for arm, sign in ((step.side, -1.0), (other(step.side), 1.0)):
            if arm not in cue.busy_arms and swing:
                score.move(f"{arm}_flexion", sign * swing, lifted, landed)
        lifted = landed
    score.shift_load(0.5, lifted, lifted + shift)
    score.now = lifted + shift


def _stance_share(swinging: str) -> float:
    """The left foot's load while a foot swings."""
    return 0.0 if swinging == "left" else 1.0


def _straight(score: Score, cue: Cue, direction: float, step: float, longest: float, speed: float
              ) -> None:  # fmt: skip
    """Walk along the heading with steps of ``step`` [m] at ``speed`` [m/s]."""
    length = step * cue.style.step_length * cue.amplitude
    pace = (cue.speed or speed) * (cue.tempo if cue.speed is None else 1.0)
    # People lengthen and quicken their steps together: length grows with the root of speed.
    length = min(length * np.sqrt(pace / speed), longest)
    footfalls = cue.count + (cue.count < 2) if cue.count else 4
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
        y = half if side == "left" else -half
        if last and i:
            beside = 0.5 * (STANCE_WIDTH - cue.style.step_width)
            y += beside if side == "left" else -beside
        advance = direction * length * (1.0 if i == 0 or last else 2.0)
        steps.append(Step(side, ahead(start, x, y), advance))
        side = other(side)
    take_steps(score, steps, length / pace, cue)


def walk_forward(score: Score, cue: Cue) -> None:
    """Walk ahead: 4 footfalls, steps of 0.34 m at 0.4 m/s."""
    _straight(score, cue, 1.0, step=0.34, longest=0.50, speed=0.40)


def walk_backward(score: Score, cue: Cue) -> None:
    """Walk back: 4 footfalls, steps of 0.18 m at 0.25 m/s."""
    _straight(score, cue, -1.0, step=0.18, longest=0.26, speed=0.25)


def walk_sideways(score: Score, cue: Cue) -> None:
    """Step aside and close, 3 times, 0.18 m each."""
    width = 0.18 * cue.style.step_length * min(cue.amplitude, 1.3)
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
    count = cue.count or 4
    step_time = 0.9 / cue.tempo
    height = 0.18 * cue.amplitude
    transfer = DOUBLE_SUPPORT * step_time
    side, lifted = cue.side, score.now + FIRST_SHIFT
    score.shift_load(_stance_share(side), score.now, lifted)
    for i in range(count):
        if i:
            score.shift_load(_stance_share(side), lifted, lifted + transfer)
            lifted += transfer
        landed = lifted + step_time - transfer
        top = 0.5 * (lifted + landed)
        score.pulse(f"{side}_foot_z", height, lifted, top, landed)
        score.pulse(f"{side}_foot_heel", 0.35, lifted, top, landed)
        # The shin hangs from the knee: the foot comes forward as it rises.
        for axis, part in (("x", np.cos), ("y", np.sin)):
            forward = 0.10 * cue.amplitude * part(score.feet[side].yaw)
            score.pulse(f"{side}_foot_{axis}", forward, lifted + 0.1 * step_time, top,
                        landed - 0.1 * step_time)  # fmt: skip
        for arm, sign in ((side, -0.5), (other(side), 1.0)):
            if arm not in cue.busy_arms:
                swing = sign * 0.5 * cue.style.arms
                score.pulse(f"{arm}_flexion", swing, lifted, top, landed)
                score.pulse(f"{arm}_elbow", 0.5 * abs(swing), lifted, top, landed)
        lifted, side = landed, other(side)
    score.shift_load(0.5, lifted, lifted + FIRST_SHIFT)
    score.now = lifted + FIRST_SHIFT
