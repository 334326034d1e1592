"""One step of a dynamic plan: its rows made linear, their bounds left as they are.

    minimise over d   ½ dᵀ H d + gᵀ d + Σ_i φ_i(y_i + J_i d) + ½ η dᵀ D d

with the Gauss–Newton model H, g of the objective, the penalties φ of the constraint rows,
kinks and all, and a damping η that keeps the step where the rows are linear enough. As this is
convex, a few Newton steps with line search find the minimum, at no derivatives of the robot.

Source: J. Burke, M. Ferris, "A Gauss–Newton method for convex composite optimization",
Mathematical Programming 71, 1995.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.exceptions import PlanningError
from robomirror_drake.messages import Array
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.planning.penalty import BoundTerms, Penalty, bound_terms
from robomirror_drake.optimization.planning.problem import (
    EFFORT,
    POSE,
    Evaluation,
    Linearization,
    Problem,
)

_NEWTON_STEPS = 8
_PRECISION = 0.1  # share of the decrease so far below which another Newton step is not worth it
_LENGTHS = 0.7 ** np.arange(14)
_LEAST_CURVATURE = 1e-3
_LEAST_STIFFNESS = 1e-2  # a row far within its bounds bends the model less than all else does

Terms = dict[str, BoundTerms]


class Step(NamedTuple):
    """A step (K, 30), and the decrease of the penalised cost that the model expects of it."""

    step: Array
    decrease: float


@dataclass(frozen=True)
class StepModel:
    """The penalised problem about one trajectory.

    Attributes:
        problem: The problem.
        at: Its linearization.
        penalty: Of each group of rows.
        multipliers: λ of each group's equalities.
    """

    problem: Problem
    at: Linearization
    penalty: dict[str, Penalty]
    multipliers: dict[str, Array]

    def terms(self, values: dict[str, Array]) -> Terms:
        """What each group of rows costs at given values."""
        rows = self.problem.rows
        return {
            name: bound_terms(y, rows[name], self.penalty[name], self.multipliers[name])
            for name, y in values.items()
        }

    def cost(self, at: Evaluation) -> float:
        """The penalised cost of a trajectory."""
        return at.objective + _total(self.terms(at.values))

    def minimise(self, damping: float) -> Step:
        """The step to the minimum of the model.

        Raises:
            PlanningError: The Gauss–Newton matrix could not be factorized.
        """
        at, n = self.at, 30
        step = np.zeros_like(at.gradient)
        values, terms = at.at.values, self.terms(at.at.values)
        start = _total(terms)
        inertia: Array | None = None
        decrease = 0.0
        for _ in range(_NEWTON_STEPS):
            band, slope = self.derivatives(terms)
            if inertia is None:
                inertia = band[:, 0] + at.band[:, 0] + _LEAST_CURVATURE
            bent = spline.multiply(at.band, step.ravel()) + damping * inertia * step.ravel()
            bent += at.gradient.ravel()
            gradient = slope.ravel() + bent
            band += at.band
            band[:, 0] += damping * inertia + 1e-6
            first = n * self.problem.fixed
            way = np.zeros_like(gradient)
            try:
                factor = spline.factorize(band[first:])
            except np.linalg.LinAlgError as error:
                raise PlanningError(f"no plan: {error}", {"cost": at.at.objective}) from error
            way[first:] = -spline.substitute(factor, gradient[first:])
            if -float(gradient @ way) < _PRECISION * decrease:
                break
            # Along the way the model is a parabola plus the penalties, which are cheap.
            change = self.change(way.reshape(step.shape))
            curve = float(way @ (spline.multiply(at.band, way) + damping * inertia * way))
            straight, before = float(way @ bent), _total(terms)
            drop, length = 0.0, 0.0
            for trial in _LENGTHS:
                there = {name: y + trial * change[name] for name, y in values.items()}
                these = self.terms(there)
                rise = trial * straight + 0.5 * trial**2 * curve + _total(these) - before
                if rise >= drop:
                    if drop < 0.0:
                        break
                    continue
                drop, length, reached = rise, float(trial), (there, these)
            if length == 0.0:
                break
            values, terms = reached
            step += length * way.reshape(step.shape)
            decrease -= drop
        d = step.ravel()
        model = float(d @ (at.gradient.ravel() + 0.5 * spline.multiply(at.band, d)))
        return Step(step, start - _total(terms) - model)

    def change(self, step: Array) -> dict[str, Array]:
        """How the rows change with a step, to first order."""
        at, basis = self.at, self.problem.basis
        x, xd, xdd = (spline.evaluate(basis, step, order) for order in range(3))
        pose = (at.of_pose @ x[..., None])[..., 0]
        effort = sum(
            (J @ d[..., None])[..., 0] for J, d in zip(at.of_effort, (x, xd, xdd), strict=True)
        )
        change = {"speed": xd[:, 7:] / self.problem.robot.velocity_limits, "limits": step}
        for names, part in ((POSE, pose), (EFFORT, effort)):
            widths = np.cumsum([at.at.values[name].shape[1] for name in names])[:-1]
            change |= dict(zip(names, np.split(part, widths, axis=1), strict=True))
        return change

    def derivatives(self, terms: Terms) -> tuple[Array, Array]:
        """Band and gradient (K, 30) of the penalties."""
        basis, at = self.problem.basis, self.at
        slope, stiffness = _joined(terms, POSE)
        gradient = spline.spread_gradient(basis, (slope[:, None] @ at.of_pose)[:, 0])
        J = np.sqrt(stiffness)[..., None] * at.of_pose
        band = spline.zero_band(basis.points, 30)
        spline.add_blocks(band, basis, np.swapaxes(J, 1, 2) @ J, rows=0, columns=0)
        slope, stiffness = _joined(terms, EFFORT)
        _add_rows(band, basis.first, basis.weights, at.of_effort, stiffness)
        for order, J in enumerate(at.of_effort):
            gradient = gradient + spline.spread_gradient(basis, (slope[:, None] @ J)[:, 0], order)
        limits = self.problem.robot.velocity_limits
        speed = np.zeros((2, len(slope), 30))
        speed[0, :, 7:] = terms["speed"].slope / limits
        speed[1, :, 7:] = terms["speed"].curvature / limits**2
        gradient = gradient + spline.spread_gradient(basis, speed[0], 1)
        spline.add_diagonal(band, basis, speed[1], 1)
        band[:, 0] += terms["limits"].curvature.ravel()
        return band, gradient + terms["limits"].slope


def _total(terms: Terms) -> float:
    return sum(term.cost for term in terms.values())


def _joined(terms: Terms, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Slopes and curvatures of several groups side by side."""
    slope = np.concatenate([terms[name].slope for name in names], axis=1)
    return slope, np.concatenate([terms[name].curvature for name in names], axis=1)


@njit(cache=True)
def _add_rows(band, first, weights, jacobians, stiffness):  # type: ignore[no-untyped-def]
    """Adds Σ c bᵀ b for rows with derivatives (3, T, m, n) by x, ẋ, ẍ and stiffness c (T, m).

    b is a row's derivative by the four control points that act on its sample, which are
    neighbours in the band.
    """
    _, T, m, n = jacobians.shape
    b = np.empty(4 * n)
    for t in range(T):
        start = first[t] * n
        for row in range(m):
            c = stiffness[t, row]
            if c < _LEAST_STIFFNESS:
                continue
            for r in range(4):
                for k in range(n):
                    b[r * n + k] = (
                        weights[0, t, r] * jacobians[0, t, row, k]
                        + weights[1, t, r] * jacobians[1, t, row, k]
                        + weights[2, t, r] * jacobians[2, t, row, k]
                    )
            for j in range(4 * n):
                column, scale = band[start + j], c * b[j]
                for d in range(4 * n - j):
                    column[d] += scale * b[j + d]
