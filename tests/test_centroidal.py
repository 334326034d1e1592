"""Contact wrench and its derivatives against finite differences and independent formulas."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from robomirror_drake.optimization import centroidal
from robomirror_drake.robot import load_robot

ROBOT = load_robot()


@pytest.fixture
def trajectory() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(5, 30) random x, ẋ, ẍ with quaternions away from unit length."""
    rng = np.random.default_rng(3)
    x = ROBOT.standing + 0.3 * rng.normal(size=(5, 30))
    x[:, :4] = rng.normal(size=(5, 4))
    return x, rng.normal(size=(5, 30)), 3.0 * rng.normal(size=(5, 30))


def quintic(x: np.ndarray, xd: np.ndarray, xdd: np.ndarray, h: float) -> np.ndarray:
    return x + h * xd + 0.5 * h * h * xdd


def test_velocities_are_the_derivatives_of_the_configuration(trajectory) -> None:
    x, xd, xdd = trajectory
    v, a = centroidal.drake_velocities(x, xd, xdd)
    h = 1e-5
    states = []
    for step in (-h, h):
        moved = quintic(x, xd, xdd, step)
        states.append(centroidal.drake_velocities(moved, xd + step * xdd, xdd))
    np.testing.assert_allclose((states[1][0] - states[0][0]) / (2 * h), a, atol=1e-6)
    q0, q1 = (
        ROBOT.to_pinocchio(centroidal.unit_quaternions(quintic(x, xd, xdd, s))) for s in (-h, h)
    )
    q = centroidal.unit_quaternions(x)
    difference = np.array(
        [pin.difference(ROBOT.model, a, b) for a, b in zip(q0, q1, strict=True)]
    ) / (2 * h)
    np.testing.assert_allclose(difference, ROBOT.v_to_pinocchio(q, v), atol=1e-6)
    at = centroidal.tangent(x, xd, xdd)
    np.testing.assert_allclose(at.v, ROBOT.v_to_pinocchio(q, v), atol=1e-12)
    np.testing.assert_allclose(at.a, ROBOT.a_to_pinocchio(q, v, a), atol=1e-12)


def test_wrench_is_the_base_wrench_of_inverse_dynamics(trajectory) -> None:
    x, xd, xdd = trajectory
    wrench = centroidal.sample(ROBOT, [], x, xd, xdd, derivatives=False).wrench
    at = centroidal.tangent(x, xd, xdd)
    data = ROBOT.model.createData()
    for t in range(len(x)):
        tau = pin.rnea(ROBOT.model, data, at.q[t], at.v[t], at.a[t])
        pin.forwardKinematics(ROBOT.model, data, at.q[t])
        base = data.oMi[1].act(pin.Force(tau[:6]))
        np.testing.assert_allclose(wrench[t], np.r_[base.angular, base.linear], atol=1e-8)


def test_angular_momentum_rate_by_finite_differences(trajectory) -> None:
    x, xd, xdd = trajectory
    h, data = 1e-5, ROBOT.model.createData()
    samples = centroidal.sample(ROBOT, [], x, xd, xdd, derivatives=False)
    for t in range(len(x)):
        momenta = []
        for step in (-h, h):
            moved = quintic(x[t : t + 1], xd[t : t + 1], xdd[t : t + 1], step)
            at = centroidal.tangent(moved, xd[t : t + 1] + step * xdd[t : t + 1], xdd[t : t + 1])
            momenta.append(pin.computeCentroidalMomentum(ROBOT.model, data, at.q[0], at.v[0]).np)
        rate = (momenta[1] - momenta[0]) / (2 * h)
        com = pin.centerOfMass(ROBOT.model, data, centroidal.tangent(x, xd, xdd).q[t])
        force = rate[:3] + np.array([0.0, 0.0, ROBOT.mass * centroidal.GRAVITY])
        np.testing.assert_allclose(samples.wrench[t, 3:], force, atol=2e-5)
        np.testing.assert_allclose(
            samples.wrench[t, :3], np.cross(com, force) + rate[3:], atol=2e-5
        )


def test_wrench_jacobians_by_finite_differences(trajectory) -> None:
    samples = centroidal.sample(ROBOT, [], *trajectory, derivatives=True)
    assert samples.wrench_jacobians is not None
    h = 1e-6
    for order in range(3):
        for column in range(30):
            sides = []
            for sign in (-1.0, 1.0):
                moved = [part.copy() for part in trajectory]
                moved[order][:, column] += sign * h
                sides.append(centroidal.sample(ROBOT, [], *moved, derivatives=False).wrench)
            numeric = (sides[1] - sides[0]) / (2 * h)
            exact = samples.wrench_jacobians[order, :, :, column]
            np.testing.assert_allclose(exact, numeric, atol=2e-5 * (1 + np.abs(numeric).max()))


def test_point_and_rotation_jacobians_by_finite_differences(trajectory) -> None:
    frames = [*ROBOT.foot_frames, ROBOT.frame_id("L_ELBOW_P_S")]
    local = np.array([0.1, -0.05, -0.2])
    samples = centroidal.sample(ROBOT, frames, *trajectory, derivatives=True)
    support = centroidal.frame_support(ROBOT.model, frames)

    def points(links: np.ndarray) -> np.ndarray:
        return links[..., :3, :3] @ local + links[..., :3, 3]

    J = centroidal.point_jacobians(samples, support, points(samples.links))
    K = centroidal.rotation_jacobians(samples, support)
    h = 1e-6
    for column in range(30):
        sides = []
        for sign in (-1.0, 1.0):
            x = trajectory[0].copy()
            x[:, column] += sign * h
            sides.append(
                centroidal.sample(ROBOT, frames, x, *trajectory[1:], derivatives=False).links
            )
        np.testing.assert_allclose(
            (points(sides[1]) - points(sides[0])) / (2 * h), J[..., column], atol=1e-7
        )
        spin = (
            (sides[1] - sides[0])[..., :3, :3]
            / (2 * h)
            @ np.swapaxes(samples.links[..., :3, :3], -1, -2)
        )
        vee = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
        np.testing.assert_allclose(vee, K[..., column], atol=1e-7)
