"""The half of the diagram that has physics: plant, controller, recorder, and their wiring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder, EventStatus, InputPort, OutputPort
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from robomirror_drake.disturbance import DisturbanceOptions, SensorNoise
from robomirror_drake.disturbance_draw import Drawn, draw
from robomirror_drake.messages import Array
from robomirror_drake.plant import add_plant
from robomirror_drake.robot import Robot
from robomirror_drake.systems.actuation import Actuation
from robomirror_drake.systems.ground_forces import GroundForces
from robomirror_drake.systems.joint_target import JointTarget
from robomirror_drake.systems.outcome_recorder import PERIOD, OutcomeRecorder
from robomirror_drake.systems.pusher import Pusher
from robomirror_drake.systems.sensors import Sensors
from robomirror_drake.systems.whole_body_controller import ControllerOptions, WholeBodyController


class SimulationOptions(BaseModel):
    """Options of the physics and of the run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    time_step: float = Field(0.002, gt=0.0, le=0.01, description="of the plant [s]")
    friction: float = Field(0.6, gt=0.0, description="between soles and ground")
    hold: float = Field(2.0, ge=0.0, le=60.0, description="how long the last pose is held [s]")
    after_fall: float = Field(0.5, ge=0.0, le=60.0, description="how long a fall is watched [s]")
    controller: ControllerOptions = ControllerOptions()
    interface: Literal["torque", "joint_target"] = Field(
        "torque", description="what the joints are given; targets go to a servo in the plant"
    )
    target_rate: float = Field(
        60.0, gt=0.0, le=1000.0, description="of joint targets, and then of the control loop [Hz]"
    )
    disturbance: DisturbanceOptions = DisturbanceOptions()


@dataclass(frozen=True)
class ExecutionSystems:
    """The systems that :func:`build_execution` has added, by role.

    Attributes:
        actuation: None where the controller's torques go straight to the joints.
        friction: Between soles and ground.
        start: (59,) by how much the robot's first state differs from the reference's.
        seen: The robot's state as the controller sees it.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    controller: WholeBodyController
    recorder: OutcomeRecorder
    log: VectorLogSink
    actuation: Actuation | None
    friction: float
    start: Array
    seen: OutputPort

    @property
    def reference_port(self) -> InputPort:
        """The one port left to connect: it takes a ``RobotReference``."""
        return self.controller.GetInputPort("reference")


def build_execution(
    builder: DiagramBuilder,
    robot: Robot,
    options: SimulationOptions | None = None,
    seed: int = 0,
) -> ExecutionSystems:
    """Adds plant, scene graph, controller, recorder and its log to a diagram.

    The controller knows the nominal robot and sees it through sensors; plant and recorder
    have the true one. What is not disturbed has no system.

    Args:
        builder: The diagram to add to.
        robot: The robot as the controller knows it.
        options: Options of the physics.
        seed: Of all that is drawn from ``options.disturbance``.

    Returns:
        The systems; all is connected but the controller's ``reference``.

    Raises:
        ConfigError: A push is on a link that the robot does not have.
    """
    options = options or SimulationOptions()
    disturbance = options.disturbance
    drawn, friction = draw_run(robot, options, seed)
    control = options.controller
    if options.interface == "joint_target":
        control = control.model_copy(update={"period": 1.0 / options.target_rate})

    physics = add_plant(
        builder,
        robot,
        drawn,
        time_step=options.time_step,
        friction=friction,
        servo=options.interface == "joint_target",
    )
    plant, _, instance = physics
    controller = builder.AddNamedSystem(
        "whole_body_controller", WholeBodyController(robot, control)
    )
    state = plant.get_state_output_port(instance)
    seen = _measured(builder, state, disturbance.sensors, seed, control.period)
    builder.Connect(seen, controller.GetInputPort("state"))
    command = controller.GetOutputPort("torque")
    actuation = _actuation(robot, options, drawn, control.period)
    if actuation is not None:
        command = _actuated(builder, actuation, command, seen)
    if options.interface == "joint_target":
        builder.Connect(command, plant.get_desired_state_input_port(instance))
        torque = plant.get_net_actuation_output_port(instance)
    else:
        builder.Connect(command, plant.get_actuation_input_port(instance))
        torque = command
    if disturbance.pushes or disturbance.random_pushes.speed[1] > 0.0:
        pusher = builder.AddNamedSystem("pusher", Pusher(robot, plant, instance, disturbance, seed))
        builder.Connect(
            pusher.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port()
        )

    ground = builder.AddNamedSystem("ground_forces", GroundForces(robot, plant, instance))
    builder.Connect(plant.get_contact_results_output_port(), ground.GetInputPort("contact_results"))
    builder.Connect(ground.GetOutputPort("foot_force"), controller.GetInputPort("foot_force"))

    recorder = builder.AddNamedSystem("outcome_recorder", OutcomeRecorder(robot))
    builder.Connect(state, recorder.GetInputPort("state"))
    builder.Connect(torque, recorder.GetInputPort("torque"))
    for port in ("reference_state", "diagnostics"):
        builder.Connect(controller.GetOutputPort(port), recorder.GetInputPort(port))
    for port in ("foot_force", "other_force"):
        builder.Connect(ground.GetOutputPort(port), recorder.GetInputPort(port))
    log = LogVectorOutput(recorder.GetOutputPort("sample"), builder, publish_period=PERIOD)
    log.set_name("execution_log")
    return ExecutionSystems(
        *physics, controller, recorder, log, actuation, friction, drawn.start, seen
    )


def draw_run(robot: Robot, options: SimulationOptions, seed: int) -> tuple[Drawn, float]:
    """What is constant during a run, and the friction between soles and ground."""
    drawn = draw(options.disturbance, seed, links=1 + len(robot.joint_names))
    return drawn, options.friction if drawn.friction is None else drawn.friction


def _measured(
    builder: DiagramBuilder, state: OutputPort, noise: SensorNoise, seed: int, period: float
) -> OutputPort:
    """The state as the controller sees it."""
    if noise == SensorNoise():
        return state
    sensors = builder.AddNamedSystem("sensors", Sensors(state.size(), noise, seed, period))
    builder.Connect(state, sensors.GetInputPort("state"))
    return sensors.GetOutputPort("measured_state")


def _actuation(
    robot: Robot, options: SimulationOptions, drawn: Drawn, period: float
) -> Actuation | None:
    """What turns the controller's torques into what the joints are given, if anything does."""
    joints = len(robot.joint_names)
    target = limits = None
    if options.interface == "joint_target":
        target = JointTarget(joints, robot.spec.joint_gains, period)
    elif drawn.strength != 1.0:
        limits = drawn.strength * robot.effort_limits
    if target is None and limits is None and drawn.latency == drawn.lag == 0.0:
        return None
    return Actuation(
        joints,
        options.time_step,
        latency=drawn.latency,
        lag=drawn.lag,
        torque_limits=limits,
        joint_target=target,
    )


def _actuated(
    builder: DiagramBuilder, actuation: Actuation, torque: OutputPort, state: OutputPort
) -> OutputPort:
    """What the joints are given."""
    builder.AddNamedSystem("actuation", actuation)
    builder.Connect(torque, actuation.GetInputPort("torque"))
    if actuation.HasInputPort("state"):
        builder.Connect(state, actuation.GetInputPort("state"))
    return actuation.GetOutputPort("command")


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
