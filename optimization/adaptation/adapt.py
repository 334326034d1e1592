"""References changed until they are judged safe, and no more than that takes.

For every reference :func:`adapt` solves the problem of :mod:`.problem` from several
starting points, all in one batch, and takes the least changed of those that are safe. The
result is sampled at the reference's own rate and judged once more: only that counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.special import expit

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.adaptation.explain import Explanation, explain
from robomirror_drake.optimization.adaptation.legs import Legs, make_legs
from robomirror_drake.optimization.adaptation.options import AdaptOptions, Beginning
from robomirror_drake.optimization.adaptation.problem import (
    STEP,
    Goal,
    Judge,
    Problem,
    asked,
    fall_ceiling,
    make_problem,
)
from robomirror_drake.optimization.adaptation.reference import adapted_reference
from robomirror_drake.optimization.adaptation.sqp import FEASIBLE, Solution, Start, solve
from robomirror_drake.optimization.retargeting.retarget import robot_tables
from robomirror_drake.robot import Robot

__all__ = ["AdaptOptions", "Adapted", "Goal", "Judge", "adapt"]

_OVER = 0.05  # of a joint's limit, between samples [rad], share of its speed
_LESS = 0.25  # of tempo, amplitude and stride at another start


class Adapted(NamedTuple):
    """An adapted reference.

    Attributes:
        reference: At the command's rate; for a dynamic plan to be made from.
        risk: P(fall) that the judge gives to exactly this reference.
        safe: Whether that is no more than 1 − T_safe and all else that must be kept is kept.
        explanation: Why and what was changed.
        solution: What the solver found.
    """

    reference: RobotReference
    risk: float
    safe: bool
    explanation: Explanation
    solution: Solution


@lru_cache(maxsize=8)
def robot_legs(robot: Robot) -> Legs:
    """The legs of a robot, worked out once."""
    return make_legs(robot)


def adapt(
    robot: Robot,
    references: Sequence[RobotReference],
    judge: Judge,
    goals: Sequence[Goal] = (),
    options: AdaptOptions | None = None,
    history: Any = None,
) -> list[Adapted]:
    """Adapts references, each with the least change that makes it safe.

    Args:
        robot: The robot.
        references: Commands, kinematic, at a constant rate.
        judge: Of the risk of a fall; asked once an iteration for all.
        goals: What the commands mean, to be kept by each.
        options: See :class:`AdaptOptions`.
        history: What the judge takes for the robot's past; None for a robot at rest.

    Returns:
        One result for each reference, in order.

    Raises:
        InputError: A reference is too short, nothing in it can change, or the judge's answer is
            not finite.
        RobotModelError: The robot's legs are not of six joints.
    """
    options = options or AdaptOptions()
    if not references:
        return []
    legs = robot_legs(robot)
    problems = [make_problem(robot, legs, one, goals, options) for one in references]
    starts = [
        Start(problem, _beginning(problem, name)) for problem in problems for name in options.starts
    ]
    solutions = solve(starts, judge, options, history)
    per = len(options.starts)
    limit = fall_ceiling(options)
    best = [
        min(solutions[i : i + per], key=lambda one: _rank(one, limit))
        for i in range(0, len(solutions), per)
    ]
    made = [adapted_reference(robot_tables(robot), s.problem, s.point.z) for s in best]
    logits = _again(judge, made, [s.problem for s in best], history)
    return [
        Adapted(
            reference,
            float(expit(logit)),
            bool(logit <= limit and _kept(solution) and _within(robot, reference)),
            explain(robot, solution),
            solution,
        )
        for reference, logit, solution in zip(made, logits, best, strict=True)
    ]


def _beginning(problem: Problem, name: Beginning) -> Array:
    """(X,) variables to start from."""
    layout = problem.layout
    z = np.zeros(layout.size)
    if name in ("slower", "both") and "tempo" in layout.blocks:
        z[layout.blocks["tempo"]] = _LESS / layout.scale[layout.blocks["tempo"]]
    if name in ("smaller", "both"):
        for block in ("amplitude", "stride"):
            if block in layout.blocks:
                z[layout.blocks[block]] = -_LESS / layout.scale[layout.blocks[block]]
    return np.clip(z, layout.lower, layout.upper)


def _kept(solution: Solution) -> bool:
    """Whether all that must be kept, the risk of a fall apart, is."""
    return bool(solution.point.violations(solution.problem.ceiling)[1:].max() <= 10.0 * FEASIBLE)


def _within(robot: Robot, reference: RobotReference) -> bool:
    """Whether joints keep their limits between the judge's samples too."""
    joints, speed = reference.q[:, 7:], np.abs(reference.v[:, 6:])
    lower, upper = robot.position_limits
    over = max(float((lower - joints).max()), float((joints - upper).max()))
    return over < _OVER and float((speed / robot.velocity_limits).max()) < 1.0 + _OVER


def _rank(solution: Solution, limit: float) -> tuple[bool, float]:
    """Safe ones first, then by cost; of the others the least risk first."""
    safe = solution.point.logit <= limit and _kept(solution)
    return not safe, solution.point.cost if safe else solution.point.logit


def _again(
    judge: Judge, references: Sequence[RobotReference], problems: Sequence[Problem], history: Any
) -> Array:
    """(n,) logits of references as they are, at the judge's rate."""
    motions = []
    for reference, problem in zip(references, problems, strict=True):
        time = np.append(np.arange(0.0, reference.duration, STEP), reference.duration)
        rows = reference.rows_at(time[: problem.seen])
        motions.append((reference.q[rows], reference.contact[rows]))
    return np.array([logit for logit, _ in asked(judge, motions, history)])
