"""One Gauss–Newton step on the control points, damped in time where the motion asks for it.

A sample of the trajectory depends on four control points only, so how far the quadratic
model can be trusted is a matter of place: a foot that is about to land may want a short step
while the rest of the clip is nearly solved. Each control point therefore has a damping of its
own (Levenberg–Marquardt), which rises where its samples do worse than the model told and
falls where they do as told; one length for all would let the worst sample hold back the clip.

Limits that are linear in the control points are not left to the line search: the step is
solved once more with those that it would break (active set of a quadratic program).

Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch. 10.3, 16.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.retargeting import rates as hinges
from robomirror_drake.optimization.retargeting.kernel import (
    Multipliers,
    Residuals,
    normal_equations,
)
from robomirror_drake.optimization.retargeting.problem import (
    Problem,
    add_diagonal_band,
    multiply_diagonal,
)
from robomirror_drake.optimization.retargeting.rates import Rates, Signs

DAMPING = 0.1
"""To begin with, per second; a joint half a metre from its keypoint has about as much."""

LEAST, MOST = 1e-3, 1.0
"""Bounds of the damping between steps."""

TRUSTED, DISTRUSTED, REJECTED = 0.3, 3.0, 10.0
"""Factors on it where the model told well, where it did not, and where a step was refused."""

GOOD, BAD = 0.25, 1.5
"""Error of the model, relative to the change it told, up to which it is good, beyond which bad."""

ATTEMPTS, SOLVES = 6, 2
"""How often a step is shortened, and how often it is solved for with new active limits."""

CLIPPED, FORESEEN = 0.05, 0.1
"""It is not solved for again where it leaves the joints' range by no more than this [rad], and
the limits that it did not foresee cost less than this share of what it is to save."""


class State(NamedTuple):
    """Control points and all that is known about them.

    Attributes:
        control: (K, 29) control points.
        x: (S, 29) frames.
        costs: (S,) augmented cost of each frame.
        cost: Their sum with that of posture, smoothness, speed and acceleration.
        residuals: Constraint functions.
        slope, blocks: (S, 29), (S, 29, 29) gradient and Hessian of ``costs``.
        gradient: (K, 29) of ``cost`` without speed and acceleration.
    """

    control: Array
    x: Array
    costs: Array
    cost: float
    residuals: Residuals
    slope: Array
    blocks: Array
    gradient: Array


def evaluate(problem: Problem, multipliers: Multipliers, rates: Rates, control: Array) -> State:
    """The state at control points (K, 29)."""
    x = spline.evaluate(problem.basis, control)
    costs, residuals, slope, blocks = normal_equations(problem.terms, multipliers, x)
    pull = multiply_diagonal(problem.quadratic, control)
    over = hinges.excess(problem.limits, problem.spacing, rates, control[:, 6:])
    cost = float(costs.sum()) + hinges.cost(problem.spacing, over)
    cost += float(np.vdot(0.5 * pull - problem.linear, control))
    gradient = spline.spread_gradient(problem.basis, slope)
    gradient += pull - problem.linear
    return State(control, x, costs, cost, residuals, slope, blocks, gradient)


def advance(
    problem: Problem,
    multipliers: Multipliers,
    rates: Rates,
    state: State,
    damping: Array,
    fixed: int,
) -> tuple[State, Array]:
    """One step that does not raise the cost.

    Args:
        problem: The problem.
        multipliers: Of the frames' constraints, those that ``state`` was evaluated with.
        rates: Of speed and acceleration, likewise.
        state: Where the step begins.
        damping: (K,) of the control points, per second.
        fixed: How many leading control points must stay.

    Returns:
        The state after it, ``state`` itself where no step was found; and (K,) the next damping.
    """
    band = spline.zero_band(*state.control.shape)
    add_diagonal_band(band, problem.quadratic)
    spline.add_blocks(band, problem.basis, state.blocks)
    for attempt in range(ATTEMPTS):
        target = _solve(problem, rates, state, band, damping, fixed)
        ahead = evaluate(problem, multipliers, rates, target)
        good, bad = _trust(problem.basis.first, state, ahead, len(damping))
        if ahead.cost <= state.cost:
            if attempt == 0:
                damping = np.where(bad, np.minimum(DISTRUSTED * damping, MOST), damping)
                damping = np.where(good, np.maximum(TRUSTED * damping, LEAST), damping)
            return ahead, damping
        everywhere = attempt > 1 or not bad.any()
        damping = np.where(bad | everywhere, REJECTED * damping, damping)
    return state, np.minimum(damping, MOST)


def _solve(
    problem: Problem, rates: Rates, state: State, band: Array, damping: Array, fixed: int
) -> Array:
    """(K, 29) where the damped quadratic model is least, within the limits of the joints."""
    limits, control = problem.limits, state.control
    n, joints = control.shape[1], control[:, 6:]
    first = fixed * n
    target = control.copy()
    rows = _active(problem, rates, control)
    held: BoolArray = np.zeros(control.shape, dtype=bool)
    for solve in range(SOLVES):
        matrix, gradient = band.copy(), state.gradient.copy()
        matrix[:, 0] += np.repeat(problem.spacing * damping, n)
        hinges.add(limits, problem.spacing, rates, joints, rows, gradient, matrix)
        if solve == 0:
            pull = gradient[:, 6:]
            held[:, 6:] = (joints <= limits.lower) & (pull > 0.0)
            held[:, 6:] |= (joints >= limits.upper) & (pull < 0.0)
        right = -gradient.ravel()[first:]
        free = matrix[first:]
        _hold(free, held.ravel()[first:], (target - control).ravel()[first:], right)
        step = spline.solve_in_place(free, right)
        target = control.copy()
        target.ravel()[first:] += step
        inside = np.clip(target[:, 6:], limits.lower, limits.upper)
        inside[:fixed] = target[:fixed, 6:]
        outside = target[:, 6:] - inside
        target[:, 6:] = inside
        over = hinges.excess(limits, problem.spacing, rates, inside)
        ahead = hinges.active(over)
        told = -0.5 * float(np.vdot(gradient, target - control))
        if np.abs(outside).max() < CLIPPED and (
            hinges.cost(problem.spacing, _unforeseen(over, rows, ahead)) < FORESEEN * told
        ):
            break
        held[:, 6:] |= outside != 0.0
        rows = ahead
    return target


def _unforeseen(over: Rates, rows: Signs, ahead: Signs) -> Rates:
    """The excess of those limits that the last solve did not know to be active."""
    return Rates(over.speed * (rows[0] != ahead[0]), over.acceleration * (rows[1] != ahead[1]))


def _active(problem: Problem, rates: Rates, control: Array) -> Signs:
    """Limits of speed and acceleration that are exceeded at control points (K, 29)."""
    over = hinges.excess(problem.limits, problem.spacing, rates, control[:, 6:])
    return hinges.active(over)


def _trust(
    first: npt.NDArray[np.int64], before: State, after: State, points: int
) -> tuple[BoolArray, BoolArray]:
    """(K,) which control points the model told well, and (K,) which it told badly."""
    told, error = _model_error(
        before.slope, before.blocks, after.x - before.x, after.costs - before.costs
    )
    # Where next to nothing was to change, the mean change of the whole says what is little.
    change = max(before.cost - after.cost, abs(float(told.sum())))
    scale = np.abs(told) + 0.5 * change / len(told)
    acts = first[:, None] + np.arange(spline.ORDER)
    good, bad = np.ones(points, dtype=bool), np.zeros(points, dtype=bool)
    good[acts[error > GOOD * scale]] = False
    bad[acts[error > BAD * scale]] = True
    return good, bad


@njit(cache=True)
def _model_error(slope, blocks, dx, change):  # type: ignore[no-untyped-def]
    """(S,) change that the quadratic model tells, and (S,) by how much the true one is more."""
    samples, n = dx.shape
    told = np.zeros(samples)
    for t in range(samples):
        for i in range(n):
            row = 0.0
            for j in range(n):
                row += blocks[t, i, j] * dx[t, j]
            told[t] += dx[t, i] * (slope[t, i] + 0.5 * row)
    return told, change - told


@njit(cache=True)
def _hold(band, held, value, right):  # type: ignore[no-untyped-def]
    """Gives unknowns of a banded system their values: rows and columns of the identity."""
    size, width = band.shape
    for j in range(size):
        if held[j]:
            for d in range(1, min(width, size - j)):
                right[j + d] -= band[j, d] * value[j]
                band[j, d] = 0.0
            for d in range(1, min(width, j + 1)):
                right[j - d] -= band[j - d, d] * value[j]
                band[j - d, d] = 0.0
            band[j, 0] = 1.0
    for j in range(size):
        if held[j]:
            right[j] = value[j]
