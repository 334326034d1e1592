"""Recorded human motion all the way into physics."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.outcome import evaluate
from robomirror_drake.robot import load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import SimulationOptions


@pytest.mark.parametrize("clip", ["walk", "turn_left1"])
def test_recorded_walking_stays_upright_through_the_hold(clip: str) -> None:
    robot = load_robot()
    reference = plan_dynamics(robot, retarget(robot, load_clip(clip)))
    told: list[float] = []
    options = SimulationOptions()
    execution = rollout(robot, reference, options, progress=lambda now, _: told.append(now))
    outcome = evaluate(execution, robot.effort_limits, options.friction)
    assert not outcome.fell
    assert execution.time[-1] == pytest.approx(reference.duration + options.hold, abs=1 / 60)
    assert outcome.A_q < 0.02
    assert outcome.A_p < 0.02
    assert (execution.qp_status == 0.0).all()
    assert told == sorted(told)
    # It steps, and it stands still in the end.
    assert (execution.foot_force[:, :, 2] == 0.0).any(axis=0).all()
    assert np.abs(execution.v[-1]).max() < 0.02
