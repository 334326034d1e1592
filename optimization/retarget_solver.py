"""Gauss–Newton on the control points, constraints by an augmented Lagrangian.

Each iteration assembles the augmented cost's normal equations frame by frame,
spreads them into a banded matrix, takes a step with the position bounds projected
(D. Bertsekas, "Projected Newton Methods", SIAM J. Control 1982) and shortens it
until the cost falls. The first iterations have a tenth of the penalty, which lets
the body find its place before the feet are held; only self-collision has all of it,
since an arm that has gone through the chest would stay there. Multipliers move only after
small steps, are clamped, and so never chase a trajectory that is still far off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.retarget_footholds import let_go
from robomirror_drake.optimization.retarget_kernel import (
    Multipliers,
    Residuals,
    cost,
    normal_equations,
)
from robomirror_drake.optimization.retarget_limits import project
from robomirror_drake.optimization.retarget_problem import (
    STRIDE,
    Problem,
    add_diagonal_band,
    multiply_diagonal,
)
from robomirror_drake.optimization.retarget_targets import RATE

PENALTY = 300.0
"""Of a metre's violation, against a keypoint's weight of 1 [1/m²]."""

SPEED_PENALTY, ACCELERATION_PENALTY = 1.0, 1e-3
SOFT_ITERATIONS, SOFTNESS, HARDNESS = 3, 0.1, 5.0
SMALL_STEP = 0.1
"""Largest change of a control point after which multipliers move [m or rad]."""

LARGEST_FORCE = 10.0
"""Clamp of the multipliers per second [1/m]; a keypoint 10 m off would push as hard."""

DEADBAND = 5e-4
"""Of stance, below which its multipliers rest: splines cannot stand still exactly [m]."""

RELEASE, RELEASE_AFTER = 4e-3, 5
"""Where a foot still misses its foothold by this much [m] as it lands or lifts, after so many
iterations, the contact begins later or ends earlier."""


class Rates(NamedTuple):
    """Multipliers of the differences of the joints' control points: ``speed`` (K−1, J) and
    ``acceleration`` (K−2, J)."""

    speed: Array
    acceleration: Array


class Solution(NamedTuple):
    """What the solver found.

    Attributes:
        control: (K, 29) control points, within the joint limits.
        standing: (S, 8) which sole corners stand; what could not be held is let go.
        multipliers: Last multipliers of the frames.
        objective: The objective, without constraints.
        violation: Largest violation of stance, floor and collision before the projection [m].
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
    warm: bool = False,
) -> Solution:
    """Solves the problem from a starting point.

    Args:
        problem: The problem.
        start: (K, 29) control points to begin with.
        fixed: How many leading control points must stay.
        iterations: Most steps.
        tolerance: Largest violation of a solution [m].
        warm: Whether the start is near a solution, so that no soft iterations are needed.
    """
    dt = STRIDE / RATE
    frames, size = len(problem.basis.first), problem.basis.points
    lower, upper = _box(problem)
    control = start.copy()
    control[fixed:] = np.clip(control[fixed:], lower, upper)
    joints = control.shape[1] - 6
    rates = Rates(np.zeros((size - 1, joints)), np.zeros((size - 2, joints)))
    zero = (
        np.zeros((frames, 8, 3)),
        np.zeros((frames, 8)),
        np.zeros((frames, len(problem.terms.capsules.pairs))),
    )
    multipliers = Multipliers(*zero, *[PENALTY * dt] * 3)
    best, best_standing, least = control, problem.terms.standing, np.inf
    step = violation = np.inf
    taken, hard = 0, warm
    for taken in range(1, iterations + 1):
        soft = not warm and taken <= SOFT_ITERATIONS
        rho = PENALTY * dt * (SOFTNESS if soft else HARDNESS if hard else 1.0)
        multipliers = multipliers._replace(
            stance_penalty=rho, floor_penalty=rho, collision_penalty=max(rho, PENALTY * dt)
        )
        control, step, residuals = _step(problem, multipliers, rates, control, fixed, lower, upper)
        violation = _violation(residuals)
        if not soft and violation < least:
            best, best_standing, least = control, problem.terms.standing, violation
        if not soft and step < SMALL_STEP:
            if violation < tolerance:
                break
            if taken >= RELEASE_AFTER - (SOFT_ITERATIONS if warm else 0):
                problem = _release(problem, residuals)
            multipliers, rates = _update(problem, multipliers, rates, residuals, control, dt)
            hard = True
    limited = best.copy()
    limited[:, 6:] = project(best[:, 6:], problem.limits, problem.spacing, fixed)
    return Solution(
        limited, best_standing, multipliers, objective(problem, limited), least, taken,
        converged=least < tolerance,
    )  # fmt: skip


def _release(problem: Problem, residuals: Residuals) -> Problem:
    """Lets go of a toe or heel at the ends of its contact where it misses its foothold."""
    standing = problem.terms.standing
    miss = np.linalg.norm(residuals.stance, axis=2).reshape(-1, 2, 2, 2).max(axis=3)
    held = let_go(standing.reshape(-1, 2, 2, 2)[..., 0], miss, RELEASE)
    standing = np.repeat(held.reshape(-1, 4), 2, axis=1)
    return problem._replace(terms=problem.terms._replace(standing=standing))


def objective(problem: Problem, control: Array) -> float:
    """The objective at control points (K, 29), without any constraint."""
    frames = len(problem.basis.first)
    pairs = len(problem.terms.capsules.pairs)
    free = Multipliers(
        np.zeros((frames, 8, 3)), np.zeros((frames, 8)), np.zeros((frames, pairs)), 1.0, 1.0, 1.0
    )
    value, _, _ = cost(problem.terms, free, spline.evaluate(problem.basis, control))
    return value + _quadratic_cost(problem, control)


def _box(problem: Problem) -> tuple[Array, Array]:
    free = np.full(6, np.inf)
    return (
        np.concatenate([-free, problem.limits.lower]),
        np.concatenate([free, problem.limits.upper]),
    )


def _step(
    problem: Problem,
    multipliers: Multipliers,
    rates: Rates,
    control: Array,
    fixed: int,
    lower: Array,
    upper: Array,
) -> tuple[Array, float, Residuals]:
    """One projected Gauss–Newton step: control points, the step's size, residuals there."""
    x = spline.evaluate(problem.basis, control)
    _, frames_cost, residuals, g, H = normal_equations(problem.terms, multipliers, x)
    band = spline.zero_band(*control.shape)
    add_diagonal_band(band, problem.quadratic)
    spline.add_blocks(band, problem.basis, H)
    gradient = spline.spread_gradient(problem.basis, g)
    gradient += multiply_diagonal(problem.quadratic, control) - problem.linear
    excess = _rate_excess(problem, rates, control)
    _add_rates(problem, *excess, gradient, band)
    before = frames_cost + _quadratic_cost(problem, control) + _rate_cost(problem, *excess)

    blocked = ((control <= lower) & (gradient > 0.0)) | ((control >= upper) & (gradient < 0.0))
    start = fixed * control.shape[1]
    right = -np.where(blocked, 0.0, gradient).ravel()[start:]
    free_band = band[start:]
    _freeze(free_band, blocked.ravel()[start:])
    free_band[:, 0] *= 1.0 + 1e-6
    delta = np.zeros_like(control)
    delta.ravel()[start:] = spline.substitute(spline.factorize(free_band), right)
    length = 1.0
    for _ in range(6):
        trial = control + length * delta
        trial[fixed:] = np.clip(trial[fixed:], lower, upper)
        _, after, trial_residuals = cost(
            problem.terms, multipliers, spline.evaluate(problem.basis, trial)
        )
        after += _quadratic_cost(problem, trial)
        after += _rate_cost(problem, *_rate_excess(problem, rates, trial))
        if after <= before:
            return trial, float(np.abs(trial - control).max()), trial_residuals
        length *= 0.4
    return control, 0.0, residuals


def _quadratic_cost(problem: Problem, control: Array) -> float:
    product = multiply_diagonal(problem.quadratic, control)
    return float(np.sum((0.5 * product - problem.linear) * control))


def _rate_excess(problem: Problem, rates: Rates, control: Array) -> tuple[Array, Array]:
    """What of speed and acceleration, shifted by their multipliers, is outside the bounds."""
    limits, h = problem.limits, problem.spacing
    c = control[:, 6:]
    speed = (c[1:] - c[:-1]) / h + rates.speed / (SPEED_PENALTY * h)
    bend = (c[2:] - 2.0 * c[1:-1] + c[:-2]) / h**2
    bend += rates.acceleration / (ACCELERATION_PENALTY * h)
    return (
        speed - np.clip(speed, -limits.speed, limits.speed),
        bend - np.clip(bend, -limits.acceleration, limits.acceleration),
    )


def _rate_cost(problem: Problem, speed: Array, bend: Array) -> float:
    """Cost of what :func:`_rate_excess` found."""
    square = SPEED_PENALTY * np.vdot(speed, speed) + ACCELERATION_PENALTY * np.vdot(bend, bend)
    return 0.5 * problem.spacing * float(square)


def _add_rates(problem: Problem, speed: Array, bend: Array, gradient: Array, band: Array) -> None:
    """Adds the limits of speed and acceleration to gradient and band."""
    h, n = problem.spacing, gradient.shape[1]
    force, moment = SPEED_PENALTY * speed, ACCELERATION_PENALTY * bend / h
    gradient[1:, 6:] += force
    gradient[:-1, 6:] -= force
    gradient[:-2, 6:] += moment
    gradient[1:-1, 6:] -= 2.0 * moment
    gradient[2:, 6:] += moment
    rows = band.reshape(len(gradient), n, -1)[:, 6:]
    if speed.any():
        w = (SPEED_PENALTY / h) * (speed != 0.0)
        rows[1:, :, 0] += w
        rows[:-1, :, 0] += w
        rows[:-1, :, n] -= w
    if bend.any():
        w = (ACCELERATION_PENALTY / h**3) * (bend != 0.0)
        rows[:-2, :, 0] += w
        rows[1:-1, :, 0] += 4.0 * w
        rows[2:, :, 0] += w
        rows[:-2, :, n] -= 2.0 * w
        rows[1:-1, :, n] -= 2.0 * w
        rows[:-2, :, 2 * n] += w


def _violation(residuals: Residuals) -> float:
    return max(
        float(np.abs(residuals.stance).max()),
        -float(residuals.height.min()),
        -float(residuals.distance.min()),
    )


def _update(
    problem: Problem,
    multipliers: Multipliers,
    rates: Rates,
    residuals: Residuals,
    control: Array,
    dt: float,
) -> tuple[Multipliers, Rates]:
    """First-order multiplier update, clamped."""
    most = LARGEST_FORCE * dt
    speed, bend = _rate_excess(problem, rates, control)
    rho = multipliers.stance_penalty
    miss = residuals.stance - np.clip(residuals.stance, -DEADBAND, DEADBAND)
    moved = multipliers._replace(
        stance=np.clip(multipliers.stance + rho * miss, -most, most),
        floor=np.clip(multipliers.floor - rho * residuals.height, 0.0, most),
        collision=np.clip(multipliers.collision - rho * residuals.distance, 0.0, most),
    )
    h = problem.spacing
    return moved, Rates(SPEED_PENALTY * h * speed, ACCELERATION_PENALTY * h * bend)


@njit(cache=True)
def _freeze(band, blocked):  # type: ignore[no-untyped-def]
    """Takes blocked unknowns out of a banded matrix: row and column of the identity."""
    size, width = band.shape
    for j in range(size):
        if blocked[j]:
            band[j, :] = 0.0
            band[j, 0] = 1.0
            for d in range(1, min(width, j + 1)):
                band[j - d, d] = 0.0
