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

from robomirror_drake.adaptation.command import goals_of
from robomirror_drake.adaptation.handover_options import AdapterOptions
from robomirror_drake.adaptation.ranking import rank
from robomirror_drake.exceptions import PlanningError
from robomirror_drake.goals import Satisfaction, measure
from robomirror_drake.messages import Array, Handover, QualityPrediction, RobotReference
from robomirror_drake.optimization.adaptation.continuation import (
    Change,
    Course,
    changed,
    foreseen,
    handed_over,
    remainder,
    stopped,
)
from robomirror_drake.ppn.predictor import History, Predictor, sampled
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
    q, contact = sampled(motions, start + np.arange(count) / options.rate)
    return predictor.foresee(q, contact, history, ahead)


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
    candidates = _candidates(robot, course, frame, options)
    back = known.time - now
    then = History(
        *foreseen(known.time, known.history.q, known.history.v, course.plan, start + back)
    )
    foresight = risk(predictor, candidates.motions, 0.0, then, options.ahead)
    falls = foresight.fall_probability
    order, reasons = _order(robot, course, frame, candidates, foresight, options)
    best: tuple[float, int, Course] | None = None
    for i in order[: options.attempts]:
        if i == 0:
            break
        try:
            made = handed_over(
                robot,
                course,
                frame,
                candidates.motions[i],
                options.planner,
                candidates.changes[i],
            )
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


def _candidates(robot: Robot, course: Course, frame: int, options: AdapterOptions) -> _Candidates:
    """The remainder from a sample on as it is, its continuations, and halts."""
    rest = remainder(course.commanded, frame)
    least = options.least.model_dump().values()
    changes = [Change(c.tempo, c.amplitude, c.stride) for c in options.continuations]
    changes = [
        change
        for change in changes
        if all(a >= b for a, b in zip(change.after(course.change), least, strict=True))
    ]
    halts = stopped(rest, options.soonest, options.braking, options.settling, options.halts)
    return _Candidates(
        [rest, *changed(robot, rest, changes), *halts],
        ["as it is", *map(_name, changes), *(f"halt {i + 1}" for i in range(len(halts)))],
        [Change(), *changes, *[Change()] * len(halts)],
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
    """Indices of candidates to be taken, the best first, and a reason for each of all of them.

    First comes what goes on safely by a margin, by its quality less what it changes; then what
    goes on safely; then halts that are safer, if the motion is about to be lost; then what else is
    safer.
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
    worth = ranking.quality - [
        options.keeping * change.size for change in candidates.changes[:going]
    ]
    by_worth = [int(i) for i in np.argsort(-worth, kind="stable")]
    by_risk = [int(i) for i in np.argsort(falls, kind="stable")]
    better = [i for i in by_risk if logit(falls[i]) <= logit(falls[0]) - options.margin]
    order = [i for i in by_worth if ranking.safe[i]]  # with what is there, where it will do
    order += [i for i in better if i < going and falls[i] <= options.allowed]
    if falls[0] >= options.halting:
        order += [i for i in better if i >= going]  # to stop and fall is worse than to go on
    order += [i for i in better if i < going]
    if done is not None and done[0].done and falls[0] < options.halting:
        # Too little is at stake to give up what is meant.
        order = [i for i in order if done[i].done]
    halts = [f"nothing goes on safely; P(fall) {falls[i]:.1%}" for i in range(going, len(falls))]
    return list(dict.fromkeys(order)), [*ranking.reasons, *halts]


def _satisfactions(
    robot: Robot, course: Course, frame: int, motions: Sequence[RobotReference]
) -> list[Satisfaction] | None:
    """How well what was done already and each motion together do what the command means."""
    goals = goals_of(robot, course.asked.text, course.asked)
    if goals is None:
        return None
    begun = course.commanded.q[:frame]
    return [measure(robot, goals, np.concatenate([begun, motion.q])) for motion in motions]
