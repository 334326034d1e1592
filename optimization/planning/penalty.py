"""What it costs that a row leaves its bounds, or comes near to one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array


class Rows(NamedTuple):
    """Bounds of one group of rows, (T, m) each."""

    lower: Array
    upper: Array


class Penalty(NamedTuple):
    """ρ and µ of a group of rows: stiffness outside the bounds, and barrier before them."""

    stiffness: float
    barrier: float


class BoundTerms(NamedTuple):
    """Cost of a group of rows, and its first two derivatives by each row (T, m)."""

    cost: float
    slope: Array
    curvature: Array


def bound_terms(y: Array, rows: Rows, penalty: Penalty, multipliers: Array) -> BoundTerms:
    """Penalty on rows that should lie within their bounds.

    Where both bounds are one, that is λ r + ½ ρ r². A single bound at a distance z ≥ δ costs
    −µ ln z, continued below δ = √(µ/ρ) by the parabola with curvature ρ that meets it with two
    equal derivatives: unlike a hinge it lets a Newton step see the bounds ahead of it.

    Source: C. Feller, C. Ebenbauer, "Relaxed logarithmic barrier function based model
    predictive control of linear systems", IEEE TAC 62(3), 2017.
    """
    slope, curvature = np.empty_like(y), np.empty_like(y)
    cost = _terms(y, *rows, *penalty, multipliers, slope, curvature)
    return BoundTerms(float(cost), slope, curvature)


@njit(cache=True)
def _terms(y, lower, upper, rho, mu, multipliers, slope, curvature):  # type: ignore[no-untyped-def]
    delta = np.sqrt(mu / rho)
    offset, cost = -np.log(delta), 0.0
    for t in range(y.shape[0]):
        for i in range(y.shape[1]):
            low, high = lower[t, i], upper[t, i]
            if low == high:
                r = y[t, i] - low
                cost += multipliers[t, i] * r + 0.5 * rho * r * r
                slope[t, i] = multipliers[t, i] + rho * r
                curvature[t, i] = rho
                continue
            slope[t, i] = curvature[t, i] = 0.0
            for sign, z in ((1.0, y[t, i] - low), (-1.0, high - y[t, i])):
                if z >= np.inf:
                    continue
                if z >= delta:
                    cost -= mu * np.log(z)
                    slope[t, i] -= sign * mu / z
                    curvature[t, i] += mu / (z * z)
                else:
                    near = (z - 2.0 * delta) / delta
                    cost += mu * (0.5 * (near * near - 1.0) + offset)
                    slope[t, i] += sign * mu * near / delta
                    curvature[t, i] += rho
    return cost
