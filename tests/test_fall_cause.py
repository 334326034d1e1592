"""Why it fell: executions that are made to fall for a known reason, in physics."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from robomirror_drake.disturbance import Push
from robomirror_drake.fall_cause import FallCause, earliest, explain_fall, judge
from robomirror_drake.fall_signs import Sign
from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.outcome import evaluate
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import SimulationOptions


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def walk(robot: Robot) -> RobotReference:
    """A recorded walk, kinematically."""
    motion = load_clip("walk")
    return retarget(robot, motion, foot_contacts(motion))


@pytest.fixture(scope="module")
def plan(robot: Robot, walk: RobotReference) -> RobotReference:
    return plan_dynamics(robot, walk)


def fall_of(
    robot: Robot, reference: RobotReference, disturbance: dict[str, Any] | None = None
) -> FallCause:
    options = SimulationOptions.model_validate(
        {"hold": 1.0, "after_fall": 0.1, "disturbance": disturbance or {}}
    )
    outcome = judge(robot, rollout(robot, reference, options), reference, options)
    assert outcome.fell
    return FallCause(outcome.cause, outcome.cause_evidence)


def later(values: np.ndarray, samples: int) -> np.ndarray:
    return np.concatenate([values[:1].repeat(samples, axis=0), values[:-samples]])


def test_a_slippery_floor_is_friction(robot, plan) -> None:
    cause, evidence = fall_of(robot, plan, {"friction": 0.04})
    assert cause == "friction_lost"
    assert "foot slid" in evidence
    assert "at µ 0.04" in evidence


def test_weak_joints_are_saturated(robot, plan) -> None:
    cause, evidence = fall_of(robot, plan, {"actuators": {"strength": 0.2}})
    assert cause == "torque_saturated"
    assert "at its 40 N·m" in evidence


def test_wrong_labels_are_a_contact_mismatch(robot, plan) -> None:
    shifted = dataclasses.replace(
        plan, contact=later(plan.contact, 20), foot_force=later(plan.foot_force, 20)
    )
    cause, evidence = fall_of(robot, shifted)
    assert cause == "contact_mismatch"
    assert "left foot" in evidence


def test_a_motion_that_no_ground_can_carry_is_infeasible(robot, walk) -> None:
    cause, evidence = fall_of(robot, walk)
    assert cause == "reference_infeasible"
    assert "centre of pressure outside" in evidence


def test_a_jump_without_flight_is_infeasible(robot) -> None:
    q = np.tile(robot.standing, (90, 1))
    v, a = np.zeros((90, 29)), np.zeros((90, 29))
    contact = np.ones((90, 2, 4), dtype=np.bool_)
    up = slice(30, 60)  # it hovers
    q[up, 6] += 0.1
    contact[up] = False
    cause, evidence = fall_of(robot, RobotReference(np.arange(90) / 60.0, q, v, a, contact))
    assert cause == "reference_infeasible"
    assert "impossible flight" in evidence


def test_a_push_in_a_sound_walk_is_left_to_the_controller(robot, plan) -> None:
    push = Push(time=1.2, speed=(0.0, 2.0, 0.0))
    cause, evidence = fall_of(robot, plan, {"pushes": [push.model_dump()]})
    assert cause == "controller"
    assert evidence == "pushed by 2.00 m/s at 1.20 s"


def test_upright_has_no_cause(robot, make_execution, reference) -> None:
    execution = make_execution()
    outcome = judge(robot, execution, reference, SimulationOptions())
    assert outcome == evaluate(execution, robot.effort_limits, 0.6)
    assert outcome.cause is None
    assert outcome.cause_evidence is None


def sign(name: str, start: int, end: int, least: float = 0.05) -> Sign:
    holds = np.zeros(120, dtype=np.bool_)
    holds[start:end] = True
    return Sign(name, holds, least, lambda a, b: f"{name} {a} {b}")


@pytest.mark.parametrize(
    ("seen", "cause"),
    [
        ([], None),
        ([sign("friction_lost", 75, 90), sign("torque_saturated", 70, 90)], "torque_saturated"),
        ([sign("friction_lost", 70, 90), sign("torque_saturated", 70, 90)], "friction_lost"),
        ([sign("friction_lost", 10, 40)], None),  # long over
        ([sign("friction_lost", 95, 110)], None),  # a consequence
        ([sign("friction_lost", 70, 72)], None),  # too short
        ([sign("contact_mismatch", 20, 120)], "contact_mismatch"),  # lasting
    ],
)
def test_the_first_sign_before_the_fall_counts(seen, cause) -> None:
    why = earliest(np.arange(120) / 60.0, 80, seen)
    assert (why and why.cause) == cause


def test_pushes_of_any_kind_are_told_by_their_speed(robot, make_execution, reference) -> None:
    q = make_execution().q.copy()
    q[30:, 5] += np.linspace(0.0, 1.0, 31)
    q[50:, 6] = 0.1
    execution = make_execution(q=q)
    for given in (
        {"speed": (0.0, 0.5, 0.0)},
        {"impulse": (0.0, 0.5 * robot.mass, 0.0)},
        {"force": (0.0, 5.0 * robot.mass, 0.0)},
    ):
        push = Push(time=0.45, **given)
        why = explain_fall(robot, execution, reference, 0.6, pushes=[push])
        assert why == ("controller", "pushed by 0.50 m/s at 0.45 s")


def test_without_any_sign_it_is_the_controller(robot, make_execution, reference) -> None:
    q = make_execution().q.copy()
    q[30:, 5] += np.linspace(0.0, 1.0, 31)
    q[50:, 6] = 0.1
    why = explain_fall(robot, make_execution(q=q), reference, 0.6)
    assert why is not None
    assert why.cause == "controller"
    assert re.fullmatch(
        r"within every limit, .* reference at 0\.[56]\d s, on both feet", why.evidence
    )
