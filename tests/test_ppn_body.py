"""The tree of links in torch beside Pinocchio's, and its mirror image."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import torch

from robomirror_drake.optimization.centroidal_motion import centroidal_motion
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import state_frames, velocities
from robomirror_drake.ppn.mirror import Mirror
from robomirror_drake.robot import load_robot

ROBOT = load_robot()


@pytest.fixture(scope="module")
def states() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    q = np.tile(ROBOT.standing, (6, 1))
    q[:, :4] += 0.3 * rng.normal(size=(6, 4))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    q[:, 4:7] += rng.normal(size=(6, 3))
    q[:, 7:] += 0.3 * rng.normal(size=(6, 23))
    return q, rng.normal(size=(6, 29))


def test_links_are_pinocchios(states):
    q, v = states
    links = Body.of(ROBOT)(torch.tensor(q), torch.tensor(v))
    model, data = ROBOT.model, ROBOT.model.createData()
    q_pin, v_pin = ROBOT.to_pinocchio(q), ROBOT.v_to_pinocchio(q, v)
    for t in range(len(q)):
        pin.forwardKinematics(model, data, q_pin[t], v_pin[t])
        for joint in range(1, model.njoints):
            placement = data.oMi[joint]
            np.testing.assert_allclose(links.R[t, joint - 1], placement.rotation, atol=1e-12)
            np.testing.assert_allclose(links.p[t, joint - 1], placement.translation, atol=1e-12)
        base = pin.getVelocity(model, data, 1, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(links.angular[t], base.angular, atol=1e-12)
        np.testing.assert_allclose(links.linear[t], base.linear, atol=1e-12)
        axes = pin.computeJointJacobians(model, data, q_pin[t])[3:, 6:].T  # in world
        np.testing.assert_allclose(links.axis[t], axes, atol=1e-12)
    motion = centroidal_motion(ROBOT, q, v)
    np.testing.assert_allclose(links.com, motion.com, atol=1e-12)
    np.testing.assert_allclose(links.com_velocity, motion.com_velocity, atol=1e-12)


def test_soles_of_the_features_are_pinocchios(states):
    q, v = (torch.tensor(x) for x in states)
    frames = state_frames(Body.of(ROBOT), q, v)
    soles = (frames.vectors[:, 6:8] + frames.place[:, None]).numpy()
    expected = centroidal_motion(ROBOT, *states).corners.mean(axis=2)
    np.testing.assert_allclose(soles, expected, atol=1e-12)
    np.testing.assert_allclose(frames.scalars[:, -2:], expected[..., 2], atol=1e-12)


def test_a_quaternion_of_any_length_will_do(states):
    q, v = (torch.tensor(x) for x in states)
    longer = torch.cat([2.5 * q[:, :4], q[:, 4:]], 1)
    for a, b in zip(Body.of(ROBOT)(q, v), Body.of(ROBOT)(longer, v), strict=True):
        torch.testing.assert_close(a, b)


def test_velocities_of_samples_are_rates(states):
    q, v = states
    q_pin, v_pin = ROBOT.to_pinocchio(q), ROBOT.v_to_pinocchio(q, v)
    step, rows = 1e-4, []
    for a, b in zip(q_pin, v_pin, strict=True):
        rows.append([pin.integrate(ROBOT.model, a, k * step * b) for k in (-1.0, 0.0, 1.0)])
    samples = torch.tensor(ROBOT.to_drake(np.array(rows)))
    np.testing.assert_allclose(velocities(samples, step)[:, 0], v, atol=1e-5)


def test_a_mirrored_robot_moves_in_the_mirror(states):
    q, v = states
    mirror, flip = Mirror(ROBOT), np.array([1.0, -1.0, 1.0])
    there = centroidal_motion(ROBOT, q, v)
    back = centroidal_motion(ROBOT, mirror.positions(q), mirror.rates(v))
    np.testing.assert_allclose(back.com, there.com * flip, atol=1e-12)
    np.testing.assert_allclose(back.com_velocity, there.com_velocity * flip, atol=1e-12)
    feet = np.moveaxis(mirror.contacts(np.moveaxis(there.corners * flip, 3, 0)), 0, 3)
    np.testing.assert_allclose(back.corners, feet, atol=1e-12)
    np.testing.assert_array_equal(mirror.positions(mirror.positions(q)), q)
    np.testing.assert_array_equal(mirror.rates(mirror.rates(v)), v)
