"""The diagrams: *plan* (no physics), *execute* (one reference), and the closed whole.

What a diagram is asked to do enters through exported input ports: ``command`` (a
``str``) or ``candidates`` (human motions that are there already), and ``reference``
for *execute*. Fix their values in the Context, or connect them inside a larger
diagram; but not to a ``ConstantValueSource``, whose output counts as changed whenever
time does, so that every stage would work anew at every tick. Every stage's result
leaves through an exported output port of its name.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from pydrake.common.value import Value
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.config import Scenario
from robomirror_drake.messages import HumanMotion, RobotReference
from robomirror_drake.robot import Robot
from robomirror_drake.simulation import ExecutionSystems, build_execution
from robomirror_drake.systems.dynamic_planner import DynamicPlanner
from robomirror_drake.systems.motion_generator import MotionGenerator
from robomirror_drake.systems.reference_selector import ReferenceSelector
from robomirror_drake.systems.retargeter import Retargeter

Source = Literal["command", "candidates"]
"""What a planning diagram starts from: words, or motions that are there already."""


class Whole(NamedTuple):
    """A diagram with physics, and the systems in it that have it."""

    diagram: Diagram
    execution: ExecutionSystems


def build_plan_diagram(robot: Robot, scenario: Scenario, source: Source = "command") -> Diagram:
    """Words or motions in, one dynamically consistent reference out; no physics.

    Exports the input port ``command`` or ``candidates``, and the output ports
    ``candidates``, ``references``, ``failures``, ``reference`` and ``plan``; where the scenario
    adapts, ``adaptation`` as well.
    """
    builder = DiagramBuilder()
    _add_planning(builder, robot, scenario, source)
    return _named(builder, "plan")


def build_execute_diagram(robot: Robot, scenario: Scenario) -> Whole:
    """One reference in, physics out.

    Exports the input port ``reference``, and the output ports ``state``, ``torque``,
    ``diagnostics``, ``sample`` and ``fall_time``.
    """
    builder = DiagramBuilder()
    execution = _add_execution(builder, robot, scenario)
    builder.ExportInput(execution.reference_port, "reference")
    return Whole(_named(builder, "execute"), execution)


def build_pipeline(
    robot: Robot, scenario: Scenario, source: Source = "command", meshcat: Meshcat | None = None
) -> Whole:
    """The closed whole: words or motions in, physics out.

    Exports the ports of both halves, but for the input ``reference``, which the planning
    half gives to the executing one. With ``meshcat`` the plant is drawn while it runs.
    """
    builder = DiagramBuilder()
    plan = _add_planning(builder, robot, scenario, source)
    execution = _add_execution(builder, robot, scenario)
    builder.Connect(plan, execution.reference_port)
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, execution.scene_graph, meshcat)
    return Whole(_named(builder, "robomirror"), execution)


def give_command(diagram: Diagram, context: Context, command: str) -> None:
    """Fixes the port ``command`` of a diagram."""
    diagram.GetInputPort("command").FixValue(context, Value[object](command))


def give_candidates(
    diagram: Diagram, context: Context, candidates: tuple[HumanMotion, ...]
) -> None:
    """Fixes the port ``candidates`` of a diagram built with ``source="candidates"``."""
    diagram.GetInputPort("candidates").FixValue(context, Value[object](candidates))


def give_reference(diagram: Diagram, context: Context, reference: RobotReference) -> None:
    """Fixes the port ``reference`` of an execute diagram."""
    diagram.GetInputPort("reference").FixValue(context, Value[object](reference))


def _add_planning(
    builder: DiagramBuilder, robot: Robot, scenario: Scenario, source: Source
) -> OutputPort:
    """Adds generator, retargeter, selector and planner; returns the plan's port."""
    retargeter = builder.AddNamedSystem("retargeter", Retargeter(robot, scenario.retargeter))
    chooser = _add_chooser(builder, robot, scenario.adaptation)
    planner = builder.AddNamedSystem("dynamic_planner", DynamicPlanner(robot, scenario.planner))

    if source == "command":
        generator = builder.AddNamedSystem(
            "motion_generator",
            MotionGenerator(scenario.candidates, scenario.seed, scenario.generator),
        )
        builder.ExportInput(generator.GetInputPort("command"), "command")
        builder.ConnectInput("command", chooser.GetInputPort("command"))
        builder.Connect(
            generator.GetOutputPort("candidates"), retargeter.GetInputPort("candidates")
        )
        builder.ExportOutput(generator.GetOutputPort("candidates"), "candidates")
    elif source == "candidates":
        builder.ExportInput(retargeter.GetInputPort("candidates"), "candidates")
    else:
        raise ValueError(f"source is {source!r}; give 'command' or 'candidates'")

    builder.Connect(retargeter.GetOutputPort("references"), chooser.GetInputPort("references"))
    builder.Connect(chooser.GetOutputPort("reference"), planner.GetInputPort("reference"))
    for port in ("references", "failures"):
        builder.ExportOutput(retargeter.GetOutputPort(port), port)
    builder.ExportOutput(chooser.GetOutputPort("reference"), "reference")
    if scenario.adaptation.method != "none":
        builder.ExportOutput(chooser.GetOutputPort("adaptation"), "adaptation")
    builder.ExportOutput(planner.GetOutputPort("plan"), "plan")
    return planner.GetOutputPort("plan")


def _add_chooser(builder: DiagramBuilder, robot: Robot, options: AdaptationOptions) -> LeafSystem:
    """Adds what takes one of the references: the first one, or what the robot can do."""
    if options.method == "none":
        return builder.AddNamedSystem(
            "reference_selector", ReferenceSelector(robot, options.ranking)
        )
    # Here, since it is for the network alone that torch has to be there: seconds, else saved.
    from robomirror_drake.ppn.ensemble import load_ensemble
    from robomirror_drake.systems.reference_adapter import ReferenceAdapter

    predictor = load_ensemble(options.predictor, robot)
    return builder.AddNamedSystem("reference_adapter", ReferenceAdapter(robot, predictor, options))


def _add_execution(builder: DiagramBuilder, robot: Robot, scenario: Scenario) -> ExecutionSystems:
    """Adds plant, controller and recorder; the controller's ``reference`` is left open."""
    execution = build_execution(builder, robot, scenario.simulation, scenario.seed)
    state = execution.plant.get_state_output_port(execution.instance)
    builder.ExportOutput(state, "state")
    for port in ("torque", "diagnostics"):
        builder.ExportOutput(execution.controller.GetOutputPort(port), port)
    for port in ("sample", "fall_time"):
        builder.ExportOutput(execution.recorder.GetOutputPort(port), port)
    return execution


def _named(builder: DiagramBuilder, name: str) -> Diagram:
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram
