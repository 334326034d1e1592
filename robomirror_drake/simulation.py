"""The half of the diagram that has physics: plant, controller, recorder, and their wiring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder, EventStatus, InputPort
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from robomirror_drake.robot import Robot, add_ground
from robomirror_drake.systems.outcome_recorder import PERIOD, OutcomeRecorder
from robomirror_drake.systems.whole_body_controller import ControllerOptions, WholeBodyController


class SimulationOptions(BaseModel):
    """Options of the physics and of the run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    time_step: float = Field(0.002, gt=0.0, le=0.01, description="of the plant [s]")
    friction: float = Field(0.6, gt=0.0, description="of the ground")
    hold: float = Field(2.0, ge=0.0, description="how long the last pose is held [s]")
    after_fall: float = Field(0.5, ge=0.0, description="how long a fall is watched [s]")
    controller: ControllerOptions = ControllerOptions()


@dataclass(frozen=True)
class ExecutionSystems:
    """The systems that :func:`build_execution` has added, by role."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    controller: WholeBodyController
    recorder: OutcomeRecorder
    log: VectorLogSink

    @property
    def reference_port(self) -> InputPort:
        """The one port left to connect: it takes a ``RobotReference``."""
        return self.controller.GetInputPort("reference")


def build_execution(
    builder: DiagramBuilder, robot: Robot, options: SimulationOptions | None = None
) -> ExecutionSystems:
    """Adds plant, scene graph, controller, recorder and its log to a diagram.

    Args:
        builder: The diagram to add to.
        robot: The robot.
        options: Options of the physics.

    Returns:
        The systems; all is connected but the controller's ``reference``.
    """
    options = options or SimulationOptions()
    config = MultibodyPlantConfig(
        time_step=options.time_step,
        discrete_contact_approximation="sap",
        contact_model="point",
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    instance = robot.add_to_plant(plant)
    add_ground(plant, options.friction)
    plant.Finalize()
    robot.filter_self_collision(plant, scene_graph, instance)

    controller = builder.AddNamedSystem(
        "whole_body_controller", WholeBodyController(robot, options.controller)
    )
    recorder = builder.AddNamedSystem("outcome_recorder", OutcomeRecorder(robot, plant, instance))
    state = plant.get_state_output_port(instance)
    torque = controller.GetOutputPort("torque")
    builder.Connect(state, controller.GetInputPort("state"))
    builder.Connect(torque, plant.get_actuation_input_port(instance))
    builder.Connect(state, recorder.GetInputPort("state"))
    builder.Connect(torque, recorder.GetInputPort("torque"))
    for port in ("reference_state", "diagnostics"):
        builder.Connect(controller.GetOutputPort(port), recorder.GetInputPort(port))
    builder.Connect(
        plant.get_contact_results_output_port(), recorder.GetInputPort("contact_results")
    )
    log = LogVectorOutput(recorder.GetOutputPort("sample"), builder, publish_period=PERIOD)
    log.set_name("execution_log")
    return ExecutionSystems(plant, scene_graph, instance, controller, recorder, log)


def fall_time(systems: ExecutionSystems, context: Context) -> float:
    """When the robot fell [s], +inf if it has not."""
    own = systems.recorder.GetMyContextFromRoot(context)
    return float(own.get_discrete_state_vector()[0])


def stop_after_fall(
    systems: ExecutionSystems, options: SimulationOptions
) -> Callable[[Context], EventStatus]:
    """A monitor for ``Simulator.set_monitor`` that ends the simulation after a fall."""

    def monitor(context: Context) -> EventStatus:
        fallen = fall_time(systems, context)
        if context.get_time() >= fallen + options.after_fall:
            return EventStatus.ReachedTermination(systems.recorder, f"fell at {fallen:.2f} s")
        return EventStatus.DidNothing()

    return monitor
