"""Adaptation by optimisation: safe, optimal, explained, and fit to be planned."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.adaptation.adapt import AdaptOptions, Goal, adapt, robot_legs
from robomirror_drake.optimization.adaptation.offline import Functions, solve_ipopt, solve_snopt
from robomirror_drake.optimization.adaptation.problem import (
    STEP,
    Problem,
    evaluate,
    fall_ceiling,
    judged,
    make_problem,
)
from robomirror_drake.optimization.adaptation.sqp import Start, solve
from robomirror_drake.optimization.adaptation.step import optimality
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()


class Answer(NamedTuple):
    logit: np.ndarray
    gradient: np.ndarray


class Formula:
    """A judge that dislikes quick joints: logit = gain · mean squared acceleration + offset."""

    def __init__(self, gain: float = 3e-3, offset: float = -4.0) -> None:
        self.gain, self.offset, self.asked = gain, offset, 0

    def judge(self, q: np.ndarray, contact: np.ndarray, _history: Any) -> Answer:
        assert contact.shape == (*q.shape[:2], 2, 4)
        self.asked += 1
        bend = np.diff(q[..., 7:], 2, axis=1) / STEP**2
        slope = 2.0 * self.gain * bend / 23 / STEP**2
        gradient = np.zeros_like(q)
        for shift, sign in ((0, 1.0), (1, -2.0), (2, 1.0)):
            gradient[:, shift : q.shape[1] - 2 + shift, 7:] += sign * slope
        logit = self.gain * np.sum(bend**2, axis=(1, 2)) / 23 + self.offset
        return Answer(logit, gradient)


@lru_cache
def walk() -> RobotReference:
    return retarget(ROBOT, load_clip("walk"))


def options(**changes: Any) -> AdaptOptions:
    return AdaptOptions.model_validate({"knot_spacing": 0.25, "margin": 0.5, **changes})


def small(**changes: Any) -> Problem:
    """Most of the walk in few variables."""
    few = {"variables": ("tempo", "amplitude", "upper"), "horizon": 0.9, "knot_spacing": 0.4}
    return make_problem(ROBOT, robot_legs(ROBOT), walk(), (), options(**{**few, **changes}))


def away(problem: Problem) -> np.ndarray:
    """A start with less tempo and amplitude."""
    z = np.zeros(problem.layout.size)
    z[:2] = 1.0, -0.5
    return z


def test_gradient_of_the_judge_by_finite_differences() -> None:
    problem, judge = small(), Formula()
    rng = np.random.default_rng(2)
    z, e = 0.1 * rng.normal(size=problem.layout.size), 1e-6
    d = rng.normal(size=problem.layout.size)

    def logit(at: np.ndarray) -> float:
        count = problem.count(z)
        return judged(judge, [problem], [evaluate(problem, at, count)])[0].logit

    point = judged(judge, [problem], [evaluate(problem, z)])[0]
    slope = (logit(z + e * d) - logit(z - e * d)) / (2 * e)
    assert point.by_logit @ d == pytest.approx(slope, rel=1e-5)


def test_optimum_meets_the_conditions_of_kuhn_and_tucker() -> None:
    problem, judge = small(), Formula(3e-3)
    found = solve([Start(problem, away(problem))], judge, options(iterations=80, tolerance=1e-8))
    (solution,) = found
    assert solution.first.logit > problem.ceiling + 0.3
    assert solution.feasible
    assert solution.multipliers is not None
    assert solution.multipliers.fall > 0.01
    residuals = optimality(problem, solution.point, solution.multipliers)
    assert residuals.stationarity < 1e-3
    assert residuals.feasibility < 1e-4
    assert residuals.complementarity < 1e-4
    assert solution.point.logit == pytest.approx(problem.ceiling, abs=1e-4)


def test_snopt_finds_the_same_optimum() -> None:
    problem, judge = small(), Formula(3e-3)
    start = away(problem)
    (online,) = solve([Start(problem, start)], judge, options(iterations=80, tolerance=1e-8))
    offline = solve_snopt(Functions(problem, judge), start)
    assert offline.success, offline.status
    assert online.point.cost == pytest.approx(offline.cost, rel=1e-3)
    np.testing.assert_allclose(online.point.z, offline.z, atol=0.02)


@pytest.mark.slow
def test_ipopt_finds_the_same_optimum() -> None:
    problem, judge = small(), Formula(3e-3)
    start = away(problem)
    (online,) = solve([Start(problem, start)], judge, options(iterations=80, tolerance=1e-8))
    offline = solve_ipopt(Functions(problem, judge), start)
    assert online.point.cost == pytest.approx(offline.cost, rel=1e-3)
    np.testing.assert_allclose(online.point.z, offline.z, atol=0.02)


@pytest.mark.parametrize("solver", ["daqp", "piqp"])
def test_solvers_agree(solver: str) -> None:
    problem, judge = small(), Formula(3e-3)
    settings = options(iterations=80, tolerance=1e-8, qp_solver=solver)
    (found,) = solve([Start(problem, away(problem))], judge, settings)
    (other,) = solve(
        [Start(problem, away(problem))],
        judge,
        settings.model_copy(update={"qp_solver": "quadprog"}),
    )
    assert found.point.cost == pytest.approx(other.point.cost, rel=1e-3)


def test_a_safe_command_is_left_as_it_is() -> None:
    judge = Formula(1e-3)
    (adapted,) = adapt(ROBOT, [walk()], judge, options=options(horizon=0.5, starts=["command"]))
    assert adapted.safe
    assert adapted.explanation.deviation < 1e-9
    np.testing.assert_allclose(adapted.reference.q, walk().q, atol=1e-7)
    assert adapted.explanation.sentence.startswith("Nothing was changed")


@lru_cache
def adapted_walk():
    judge = Formula(3e-3)
    return adapt(ROBOT, [walk()], judge, options=options()), judge.asked


def test_a_falling_command_is_made_safe() -> None:
    ((adapted,), asked) = adapted_walk()
    assert adapted.safe
    why = adapted.explanation
    assert why.risk_before > 0.12
    assert adapted.risk <= 1.0 - AdaptOptions().safe
    assert why.tempo < 1.0
    assert why.changes
    assert "risk of a fall" in [active.name for active in why.active]
    assert f"{100 * why.tempo:.0f} % of the tempo" in why.sentence
    assert asked <= AdaptOptions().iterations + 3  # one call an iteration, whatever the starts


def test_the_result_keeps_its_limits_and_its_stance() -> None:
    ((adapted,), _) = adapted_walk()
    made, command = adapted.reference, walk()
    lower, upper = ROBOT.position_limits
    assert (made.q[:, 7:] >= lower - 1e-3).all()
    assert (made.q[:, 7:] <= upper + 1e-3).all()
    assert (np.abs(made.v[:, 6:]) <= 1.05 * ROBOT.velocity_limits).all()
    assert made.residuals["stance_drift"] < command.residuals["stance_drift"] + 1e-3
    assert made.residuals["penetration"] < command.residuals["penetration"] + 1e-3
    np.testing.assert_allclose(np.linalg.norm(made.q[:, :4], axis=1), 1.0, atol=1e-12)
    dt = made.time[1]
    rates = (made.q[2:, 7:] - made.q[:-2, 7:]) / (2 * dt)
    assert np.median(np.abs(rates - made.v[1:-1, 6:])) < 0.01
    np.testing.assert_allclose(np.diff(made.time), command.time[1])


def test_the_start_goes_on_as_it_was() -> None:
    ((adapted,), _) = adapted_walk()
    np.testing.assert_allclose(adapted.reference.q[0], walk().q[0], atol=1e-9)
    np.testing.assert_allclose(adapted.reference.v[0], walk().v[0], atol=0.05)


def test_a_plan_can_be_made_of_it() -> None:
    ((adapted,), _) = adapted_walk()
    plan = plan_dynamics(ROBOT, adapted.reference)
    assert plan.planned
    assert plan.residuals["dynamic_violation"] < 0.05


def test_goals_are_kept() -> None:
    """A goal of going farther than the motion does by itself is met, and has its price."""

    def way(q: np.ndarray) -> tuple[float, np.ndarray]:
        step = q[-1, 4:6] - q[0, 4:6]
        length = float(np.linalg.norm(step))
        gradient = np.zeros_like(q)
        gradient[-1, 4:6], gradient[0, 4:6] = step / length, -step / length
        return length, gradient

    few = ["tempo", "amplitude", "stride"]
    settings = options(starts=["both"], iterations=30, variables=few)
    (free,) = adapt(ROBOT, [walk()], Formula(), (), settings)
    farther = 1.003 * way(free.solution.point.samples.q)[0]

    def goal(q: np.ndarray) -> tuple[float, np.ndarray]:
        length, gradient = way(q)
        return length / farther - 1.0, gradient / farther

    (kept,) = adapt(ROBOT, [walk()], Formula(), [Goal("goes farther", goal)], settings)
    assert goal(kept.solution.point.samples.q)[0] > -1e-3
    assert kept.explanation.deviation > free.explanation.deviation
    assert "goes farther" in [active.name for active in kept.explanation.active]


def test_in_a_hurry_the_first_that_will_do_ends_it() -> None:
    problem, judge = small(), Formula(3e-3)
    starts = [Start(problem, away(problem)), Start(problem, np.zeros(problem.layout.size))]
    patient = solve(starts, judge, options(iterations=40, tolerance=1e-6))
    hurried = solve(starts, judge, options(iterations=40, tolerance=1e-6, hurry=True))
    half = problem.ceiling + 0.5 * options().margin
    assert any(one.feasible or one.point.logit <= half for one in hurried)
    assert max(one.iterations for one in hurried) < max(one.iterations for one in patient)


def test_same_arguments_same_bytes() -> None:
    first, second = (
        adapt(ROBOT, [walk()], Formula(3e-3), options=options(iterations=2))[0] for _ in range(2)
    )
    np.testing.assert_array_equal(first.reference.q, second.reference.q)


def test_a_judge_out_of_its_mind_is_refused() -> None:
    with pytest.raises(InputError, match="not finite"):
        adapt(ROBOT, [walk()], Formula(np.nan), options=options(horizon=0.5))


def test_ceiling() -> None:
    assert fall_ceiling(AdaptOptions(safe=0.9)) == pytest.approx(np.log(0.1 / 0.9))
    assert adapt(ROBOT, [], Formula()) == []


def test_the_robots_own_limits_stay_as_they_are() -> None:
    before = [limit.copy() for limit in ROBOT.position_limits]
    small()
    for now, was in zip(ROBOT.position_limits, before, strict=True):
        assert np.isfinite(now).all()
        np.testing.assert_array_equal(now, was)
