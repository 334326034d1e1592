"""One reference in, what the robot does with it in physics out."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from robomirror_drake.exceptions import SimulationError
from robomirror_drake.messages import Execution, RobotReference
from robomirror_drake.pipeline import give_reference
from robomirror_drake.robot import Robot
from robomirror_drake.simulation import (
    ExecutionSystems,
    SimulationOptions,
    build_execution,
    fall_time,
    stop_after_fall,
)
from robomirror_drake.systems.outcome_recorder import PERIOD

Progress = Callable[[float, float], None]
"""Called with the time simulated and the time to simulate [s]."""


def rollout(
    robot: Robot,
    reference: RobotReference,
    options: SimulationOptions | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    longest: float = math.inf,
) -> Execution:
    """Executes a reference and then holds its last pose.

    Each call builds a diagram, of which Drake frees about all but 2 MB; for thousands of
    executions, renew the process now and then.

    Args:
        robot: The robot.
        reference: What it shall do; it starts in the reference's first state, but for the
            disturbance of the start.
        options: Options of the physics.
        seed: Of all disturbances that are drawn; carried into the result.
        progress: Called after each tenth of a second.
        longest: Where it is cut off at the latest [s].

    Returns:
        The execution, which ends shortly after a fall if there is one.

    Raises:
        ConfigError: A push is on a link that the robot does not have.
        SimulationError: The physics diverged before a fall was on record.
    """
    options = options or SimulationOptions()
    builder = DiagramBuilder()
    systems = build_execution(builder, robot, options, seed)
    builder.ExportInput(systems.reference_port, "reference")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    give_reference(diagram, context, reference)
    set_initial_state(systems, context, reference)
    end = min(reference.duration + options.hold, longest)
    simulate(simulator, systems, end, options, progress)
    return execution(systems, context, reference, seed)


def set_initial_state(
    systems: ExecutionSystems, context: Context, reference: RobotReference
) -> None:
    """Puts the plant into the reference's first state, with its error and no torque."""
    plant = systems.plant
    own = plant.GetMyMutableContextFromRoot(context)
    state = np.append(reference.q[0], reference.v[0]) + systems.start
    plant.SetPositionsAndVelocities(own, systems.instance, state)
    if systems.actuation is not None:
        systems.actuation.start(context, state)


def simulate(
    simulator: Simulator,
    systems: ExecutionSystems,
    end: float | Callable[[], float],
    options: SimulationOptions,
    progress: Progress | None = None,
) -> None:
    """Simulates up to ``end``, which may move on the way, or until shortly after a fall.

    Raises:
        SimulationError: The physics diverged before a fall was on record.
    """
    simulator.set_monitor(stop_after_fall(systems, options))
    simulator.Initialize()
    until = end if callable(end) else lambda: end
    tenth = 0
    while simulator.get_context().get_time() < until():
        tenth += 1
        try:
            status = simulator.AdvanceTo(min(0.1 * tenth, until()))
        except RuntimeError as error:
            now = simulator.get_context().get_time()
            if now > fall_time(systems, simulator.get_context()) + PERIOD:
                break
            raise SimulationError(now, str(error)) from error
        if progress is not None:
            progress(simulator.get_context().get_time(), until())
        if status.reason() == status.ReturnReason.kReachedTerminationCondition:
            break


def execution(
    systems: ExecutionSystems, context: Context, reference: RobotReference, seed: int = 0
) -> Execution:
    """The execution that the log in a Context holds."""
    log = systems.log.FindLog(context)
    time = log.sample_times()
    sample = systems.recorder.split(log.data().T)
    said = sample.diagnostics
    return Execution(
        time=time,
        q=sample.q,
        v=sample.v,
        q_ref=sample.q_ref,
        v_ref=sample.v_ref,
        torque=sample.torque,
        foot_force=sample.foot_force,
        other_force=sample.other_force,
        contact_ref=reference.contact[reference.rows_at(time)],
        qp_status=said.qp_failures,
        qp_slack=said.slack,
        contact_scheduled=said.planned_contact,
        contact_measured=said.measured_contact,
        torque_limit=said.torque_limit,
        text=reference.text,
        source=reference.source,
        seed=seed,
        motion_end=reference.duration,
    )
