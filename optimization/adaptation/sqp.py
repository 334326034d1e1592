"""A trust-region SQP over many candidates at once: one call of the judge an iteration.

Each candidate has its own QP, radius, penalty and curvature, and stops by itself; what is costly,
the judge, sees all of them in one batch. The cost's curvature is exact, that of the constraints
comes by damped BFGS.

Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, algorithm 18.4 and procedure 18.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization.adaptation.options import AdaptOptions
from robomirror_drake.optimization.adaptation.problem import (
    Judge,
    Point,
    Problem,
    evaluate,
    judged,
)
from robomirror_drake.optimization.adaptation.step import (
    Multipliers,
    Step,
    lagrangian_gradient,
    merit,
    solve_step,
)

FEASIBLE = 1e-3
"""Violation up to which constraints count as met, in their units."""

_ACCEPT, _GOOD = 0.05, 0.7  # share of the promised saving
_SMALLEST, _WIDEST = 1e-4, 4.0  # radius
_CHEAPEST, _DEAREST = 1.0, 1e4  # penalty


class Start(NamedTuple):
    """A problem, and variables z (X,) to start from."""

    problem: Problem
    z: Array


class Solution(NamedTuple):
    """What became of a start.

    Attributes:
        problem: The problem.
        first: The command (z = 0), judged.
        point: The best point found, judged.
        multipliers: Prices of its constraints; None where no QP was solved.
        iterations: Judged steps.
        converged: Whether no step saves more than the tolerance, all constraints met.
    """

    problem: Problem
    first: Point
    point: Point
    multipliers: Multipliers | None
    iterations: int
    converged: bool

    @property
    def feasible(self) -> bool:
        """Whether all constraints are met."""
        return bool(self.point.violations(self.problem.ceiling).max() <= FEASIBLE)


class _State(NamedTuple):
    problem: Problem
    point: Point
    B: Array
    radius: float
    penalty: float
    multipliers: Multipliers | None = None
    iterations: int = 0
    done: bool = False
    converged: bool = False


def solve(
    starts: Sequence[Start], judge: Judge, options: AdaptOptions, history: Any = None
) -> list[Solution]:
    """Adapts candidates, each from its start.

    A start whose feet are out of reach is moved towards its command.

    Args:
        starts: Where from; several may share a problem.
        judge: See :class:`Judge`.
        options: See :class:`AdaptOptions`.
        history: What the judge is to know of the robot's past.

    Returns:
        A solution for each start, in order.
    """
    begun = [(start.problem, _reachable(start)) for start in starts]
    points = _judge_all(judge, begun, history)
    commands = _commands(judge, points, begun, history)
    states = [
        _State(s.problem, point, s.problem.layout.hessian, options.radius, options.penalty)
        for s, point in zip(starts, points, strict=True)
    ]
    for _ in range(options.iterations):
        steps = [None if state.done else _step(state, options) for state in states]
        states = [_settled(s, step, options) for s, step in zip(states, steps, strict=True)]
        if options.hurry and any(s.done and _will_do(s, options) for s in states):
            states = [s._replace(done=True) for s in states]  # they have their prices
            break
        going = [i for i, state in enumerate(states) if not state.done]
        if not going:
            break
        trials = _judge_all(
            judge,
            [(states[i].problem, states[i].point.z + _of(steps[i]).change) for i in going],
            history,
        )
        for i, trial in zip(going, trials, strict=True):
            states[i] = _advanced(states[i], _of(steps[i]), trial)
    # Prices of the last point, and whether it is one to stop at.
    states = [s if s.done else _settled(s, _step(s, options), options) for s in states]
    return [
        Solution(
            s.problem, commands[id(s.problem)], s.point, s.multipliers, s.iterations, s.converged
        )
        for s in states
    ]


def _will_do(state: _State, options: AdaptOptions) -> bool:
    """Whether a point is safe by half the margin, and keeps what must be kept."""
    over = state.point.violations(state.problem.ceiling)
    return bool(over[0] < 0.5 * options.margin and over[1:].max() <= FEASIBLE)


def _of(step: Step | None) -> Step:
    assert step is not None  # only those that are not done are asked
    return step


def _judge_all(
    judge: Judge, wanted: Sequence[tuple[Problem, Array]], history: Any, derivatives: bool = True
) -> list[Point]:
    """Judged points of problems."""
    points = [evaluate(problem, z, derivatives=derivatives) for problem, z in wanted]
    return judged(judge, [problem for problem, _ in wanted], points, history)


def _commands(
    judge: Judge, points: Sequence[Point], begun: Sequence[tuple[Problem, Array]], history: Any
) -> dict[int, Point]:
    """The judged command of each problem, by its id; a start at the command is one already."""
    made = {id(p): point for (p, z), point in zip(begun, points, strict=True) if not z.any()}
    others = {id(p): p for p, _ in begun if id(p) not in made}
    if others:
        wanted = [(p, np.zeros(p.layout.size)) for p in others.values()]
        asked = _judge_all(judge, wanted, history, derivatives=False)
        made |= zip(others, asked, strict=True)
    return made


def _reachable(start: Start) -> Array:
    layout = start.problem.layout
    z = np.clip(start.z, layout.lower, layout.upper)
    for _ in range(6 if z.any() else 0):
        if evaluate(start.problem, z, derivatives=False).reached:
            return z
        z = 0.5 * z
    return np.zeros_like(z)


def _step(state: _State, options: AdaptOptions) -> Step | None:
    return solve_step(
        state.problem, state.point, state.B, state.radius, state.penalty, options.qp_solver
    )


def _settled(state: _State, step: Step | None, options: AdaptOptions) -> _State:
    """Done, if there is no step or none that is worth it; else its prices are noted."""
    if state.done:
        return state
    if step is None:
        return state._replace(done=True)
    over = state.point.violations(state.problem.ceiling)
    feasible = over.max() <= FEASIBLE
    if options.hurry and _will_do(state, options):
        return state._replace(multipliers=step.multipliers, done=True, converged=False)
    small = step.promised <= options.tolerance * max(state.point.cost, FEASIBLE)
    state = state._replace(multipliers=step.multipliers)
    if small and (feasible or state.penalty >= _DEAREST):
        return state._replace(done=True, converged=feasible)
    if small:
        return state._replace(penalty=10.0 * state.penalty)
    return state._replace(done=state.radius < _SMALLEST)


def _advanced(state: _State, step: Step, trial: Point) -> _State:
    """After a trial: taken or not, with the next radius, penalty and curvature."""
    problem, d = state.problem, step.change
    saved = merit(problem, state.point, state.penalty) - merit(problem, trial, state.penalty)
    share = saved / max(step.promised, 1e-12)
    taken = share > _ACCEPT
    radius = state.radius
    if share < 0.25:
        radius = 0.4 * float(np.abs(d).max())
    elif share > _GOOD and np.abs(d).max() > 0.9 * radius:
        radius = min(2.0 * radius, _WIDEST)
    # Out of reach the motion is not that of the variables, and says nothing of curvature.
    B = _curvature(state, step, trial) if trial.reached else state.B
    stuck = step.slack > FEASIBLE and np.abs(d).max() < 0.9 * state.radius
    dear = 2.0 * step.multipliers.largest
    if stuck:
        penalty = min(4.0 * state.penalty, _DEAREST)
    elif step.slack > FEASIBLE:
        penalty = state.penalty
    else:  # no more than the constraints are worth, or their curvature forbids long steps
        penalty = max(dear, 0.5 * (state.penalty + dear), _CHEAPEST)
    return state._replace(
        point=trial if taken else state.point,
        B=B,
        radius=radius,
        penalty=penalty,
        iterations=state.iterations + 1,
    )


def _curvature(state: _State, step: Step, trial: Point) -> Array:
    """Damped BFGS of the Lagrangian's Hessian; rows count as linear."""
    prices = step.multipliers._replace(rows=[np.zeros_like(r) for r in step.multipliers.rows])
    d = step.change
    y = lagrangian_gradient(trial, prices) - lagrangian_gradient(state.point, prices)
    Bd = state.B @ d
    along, turn = float(d @ Bd), float(d @ y)
    if along < 1e-14:
        return state.B
    theta = 1.0 if turn >= 0.2 * along else 0.8 * along / (along - turn)
    r = theta * y + (1.0 - theta) * Bd
    return np.asarray(state.B - np.outer(Bd, Bd) / along + np.outer(r, r) / float(d @ r))
