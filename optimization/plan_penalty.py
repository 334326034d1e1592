"""What it costs that a row leaves its bounds, or comes near to one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array


class Rows(NamedTuple):
    """Bounds of one group of rows, (T, m) each."""

    lower: Array
    upper: Array


class Penalty(NamedTuple):
    """ρ of a group's equalities, and µ of the barrier on its inequalities."""

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
    rho, mu = penalty
    delta = np.sqrt(mu / rho)
    equal = rows.lower == rows.upper
    r = np.where(equal, y - np.where(equal, rows.lower, 0.0), 0.0)
    cost = float(np.sum(multipliers * r) + 0.5 * rho * np.sum(r * r))
    slope = np.where(equal, multipliers + rho * r, 0.0)
    curvature = np.where(equal, rho, 0.0)
    for bound, sign in ((rows.lower, 1.0), (rows.upper, -1.0)):
        used = ~equal & np.isfinite(bound)
        z = np.where(used, sign * (y - np.where(used, bound, 0.0)), 1.0)
        inside = np.maximum(z, delta)
        far = z >= delta
        near = (z - 2.0 * delta) / delta
        log = np.where(far, -np.log(inside), 0.5 * (near**2 - 1.0) - np.log(delta))
        cost += mu * float(np.sum(log[used]))
        slope += sign * np.where(used, np.where(far, -mu / inside, mu * near / delta), 0.0)
        curvature += np.where(used, mu / inside**2, 0.0)
    return BoundTerms(cost, slope, curvature)
