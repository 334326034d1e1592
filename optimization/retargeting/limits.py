"""Joint limits of a B-spline that hold at every instant, not only at samples.

A B-spline lies in the hull of its control points, and its derivatives are
B-splines of their differences. So bounds on the c_k, on (c_{k+1} − c_k)/h and on
(c_{k+2} − 2 c_{k+1} + c_k)/h² bound position, velocity and acceleration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import qpsolvers
import scipy.sparse as sparse

from robomirror_drake.messages import Array


class Limits(NamedTuple):
    """Bounds of J joints: ``lower``, ``upper`` [rad], ``speed`` [rad/s], ``acceleration``
    [rad/s²], (J,) each."""

    lower: Array
    upper: Array
    speed: Array
    acceleration: Array


def excess(control: Array, limits: Limits, spacing: float) -> Array:
    """(J,) how far control points (K, J) exceed their bounds, relative to each bound's width."""
    over = [
        (limits.lower - control, limits.upper - limits.lower),
        (control - limits.upper, limits.upper - limits.lower),
        (np.abs(np.diff(control, axis=0)) / spacing - limits.speed, limits.speed),
        (
            np.abs(np.diff(control, 2, axis=0)) / spacing**2 - limits.acceleration,
            limits.acceleration,
        ),
    ]
    return np.asarray(np.max([(value / scale).max(axis=0) for value, scale in over], axis=0))


def project(control: Array, limits: Limits, spacing: float, fixed: int = 0) -> Array:
    """The nearest control points that keep the limits, in the sense of least squares.

    The joints are independent; each that exceeds a bound is a QP of K variables.

    Args:
        control: (K, J) control points of the joints.
        limits: Their bounds.
        spacing: Distance of the knots [s].
        fixed: How many leading control points must stay as they are.

    Returns:
        (K, J) control points; a joint whose QP has no solution is left as it is.
    """
    result = control.copy()
    for joint in np.flatnonzero(excess(control, limits, spacing) > 0.0):
        solution = _project_joint(
            control[:, joint], Limits(*(b[joint] for b in limits)), spacing, fixed
        )
        if solution is not None:
            result[:, joint] = solution
    return result


def _project_joint(control: Array, limits: Limits, spacing: float, fixed: int) -> Array | None:
    size = len(control)
    inside = 1.0 - 1e-6  # of the bounds, to absorb what the QP solver leaves open
    middle, half = (limits.lower + limits.upper) / 2, inside * (limits.upper - limits.lower) / 2
    lower, upper = np.full(size, middle - half), np.full(size, middle + half)
    lower[:fixed] = upper[:fixed] = control[:fixed]
    first = sparse.diags([-1.0, 1.0], [0, 1], shape=(size - 1, size))
    second = sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(size - 2, size))
    G = sparse.vstack([first, -first, second, -second], format="csc")
    bounds = [limits.speed * spacing, limits.acceleration * spacing**2]
    h = inside * np.repeat(
        [bounds[0], bounds[0], bounds[1], bounds[1]], [size - 1] * 2 + [size - 2] * 2
    )
    # Rows among the fixed points alone are kept or broken already.
    settled = np.asarray(abs(G[:, fixed:]).sum(axis=1)).ravel() == 0.0
    h = np.where(settled, np.maximum(h, G @ control), h)
    identity = sparse.eye(size, format="csc")
    return qpsolvers.solve_qp(
        identity, -control, G, h, lb=lower, ub=upper, solver="piqp", eps_abs=1e-10, eps_rel=0.0
    )
