"""Links that keep apart: derivatives, and an arm that is told to go through the body."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.control.collision import CollisionOptions, apart_rows
from robomirror_drake.optimization.control.dynamics_terms import (
    control_model,
    dynamics_terms,
    memory,
)
from robomirror_drake.optimization.planning.collision import gaps
from robomirror_drake.robot import load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import SimulationOptions

ROBOT = load_robot()
CONTROL = control_model(ROBOT)


def _distances(q: Array) -> Array:
    """(M,) distances of all pairs at positions in Pinocchio's order."""
    data = CONTROL.model.createData()
    pin.framesForwardKinematics(CONTROL.model, data, q)
    links = np.array([data.oMf[link].homogeneous for link in CONTROL.collision.links])
    return gaps(CONTROL.collision.capsules, links[None]).distance[0]


@pytest.mark.parametrize("seed", range(5))
def test_rows_are_the_derivatives_of_the_near_distances(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = ROBOT.to_pinocchio(ROBOT.standing)
    q[7:] = rng.uniform(CONTROL.lower, CONTROL.upper)
    way, step = rng.standard_normal(23), 1e-6
    room = memory(CONTROL)
    dynamics_terms(CONTROL, room, q, np.zeros(29))
    rates = rng.standard_normal(23)
    options = CollisionOptions(influence=0.3)
    rows = apart_rows(CONTROL.collision, room, rates, options)
    ahead, behind = q.copy(), q.copy()
    ahead[7:] += step * way
    behind[7:] -= step * way
    near = _distances(q) < options.influence
    expected = ((_distances(ahead) - _distances(behind)) / (2 * step))[near]
    assert near.sum() > 3
    np.testing.assert_allclose(rows.A @ way, expected, atol=1e-5)
    bound = -(_distances(q)[near] - options.distance) / options.response**2
    bound -= 2.0 / options.response * (rows.A @ rates)
    np.testing.assert_allclose(rows.b, np.minimum(bound, options.strongest), rtol=1e-9)


def _arm_into_the_body() -> RobotReference:
    """Standing, while the right upper arm is turned inwards through the chest."""
    time = np.arange(61) / 60.0
    share = 0.5 - 0.5 * np.cos(np.pi * time)
    q = np.tile(ROBOT.standing, (61, 1))
    joint = 7 + ROBOT.joint_names.index("R_SHOULDER_R")
    q[:, joint] += 0.37 * share
    v = np.zeros((61, 29))
    v[:, joint - 1] = np.gradient(q[:, joint], time)
    contact = np.ones((61, 2, 4), dtype=np.bool_)
    return RobotReference(time=time, q=q, v=v, a=np.gradient(v, time, axis=0), contact=contact)


def test_an_arm_stops_short_of_the_body() -> None:
    reference = _arm_into_the_body()
    wanted = min(_distances(ROBOT.to_pinocchio(q)).min() for q in reference.q)
    assert wanted < -0.01, "the reference does not go through the body: nothing is tested"
    execution = rollout(ROBOT, reference, SimulationOptions(hold=0.5))
    least = min(_distances(ROBOT.to_pinocchio(q)).min() for q in execution.q)
    assert least > 0.003, "only the touch itself stopped it"
