"""What was made of a command, for its result; and what would have happened without it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from robomirror_drake.adaptation.command import Adaptation
from robomirror_drake.adaptation.motion_measures import compare, told
from robomirror_drake.adaptation.record import (
    AdaptationRecord,
    HandoverRecord,
    Original,
    RankedCandidate,
    Task,
)
from robomirror_drake.config import Scenario
from robomirror_drake.fall_cause import judge
from robomirror_drake.goals import measure
from robomirror_drake.messages import (
    Execution,
    Foresight,
    Handover,
    HumanMotion,
    RobotReference,
)
from robomirror_drake.optimization.adaptation.continuation import begun
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.ppn.features import RECORDED
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.robot import Robot
from robomirror_drake.rollout import rollout

EVERY = 0.1
"""From one look ahead to the next [s]."""


def record_of(
    robot: Robot,
    scenario: Scenario,
    made: Adaptation,
    references: Sequence[RobotReference],
    motions: Sequence[HumanMotion],
    done: Execution | None = None,
) -> AdaptationRecord:
    """An adaptation in plain figures.

    Args:
        robot: The robot.
        scenario: By which it was adapted.
        made: What was done.
        references: The candidates, the command's own motion first.
        motions: The human motions that these were made from, by their ``source``.
        done: What the robot did; None where it fell, which does no task.
    """
    sources = [motion.source for motion in motions]
    numbers = [sources.index(reference.source) for reference in references]
    options, ranking = scenario.adaptation, made.ranking
    places = np.argsort(ranking.order)
    candidates = [
        RankedCandidate(
            number=numbers[i],
            place=int(places[i]) + 1,
            scores=tuple(float(score) for score in ranking.scores[i]),
            quality=float(ranking.quality[i]),
            fall_probability=float(1.0 - ranking.scores[i, 2]),
            safe=bool(ranking.safe[i]),
            reason=ranking.reasons[i],
        )
        for i in range(len(ranking.reasons))
    ]
    return AdaptationRecord(
        method=options.method,
        weights=" and ".join(options.predictor),
        underway=options.adapter.predictor,
        how=made.how,
        number=numbers[made.candidate],
        changed=made.changed is not None or made.candidate != 0,
        risk_before=made.risk_before,
        risk=made.risk,
        allowed=1.0 - options.ranking.t_safe,
        reason=_sentence(robot, made, references[0], 1.0 - options.ranking.t_safe),
        candidates=tuple(candidates),
        tasks=_tasks(robot, made, references[0], done),
        explanation=None if made.changed is None else made.changed.explanation,
    )


def _sentence(robot: Robot, made: Adaptation, own: RobotReference, allowed: float) -> str:
    """What was changed and why; of a candidate that was chosen, how it differs."""
    if made.changed is not None or made.candidate == 0:
        return made.reason[:1].upper() + made.reason[1:]
    apart = told(compare(robot, own, made.reference))
    taken = f"candidate {made.candidate}" + (f" ({apart})" if apart else "")
    begin = "C" + taken[1:] if made.how == "selected" else f"Nothing safe was found; {taken}"
    return (
        f"{begin} is done instead of the command's own motion: the predicted risk of a fall"
        f" goes from {100.0 * made.risk_before:.0f} % to {100.0 * made.risk:.0f} %, allowed are"
        f" {100.0 * allowed:.0f} %."
    )


def _tasks(
    robot: Robot, made: Adaptation, own: RobotReference, done: Execution | None
) -> tuple[Task, ...]:
    """What the command means, in its own motion, in the one that was taken, and as done."""
    if made.goals is None or made.satisfaction is None:
        return ()
    before, taken = measure(robot, made.goals, own.q).measured, made.satisfaction.measured
    tasks = [
        Task(now.predicate.sentence, now.predicate.unit, was.value, now.value, now.met)
        for was, now in zip(before, taken, strict=True)
    ]
    if done is None:
        return tuple(tasks)
    real = measure(robot, made.goals, done.q).measured
    return tuple(
        replace(task, executed=one.value, done=one.met)
        for task, one in zip(tasks, real, strict=True)
    )


class Judges(NamedTuple):
    """What foresees falls, of motions that have yet to begin and of those that run."""

    beforehand: Predictor | Ensemble
    underway: Predictor


def foresight(judges: Judges, led: RobotReference, execution: Execution) -> Foresight:
    """P(fall) over the time of an execution, as it looked beforehand and on the way.

    Args:
        judges: What foresees falls.
        led: The kinematic reference in the time of the execution.
        execution: What the robot did.
    """
    times = np.arange(0.0, min(execution.time[-1], led.duration), EVERY)
    risks: list[list[float]] = []
    followed: tuple[RobotReference | Execution, ...] = led, execution
    for predictor, moved in zip(judges, followed, strict=True):
        options = predictor.options
        back = round(RECORDED / options.rate) * np.arange(1 - options.back, 1)
        risks.append([])
        for time in times:
            at = np.clip(round(time * RECORDED) + back, 0, len(moved.time) - 1)
            history = History(moved.q[at], moved.v[at])
            said = predictor.predict([led], float(time), history)
            risks[-1].append(float(said.fall_probability[0]))
    beforehand, underway = map(np.array, risks)
    return Foresight(times, beforehand, underway, judges.underway.options.horizon)


def execute_own(
    robot: Robot,
    scenario: Scenario,
    judges: Judges,
    own: RobotReference,
    progress: Callable[[float, float], None],
) -> Original:
    """The command's own motion in the same physics, with the same seed.

    Raises:
        PlanningError: There is no dynamic plan of it.
        SimulationError: The physics diverged before a fall was on record.
    """
    plan = plan_dynamics(robot, own, scenario.planner)
    done = rollout(robot, plan, scenario.simulation, scenario.seed, progress)
    outcome = judge(robot, done, plan, scenario.simulation)
    seen = foresight(judges, begun(own, plan).commanded, done)
    return Original(plan, done, outcome, seen)


def handover_records(handovers: Sequence[Handover]) -> tuple[HandoverRecord, ...]:
    """What was decided while a motion ran, in plain figures."""
    names = [field.name for field in fields(HandoverRecord)]
    return tuple(
        HandoverRecord(**{name: getattr(handover, name) for name in names})
        for handover in handovers
    )
