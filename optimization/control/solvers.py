"""Solves the whole-body QP, and judges what a solver gave.

DAQP, the default, is called as it is: checking and copying took a third of a solution's time.
The other solvers are reached through qpsolvers.
"""

from __future__ import annotations

from typing import Any

import daqp
import numpy as np
import qpsolvers
from scipy.linalg import solve_triangular
from scipy.sparse import csc_matrix, identity

from robomirror_drake.messages import Array
from robomirror_drake.optimization.control.kernels import finite
from robomirror_drake.optimization.control.qp import QP, Solution, Solver

_TOLERANCES: dict[str, dict[str, Any]] = {
    "daqp": {"primal_tol": 1e-7, "iter_limit": 500},
    "osqp": {
        "eps_abs": 1e-5,
        "eps_rel": 0.0,
        "check_dualgap": False,
        "scaling": 0,
        "max_iter": 4000,
        "raise_error": False,
    },
    "proxqp": {"eps_abs": 1e-6, "eps_rel": 0.0, "max_iter": 1000},
    "quadprog": {},
    "piqp": {
        "eps_abs": 1e-11,
        "eps_rel": 1e-12,
        "eps_duality_gap_abs": 1e-11,
        "eps_duality_gap_rel": 1e-12,
    },
}
"""At these every solver's torques are within 0.1 N·m of the optimum's, or it gives up: OSQP
does where many limits are active, PIQP's and ProxQP's multipliers are less exact than DAQP's."""


_UNBOUNDED = -1e30  # what DAQP takes for no bound


def solve_qp(qp: QP, solver: Solver) -> Solution:
    """Solves the QP; no solver is warm-started, so the answer depends on the QP alone.

    An infeasible problem, one that is not finite, and a solver that gives up all give
    ``found = False``; nothing is raised.
    """
    if not (finite(qp.q) and finite(qp.h) and finite(qp.P.ravel())):
        return _unsolved(qp)
    try:
        if solver == "daqp":
            x, z, z_box = _solve_daqp(qp)
        elif solver == "osqp":
            x, z, z_box = _solve_conditioned(qp, solver)
        else:
            problem = qpsolvers.Problem(qp.P, qp.q, qp.G, qp.h, None, None, qp.lb, qp.ub)
            x, z, z_box = _solve(problem, solver)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError, qpsolvers.SolverError):
        return _unsolved(qp)
    return Solution(True, x, z, z_box, qp) if finite(x) else _unsolved(qp)


def _unsolved(qp: QP) -> Solution:
    return Solution(False, np.zeros_like(qp.q), np.zeros_like(qp.h), np.zeros_like(qp.q), qp)


def _solve_daqp(qp: QP) -> tuple[Array, Array, Array]:
    """Optimum and multipliers.

    Raises:
        qpsolvers.SolverError: There is none, or DAQP gives up.
    """
    upper = np.concatenate([qp.ub, qp.h])
    lower = np.full(upper.size, _UNBOUNDED)
    lower[: qp.lb.size] = qp.lb
    every = np.zeros(upper.size, dtype=np.intc)  # all are inequalities, none is known to be active
    x, _, flag, info = daqp.solve(qp.P, qp.q, qp.G, upper, lower, every, **_TOLERANCES["daqp"])
    if flag <= 0:
        raise qpsolvers.SolverError("daqp found no solution")
    multipliers = info["lam"]
    return x, multipliers[qp.lb.size :], multipliers[: qp.lb.size]


def _solve(problem: qpsolvers.Problem, solver: Solver) -> tuple[Array, Array, Array]:
    """Optimum and multipliers.

    Raises:
        qpsolvers.SolverError: There is none, or the solver gives up.
    """
    solution = qpsolvers.solve_problem(problem, solver, **_TOLERANCES[solver])
    if not solution.found or solution.x is None or solution.z is None:
        raise qpsolvers.SolverError(f"{solver} found no solution")
    z_box = np.empty(0) if solution.z_box is None else solution.z_box  # none without bounds
    return solution.x, solution.z, z_box


def _solve_conditioned(qp: QP, solver: Solver) -> tuple[Array, Array, Array]:
    """Optimum and multipliers in coordinates y = Lᵀx, P = L Lᵀ, with rows of length 1.

    The condition number of P is about 10⁸, with which first-order methods crawl; there it is 1.
    """
    L = np.linalg.cholesky(qp.P)
    count, box = qp.h.size, np.eye(qp.q.size)
    rows = np.concatenate([qp.G, box, -box])
    bounds = np.concatenate([qp.h, qp.ub, -qp.lb])
    bounded = np.isfinite(bounds)
    turned = solve_triangular(L, rows[bounded].T, lower=True).T
    length = np.linalg.norm(turned, axis=1)
    problem = qpsolvers.Problem(
        identity(qp.q.size, format="csc"),
        solve_triangular(L, qp.q, lower=True),
        csc_matrix(turned / length[:, None]),
        bounds[bounded] / length,
    )
    y, multipliers, _ = _solve(problem, solver)
    every = np.zeros_like(bounds)
    every[bounded] = multipliers / length
    upper, lower = np.split(every[count:], 2)
    return solve_triangular(L, y, lower=True, trans=1), every[:count], upper - lower


def kkt_residual(solution: Solution) -> float:
    """Largest violation of the Karush-Kuhn-Tucker conditions, in their own units.

    Stationarity, feasibility, sign of the multipliers, and complementarity as the smaller of
    a constraint's slack and its multiplier.
    """
    qp, x, z, z_box = solution.problem, solution.x, solution.z, solution.z_box
    slack = np.concatenate([qp.h - qp.G @ x, qp.ub - x, x - qp.lb])
    multiplier = np.concatenate([z, np.maximum(z_box, 0.0), np.maximum(-z_box, 0.0)])
    violations = (
        np.abs(qp.P @ x + qp.q + qp.G.T @ z + z_box),
        -slack,
        -multiplier,
        np.minimum(np.abs(slack), np.abs(multiplier)),
    )
    return float(max(violation.max(initial=0.0) for violation in violations))
