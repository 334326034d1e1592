"""The compiled parts of the QP and its diagnosis give what plain NumPy gives."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.control.collision import ApartRows
from robomirror_drake.optimization.control.diagnostics import (
    ACTIVE,
    LEAST_FORCE,
    Diagnostics,
    packed_diagnosis,
    unpack,
)
from robomirror_drake.optimization.control.dynamics_terms import (
    ControlModel,
    DynamicsTerms,
    TaskMotion,
    control_model,
)
from robomirror_drake.optimization.control.kernels import (
    FORCE_UNIT,
    contact_generators,
)
from robomirror_drake.optimization.control.qp import (
    QP,
    Solution,
    Targets,
    WholeBodyOptions,
    build_qp,
    foot_wrench_from,
    torque_from,
    tuning,
)
from robomirror_drake.optimization.control.stance import Stance, initial_stance
from robomirror_drake.optimization.control.task_kernels import task_rows
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
    found = unpack(packed_diagnosis(qp, solution, scheduled, stance, model, FRICTION))
    expected = _plain_diagnosis(qp, solution, scheduled, stance, model.effort)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)
    assert expected.joint_limit.any()
    assert expected.torque_limit.any()


def _motion(rng: np.random.Generator) -> TaskMotion:
    R = np.linalg.qr(np.eye(3) + 0.1 * rng.normal(size=(4, 3, 3)))[0]
    shapes = (3, 3), (2, 3), (4, 3), (4, 6), (4, 6)
    com, angular, p, v, a = (rng.normal(size=shape) for shape in shapes)
    return TaskMotion(com, angular, R, p, v, a)


@pytest.mark.parametrize("seed", range(6))
def test_assembly(model: ControlModel, seed: int) -> None:
    rng, options = np.random.default_rng(seed), WholeBodyOptions()
    tuned, joints = tuning(model, options), slice(6, 29)
    root = rng.normal(size=(29, 29))
    M, momentum, J = root @ root.T, rng.normal(size=(6, 29)), rng.normal(size=(4, 6, 29))
    angles = 0.1 * rng.normal(size=23)
    h, rates, q, v, a = (rng.normal(size=n) for n in (29, 23, 23, 23, 23))
    terms = DynamicsTerms(M, h, momentum, J, _motion(rng), angles, rates)
    load = rng.random((2, 4)) * (rng.random((2, 4)) < 0.7) * (seed > 0)
    force, anchor = 100.0 * rng.normal(size=(2, 6)), rng.normal(size=(2, 3))
    targets = Targets(_motion(rng), q, v, a, load, force, seed % 2 == 0, anchor)
    apart = ApartRows(rng.normal(size=(seed, 23)), rng.normal(size=seed))
    qp = build_qp(model, terms, targets, tuned, apart)

    at, wanted = terms.motion, targets.motion
    W, cap = contact_generators(
        at.R[2:], model.corners, load, options.friction, options.corner_force
    )
    T, t, w = task_rows(
        *(tuned.gains, momentum, J, model.mass, *at, *wanted),
        *(model.corners, load, anchor, options.swing_feedback),
    )
    x = rng.normal(size=qp.q.size)
    a_joints, wrench = x[:23], W @ x[23:]
    pull = J[2].T @ wrench[0] + J[3].T @ wrench[1]
    base = np.linalg.solve(M[:6, :6], pull[:6] - h[:6] - M[:6, joints] @ a_joints)
    whole = np.r_[base, a_joints]
    np.testing.assert_allclose(qp.N @ x + qp.n, whole, rtol=1e-9, atol=1e-9)
    torque = (M @ whole + h - pull)[joints]
    np.testing.assert_allclose(qp.S @ x + qp.s, torque, rtol=1e-8, atol=1e-6)
    posture = a + options.posture_stiffness * (q - angles) + options.posture_damping * (v - rates)
    moments = np.repeat([1.0, 10.0], 3) * (options.planned_force if targets.planned else 0.0)

    def price(whole: Array, a_joints: Array, wrench: Array, generators: Array) -> float:
        parts = (
            w * (T @ whole - t),
            tuned.posture * (a_joints - posture),
            np.ravel(moments * (wrench - force)),
            np.sqrt(options.acceleration_cost) * a_joints,
            np.sqrt(options.force_cost) * FORCE_UNIT * generators,
        )
        return 0.5 * float(sum(np.sum(part**2) for part in parts))

    none = np.zeros(qp.q.size)
    rise = price(whole, a_joints, wrench, x[23:]) - price(
        qp.n, none[:23], np.zeros((2, 6)), none[23:]
    )
    assert rise == pytest.approx(float(0.5 * x @ qp.P @ x + qp.q @ x), rel=1e-8)
    effort = model.effort
    rows, bounds = [qp.S, -qp.S], [effort - qp.s, effort + qp.s, -apart.b]
    keep = np.pad(-apart.A, ((0, 0), (0, cap.size)))
    np.testing.assert_array_equal(qp.G, np.concatenate([*rows, keep]))
    np.testing.assert_array_equal(qp.h, np.concatenate(bounds))
    ahead, limit = options.limit_horizon, options.acceleration_limit
    low, high = (
        2.0 * (end - angles - rates * ahead) / ahead**2 for end in (tuned.lower, model.upper)
    )
    low, high = low.clip(-limit, 0.9 * limit), high.clip(-0.9 * limit, limit)
    np.testing.assert_allclose(qp.lb, np.r_[low, 0.0 * cap], rtol=1e-12)
    np.testing.assert_allclose(qp.ub, np.r_[high, cap], rtol=1e-12)
