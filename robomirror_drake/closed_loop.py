"""A motion that is adapted while it runs: the diagram, and one execution in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from robomirror_drake.adaptation.handover_options import AdapterOptions
from robomirror_drake.messages import Array, Execution, Handover, RobotReference
from robomirror_drake.ppn.predictor import Predictor
from robomirror_drake.robot import Robot
from robomirror_drake.rollout import Progress, execution, set_initial_state, simulate
from robomirror_drake.simulation import ExecutionSystems, SimulationOptions, build_execution
from robomirror_drake.systems.adapter import Adapter


class ClosedLoop(NamedTuple):
    """A diagram whose motion is adapted while it runs, and the systems in it."""

    diagram: Diagram
    execution: ExecutionSystems
    adapter: Adapter


def build_closed_loop(
    robot: Robot,
    predictor: Predictor,
    simulation: SimulationOptions | None = None,
    options: AdapterOptions | None = None,
    seed: int = 0,
    watch: Callable[[float], None] | None = None,
) -> ClosedLoop:
    """A motion and its plan in, physics out, with an adapter between plan and controller.

    Exports the input ports ``commanded`` and ``plan``, and the output ports ``reference``,
    ``handovers`` and ``risk`` of the :class:`.Adapter`.

    Args:
        robot: The robot.
        predictor: What foresees falls.
        simulation: Of the physics.
        options: When and how the motion is changed.
        seed: Of all disturbances that are drawn.
        watch: Told how long each look ahead took by the clock [s].
    """
    builder = DiagramBuilder()
    execution = build_execution(builder, robot, simulation, seed)
    adapter = builder.AddNamedSystem("adapter", Adapter(robot, predictor, options, watch))
    builder.Connect(execution.seen, adapter.GetInputPort("state"))
    builder.Connect(adapter.GetOutputPort("reference"), execution.reference_port)
    for port in ("commanded", "plan"):
        builder.ExportInput(adapter.GetInputPort(port), port)
    for port in ("reference", "handovers", "risk"):
        builder.ExportOutput(adapter.GetOutputPort(port), port)
    diagram = builder.Build()
    diagram.set_name("closed_loop")
    return ClosedLoop(diagram, execution, adapter)


class Adapted(NamedTuple):
    """An execution of a motion that was adapted while it ran.

    Attributes:
        execution: What the robot did.
        handovers: What was decided on the way.
        plan: What it followed in the end.
        commanded: The kinematic reference of that.
        risk: (L, 2) times of looking ahead [s], and P(fall) then.
        seconds: (L,) what each look took by the clock [s]; differs from run to run.
    """

    execution: Execution
    handovers: tuple[Handover, ...]
    plan: RobotReference
    commanded: RobotReference
    risk: Array
    seconds: Array


def rollout_adaptive(
    robot: Robot,
    commanded: RobotReference,
    plan: RobotReference,
    predictor: Predictor,
    simulation: SimulationOptions | None = None,
    options: AdapterOptions | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Adapted:
    """Executes a plan that is changed on the way where that is foreseen to be safer.

    Args:
        robot: The robot.
        commanded: What it shall do; kinematic.
        plan: The dynamic plan made from it.
        predictor: What foresees falls.
        simulation: Options of the physics.
        options: When and how the motion is changed.
        seed: Of all disturbances that are drawn; carried into the result.
        progress: Called after each tenth of a second.

    Raises:
        ConfigError: A push is on a link that the robot does not have.
        SimulationError: The physics diverged before a fall was on record.
    """
    simulation, seconds = simulation or SimulationOptions(), list[float]()
    looks: list[Array] = []
    loop = build_closed_loop(robot, predictor, simulation, options, seed, seconds.append)
    simulator = Simulator(loop.diagram)
    context = simulator.get_mutable_context()
    for port, reference in (("commanded", commanded), ("plan", plan)):
        loop.diagram.GetInputPort(port).FixValue(context, Value[object](reference))
    set_initial_state(loop.execution, context, plan)

    def now(port: str) -> Any:
        return loop.adapter.GetOutputPort(port).Eval(loop.adapter.GetMyContextFromRoot(context))

    def until() -> float:
        looks.append(now("risk").copy())
        return float(now("reference").duration + simulation.hold)

    simulate(simulator, loop.execution, until, simulation, progress)
    until()
    done = execution(loop.execution, context, now("reference"), seed)
    return Adapted(
        done,
        now("handovers"),
        now("reference"),
        now("commanded_now"),
        np.unique([look for look in looks if np.isfinite(look[0])], axis=0).reshape(-1, 2),
        np.array(seconds),
    )
