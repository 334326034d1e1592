"""Gauss–Newton with penalty continuation, then multipliers, for dynamic plans."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robomirror_drake.exceptions import PlanningError
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.plan_contacts import ConeOptions, anchors, wrench_cones
from robomirror_drake.optimization.plan_penalty import Penalty, Rows
from robomirror_drake.optimization.plan_problem import GROUPS, Evaluation, Problem
from robomirror_drake.optimization.plan_torque import split_of

_CONTINUATION = (0.1, 0.1, 0.1, 0.3, 1.0, 3.0, 10.0, 20.0)
_SPLITS = (4, 7)  # levels at whose start the feet share the wrench anew
_STEPS = (1.0, 0.5, 0.25, 0.1, 0.03)
_PENALTY = {
    "wrench": Penalty(30.0, 2e-3),
    "corners": Penalty(1000.0, 1e-3),
    "speed": Penalty(1.0, 2e-3),
    "torque": Penalty(10.0, 2e-3),
    "gaps": Penalty(300.0, 1e-4),
}
_MULTIPLIER_LIMIT = 50.0
_LEAST_DAMPING = 1e-4
_DECREASE = 2e-2  # expected decrease of the cost at which iterations may end,
_SETTLED = 0.1  # and at which multipliers are updated
_BOUND_WEIGHT = 1e9  # holds a control point at its limit while the others move


class Standing(NamedTuple):
    """The contacts of a problem, whose anchors follow the feet at first.

    Attributes:
        contact, loaded: (T, 2, 4) corners that stand, and that may bear load.
        least: (T, 2, 4) least height of corners in the air [m].
        cone: Options of the wrench cones.
        torque_share: Of the joints' torque limits that may be planned with.
        slack: (T,) how far outside them the wrench may be.
    """

    contact: BoolArray
    loaded: BoolArray
    least: Array
    cone: ConeOptions
    torque_share: float
    slack: Array


class Solution(NamedTuple):
    """A plan's control points, its last evaluation and the problem with its last anchors."""

    control: Array
    evaluation: Evaluation
    problem: Problem


def anchored(problem: Problem, standing: Standing, points: Array) -> Problem:
    """The problem with its stance rows and cones at the mean poses of the soles in ``points``."""
    corners = points[:, :8].reshape(-1, 2, 4, 3)
    placed = anchors(corners, standing.contact.copy(), problem.robot.sole_corners)
    stands = standing.contact[..., None]
    air = np.full_like(placed, -np.inf)
    air[..., 2] = standing.least
    lower, upper = np.where(stands, placed, air), np.where(stands, placed, np.inf)
    cones = wrench_cones(placed, standing.loaded, standing.cone)
    slack = standing.slack[:, None]
    rows = {
        **problem.rows,
        "corners": Rows(lower.reshape(-1, 24), upper.reshape(-1, 24)),
        "wrench": Rows(cones.lower - slack, cones.upper + slack),
    }
    return replace(problem, rows=rows, cones=cones)


def shared(problem: Problem, standing: Standing, at: Evaluation) -> Problem:
    """The problem with torques for the split of the wrench that is needed at ``at``."""
    corners = at.points[:, :8].reshape(-1, 2, 4, 3)
    placed = anchors(corners, standing.contact, problem.robot.sole_corners)
    split = split_of(at.wrench, placed, standing.loaded, standing.cone)
    most = np.full_like(problem.rows["torque"].upper, standing.torque_share)
    return replace(problem, split=split, rows={**problem.rows, "torque": Rows(-most, most)})


def solve(
    problem: Problem,
    standing: Standing,
    control: Array,
    limits: tuple[Array, Array],
    *,
    iterations: int,
    tolerance: float,
) -> Solution:
    """Solves a plan from a first guess.

    Until the penalties have reached their full weight, the anchors follow the feet.

    Args:
        problem: The problem; its contact rows are made here.
        standing: The contacts.
        control: (K, 30) first guess.
        limits: (30,), (30,) bounds of the control points, and so of the trajectory.
        iterations: Most Gauss–Newton steps.
        tolerance: Constraint violation at which a small step ends the iterations.

    Raises:
        PlanningError: The Gauss–Newton matrix could not be factorized.
    """
    control = np.clip(control, *limits)
    multipliers = {name: np.zeros_like(problem.rows[name].lower) for name in GROUPS}
    points = problem.target_points
    damping, level, last = 0.0, 0, len(_CONTINUATION) - 1
    for _ in range(iterations):
        if level < last:
            problem = anchored(problem, standing, points)
        penalty = {
            name: Penalty(_CONTINUATION[level] * stiffness, barrier)
            for name, (stiffness, barrier) in _PENALTY.items()
        }
        now = problem.evaluate(control, penalty, multipliers, derivatives=True)
        step, expected = _newton_step(now, control, limits, damping)
        for length in _STEPS:
            trial = np.clip(control + length * step, *limits)
            reached = problem.evaluate(trial, penalty, multipliers, derivatives=False)
            if reached.cost < now.cost:
                control, points = trial, reached.points
                break
        else:
            length, reached = 0.0, now
        damping = _damping_after(damping, length)
        if level < last:
            level += length >= 0.5
            if level in _SPLITS and length >= 0.5:
                problem = shared(problem, standing, reached)
        elif expected < _DECREASE and violation(problem, reached.values) < tolerance:
            break
        elif expected < _SETTLED:
            multipliers = _updated(problem, reached.values, multipliers, penalty)
    return Solution(control, reached, problem)


def violation(problem: Problem, values: dict[str, Array]) -> float:
    """Largest distance of any row from its bounds."""
    return max(
        float(np.max(np.abs(y - np.clip(y, *problem.rows[name])))) for name, y in values.items()
    )


def _damping_after(damping: float, length: float) -> float:
    """More damping where only short steps were good, less where the full one was."""
    if length <= 0.1:
        return 10.0 * max(damping, _LEAST_DAMPING)
    return damping / 10.0 if length == 1.0 and damping > _LEAST_DAMPING else damping


def _newton_step(
    at: Evaluation, control: Array, limits: tuple[Array, Array], damping: float
) -> tuple[Array, float]:
    """The step (K, 30) and the decrease of the cost that the quadratic model expects of it."""
    if at.band is None or at.gradient is None:
        raise ValueError("the evaluation carries no derivatives")
    band, gradient = at.band.copy(), at.gradient.copy()
    held = ((control <= limits[0]) & (gradient > 0.0)) | ((control >= limits[1]) & (gradient < 0.0))
    band[:, 0] *= 1.0 + damping
    band[:, 0] += 1e-6 + _BOUND_WEIGHT * held.ravel()
    gradient[held] = 0.0
    try:
        step = -spline.substitute(spline.factorize(band), gradient.ravel())
    except np.linalg.LinAlgError as error:
        raise PlanningError(f"no plan: {error}", {"cost": at.cost}) from error
    return step.reshape(control.shape), -0.5 * float(gradient.ravel() @ step)


def _updated(
    problem: Problem,
    values: dict[str, Array],
    multipliers: dict[str, Array],
    penalty: dict[str, Penalty],
) -> dict[str, Array]:
    new = {}
    for name in GROUPS:
        lower, upper = problem.rows[name]
        moved = multipliers[name] + penalty[name].stiffness * (values[name] - lower)
        limit = _MULTIPLIER_LIMIT * _PENALTY[name].stiffness
        new[name] = np.where(lower == upper, np.clip(moved, -limit, limit), 0.0)
    return new
