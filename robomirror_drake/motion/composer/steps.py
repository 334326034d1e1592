"""Footsteps: a plan of where the feet go becomes moves of feet, weight, trunk and arms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
PELVIS_TURN, CHEST_TURN = 0.08, -0.22
"""Turn of the pelvis with the leading leg, and of the chest against it [rad/m]."""
PathFunction = Callable[[float], Footprint]
"""Where the middle of the body is after a way [m]."""


@dataclass(frozen=True)
class Step:
    """One swing.

    Attributes:
        side: The foot.
        to: Where it goes.
        advance: How much farther ahead of the other it gets [m].
        time: Factor on the time of a step.
        lift: Height of the swing [m]; None for the style's.
    """

    side: str
    to: Footprint
    advance: float = 0.0
    time: float = 1.0
    lift: float | None = None


@dataclass(frozen=True)
class Manner:
    """How a plan of steps is walked.

    Attributes:
        crouch: How much lower the pelvis is [m].
        lean: Forward lean, half of the hips and half of the spine [rad].
        elbows: Flexion of the elbows over neutral [rad].
        swing: Factor on the swing of the arms.
        heel: Lift of the heel in swing [rad].
        bob: Dip of the pelvis in each double support [m].
        roll: Lean of the trunk towards the stance foot [rad].
        look_down: Pitch of the head [rad].
    """

    crouch: float = 0.0
    lean: float = 0.0
    elbows: float = 0.0
    swing: float = 1.0
    heel: float = 0.15
    bob: float = 0.0
    roll: float = 0.0
    look_down: float = 0.0


PLAIN = Manner()


def take_steps(
    score: Score, steps: Sequence[Step], step_time: float, cue: Cue, manner: Manner = PLAIN
) -> None:
    """Write a plan of steps, one every ``step_time`` [s], with weight shifts and arm swing."""
    transfer = DOUBLE_SUPPORT * step_time
    shift = max(FIRST_SHIFT / cue.haste, transfer)
    begin = score.now
    lifted = begin + shift
    score.shift_load(_stance_share(steps[0].side), begin, lifted)
    leant = 0.0
    for i, step in enumerate(steps):
        if i:
            score.shift_load(_stance_share(step.side), lifted, lifted + transfer)
            if manner.bob:
                middle = lifted + 0.5 * transfer
                score.pulse("pelvis_z", -manner.bob, lifted - 0.3 * step_time, middle,
                            middle + 0.5 * step_time)  # fmt: skip
            lifted += transfer
        landed = lifted + step.time * step_time - transfer
        lift = cue.style.step_height if step.lift is None else step.lift
        score.swing(step.side, step.to, lifted, landed, lift, manner.heel)
        leant = _sway(score, step, leant, manner, lifted, landed)
        _counter_swing(score, step, cue, manner, lifted, landed)
        lifted = landed
    score.shift_load(0.5, lifted, lifted + shift)
    score.now = lifted + shift
    if manner.roll:
        score.move("chest_roll", -leant, lifted, score.now)
    _carry(score, cue, manner, begin, lifted)


def _stance_share(swinging: str) -> float:
    """The left foot's load while a foot swings."""
    return 0.0 if swinging == "left" else 1.0


def _sway(
    score: Score, step: Step, leant: float, manner: Manner, start: float, end: float
) -> float:
    """Lean over the stance foot; returns the lean then."""
    lean = manner.roll if step.side == "left" else -manner.roll
    if manner.roll:
        score.move("chest_roll", lean - leant, start, end)
    return lean


def _counter_swing(
    score: Score, step: Step, cue: Cue, manner: Manner, start: float, end: float
) -> None:
    """The arms swing against the legs, and the chest turns against the pelvis."""
    if not step.advance:
        return
    swing = cue.style.arms * manner.swing * ARM_SWING * step.advance
    for arm, sign in ((step.side, -1.0), (other(step.side), 1.0)):
        if arm not in cue.busy_arms and swing:
            score.move(f"{arm}_flexion", sign * swing, start, end)
    leading = -1.0 if step.side == "left" else 1.0  # the left leg ahead turns to the right
    score.move("pelvis_yaw", leading * PELVIS_TURN * step.advance, start, end)
    score.move("chest_yaw", leading * CHEST_TURN * step.advance * cue.style.arms, start, end)


def _carry(score: Score, cue: Cue, manner: Manner, begin: float, end: float) -> None:
    """The bearing of trunk and arms, taken up with the first shift and given up with the last."""
    up, down = begin + FIRST_SHIFT / cue.haste, score.now
    moves = [("pelvis_z", -manner.crouch), ("pelvis_pitch", 0.5 * manner.lean),
             ("chest_pitch", 0.5 * manner.lean),
             ("head_pitch", manner.look_down - 0.6 * manner.lean)]  # fmt: skip
    moves += [(f"{arm}_elbow", manner.elbows) for arm in cue.free_arms]
    for channel, value in moves:
        if value:
            score.move(channel, value, begin, up)
            score.move(channel, -value, end, down)


def along_path(
    score: Score, path: PathFunction, length: float, stride: float, first: str, width: float
) -> list[Step]:
    """Alternating steps whose middle follows a path from where the body stands.

    Args:
        score: Where the feet are.
        path: The way, as seen from there.
        length: How far to go along it [m].
        stride: Longest step [m].
        first: The foot that starts.
        width: Distance of the feet on the way [m].
    """
    start = score.center()
    count = max(1, int(np.ceil(length / stride - 1e-9)))
    steps, side = [], first
    for i in range(count + 1):
        last = i == count
        here = path(length * min(i + 1, count) / count)
        sign = 1.0 if side == "left" else -1.0
        at = ahead(start, here.x, here.y, here.yaw)
        # The foot before the last came down at the width of the way.
        beside = STANCE_WIDTH - 0.5 * width if last else 0.5 * width
        to = ahead(at, 0.0, sign * beside)
        advance = (1.0 if i in (0, count) else 2.0) * length / count
        steps.append(Step(side, to, advance))
        side = other(side)
    return steps
