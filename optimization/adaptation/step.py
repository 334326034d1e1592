"""One step of sequential quadratic programming: a small QP, with slack.

    min_{d, s}  ½ dᵀ B d + gᵀ d + ρ Σ s
    s.t.        c_i + ∇c_iᵀ d ≤ s_i,  s ≥ 0,  |d| ≤ Δ,  z_min ≤ z + d ≤ z_max

The fall and each goal have a slack of their own; rows of one family share one, so that the
penalty is exact as well and the QP small. Of the rows only those are in it that can become
active within the step's box.

Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch. 18.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import qpsolvers

from robomirror_drake.messages import Array
from robomirror_drake.optimization.adaptation.problem import Point, Problem

_SLACK = 1e-4  # curvature of the slack: QP solvers want some


class Multipliers(NamedTuple):
    """Prices of the constraints: cost saved per unit by which one is relaxed.

    Attributes:
        fall: Of the logit's ceiling.
        goals: (G,) of the goals.
        rows: Of each family, (R,) signed: positive at the upper bound.
        box: (X,) of the variables' bounds, signed likewise; zero at the trust region's.
    """

    fall: float
    goals: Array
    rows: list[Array]
    box: Array

    @property
    def largest(self) -> float:
        """The least penalty that is exact, as rows of a family share their slack."""
        shared = [float(np.abs(prices).sum()) for prices in self.rows]
        return max([self.fall, *map(float, self.goals), *shared])


class Step(NamedTuple):
    """A solved step.

    Attributes:
        change: (X,) d.
        promised: How much of the merit it should save.
        slack: Sum of what the linear model leaves violated.
        multipliers: Of the QP.
    """

    change: Array
    promised: float
    slack: float
    multipliers: Multipliers


def merit(problem: Problem, point: Point, penalty: float) -> float:
    """Cost and violations; infinite where the legs do not reach."""
    if not point.reached:
        return float("inf")
    return point.cost + penalty * float(point.violations(problem.ceiling).sum())


def solve_step(
    problem: Problem, point: Point, B: Array, radius: float, penalty: float, solver: str
) -> Step | None:
    """The step from a judged point, or None where the QP solver finds none.

    Args:
        problem, point: Where.
        B: (X, X) model of the Lagrangian's curvature, positive definite.
        radius: Δ.
        penalty: ρ.
        solver: Name of a solver that ``qpsolvers`` knows.
    """
    layout, size = problem.layout, len(point.z)
    low = np.maximum(layout.lower - point.z, -radius)
    high = np.minimum(layout.upper - point.z, radius)
    G = [point.by_logit[None], -point.by_goals]
    h = [np.array([problem.ceiling - point.logit]), point.goals]
    owner = [np.arange(1 + len(point.goals))]
    picked: list[tuple[int, float, npt.NDArray[np.intp]]] = []
    for number, family in enumerate(point.rows):
        # The farthest that each row can go, exactly, as the step is in a box.
        at, near = family.value[family.near], family.near
        middle = at + family.jacobian @ (0.5 * (high + low))
        half = np.abs(family.jacobian) @ (0.5 * (high - low))
        sides = (
            (1.0, middle + half, family.upper[near]),
            (-1.0, half - middle, -family.lower[near]),
        )
        for sign, farthest, bound in sides:
            rows = np.flatnonzero(farthest > bound)
            picked.append((number, sign, near[rows]))
            G.append(sign * family.jacobian[rows])
            h.append(bound[rows] - sign * at[rows])
            owner.append(np.full(len(rows), 1 + len(point.goals) + number))
    owned = np.concatenate(owner)
    slacks, column = np.unique(owned, return_inverse=True)
    left = np.vstack(G)
    left = np.hstack([left, -np.eye(len(slacks))[column]])
    count = len(slacks)
    P = np.zeros((size + count, size + count))
    P[:size, :size] = B
    P[size:, size:] = _SLACK * penalty * np.eye(count)
    qp = qpsolvers.Problem(
        P,
        np.concatenate([point.gradient, np.full(count, penalty)]),
        left,
        np.concatenate(h),
        lb=np.concatenate([low, np.zeros(count)]),
        ub=np.concatenate([high, np.full(count, 1e6)]),
    )
    solution = qpsolvers.solve_problem(qp, solver=solver)
    if not solution.found or solution.x is None or solution.z is None or solution.z_box is None:
        return None
    d, slack = np.clip(solution.x[:size], low, high), solution.x[size:]
    prices = np.maximum(solution.z, 0.0)
    return Step(
        d,
        _promised(problem, point, B, d, penalty),
        float(np.maximum(slack, 0.0).sum()),
        _multipliers(problem, point, d, prices, solution.z_box[:size], picked),
    )


def _promised(problem: Problem, point: Point, B: Array, d: Array, penalty: float) -> float:
    """How much less the model's merit is after the step d."""
    rows = []
    for family in point.rows:
        value = family.value.copy()
        value[family.near] += family.jacobian @ d
        rows.append(family._replace(value=value))
    ahead = point._replace(
        logit=point.logit + float(point.by_logit @ d),
        goals=point.goals + point.by_goals @ d,
        rows=rows,
    )
    saved = point.violations(problem.ceiling) - ahead.violations(problem.ceiling)
    return float(penalty * saved.sum() - point.gradient @ d - 0.5 * d @ B @ d)


def _multipliers(
    problem: Problem,
    point: Point,
    d: Array,
    prices: Array,
    box: Array,
    picked: list[tuple[int, float, npt.NDArray[np.intp]]],
) -> Multipliers:
    rows = [np.zeros(len(family.value)) for family in point.rows]
    at = 1 + len(point.goals)
    for number, sign, chosen in picked:
        rows[number][chosen] += sign * prices[at : at + len(chosen)]
        at += len(chosen)
    z, layout = point.z + d, problem.layout
    own = np.isclose(z, np.where(box > 0.0, layout.upper, layout.lower), atol=1e-9)
    goals = len(point.goals)
    return Multipliers(float(prices[0]), prices[1 : 1 + goals], rows, np.where(own, box, 0.0))


def lagrangian_gradient(point: Point, prices: Multipliers, box: bool = True) -> Array:
    """(X,) gradient of the Lagrangian, with or without the variables' own bounds."""
    made = point.gradient + prices.fall * point.by_logit - prices.goals @ point.by_goals
    for family, price in zip(point.rows, prices.rows, strict=True):
        if price.any():
            made = made + price[family.near] @ family.jacobian
    return np.asarray(made + prices.box if box else made)


class Optimality(NamedTuple):
    """How far a point is from meeting the conditions of Karush, Kuhn and Tucker.

    Attributes:
        stationarity: Largest entry of z less its projected gradient step.
        feasibility: Largest violation of a constraint.
        complementarity: Largest product of a price and the distance from its constraint.
    """

    stationarity: float
    feasibility: float
    complementarity: float


def optimality(problem: Problem, point: Point, prices: Multipliers) -> Optimality:
    """Residuals of a judged point with the multipliers that a solver gave."""
    layout = problem.layout
    slope = lagrangian_gradient(point, prices, box=False)
    inside = np.clip(point.z - slope, layout.lower, layout.upper)
    loose = [abs(prices.fall * (point.logit - problem.ceiling))]
    loose += list(np.abs(prices.goals * point.goals))
    for family, price in zip(point.rows, prices.rows, strict=True):
        bound = np.where(price > 0.0, family.upper, family.lower)
        active = np.flatnonzero(price)
        loose += list(np.abs(price[active] * (family.value - bound)[active]))
    return Optimality(
        float(np.abs(inside - point.z).max()),
        float(point.violations(problem.ceiling).max()),
        float(max(loose)),
    )
