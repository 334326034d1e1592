"""Gauss–Newton on the control points, constraints by an augmented Lagrangian.

:mod:`.step` takes the steps; here penalties and multipliers move. The first steps
have a tenth of the penalty, which lets the body find its place before the feet are held; only
self-collision has all of it, since an arm that has gone through the chest would stay there.
Whenever the cost has settled, contacts that cannot be held are let go and the multipliers
move, and after two rounds of that the penalty rises (J. Nocedal, S. Wright, "Numerical
Optimization", 2006, ch. 17.4). Multipliers are clamped, and so never chase a trajectory that
is still far off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.retargeting import rates as hinges
from robomirror_drake.optimization.retargeting.footholds import let_go
from robomirror_drake.optimization.retargeting.kernel import DEADBAND, Multipliers, Residuals, cost
from robomirror_drake.optimization.retargeting.limits import project
from robomirror_drake.optimization.retargeting.problem import Problem, multiply_diagonal
from robomirror_drake.optimization.retargeting.step import DAMPING, State, advance, evaluate

PENALTY = 300.0
"""Of a metre's violation, against a keypoint's weight of 1 [1/m²]."""

SOFT_ITERATIONS, SOFTNESS = 3, 0.1
"""How many iterations begin with less of it, and how much."""

SOFT_ROUNDS, HARDNESS = 2, 5.0
"""After how many moves of the multipliers there is more of it, and how much."""

SETTLED, STILL = 0.3, 0.01
"""The multipliers move when the cost falls by less than this share, or when no control point
moves so far [m or rad]."""

LARGEST_FORCE = 10.0
"""Clamp of the multipliers per second [1/m]; a keypoint 10 m off would push as hard."""

RELEASE, RELEASE_AFTER = 4e-3, 5
"""Where a foot still misses its foothold by this much [m] as it lands or lifts, after so many
iterations, the contact begins later or ends earlier."""


class Solution(NamedTuple):
    """What the solver found.

    Attributes:
        control: (K, 29) control points, within the joint limits.
        standing: (S, 8) which sole corners stand; what could not be held is let go.
        multipliers: Last multipliers of the frames.
        objective: The objective, without constraints.
        violation: Largest violation of stance, floor and collision before the projection, where
            it was free to be less [m].
        iterations: How many steps were taken.
        converged: Whether the violation is within the tolerance.
    """

    control: Array
    standing: BoolArray
    multipliers: Multipliers
    objective: float
    violation: float
    iterations: int
    converged: bool


def solve(
    problem: Problem,
    start: Array,
    *,
    fixed: int = 0,
    iterations: int = 30,
    tolerance: float = 2e-3,
    flatness: float = 0.1,
    warm: bool = False,
) -> Solution:
    """Solves the problem from a starting point.

    Args:
        problem: The problem.
        start: (K, 29) control points to begin with.
        fixed: How many leading control points must stay.
        iterations: Most steps.
        tolerance: Largest violation of a solution [m].
        flatness: Share of the cost that a step must save for another to be taken.
        warm: Whether the start is near a solution, so that no soft iterations are needed.
    """
    with spline.one_thread(spline.ORDER * start.shape[1]):
        return _solve(problem, start, fixed, iterations, tolerance, flatness, warm)


def _solve(
    problem: Problem,
    start: Array,
    fixed: int,
    iterations: int,
    tolerance: float,
    flatness: float,
    warm: bool,
) -> Solution:
    limits, basis = problem.limits, problem.basis
    control = start.copy()
    control[fixed:, 6:] = np.clip(control[fixed:, 6:], limits.lower, limits.upper)
    free = _free_samples(basis, fixed)
    dt = problem.step
    multipliers = _no_multipliers(problem)
    rates = hinges.zero(basis.points, len(limits.lower))
    damping = np.full(basis.points, DAMPING)
    best, best_standing, least = control, problem.terms.standing, np.inf
    state: State | None = None
    soft_until = 0 if warm else SOFT_ITERATIONS
    rounds = SOFT_ROUNDS if warm else 0
    taken = 0
    for taken in range(1, iterations + 1):
        soft = taken <= soft_until
        share = SOFTNESS if soft else HARDNESS if rounds >= SOFT_ROUNDS else 1.0
        rho = PENALTY * dt * share
        if state is None or rho != multipliers.stance_penalty:
            multipliers = multipliers._replace(
                stance_penalty=rho, floor_penalty=rho, collision_penalty=max(rho, PENALTY * dt)
            )
            state = evaluate(problem, multipliers, rates, control)
        before = state.cost
        state, damping = advance(problem, multipliers, rates, state, damping, fixed)
        moved = float(np.abs(state.control - control).max())
        control = state.control
        if soft:
            continue
        violation = _violation(state.residuals, free)
        if violation < least:
            best, best_standing, least = control, problem.terms.standing, violation
        fall = 1.0 - state.cost / before
        if violation < tolerance:
            if fall < flatness or moved < STILL:
                break
        elif fall < SETTLED or moved < STILL:
            if taken >= RELEASE_AFTER + soft_until - SOFT_ITERATIONS:
                problem = _release(problem, state.residuals)
            over = hinges.excess(limits, problem.spacing, rates, control[:, 6:])
            rates = hinges.updated(problem.spacing, over)
            multipliers = _updated(multipliers, state.residuals, LARGEST_FORCE * dt)
            rounds += 1
            state = None
    limited = best.copy()
    limited[:, 6:] = project(best[:, 6:], limits, problem.spacing, fixed)
    return Solution(
        limited, best_standing, multipliers, objective(problem, limited), least, taken,
        converged=least < tolerance,
    )  # fmt: skip


def _free_samples(basis: spline.Basis, fixed: int) -> BoolArray:
    """(S,) samples that are not settled, for the greater part, by fixed leading control points."""
    given = basis.first[:, None] + np.arange(spline.ORDER) < fixed
    return np.asarray(np.sum(basis.weights[0] * given, axis=1) <= 0.5)


def _no_multipliers(problem: Problem) -> Multipliers:
    frames, pairs = len(problem.basis.first), len(problem.terms.capsules.pairs)
    return Multipliers(
        np.zeros((frames, 8, 3)), np.zeros((frames, 8)), np.zeros((frames, pairs)), 1.0, 1.0, 1.0
    )


def _release(problem: Problem, residuals: Residuals) -> Problem:
    """Lets go of a toe or heel at the ends of its contact where it misses its foothold."""
    standing = problem.terms.standing
    miss = np.linalg.norm(residuals.stance, axis=2).reshape(-1, 2, 2, 2).max(axis=3)
    held = let_go(standing.reshape(-1, 2, 2, 2)[..., 0], miss, RELEASE)
    standing = np.repeat(held.reshape(-1, 4), 2, axis=1)
    return problem._replace(terms=problem.terms._replace(standing=standing))


def objective(problem: Problem, control: Array) -> float:
    """The objective at control points (K, 29), without any constraint."""
    value, _, _ = cost(
        problem.terms, _no_multipliers(problem), spline.evaluate(problem.basis, control)
    )
    pull = multiply_diagonal(problem.quadratic, control)
    return value + float(np.vdot(0.5 * pull - problem.linear, control))


def _violation(residuals: Residuals, free: BoolArray) -> float:
    """Largest violation at the samples that are free to move [m]."""
    return max(
        float(np.abs(residuals.stance[free]).max(initial=0.0)),
        -float(residuals.height[free].min(initial=0.0)),
        -float(residuals.distance[free].min(initial=0.0)),
    )


def _updated(multipliers: Multipliers, residuals: Residuals, most: float) -> Multipliers:
    """First-order multiplier update, clamped."""
    rho = multipliers.stance_penalty
    pull = multipliers.stance + rho * residuals.stance
    pull -= np.clip(pull, -rho * DEADBAND, rho * DEADBAND)
    floor = multipliers.floor - multipliers.floor_penalty * residuals.height
    push = multipliers.collision - multipliers.collision_penalty * residuals.distance
    return multipliers._replace(
        stance=np.clip(pull, -most, most),
        floor=np.clip(floor, 0.0, most),
        collision=np.clip(push, 0.0, most),
    )
