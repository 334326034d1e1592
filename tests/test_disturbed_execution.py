"""Disturbances and the joint-target interface in physics."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from robomirror_drake.config import load_scenario
from robomirror_drake.disturbance import Push, StartErrors
from robomirror_drake.disturbance_draw import start_error
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import RobotReference
from robomirror_drake.outcome import evaluate
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.robot_spec import JointGains
from robomirror_drake.rollout import rollout, set_initial_state
from robomirror_drake.simulation import ExecutionSystems, SimulationOptions, build_execution
from robomirror_drake.systems.actuation import Actuation
from robomirror_drake.systems.joint_target import joint_target
from robomirror_drake.systems.pusher import mean_force

STEP = SimulationOptions().time_step

ALL: dict[str, Any] = {
    "pushes": [{"time": 0.2, "speed": [0.1, 0.0, 0.0], "body": "WAIST_R_S"}],
    "random_pushes": {"interval": 0.5, "speed": [0.05, 0.1]},
    "friction": [0.5, 1.0],
    "mass": [-0.02, 0.02],
    "center_of_mass": 0.005,
    "sensors": {
        "joint_position": 0.001,
        "joint_velocity": 0.02,
        "orientation": 0.002,
        "angular_velocity": 0.01,
    },
    "actuators": {"latency": [0.001, 0.004], "lag": 0.002, "strength": [0.8, 0.9]},
}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def stand(robot: Robot) -> RobotReference:
    return squatting(robot, 0.0, 31)


def squatting(robot: Robot, depth: float, samples: int) -> RobotReference:
    """Knees bent by ``depth`` [rad] and stretched again over all samples, soles in place."""
    time = np.arange(samples) / 60.0
    bend = 0.5 * depth * (1.0 - np.cos(2.0 * np.pi * time / time[-1]))
    q = np.tile(robot.standing, (samples, 1))
    for joint, share in (("HIP_P", -0.5), ("KNEE", 1.0), ("ANKLE_P", -0.5)):
        for side in "LR":
            q[:, 7 + robot.joint_names.index(f"{side}_{joint}")] += share * bend
    data = robot.model.createData()
    foot = []
    for row in robot.to_pinocchio(q):
        pin.framesForwardKinematics(robot.model, data, row)
        foot.append(data.oMf[robot.foot_frames[0]].translation.copy())
    q[:, 4:7] += foot[0] - np.array(foot)
    v = np.zeros((samples, 29))
    v[:, 3:] = np.gradient(q[:, 4:], time, axis=0)
    return RobotReference(
        time, q, v, np.gradient(v, time, axis=0), np.ones((samples, 2, 4), dtype=np.bool_)
    )


def options(disturbance: dict[str, Any] | None = None, **others: Any) -> SimulationOptions:
    return SimulationOptions.model_validate({"disturbance": disturbance or {}, **others})


def built(
    robot: Robot, reference: RobotReference, settings: SimulationOptions, seed: int = 0
) -> tuple[Diagram, ExecutionSystems, Simulator]:
    builder = DiagramBuilder()
    systems = build_execution(builder, robot, settings, seed)
    builder.ExportInput(systems.reference_port, "reference")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("reference").FixValue(context, Value[object](reference))
    set_initial_state(systems, context, reference)
    simulator.Initialize()
    return diagram, systems, simulator


def all_state(context: Context) -> bytes:
    groups = range(context.num_discrete_state_groups())
    return b"".join(context.get_discrete_state(i).value().tobytes() for i in groups)


def test_zero_disturbance_is_no_disturbance_to_the_bit(robot: Robot, stand: RobotReference) -> None:
    zero = {
        "random_pushes": {"speed": 0.0},
        "mass": 0.0,
        "center_of_mass": 0.0,
        "sensors": {"joint_position": 0.0},
        "actuators": {"latency": [0.0, 0.0], "lag": 0.0, "strength": 1.0},
    }
    diagram, systems, _ = built(robot, stand, options(zero))
    names = {system.get_name() for system in diagram.GetSystems()}
    assert names == {
        "plant",
        "scene_graph",
        "whole_body_controller",
        "ground_forces",
        "outcome_recorder",
        "execution_log",
    }
    assert systems.actuation is None
    calm = SimulationOptions(hold=0.0)
    assert rollout(robot, stand, options(zero, hold=0.0), 3) == rollout(robot, stand, calm, 3)


def test_an_execution_starts_off_by_what_was_drawn(robot: Robot, stand: RobotReference) -> None:
    errors = {"joint_position": 0.01, "linear_velocity": 0.05}
    done = rollout(robot, stand, options({"start": errors}, hold=0.0), 4)
    off = np.append(done.q[0] - stand.q[0], done.v[0] - stand.v[0])
    drawn = start_error(StartErrors(**errors), 4, len(robot.joint_names))
    np.testing.assert_allclose(off, drawn, atol=1e-12)
    assert drawn.any()


@pytest.mark.parametrize(
    "push",
    [
        {"time": 0.05, "duration": 0.1, "impulse": [20.0, -10.0, 5.0]},
        {"time": 0.0511, "duration": 0.0333, "force": [200.0, 100.0, -50.0]},
        {"time": 0.05, "duration": 0.0005, "speed": [0.2, 0.1, 0.3]},
    ],
)
def test_a_push_in_flight_changes_momentum_by_its_impulse(
    robot: Robot, stand: RobotReference, push: dict[str, Any]
) -> None:
    q = stand.q.copy()
    q[:, 6] += 1.0
    flying = dataclasses.replace(stand, q=q, contact=np.zeros_like(stand.contact))
    momentum = []
    for pushes in ([], [push]):
        _, systems, simulator = built(robot, flying, options({"pushes": pushes}, time_step=0.0005))
        simulator.AdvanceTo(0.2)
        own = systems.plant.GetMyContextFromRoot(simulator.get_context())
        momentum.append(systems.plant.CalcSpatialMomentumInWorldAboutPoint(own, np.zeros(3)))
    gained = momentum[1].translational() - momentum[0].translational()
    if "force" in push:
        impulse = push["duration"] * np.array(push["force"])
    else:
        impulse = np.array(push.get("impulse", robot.mass * np.array(push.get("speed", 0.0))))
    # A discrete step conserves the momentum of a moving tree to first order only.
    np.testing.assert_allclose(gained, impulse, atol=0.01 * np.linalg.norm(impulse))


def test_steps_share_an_impulse_without_loss() -> None:
    push = Push(time=0.0511, duration=0.0333, force=(200.0, 0.0, -50.0))
    steps = np.arange(100) * STEP
    impulse = STEP * sum(mean_force(push, 60.0, start, start + STEP) for start in steps)
    np.testing.assert_allclose(impulse, 0.0333 * np.array([200.0, 0.0, -50.0]), rtol=1e-12)
    as_speed = Push(time=0.0, duration=0.1, speed=(0.5, 0.0, 0.0))
    assert mean_force(as_speed, 60.0, 0.02, 0.022)[0] == pytest.approx(60.0 * 0.5 / 0.1)


def test_random_pushes_come_at_their_times(robot: Robot, stand: RobotReference) -> None:
    given = {"random_pushes": {"interval": 0.2, "duration": 0.05, "speed": [0.3, 0.3]}}
    diagram, systems, simulator = built(robot, stand, options(given), seed=2)
    pusher = diagram.GetSubsystemByName("pusher")
    own = pusher.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    port = pusher.GetOutputPort("spatial_forces")
    impulse = np.zeros(3)
    for step in range(round(1.0 / STEP)):
        simulator.get_mutable_context().SetTime(step * STEP)
        for force in port.Eval(own):
            impulse += STEP * np.abs(force.F_Bq_W.translational())
            assert force.body_index == systems.plant.GetBodyByName("PELVIS_S").index()
    assert 5 * 0.3 <= impulse.sum() / robot.mass <= 5 * 0.3 * 2**0.5
    assert impulse[2] == 0.0


def test_an_unknown_link_is_named(robot: Robot) -> None:
    push = {"time": 0.0, "force": [1, 0, 0], "body": "TAIL"}
    with pytest.raises(ConfigError, match="no link 'TAIL'"):
        build_execution(DiagramBuilder(), robot, options({"pushes": [push]}))


def test_mass_error_is_the_plants_alone(robot: Robot, stand: RobotReference) -> None:
    _, systems, simulator = built(robot, stand, options({"mass": 0.05, "center_of_mass": 0.02}), 1)
    _, nominal, calm = built(robot, stand, options())
    own = systems.plant.GetMyContextFromRoot(simulator.get_context())
    own_calm = nominal.plant.GetMyContextFromRoot(calm.get_context())
    mass = systems.plant.CalcTotalMass(own)
    assert mass == pytest.approx(1.05 * robot.mass)
    shifts = []
    for index in nominal.plant.GetBodyIndices(nominal.instance):
        body, true = nominal.plant.get_body(index), systems.plant.get_body(index)
        inertia = body.CalcSpatialInertiaInBodyFrame(own_calm)
        changed = true.CalcSpatialInertiaInBodyFrame(own)
        assert changed.get_mass() == pytest.approx(1.05 * inertia.get_mass())
        shifts.append(changed.get_com() - inertia.get_com())
        about_com = [i.Shift(i.get_com()).CalcRotationalInertia() for i in (inertia, changed)]
        np.testing.assert_allclose(
            about_com[1].CopyToFullMatrix3(), 1.05 * about_com[0].CopyToFullMatrix3(), atol=1e-12
        )
    for index in nominal.plant.GetJointActuatorIndices(nominal.instance):
        rotors = [
            made.plant.get_joint_actuator(index).default_reflected_inertia()
            for made in (nominal, systems)
        ]
        assert rotors[0] == rotors[1] > 0.05
    assert 0.015 < np.abs(shifts).max() <= 0.02
    assert sum(inertia.mass for inertia in systems.controller._robot.model.inertias) == robot.mass
    assert load_robot() is robot
    # It weighs more than the controller believes.
    simulator.AdvanceTo(1.0)
    recorder = systems.recorder.GetMyContextFromRoot(simulator.get_context())
    sample = systems.recorder.split(systems.recorder.GetOutputPort("sample").Eval(recorder))
    assert sample.foot_force[:, 2].sum() == pytest.approx(9.81 * mass, rel=0.02)


def test_drawn_friction_is_that_of_the_contact(robot: Robot, stand: RobotReference) -> None:
    """A robot that is thrown sideways brakes with µ times its weight."""
    v = stand.v.copy()
    v[0, 4] = 2.0
    settings = options({"friction": 0.3}, hold=0.0)
    force = rollout(robot, dataclasses.replace(stand, v=v), settings).foot_force[:6]
    force = force[force[..., 2] > 50.0]
    assert len(force) >= 2
    ratio = np.linalg.norm(force[:, :2], axis=1) / force[:, 2]
    np.testing.assert_allclose(ratio, 0.3, rtol=0.02)
    assert built(robot, stand, settings)[1].friction == 0.3


@pytest.mark.parametrize(("latency", "steps"), [(0.0, 0), (0.002, 1), (0.0081, 4), (0.05, 25)])
def test_latency_is_whole_steps(
    robot: Robot, stand: RobotReference, latency: float, steps: int
) -> None:
    given = {"actuators": {"latency": latency, "strength": 2.0}}
    _, systems, simulator = built(robot, stand, options(given))
    torque = systems.controller.GetOutputPort("torque")
    command = systems.plant.get_actuation_input_port(systems.instance)
    controller = systems.controller.GetMyContextFromRoot(simulator.get_context())
    plant = systems.plant.GetMyContextFromRoot(simulator.get_context())
    sent, read = [], []
    for step in range(60):  # what there is before the updates of a time is what they read
        sent.append(torque.Eval(controller).copy())
        read.append(command.Eval(plant).copy())
        simulator.AdvanceTo((step + 1) * STEP)
    np.testing.assert_array_equal(read[steps:], sent[: 60 - steps])
    np.testing.assert_array_equal(read[:steps], 0.0)
    assert np.abs(sent[-1]).max() > 1.0


def test_lag_has_its_step_response(robot: Robot) -> None:
    joints = len(robot.joint_names)
    actuation = Actuation(joints, STEP, lag=0.01)
    simulator = Simulator(actuation)
    context = simulator.get_mutable_context()
    actuation.GetInputPort("torque").FixValue(context, np.full(joints, 80.0))
    response = []
    for step in range(25):
        response.append(actuation.GetOutputPort("command").Eval(context).copy())
        simulator.AdvanceTo((step + 1) * STEP)
    after = (np.arange(25) + 1.0) * STEP
    wanted = 80.0 * (1.0 - np.exp(-after / 0.01))
    np.testing.assert_allclose(response, np.tile(wanted[:, None], joints), rtol=1e-9)


def test_weak_actuators_give_no_more_than_they_can(robot: Robot, stand: RobotReference) -> None:
    weak = options({"actuators": {"strength": 0.1}}, hold=0.0)
    limit = 0.1 * robot.effort_limits
    for interface in ("torque", "joint_target"):
        execution = rollout(robot, stand, weak.model_copy(update={"interface": interface}))
        assert (np.abs(execution.torque) <= limit * (1.0 + 1e-9)).all()
        assert (np.abs(execution.torque) >= limit * (1.0 - 1e-6)).any()


def test_what_is_recorded_is_the_truth(robot: Robot, stand: RobotReference) -> None:
    noisy = options({"sensors": {"joint_position": 0.002, "orientation": 0.01}}, hold=0.0)
    execution = rollout(robot, stand, noisy)
    second_difference = np.diff(execution.q[:, 7:], n=2, axis=0)
    assert 0.0 < second_difference.std() < 3e-4


@pytest.mark.parametrize("interface", ["torque", "joint_target"])
def test_snapshot_replays_to_the_bit_with_everything_on(
    robot: Robot, stand: RobotReference, interface: str
) -> None:
    diagram, _, simulator = built(robot, stand, options(ALL, interface=interface), seed=4)
    assert {"pusher", "sensors", "actuation"} <= {s.get_name() for s in diagram.GetSystems()}
    simulator.AdvanceTo(0.25)
    snapshot = simulator.get_context().Clone()
    simulator.AdvanceTo(0.45)
    first = all_state(simulator.get_context())
    go_on = InitializeParams(suppress_initialization_events=True)
    simulator.get_mutable_context().SetTimeStateAndParametersFrom(snapshot)
    simulator.Initialize(go_on)
    simulator.AdvanceTo(0.45)
    assert all_state(simulator.get_context()) == first
    branch = Simulator(diagram, snapshot)
    branch.Initialize(go_on)
    branch.AdvanceTo(0.45)
    assert all_state(branch.get_context()) == first
    # Another diagram of the same seed does the same, of another seed something else.
    for seed, same in ((4, True), (5, False)):
        _, _, again = built(robot, stand, options(ALL, interface=interface), seed)
        again.AdvanceTo(0.45)
        assert (all_state(again.get_context()) == first) == same


def test_joint_target_asks_the_servo_for_the_torque() -> None:
    rng = np.random.default_rng(1)
    q, v, torque = rng.standard_normal((3, 23))
    gains = JointGains(stiffness=100.0, damping=10.0)
    target = joint_target(q, v, torque, gains)
    np.testing.assert_allclose(100.0 * (target - q) - 10.0 * v, torque, atol=1e-12)


def test_stands_and_squats_on_joint_targets(robot: Robot) -> None:
    settings = options(interface="joint_target", hold=0.5)
    execution = rollout(robot, squatting(robot, 0.5, 91), settings)
    outcome = evaluate(execution, robot.effort_limits, settings.friction)
    assert not outcome.fell
    assert outcome.A_q < 0.03
    assert np.ptp(execution.q[:, 6]) > 0.03
    assert execution.foot_force[-1, :, 2].sum() == pytest.approx(9.81 * robot.mass, rel=0.02)


def test_joint_targets_are_held_at_their_rate(robot: Robot, stand: RobotReference) -> None:
    _, systems, simulator = built(robot, stand, options(interface="joint_target"))
    port = systems.plant.get_desired_state_input_port(systems.instance)
    own = systems.plant.GetMyContextFromRoot(simulator.get_context())
    seen = [port.Eval(own).copy()]
    # Before the first tick: no torque.
    np.testing.assert_array_equal(seen[0], np.append(stand.q[0, 7:], np.zeros(23)))
    for step in range(round(0.2 / STEP)):
        simulator.AdvanceTo((step + 1) * STEP)
        seen.append(port.Eval(own).copy())
    changes = np.flatnonzero(np.abs(np.diff(seen, axis=0)).max(axis=1)) * STEP
    np.testing.assert_allclose(changes, np.arange(len(changes)) / 60.0, atol=STEP)
    assert len(changes) == 12


def test_until_latency_is_over_targets_ask_for_no_torque(
    robot: Robot, stand: RobotReference
) -> None:
    v = stand.v.copy()
    v[0, 6:] = 0.1
    moving = dataclasses.replace(stand, v=v)
    slow = options({"actuators": {"latency": 0.01, "lag": 0.004}}, interface="joint_target")
    _, systems, simulator = built(robot, moving, slow)
    port = systems.plant.get_desired_state_input_port(systems.instance)
    own = systems.plant.GetMyContextFromRoot(simulator.get_context())
    torque_free = np.append(stand.q[0, 7:] + 0.1 * 0.1, np.zeros(23))
    for step in range(6):
        np.testing.assert_allclose(port.Eval(own), torque_free, atol=1e-12)
        simulator.AdvanceTo((step + 1) * STEP)
    assert np.abs(port.Eval(own) - torque_free).max() > 1e-3


def test_squats_under_moderate_disturbances(robot: Robot) -> None:
    moderate = load_scenario("moderate").simulation.model_copy(update={"hold": 0.5})
    squat = squatting(robot, 0.5, 91)
    for seed in range(2):
        execution = rollout(robot, squat, moderate, seed)
        assert execution.seed == seed
        outcome = evaluate(execution, robot.effort_limits, moderate.friction)
        assert not outcome.fell
        assert outcome.A_q < 0.05
