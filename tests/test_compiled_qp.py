"""The compiled parts of the QP and its diagnosis give what plain NumPy gives."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.dynamics_terms import ControlModel, control_model
from robomirror_drake.optimization.stance import Stance, initial_stance
from robomirror_drake.optimization.whole_body_diagnostics import (
    ACTIVE,
    LEAST_FORCE,
    Diagnostics,
    diagnose,
)
from robomirror_drake.optimization.whole_body_qp import (
    QP,
    Solution,
    foot_wrench_from,
    torque_from,
)
from robomirror_drake.robot import load_robot

FRICTION = 0.5


@pytest.fixture(scope="module")
def model() -> ControlModel:
    return control_model(load_robot())


def _solved(rng: np.random.Generator, load: Array, effort: Array) -> tuple[QP, Solution]:
    """A solution at, beyond and within its bounds, of a QP of no particular sense."""
    generators = 4 * int((load > 0.0).sum())
    size, nothing = 23 + generators, np.zeros(0)
    x = np.r_[100.0 * rng.normal(size=23), rng.random(generators) * (rng.random(generators) < 0.5)]
    lb, ub = x - rng.choice([-0.3, 0.0, 1e-6, 5.0], size), x + rng.choice([1e-6, 5.0], size)
    W = rng.normal(size=(2, 6, generators))
    W[:, 2] = np.abs(W[:, 2]) * 100.0 * (rng.random((2, 1)) < 0.7)
    torque = effort * rng.choice([-1.0, 1.0, 0.3, -0.9999, 1.1], 23)
    S = rng.normal(size=(23, size))
    qp = QP(
        *(np.zeros((size, size)), np.zeros(size), np.zeros((0, size)), nothing, lb, ub),
        *(np.zeros((29, size)), np.zeros(29), S, torque - S @ x, W),
    )
    problem = qp._replace(lb=lb - rng.random(size), ub=ub + rng.random(size))
    return qp, Solution(True, x, nothing, np.zeros(size), problem)


def _plain_diagnosis(
    qp: QP, solution: Solution, scheduled: BoolArray, stance: Stance, effort: Array
) -> Diagnostics:
    x, solved = solution.x, solution.problem
    torque, force = torque_from(solution), foot_wrench_from(solution)[:, :3]
    bound = np.maximum(np.abs(force[:, 2]), LEAST_FORCE)
    loaded = force[:, 2] > LEAST_FORCE
    lower, upper, bounded = qp.lb[:23], qp.ub[:23], x[:23]
    tolerance = ACTIVE * (upper - lower)
    normal = np.zeros((2, 4))
    normal[stance.load > 0.0] = x[23:].reshape(-1, 4).sum(axis=1)
    beyond = np.concatenate([np.abs(torque) - effort, solved.lb - x, x - solved.ub])
    slip = np.hypot(force[:, 0], force[:, 1]) / bound
    edge = np.abs(force[:, :2]).sum(axis=1) / bound >= (1.0 - ACTIVE) * FRICTION
    return Diagnostics(
        qp_failures=np.array(0.0),
        residual=np.max(beyond, initial=0.0),
        slack=np.max(np.concatenate([lower - bounded, bounded - upper]), initial=0.0),
        friction_margin=FRICTION - np.where(loaded, slip, 0.0),
        torque_limit=np.sign(torque) * (np.abs(torque) >= (1.0 - ACTIVE) * effort),
        joint_limit=1.0 * (bounded >= upper - tolerance) - 1.0 * (bounded <= lower + tolerance),
        friction=1.0 * (loaded & edge),
        unilateral=((stance.load > 0.0) & (normal <= ACTIVE)).mean(axis=1),
        planned_contact=scheduled.mean(axis=1),
        measured_contact=1.0 * (stance.touching > 0.0),
    )


@pytest.mark.parametrize("seed", range(20))
def test_diagnosis(model: ControlModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    load = rng.random((2, 4)) * (rng.random((2, 4)) < 0.7) * (seed > 0)
    qp, solution = _solved(rng, load, model.effort)
    stance = initial_stance()._replace(load=load, touching=rng.integers(0, 2, 2) * 0.1)
    scheduled = rng.random((2, 4)) < 0.5
    found = diagnose(qp, solution, scheduled, stance, model, FRICTION)
    expected = _plain_diagnosis(qp, solution, scheduled, stance, model.effort)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)
    assert expected.joint_limit.any()
    assert expected.torque_limit.any()
