"""From a motion that runs into danger to one that goes on safely, or stops.

What is foreseen beyond the next moments is the kinematic reference's; the robot is taken to
keep its distance to the plan until the hand-over. Among the continuations the ranking chooses;
where none of them is safe enough, a halt counts too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logit

from robomirror_drake.exceptions import InputError, PlanningError, UnknownCommandError
from robomirror_drake.goals import Satisfaction, make_goals, measure
from robomirror_drake.handover_options import AdapterOptions
from robomirror_drake.messages import Array, Handover, QualityPrediction, RobotReference
from robomirror_drake.motion.text import parse
from robomirror_drake.optimization.continuation import (
    Change,
    Course,
    changed,
    foreseen,
    handed_over,
    remainder,
    stopped,
)
from robomirror_drake.ppn.features import RECORDED
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.ranking import rank
from robomirror_drake.robot import Robot

_LEAST = 0.5  # of a motion that must be left for a change to be worth it [s]


class Known(NamedTuple):
    """What is known of the robot: times (S,) [s], the last one now, and its history then."""

    time: Array
    history: History


class _Candidates(NamedTuple):
    """Ways to go on from a hand-over; names and changes where there are any, halts last."""

    motions: list[RobotReference]
    names: list[str]
    changes: list[Change]
    going: int  # how many of them, from the first, are no halt


class Look(NamedTuple):
    """What was seen ahead of a motion that runs.

    Attributes:
        risk: P(fall) of the motion as it is.
        handover: What was decided; None where that is safe enough.
        course: What runs from now on; the old one where nothing better was found.
    """

    risk: float
    handover: Handover | None
    course: Course


def risk(
    predictor: Predictor,
    motions: Sequence[RobotReference],
    start: float,
    history: History,
    ahead: float,
) -> QualityPrediction:
    """What becomes of motions from a time on: risk and errors over windows that begin in ``ahead``.

    Args:
        predictor: What foresees falls.
        motions: Kinematic references; their ends are held.
        start: Time in each of them that is now [s].
        history: Of the robot.
        ahead: Time in which windows begin [s].
    """
    options = predictor.options
    count = round((ahead + options.horizon) * options.rate) + 1
    frames = np.round((start + np.arange(count) / options.rate) * RECORDED).astype(int)
    rows = [np.minimum(frames, len(motion.time) - 1) for motion in motions]
    return predictor.foresee(
        np.stack([motion.q[row] for motion, row in zip(motions, rows, strict=True)]),
        np.stack([motion.contact[row] for motion, row in zip(motions, rows, strict=True)]),
        history,
        ahead,
    )


def decide(
    robot: Robot,
    predictor: Predictor,
    course: Course,
    known: Known,
    options: AdapterOptions | None = None,
) -> Look | None:
    """Looks ahead, and decides what to do about a motion that is not safe enough.

    Args:
        robot: The robot.
        predictor: What foresees falls.
        course: What runs.
        known: Of the robot until now, in the time of the course.
        options: See :class:`AdapterOptions`.

    Returns:
        What was seen; None where there is nothing to be decided any more, so near to the end.
    """
    options = options or AdapterOptions()
    now = float(known.time[-1])
    # The hand-over is at a sample of the plan: there its state is known exactly.
    frame = int(np.ceil((now + options.latency) / course.step - 1e-6))
    if len(course.plan.time) - frame < _LEAST / course.step:
        return None
    foresight = risk(predictor, [course.commanded], now, known.history, options.ahead)
    before = float(foresight.fall_probability[0])
    if before <= options.allowed:
        return Look(before, None, course)
    start = frame * course.step
    candidates = _candidates(robot, remainder(course.commanded, frame), options)
    back = known.time - now
    then = History(
        *foreseen(known.time, known.history.q, known.history.v, course.plan, start + back)
    )
    foresight = risk(predictor, candidates.motions, 0.0, then, options.ahead)
    falls = foresight.fall_probability
    order, reasons = _order(robot, course, frame, candidates, foresight, options)
    better = logit(falls) <= logit(falls[0]) - options.margin
    if falls[0] >= options.hopeless and not better.any():
        better[candidates.going :] = True
    best: tuple[float, int, Course] | None = None
    for i in [i for i in order if better[i]][: options.attempts]:
        try:
            made = handed_over(robot, course, frame, candidates.motions[i], options.planner)
        except PlanningError:
            continue
        violation = made.plan.residuals["dynamic_violation"]
        if best is None or violation < best[0]:
            best = violation, i, made
        if violation <= options.planner.feasible:
            break
    taken = 0 if best is None else best[1]
    told = (
        f"P(fall) {before:.1%}, allowed {options.allowed:.1%}; {candidates.names[taken]}"
        f" from {start:.2f} s on: {reasons[taken]}"
    )
    change = candidates.changes[taken]
    handover = Handover(
        time=now,
        start=start,
        done=best is not None,
        stopped=taken >= candidates.going,
        **change._asdict(),
        risk_before=before,
        risk_after=float(falls[taken]),
        names=tuple(candidates.names),
        risks=falls,
        reason=told,
    )
    return Look(before, handover, course if best is None else best[2])


def _candidates(robot: Robot, rest: RobotReference, options: AdapterOptions) -> _Candidates:
    """The remainder as it is, its continuations, and halts."""
    changes = [Change(c.tempo, c.amplitude, c.stride) for c in options.continuations]
    halts = stopped(rest, options.soonest, options.braking, options.settling, options.halts)
    same = Change(1.0, 1.0, 1.0)
    return _Candidates(
        [rest, *changed(robot, rest, changes), *halts],
        ["as it is", *map(_name, changes), *(f"halt {i + 1}" for i in range(len(halts)))],
        [same, *changes, *[same] * len(halts)],
        1 + len(changes),
    )


def _name(change: Change) -> str:
    shares = (f"{name} {share:.0%}" for name, share in change._asdict().items() if share < 1.0)
    return ", ".join(shares) or "as it is"


def _order(
    robot: Robot,
    course: Course,
    frame: int,
    candidates: _Candidates,
    foresight: QualityPrediction,
    options: AdapterOptions,
) -> tuple[list[int], list[str]]:
    """Indices of candidates, the best first, and a reason for each of all.

    What goes on safely comes first, by its quality; then all that is left, by its risk.
    """
    going, falls = candidates.going, foresight.fall_probability
    part = QualityPrediction(
        foresight.horizon,
        *(
            getattr(foresight, name)[:going]
            for name in ("fall_probability", "A_q", "A_qd", "A_qdd", "A_p", "A_theta")
        ),
    )
    motions = candidates.motions[:going]
    done = _satisfactions(robot, course, frame, motions)
    strict = options.ranking.model_copy(update={"t_safe": 1.0 - options.aim})
    ranking = rank([motion.residuals for motion in motions], part, done, strict)
    safe = [int(i) for i in ranking.order if ranking.safe[i]]
    rest = [int(i) for i in np.argsort(falls, kind="stable") if int(i) not in safe]
    halts = [f"nothing goes on safely; P(fall) {falls[i]:.1%}" for i in range(going, len(falls))]
    return [*safe, *rest], [*ranking.reasons, *halts]


def _satisfactions(
    robot: Robot, course: Course, frame: int, motions: Sequence[RobotReference]
) -> list[Satisfaction] | None:
    """How well what was done already and each motion together do what the command means."""
    begun = course.commanded.q
    try:
        goals = make_goals(robot, parse(course.commanded.text), begun)
    except (InputError, UnknownCommandError):
        return None
    return [measure(robot, goals, np.concatenate([begun[:frame], m.q])) for m in motions]
