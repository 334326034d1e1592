"""The same problem for solvers that take their time: SNOPT through Drake, IPOPT through CasADi.

Both are given the functions that the online solver uses, with their exact first derivatives,
and all rows at once. They are the reference to compare with, and to study variations of the
problem on: a ``MathematicalProgram`` takes further costs and constraints.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import MathematicalProgram, SnoptSolver

from robomirror_drake.messages import Array
from robomirror_drake.optimization.adaptation.problem import Judge, Point, Problem, evaluate, judged

_STRIDE = 0.1  # SNOPT's steps by the size of the variables, and 1
_KEPT = 8  # points remembered: solvers ask for values and derivatives apart


class Constraints(NamedTuple):
    """All constraints of a problem: ``lower`` (C,) ≤ value ≤ ``upper`` (C,)."""

    value: Array
    lower: Array
    upper: Array
    jacobian: Array


class Functions:
    """Cost and constraints of a problem as functions of its variables.

    The number of samples is the same whatever the variables, as solvers expect.
    """

    def __init__(self, problem: Problem, judge: Judge, history: Any = None) -> None:
        """Of a problem, with all that the slowest tempo needs to be seen."""
        self.problem = problem
        self._judge, self._history = judge, history
        self._count = max(problem.count(z) for z in (problem.layout.lower, problem.layout.upper))
        self._points: OrderedDict[bytes, Point] = OrderedDict()

    def point(self, z: Array) -> Point:
        """The judged point at variables (X,)."""
        key = z.tobytes()
        if key not in self._points:
            made = evaluate(self.problem, z.copy(), self._count, near=np.inf)
            self._points[key] = judged(self._judge, [self.problem], [made], self._history)[0]
            while len(self._points) > _KEPT:
                self._points.popitem(last=False)
        return self._points[key]

    def constraints(self, z: Array) -> Constraints:
        """All constraints at variables (X,): the fall, the goals, the rows."""
        point = self.point(z)
        goals, rows = np.zeros(len(point.goals)), point.rows
        return Constraints(
            np.concatenate([[point.logit], point.goals, *(row.value for row in rows)]),
            np.concatenate([[-np.inf], goals, *(row.lower for row in rows)]),
            np.concatenate([[self.problem.ceiling], goals + np.inf, *(row.upper for row in rows)]),
            np.vstack([point.by_logit[None], point.by_goals, *(row.jacobian for row in rows)]),
        )


class OfflineSolution(NamedTuple):
    """What an offline solver found.

    Attributes:
        z: (X,) variables.
        cost: ½ zᵀ H z.
        logit: Of the fall.
        success: Whether the solver says that it is an optimum.
        status: What it says.
    """

    z: Array
    cost: float
    logit: float
    success: bool
    status: str


def mathematical_program(
    functions: Functions, start: Array
) -> tuple[MathematicalProgram, npt.NDArray[Any]]:
    """The problem as a Drake program, and its variables (X,), guessed to be ``start``."""
    layout = functions.problem.layout
    program = MathematicalProgram()
    z = program.NewContinuousVariables(layout.size, "z")
    program.SetInitialGuess(z, start)
    program.AddBoundingBoxConstraint(layout.lower, layout.upper, z)
    program.AddQuadraticCost(layout.hessian, np.zeros(layout.size), z, is_convex=True)

    def rows(x: npt.NDArray[Any]) -> npt.NDArray[Any]:
        if x.dtype != object:
            return functions.constraints(x).value
        at, slope = ExtractValue(x).ravel(), ExtractGradient(x)
        found = functions.constraints(at)
        by_x = found.jacobian @ slope if slope.shape[1] else np.zeros((len(found.value), 0))
        return np.array(
            [AutoDiffXd(value, row) for value, row in zip(found.value, by_x, strict=True)]
        )

    bounds = functions.constraints(np.asarray(start, dtype=np.float64))
    program.AddConstraint(rows, lb=bounds.lower, ub=bounds.upper, vars=z)
    return program, z


def solve_snopt(functions: Functions, start: Array, iterations: int = 200) -> OfflineSolution:
    """Solves the problem by SNOPT.

    Args:
        functions: The problem.
        start: (X,) variables to start from.
        iterations: Major iterations at most.
    """
    program, z = mathematical_program(functions, start)
    solver = SnoptSolver()
    program.SetSolverOption(solver.solver_id(), "Major iterations limit", iterations)
    # From far away, where the legs do not reach, it would not find back.
    program.SetSolverOption(solver.solver_id(), "Major step limit", _STRIDE)
    result = solver.Solve(program)
    details = result.get_solver_details()
    return _solution(
        functions, result.GetSolution(z), result.is_success(), f"SNOPT info {details.info}"
    )


def solve_ipopt(functions: Functions, start: Array, iterations: int = 300) -> OfflineSolution:
    """Solves the problem by IPOPT through CasADi, with curvature by limited-memory BFGS.

    Args:
        functions: The problem.
        start: (X,) variables to start from.
        iterations: At most.
    """
    layout = functions.problem.layout
    alive: list[ca.Callback] = []  # CasADi does not own its callbacks
    rows = _Rows(functions, alive)
    z = ca.MX.sym("z", layout.size)
    H = ca.DM(layout.hessian)
    solver = ca.nlpsol(
        "adapt",
        "ipopt",
        {"x": z, "f": 0.5 * ca.dot(z, ca.mtimes(H, z)), "g": rows(z)},
        {
            "print_time": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "hessian_approximation": "limited-memory",
                "max_iter": iterations,
                "tol": 1e-6,
            },
        },
    )
    bounds = functions.constraints(np.asarray(start, dtype=np.float64))
    found = solver(x0=start, lbx=layout.lower, ubx=layout.upper, lbg=bounds.lower, ubg=bounds.upper)
    stats = solver.stats()
    return _solution(
        functions, np.array(found["x"]).ravel(), bool(stats["success"]), stats["return_status"]
    )


def _solution(functions: Functions, z: Array, success: bool, status: str) -> OfflineSolution:
    point = functions.point(np.ascontiguousarray(z, dtype=np.float64))
    return OfflineSolution(point.z, point.cost, point.logit, success, status)


class _Rows(ca.Callback):
    """The constraints as a CasADi function, which knows its own Jacobian."""

    def __init__(self, functions: Functions, alive: list[ca.Callback]) -> None:
        super().__init__()
        self._functions, self._alive = functions, alive
        size = functions.problem.layout.size
        self._shape = (len(functions.constraints(np.zeros(size)).value), size)
        alive.append(self)
        self.construct("rows", {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shape[1], 1)

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shape[0], 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        z = np.array(arguments[0]).ravel()
        value = self._functions.constraints(z).value
        # IPOPT shortens a step that leads where the problem is not defined.
        return [ca.DM(value if self._functions.point(z).reached else np.full_like(value, np.nan))]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(
        self,
        name: str,
        _names_in: Sequence[str],
        _names_out: Sequence[str],
        options: Mapping[str, Any],
    ) -> ca.Function:
        return _Slopes(self._functions, self._alive, self._shape, name, options)


class _Slopes(ca.Callback):
    """The Jacobian of the constraints as a CasADi function."""

    def __init__(
        self,
        functions: Functions,
        alive: list[ca.Callback],
        shape: tuple[int, int],
        name: str,
        options: Mapping[str, Any],
    ) -> None:
        super().__init__()
        self._functions, self._shape = functions, shape
        alive.append(self)
        self.construct(name, dict(options))

    def get_n_in(self) -> int:
        return 2  # the variables, and the value there

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, which: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shape[1 - which], 1)

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shape)

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        z = np.array(arguments[0]).ravel()
        return [ca.DM(self._functions.constraints(z).jacobian)]
