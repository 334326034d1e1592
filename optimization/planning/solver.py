"""Levenberg–Marquardt with penalty continuation, then multipliers, for dynamic plans."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.planning.contacts import ConeOptions, anchors, wrench_cones
from robomirror_drake.optimization.planning.frames import soles
from robomirror_drake.optimization.planning.penalty import Penalty, Rows
from robomirror_drake.optimization.planning.problem import GROUPS, Evaluation, Problem
from robomirror_drake.optimization.planning.step import StepModel
from robomirror_drake.optimization.planning.torque import split_of
from robomirror_drake.optimization.retargeting.footholds import planar_rotation

_CONTINUATION = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
NEAR, WARM = 3, 5
"""Levels at which to begin with a fair guess, and with one that nearly is a plan."""

_SPLITS = (2, 5)  # levels at whose start the feet share the wrench anew
_PENALTY = {
    "wrench": Penalty(30.0, 2e-3),
    "corners": Penalty(1000.0, 1e-3),
    "speed": Penalty(1.0, 2e-3),
    "torque": Penalty(10.0, 2e-3),
    "gaps": Penalty(300.0, 1e-4),
    "limits": Penalty(300.0, 1e-4),
}
_MULTIPLIER_LIMIT = 50.0
_UPDATES = 1  # of the multipliers, at most
_SETTLED = 0.02  # share of the cost: a smaller expected decrease ends a round of steps
_DAMPING = 1e-3  # to begin with,
_LEAST_DAMPING = 1e-5
_MOST_DAMPING = 1e3
_AGREEMENT = 0.25  # of the decrease with the expected one, above which penalties may rise


class Standing(NamedTuple):
    """The contacts of a problem, whose anchors follow the feet at first.

    Attributes:
        contact, loaded: (T, 2, 4) corners that stand, and that may bear load.
        path: (T, 2, 4, 3) corners of the soles in the reference [m].
        least: (T, 2, 4) least height of corners in the air [m].
        cone: Options of the wrench cones.
        torque_share: Of the joints' torque limits that may be planned with.
        slack: (T,) how far outside them the wrench may be.
        held: (2, 4, 3) where the soles are that stand from the start on [m], if that is given.
    """

    contact: BoolArray
    loaded: BoolArray
    path: Array
    least: Array
    cone: ConeOptions
    torque_share: float
    slack: Array
    held: Array | None = None


class Solution(NamedTuple):
    """A plan's control points, its evaluation, the problem with its last anchors, iterations."""

    control: Array
    evaluation: Evaluation
    problem: Problem
    iterations: int


def placed_feet(problem: Problem, standing: Standing, corners: Array) -> Array:
    """(T, 2, 4, 3) anchors of the soles, of which the first phase's are where they are held."""
    sole = problem.robot.sole_corners
    placed = anchors(corners, standing.contact, sole, standing.path)
    if standing.held is None:
        return placed
    for foot in range(2):
        stands: BoolArray = np.asarray(standing.contact[:, foot].any(axis=1))
        if stands[0]:
            end = len(stands) if stands.all() else int(np.argmin(stands))
            placed[:end, foot] = moved_onto(placed[:end, foot], standing.held[foot])
    return placed


def moved_onto(phase: Array, held: Array) -> Array:
    """(T, 4, 3) corners moved and turned on the floor so that the first are where ``held`` is."""
    middle, there = phase[0, :, :2].mean(axis=0), held[:, :2].mean(axis=0)
    a, b = phase[0, 0, :2] - middle, held[0, :2] - there
    angle = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
    moved = phase.copy()
    moved[..., :2] = there + (phase[..., :2] - middle) @ planar_rotation(angle).T
    return moved


def anchored(problem: Problem, standing: Standing, points: Array) -> Problem:
    """The problem with its stance rows and cones at the mean poses of the soles in ``points``."""
    placed = placed_feet(problem, standing, soles(points))
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
    placed = placed_feet(problem, standing, soles(at.points))
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
    level: int = 0,
) -> Solution:
    """Solves a plan from a first guess by the method of Levenberg and Marquardt.

    Until the penalties have reached their full weight, the anchors follow the feet.

    Args:
        problem: The problem; its contact rows are made here.
        standing: The contacts.
        control: (K, 30) first guess.
        limits: (30,), (30,) bounds of the control points, and so of the trajectory.
        iterations: Most linearizations.
        tolerance: Constraint violation at which the iterations end.
        level: Of the continuation at which to begin; ``NEAR`` or ``WARM``
            with a guess that is no kinematic reference.

    Raises:
        PlanningError: The Gauss–Newton matrix could not be factorized.
    """
    fixed = control[: problem.fixed]
    control = np.concatenate([fixed, np.clip(control[len(fixed) :], *limits)])
    start = problem.evaluate(control)
    problem = anchored(problem, standing, start.points if level > 0 else problem.target_points)
    if level >= _SPLITS[0]:
        problem = shared(problem, standing, start)
    multipliers = {name: np.zeros_like(problem.rows[name].lower) for name in GROUPS}
    last, updates = len(_CONTINUATION) - 1, 0
    damping, growth = _DAMPING, 2.0
    at = problem.linearize(control)
    taken = 0
    while taken < iterations and damping < _MOST_DAMPING:
        taken += 1
        penalty = {
            name: Penalty(_CONTINUATION[level] * stiffness, barrier)
            for name, (stiffness, barrier) in _PENALTY.items()
        }
        model = StepModel(problem, at, penalty, multipliers)
        step, expected = model.minimise(damping)
        reached = problem.evaluate(control + step)
        cost = model.cost(at.at)
        gain = (cost - model.cost(reached)) / max(expected, 1e-12)
        if gain <= 0.0:
            damping, growth = damping * growth, 2.0 * growth
            continue
        control = control + step
        damping = max(_LEAST_DAMPING, damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3))
        growth = 2.0
        if level < last and gain > _AGREEMENT:
            level += 1
            problem = anchored(problem, standing, reached.points)
            if level in _SPLITS:
                problem = shared(problem, standing, reached)
        elif level == last and expected < _SETTLED * cost:
            if updates == _UPDATES or violation(problem, reached.values) < tolerance:
                break
            multipliers = _updated(problem, reached.values, multipliers, penalty)
            problem = shared(problem, standing, reached)
            updates += 1
        at = problem.linearize(control)
    control = np.concatenate([fixed, np.clip(control[len(fixed) :], *limits)])
    return Solution(control, problem.evaluate(control), problem, taken)


def violation(problem: Problem, values: dict[str, Array]) -> float:
    """Largest distance of any row from its bounds."""
    return max(
        float(np.max(np.abs(y - np.clip(y, *problem.rows[name])))) for name, y in values.items()
    )


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
