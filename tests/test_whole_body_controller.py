"""The controller as a system, and the executions it makes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from robomirror_drake.exceptions import PortError, SimulationError
from robomirror_drake.messages import RobotReference
from robomirror_drake.optimization.control.dynamics_terms import control_model
from robomirror_drake.optimization.control.qp import (
    WholeBodyOptions,
    acceleration_from,
    foot_wrench_from,
    torque_from,
    tuning,
)
from robomirror_drake.optimization.control.reference_trajectory import (
    reference_trajectory,
    sample_reference,
)
from robomirror_drake.optimization.control.solvers import kkt_residual, solve_qp
from robomirror_drake.optimization.control.stance import initial_stance
from robomirror_drake.optimization.control.tick import control_problem, scratch
from robomirror_drake.outcome import evaluate
from robomirror_drake.robot import FEET, Robot, load_robot
from robomirror_drake.rollout import rollout, set_initial_state
from robomirror_drake.simulation import ExecutionSystems, SimulationOptions, build_execution
from robomirror_drake.systems.whole_body_controller import ControllerOptions, WholeBodyController


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def nod(robot: Robot) -> RobotReference:
    """A second of standing in which waist and elbows move there and back."""
    n, amplitude, rate = 61, np.zeros(23), 2.0 * np.pi
    for joint, size in (("WAIST_P", 0.15), ("WAIST_Y", 0.2), ("L_ELBOW_P", 0.4)):
        amplitude[robot.joint_names.index(joint)] = size
    time = np.arange(n) / 60.0
    q, v, a = np.tile(robot.standing, (n, 1)), np.zeros((n, 29)), np.zeros((n, 29))
    phase = rate * time[:, None]
    q[:, 7:] -= amplitude * 0.5 * (1.0 - np.cos(phase))
    v[:, 6:] = -amplitude * 0.5 * rate * np.sin(phase)
    a[:, 6:] = -amplitude * 0.5 * rate**2 * np.cos(phase)
    return RobotReference(time, q, v, a, np.ones((n, 2, 4), dtype=np.bool_), text="nod")


def _diagram(robot: Robot, reference: object) -> tuple[Diagram, ExecutionSystems, Context]:
    builder = DiagramBuilder()
    systems = build_execution(builder, robot)
    builder.ExportInput(systems.reference_port, "reference")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("reference").FixValue(context, Value[object](reference))
    if isinstance(reference, RobotReference):
        set_initial_state(systems, context, reference)
    return diagram, systems, context


def _controller(
    robot: Robot, reference: object, state: np.ndarray, options: ControllerOptions | None = None
) -> tuple[WholeBodyController, Context]:
    controller = WholeBodyController(robot, options)
    context = controller.CreateDefaultContext()
    controller.GetInputPort("reference").FixValue(context, Value[object](reference))
    controller.GetInputPort("state").FixValue(context, state)
    return controller, context


def _tick(controller: WholeBodyController, context: Context) -> tuple[np.ndarray, np.ndarray]:
    """Torque and diagnostics after one control tick."""
    held = controller.AllocateDiscreteVariables()
    controller._update(context, held)
    context.SetDiscreteState(held)
    torque = controller.GetOutputPort("torque").Eval(context)
    return torque, controller.GetOutputPort("diagnostics").Eval(context)


def test_stands_and_nods_in_physics(robot: Robot, nod: RobotReference) -> None:
    options = SimulationOptions(hold=1.0)
    execution = rollout(robot, nod, options)
    outcome = evaluate(execution, robot.effort_limits, options.friction)
    assert not outcome.fell
    assert outcome.A_q < 0.01
    assert outcome.A_p < 0.01
    assert outcome.friction_margin > 0.2
    assert (execution.qp_status == 0).all()
    assert execution.time[-1] == pytest.approx(2.0)
    assert execution.motion_end == 1.0
    np.testing.assert_allclose(np.diff(execution.time), 1.0 / 60.0, atol=1e-9)
    weight = execution.foot_force[-1, :, 2].sum()
    assert weight == pytest.approx(9.81 * robot.mass, rel=0.01)
    np.testing.assert_allclose(execution.q_ref[:61], nod.q, atol=1e-9)
    np.testing.assert_allclose(execution.v_ref[:60], nod.v[:60], atol=1e-9)
    np.testing.assert_array_equal(execution.v_ref[61:], 0.0)


def test_restored_snapshot_runs_to_the_same_bytes(robot: Robot, nod: RobotReference) -> None:
    diagram, _, context = _diagram(robot, nod)
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(0.3)
    snapshot = simulator.get_context().Clone()

    def run_on() -> np.ndarray:
        simulator.AdvanceTo(0.6)
        return (
            simulator.get_context().get_discrete_state_vector().value().copy()
            if (simulator.get_context().num_discrete_state_groups() == 1)
            else np.concatenate(
                [
                    simulator.get_context().get_discrete_state(i).value()
                    for i in range(simulator.get_context().num_discrete_state_groups())
                ]
            )
        )

    first = run_on()
    simulator.get_mutable_context().SetTimeStateAndParametersFrom(snapshot)
    simulator.Initialize()
    again = run_on()
    assert first.tobytes() == again.tobytes()


def test_same_reference_gives_the_same_execution(robot: Robot, nod: RobotReference) -> None:
    short = SimulationOptions(hold=0.0)
    assert rollout(robot, nod, short) == rollout(robot, nod, short)


def test_a_push_over_is_noticed_and_ends_the_run(robot: Robot, nod: RobotReference) -> None:
    v = nod.v.copy()
    v[0, 3] = 3.0  # thrown forward
    execution = rollout(robot, dataclasses.replace(nod, v=v), SimulationOptions(hold=3.0))
    outcome = evaluate(execution, robot.effort_limits, 0.6)
    assert outcome.fell
    assert outcome.fall_time_s is not None
    assert execution.time[-1] == pytest.approx(outcome.fall_time_s + 0.5, abs=0.02)
    assert np.isfinite(execution.torque).all()


def test_diverging_physics_is_an_error_of_ours(robot: Robot, nod: RobotReference) -> None:
    v = nod.v.copy()
    v[0] = 1e150
    with pytest.raises(SimulationError, match="diverged at 0"):
        rollout(robot, dataclasses.replace(nod, v=v))


def test_failures_hold_the_torque_then_damp_and_are_reported(
    robot: Robot, nod: RobotReference
) -> None:
    state = np.concatenate([nod.q[0], np.full(29, 0.1)])
    controller, context = _controller(robot, nod, state, ControllerOptions(patience=2, delay=0.0))
    torque, diagnostics = _tick(controller, context)
    assert diagnostics[0] == 0.0
    assert np.abs(torque).max() > 1.0
    broken = state.copy()
    broken[35] = np.nan
    controller.GetInputPort("state").FixValue(context, broken)
    for count in (1.0, 2.0):
        held, diagnostics = _tick(controller, context)
        assert diagnostics[0] == count
        np.testing.assert_array_equal(held, torque)
    damped, _ = _tick(controller, context)
    np.testing.assert_array_equal(damped, 0.0)
    controller.GetInputPort("state").FixValue(context, state)
    recovered, diagnostics = _tick(controller, context)
    assert diagnostics[0] == 0.0
    np.testing.assert_array_equal(recovered, torque)


def test_a_thousand_states_however_absurd_give_torques_within_limits(
    robot: Robot, nod: RobotReference
) -> None:
    rng = np.random.default_rng(0)
    standing = np.concatenate([nod.q[0], np.zeros(29)])
    controller, context = _controller(robot, nod, standing)
    port = controller.GetInputPort("state")
    unsolved = 0
    for k in range(1000):
        size = 10.0 ** rng.uniform(-3.0, 3.0) if k % 2 else 10.0 ** rng.uniform(3.0, 300.0)
        state = standing.copy()
        state[4:] += size * rng.standard_normal(55)
        upside_down = rng.standard_normal(4)
        state[:4] = upside_down / np.linalg.norm(upside_down)
        broken = k % 5 == 0
        if broken:
            state[rng.integers(59)] = rng.choice([np.nan, np.inf, -np.inf])
        port.FixValue(context, state)
        torque, diagnostics = _tick(controller, context)
        assert np.isfinite(torque).all()
        assert np.isfinite(diagnostics).all()
        assert (np.abs(torque) <= robot.effort_limits).all()
        failed = diagnostics[0] > 0.0
        assert failed or not broken
        unsolved = unsolved + 1 if failed else 0
        assert diagnostics[0] == unsolved  # and says for how long
    # Nothing of it sticks.
    port.FixValue(context, standing)
    for _ in range(500):
        torque, diagnostics = _tick(controller, context)
    fresh, clean = _controller(robot, nod, standing)
    for _ in range(500):
        expected, _ = _tick(fresh, clean)
    assert diagnostics[0] == 0.0
    np.testing.assert_allclose(torque, expected, atol=1e-3)


def test_every_tick_of_a_rollout_is_optimal_and_drakes_dynamics(
    robot: Robot, nod: RobotReference
) -> None:
    execution = rollout(robot, nod, SimulationOptions(hold=0.0))
    model = control_model(robot)
    tuned, memory, stance = tuning(model, WholeBodyOptions()), scratch(model), initial_stance()
    trajectory = reference_trajectory(robot, nod)
    plant = MultibodyPlant(0.002)
    robot.add_to_plant(plant, collision=False)
    plant.Finalize()
    own = plant.CreateDefaultContext()
    forces = MultibodyForces(plant)
    for time, q, v in zip(execution.time, execution.q, execution.v, strict=True):
        q_pin, v_pin = robot.to_pinocchio(q), robot.v_to_pinocchio(q, v)
        tick = control_problem(
            model, memory, tuned, q_pin, v_pin, trajectory, time, stance, 1.0 / 60.0
        )
        stance = tick.stance
        exact = {solver: solve_qp(tick.qp, solver) for solver in ("daqp", "quadprog")}
        for solution in exact.values():
            assert solution.found
            assert kkt_residual(solution) < 1e-6
        solution = exact["daqp"]
        for solver in ("proxqp", "piqp", "osqp"):
            other = solve_qp(tick.qp, solver)
            assert other.found
            np.testing.assert_allclose(
                torque_from(other), torque_from(solution), atol=0.1, err_msg=solver
            )
        np.testing.assert_allclose(torque_from(solution), torque_from(exact["quadprog"]), atol=1e-4)
        plant.SetPositionsAndVelocities(own, np.concatenate([q, v]))
        plant.CalcForceElementsContribution(own, forces)
        for foot, wrench in zip(FEET, foot_wrench_from(solution), strict=True):
            body = plant.GetBodyByName(robot.spec.feet[foot].link)
            center = body.EvalPoseInWorld(own).rotation() @ robot.spec.feet[foot].center
            force = SpatialForce(tau=wrench[3:], f=wrench[:3])
            body.AddInForce(own, center, force, plant.world_frame(), forces)
        a = robot.a_to_drake(q, v, acceleration_from(solution))
        tau = plant.CalcInverseDynamics(own, a, forces)
        np.testing.assert_allclose(tau[:6], 0.0, atol=1e-6)
        np.testing.assert_allclose(tau[6:], torque_from(solution), atol=1e-6)


def test_wrong_message_is_refused(robot: Robot, nod: RobotReference) -> None:
    controller, context = _controller(robot, "walk", np.concatenate([nod.q[0], np.zeros(29)]))
    with pytest.raises(PortError, match="carries a str, expected a RobotReference"):
        _tick(controller, context)


def test_reference_can_start_late(robot: Robot, nod: RobotReference) -> None:
    state = np.concatenate([nod.q[0], nod.v[0]])
    controller, context = _controller(robot, nod, state, ControllerOptions(start=1.0))
    port = controller.GetOutputPort("reference_state")
    context.SetTime(0.5)
    np.testing.assert_allclose(port.Eval(context)[:30], nod.q[0], atol=1e-12)
    context.SetTime(1.5)
    np.testing.assert_allclose(
        port.Eval(context), np.concatenate([nod.q[30], nod.v[30]]), atol=1e-9
    )


def test_reference_between_samples_is_consistent(robot: Robot, nod: RobotReference) -> None:
    trajectory = reference_trajectory(robot, nod)
    h = 1e-5
    for t in (0.111, 0.4321, 0.777):
        before, now, after = (sample_reference(trajectory, t + s, 0.03) for s in (-h, 0.0, h))
        np.testing.assert_allclose(now.v[6:], (after.q - before.q)[7:] / (2 * h), atol=2e-3)
        np.testing.assert_allclose(now.a, (after.v - before.v) / (2 * h), atol=2e-2)


def test_corner_loads_ramp_around_a_switch(robot: Robot, nod: RobotReference) -> None:
    contact = nod.contact.copy()
    contact[20:40, 0] = False
    trajectory = reference_trajectory(robot, dataclasses.replace(nod, contact=contact))
    times = np.arange(0.0, 1.5, 0.001)
    load = np.array([sample_reference(trajectory, t, 0.04).load for t in times])
    off, on = 20 / 60, 40 / 60
    assert (load[:, 1] == 1.0).all()
    assert (load[(times > off + 1e-6) & (times < on - 1e-6), 0] == 0.0).all()
    assert (load[(times < off - 0.04) | (times > on + 0.04), 0] == 1.0).all()
    assert (load[(times < off - 1e-6) | (times > on + 1e-6), 0] > 0.0).all()
    assert np.abs(np.diff(load[times < off - 1e-6, 0, 0])).max() < 0.03


def test_flight_keeps_momentum_and_energy_sane(robot: Robot, nod: RobotReference) -> None:
    """In free fall the centre of mass accelerates with g and momentum about it stays."""
    lifted = nod.q.copy()
    lifted[:, 6] += 1.0
    flying = dataclasses.replace(
        nod, q=lifted, v=0 * nod.v, a=0 * nod.a, contact=np.zeros_like(nod.contact)
    )
    diagram, systems, context = _diagram(robot, flying)
    simulator = Simulator(diagram, context)
    plant = systems.plant
    own = plant.GetMyContextFromRoot(simulator.get_context())
    start = plant.CalcCenterOfMassPositionInWorld(own)
    simulator.AdvanceTo(0.3)
    fallen = plant.CalcCenterOfMassPositionInWorld(own)
    # Symplectic Euler falls g dt t / 2 further than the parabola.
    drop = 0.5 * 9.81 * 0.3**2 + 0.5 * 9.81 * 0.3 * plant.time_step()
    np.testing.assert_allclose(fallen - start, [0.0, 0.0, -drop], atol=1e-3)
    spin = plant.CalcSpatialMomentumInWorldAboutPoint(own, fallen).rotational()
    np.testing.assert_allclose(spin, 0.0, atol=0.05)


def test_flight_balances_energy(robot: Robot, nod: RobotReference) -> None:
    """What joints do, less what they lose in friction, is what the motion gains."""
    lifted = nod.q.copy()
    lifted[:, 6] += 2.0
    flying = dataclasses.replace(nod, q=lifted, contact=np.zeros_like(nod.contact))
    diagram, systems, context = _diagram(robot, flying)
    simulator = Simulator(diagram, context)
    plant = systems.plant
    own = plant.GetMyContextFromRoot(simulator.get_context())
    controller = systems.controller.GetMyContextFromRoot(simulator.get_context())
    step, worked = plant.time_step(), 0.0
    friction = control_model(robot).damping[6:]

    def energy() -> float:
        v = plant.GetVelocities(own)
        kinetic = 0.5 * v @ plant.CalcMassMatrix(own) @ v  # with the rotors
        return float(kinetic + plant.CalcPotentialEnergy(own))

    simulator.AdvanceTo(step)
    start = last = energy()
    most = 0.0
    for k in range(1, 200):
        before = plant.GetVelocities(own)[6:]
        torque = systems.controller.GetOutputPort("torque").Eval(controller)
        simulator.AdvanceTo((k + 1) * step)
        after = plant.GetVelocities(own)[6:]
        worked += step * (torque - friction * after) @ (0.5 * (before + after))
        last = energy()
        most = max(most, abs(worked))
    assert most > 1.0  # joints do work
    # The integration itself turns g²·step·m/2 = 6 W·s of fall and spin into an error.
    drop = 0.5 * robot.mass * 9.81**2 * step * 199 * step
    assert last - start - worked == pytest.approx(-drop, abs=0.05 * most + 0.3)


def test_diagrams_do_not_pile_up_in_memory(robot: Robot, nod: RobotReference) -> None:
    def resident() -> float:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096 / 2**20

    for _ in range(2):
        _diagram(robot, nod)
    before = resident()
    for _ in range(5):
        _diagram(robot, nod)
    assert resident() - before < 20.0
