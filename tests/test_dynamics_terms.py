"""What is read off Pinocchio's memory is what Pinocchio says when it is asked for each part."""

from __future__ import annotations

import copy

import numpy as np
import pinocchio as pin
import pytest

from robomirror_drake.messages import Array
from robomirror_drake.optimization.control.dynamics_terms import (
    ControlModel,
    control_model,
    dynamics_terms,
    memory,
    task_motion,
)
from robomirror_drake.robot import load_robot

WORLD = pin.LOCAL_WORLD_ALIGNED


@pytest.fixture(scope="module")
def model() -> ControlModel:
    return control_model(load_robot())


def _state(model: ControlModel, seed: int) -> tuple[Array, Array, Array]:
    """A state whose quaternion is as little of unit length as a simulated one may be."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(model.model, pin.neutral(model.model), 0.5 * rng.normal(size=29))
    q[3:7] *= 1.003
    return q, rng.normal(size=29), rng.normal(size=29)


@pytest.mark.parametrize("seed", range(3))
def test_motion(model: ControlModel, seed: int) -> None:
    q, v, a = _state(model, seed)
    found = task_motion(model, memory(model), q, v, a)
    data = model.model.createData()
    pin.computeCentroidalMomentumTimeVariation(model.model, data, q, v, a)
    pin.updateFramePlacements(model.model, data)
    for k, frame in enumerate(model.frames):
        np.testing.assert_array_equal(found.R[k], data.oMf[frame].rotation)
        np.testing.assert_array_equal(found.p[k], data.oMf[frame].translation)
        velocity = pin.getFrameVelocity(model.model, data, frame, WORLD).vector
        np.testing.assert_allclose(found.v[k], velocity, rtol=1e-12, atol=1e-13)
        acceleration = pin.getFrameClassicalAcceleration(model.model, data, frame, WORLD).vector
        np.testing.assert_allclose(found.a[k], acceleration, rtol=1e-12, atol=1e-12)
    momentum, force = data.hg.vector, data.dhg.vector
    com = [data.com[0], momentum[:3] / model.mass, force[:3] / model.mass]
    np.testing.assert_allclose(found.com, com, rtol=1e-13)
    np.testing.assert_allclose(found.angular, [momentum[3:], force[3:]], rtol=1e-13)


@pytest.mark.parametrize("seed", range(3))
def test_dynamics(model: ControlModel, seed: int) -> None:
    q, v, _ = _state(model, seed)
    found = dynamics_terms(model, memory(model), q, v)
    data = model.model.createData()
    pin.computeAllTerms(model.model, data, q, v)
    pin.updateFramePlacements(model.model, data)
    np.testing.assert_allclose(found.M, data.M, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.h, data.nle + model.damping * v, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.momentum, data.Ag, rtol=1e-12, atol=1e-12)
    for k, frame in enumerate(model.frames):
        J = pin.getFrameJacobian(model.model, data, frame, WORLD)
        np.testing.assert_allclose(found.J[k], J, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(found.joints, q[7:])
    np.testing.assert_array_equal(found.rates, v[6:])


def test_copied_memory_shows_its_own_data(model: ControlModel) -> None:
    room, (q, v, _) = memory(model), _state(model, 0)
    copied = copy.deepcopy(room)
    expected = dynamics_terms(model, room, q, v)
    other = dynamics_terms(model, copied, *_state(model, 1)[:2])
    again = dynamics_terms(model, copied, q, v)
    assert (other.M != expected.M).any()
    np.testing.assert_array_equal(again.M, expected.M)
    np.testing.assert_array_equal(again.motion.p, expected.motion.p)
    np.testing.assert_array_equal(room.dynamics.M, room.data.M)
