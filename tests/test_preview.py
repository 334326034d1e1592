"""The regulator of centre of mass and angular momentum: model, costs, gains, closed loop."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import solve_discrete_are

from robomirror_drake.messages import RobotReference
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.centroidal_motion import centroidal_motion
from robomirror_drake.optimization.control.dynamics_terms import control_model, memory, task_motion
from robomirror_drake.optimization.control.preview import (
    Preview,
    PreviewOptions,
    centroidal_model,
    preview_gains,
    riccati,
    steered,
    wrench_cost,
)
from robomirror_drake.optimization.planning.contacts import ConeOptions, wrench_cones
from robomirror_drake.robot import Robot, load_robot

STEP, FRICTION, OPTIONS = 1.0 / 60.0, 0.5, PreviewOptions()
LEFT_ONLY = slice(60, 90)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def stand(robot: Robot) -> RobotReference:
    """Two seconds of standing, half a second of them on the left foot as far as labels go."""
    count = 121
    contact = np.ones((count, 2, 4), dtype=np.bool_)
    contact[LEFT_ONLY, 1] = False
    return RobotReference(
        time=STEP * np.arange(count),
        q=np.tile(robot.standing, (count, 1)),
        v=np.zeros((count, 29)),
        a=np.zeros((count, 29)),
        contact=contact,
    )


@pytest.fixture(scope="module")
def both_feet(stand: RobotReference) -> RobotReference:
    return dataclasses.replace(stand, contact=np.ones_like(stand.contact))


@pytest.fixture(scope="module")
def preview(robot: Robot, stand: RobotReference) -> Preview:
    return preview_gains(robot, stand, FRICTION, OPTIONS)


def test_model_is_the_derivative_of_newton_and_euler() -> None:
    """One step of A, B against exact integration of the nonlinear dynamics."""
    rng = np.random.default_rng(0)
    mass, h, com, eps = 60.0, 0.02, np.array([0.3, -0.2, 0.8]), 1e-6
    force, velocity = np.array([80.0, -50.0, 700.0]), rng.standard_normal(3)

    def step(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        # The wrench (moment about the planned centre of mass, which moves as planned).
        c, c_dot, momentum = com + x[:3], velocity + x[3:6], x[6:]
        for _ in range(substeps := 2000):
            dt = h / substeps
            f = force + u[3:]
            away = c - planned[0]
            momentum = momentum + dt * (u[:3] - np.cross(away, f))
            c, planned[0] = c + dt * c_dot, planned[0] + dt * planned[1]
            c_dot = c_dot + dt * (f / mass - [0.0, 0.0, GRAVITY])
            planned[1] = planned[1] + dt * (force / mass - [0.0, 0.0, GRAVITY])
        return np.concatenate([c - planned[0], c_dot - planned[1], momentum])

    A, B = centroidal_model(force[None], np.array([h]), mass)
    for column in range(15):
        z = eps * np.eye(15)[column]
        ends = []
        for sign in (1.0, -1.0):
            planned = [com.copy(), velocity.copy()]
            ends.append(step(sign * z[:9], sign * z[9:]))
        wanted = (A[0] @ z[:9] + B[0] @ z[9:]) / eps
        np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * eps), wanted, rtol=2e-3, atol=1e-4)


def test_standing_gains_are_those_of_the_algebraic_riccati_equation(
    robot: Robot, both_feet: RobotReference
) -> None:
    made = preview_gains(robot, both_feet, FRICTION, OPTIONS)
    np.testing.assert_allclose(made.gain[0], made.gain[-1], rtol=1e-6, atol=1e-6)
    motion = centroidal_motion(robot, both_feet.q, both_feet.v, both_feet.a)
    cone = ConeOptions(FRICTION, 0.0, OPTIONS.max_normal_force, robot.mass * GRAVITY)
    R = STEP * wrench_cost(motion, both_feet.contact, cone)[0]
    Q = STEP * np.diag(np.repeat([0.05, 0.15, 6.0], 3) ** -2.0)
    A, B = (m[0] for m in centroidal_model(motion.force[:1], np.array([STEP]), robot.mass))
    P = solve_discrete_are(A, B, Q, R)
    expected = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    np.testing.assert_allclose(made.gain[0], expected, rtol=1e-5, atol=1e-3)
    assert np.abs(np.linalg.eigvals(A - B @ made.gain[0])).max() < 1.0


def test_gains_minimise_the_cost() -> None:
    """The recursion against the least-squares solution over a whole random horizon."""
    rng = np.random.default_rng(1)
    T, n, m = 6, 4, 2
    A, B = rng.standard_normal((T, n, n)), rng.standard_normal((T, n, m))
    Q, R = (np.array([s @ s.T + np.eye(k) for s in rng.standard_normal((T, k, k))]) for k in (n, m))
    P = 3.0 * np.eye(n)
    K, x0 = riccati(A, B, Q, R, P), rng.standard_normal(n)
    # States as a linear function of x0 and all inputs.
    rows, at = [], np.concatenate([np.eye(n), np.zeros((n, T * m))], axis=1)
    for t in range(T):
        u = np.zeros((m, n + T * m))
        u[:, n + t * m : n + (t + 1) * m] = np.eye(m)
        rows += [np.linalg.cholesky(Q[t]).T @ at, np.linalg.cholesky(R[t]).T @ u]
        at = A[t] @ at + B[t] @ u
    rows.append(np.linalg.cholesky(P).T @ at)
    stacked = np.concatenate(rows)
    best = np.linalg.lstsq(stacked[:, n:], -stacked[:, :n] @ x0, rcond=None)[0]
    np.testing.assert_allclose(-K[0] @ x0, best[:m], atol=1e-9)


def test_wrenches_that_cost_less_than_one_are_possible(robot: Robot, stand: RobotReference) -> None:
    motion = centroidal_motion(robot, stand.q, stand.v, stand.a)
    # Over the left foot, where the wrench of standing is inside its cone with room to spare.
    motion.com[:, :2] = motion.corners[0, 0, :, :2].mean(axis=0)
    motion = motion._replace(moment=np.cross(motion.com, motion.force))
    cone = ConeOptions(FRICTION, 0.0, OPTIONS.max_normal_force, robot.mass * GRAVITY)
    t = LEFT_ONLY.start
    cost = wrench_cost(motion, stand.contact, cone)[t]
    limits = wrench_cones(motion.corners[t : t + 1].round(3), stand.contact[t : t + 1], cone)
    directions = np.random.default_rng(2).standard_normal((500, 6)) * [20, 20, 20, 100, 100, 100]
    sizes = np.sqrt(np.einsum("ki,ij,kj->k", directions, cost, directions))
    u = 0.99 * directions / sizes[:, None]
    force = motion.force[t] + u[:, 3:]
    moment = motion.moment[t] + u[:, :3] + np.cross(motion.com[t], u[:, 3:])
    y = np.concatenate([moment, force], axis=1) @ limits.rows[0].T
    assert (y >= limits.lower[0]).all()
    assert (y <= limits.upper[0]).all()


def test_support_to_come_counts(preview: Preview, robot: Robot, both_feet: RobotReference) -> None:
    """Before the narrow support the gains differ from those of standing; long before, less."""
    standing = preview_gains(robot, both_feet, FRICTION, OPTIONS)
    apart = np.linalg.norm(preview.gain - standing.gain, axis=(1, 2))
    assert apart[LEFT_ONLY.start - 3] > 3.0 * apart[0]
    assert apart[-1] < 1e-6 * np.linalg.norm(standing.gain[-1])


def test_nothing_moves_the_centre_of_mass_in_flight(robot: Robot, stand: RobotReference) -> None:
    """Gains in flight are those of the landing; what happens before counts on no force there."""
    contact = np.ones_like(stand.contact)
    contact[LEFT_ONLY] = False
    made = preview_gains(robot, dataclasses.replace(stand, contact=contact), FRICTION, OPTIONS)
    landing = made.gain[LEFT_ONLY.stop]
    assert (made.gain[LEFT_ONLY] == landing).all()
    assert np.isfinite(made.gain).all()


def test_steering_agrees_with_the_law(robot: Robot, preview: Preview) -> None:
    model = control_model(robot)
    data = memory(model)
    q = robot.to_pinocchio(robot.standing)
    wanted = task_motion(model, data, q, np.zeros(29), np.zeros(29))
    pushed = pin.integrate(model.model, q, np.full(29, 0.01))
    actual = task_motion(model, data, pushed, np.full(29, 0.02), np.zeros(29))
    row = 40
    new = steered(preview, preview.time[row] + 1e-4, wanted, actual)
    away = actual.com[0] - wanted.com[0]
    x = np.concatenate([away, actual.com[1], actual.angular[0]])
    u = -preview.gain[row] @ x
    np.testing.assert_allclose(robot.mass * new.com[2], u[3:])
    np.testing.assert_allclose(new.angular[1], u[:3] + np.cross(preview.force[row], away))
    np.testing.assert_array_equal(new.com[:2], actual.com[:2])
    np.testing.assert_array_equal(new.angular[0], actual.angular[0])
    # The reference itself, undisturbed, is followed as it is; so it is after its end.
    np.testing.assert_allclose(steered(preview, 99.0, wanted, wanted).com[2], wanted.com[2])
