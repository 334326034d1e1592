"""The diagrams as wholes: ports, real motion through them, and replay."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import Context

from robomirror_drake.config import Scenario
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.outcome import evaluate
from robomirror_drake.pipeline import (
    Whole,
    build_execute_diagram,
    build_pipeline,
    build_plan_diagram,
    give_candidates,
    give_command,
    give_reference,
)
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout, set_initial_state
from robomirror_drake.run import run


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario.model_validate({"candidates": 2, "seed": 1, "simulation": {"hold": 0.5}})


def started(whole: Whole, clip: str) -> Simulator:
    """A simulator of the closed whole at the start of a real clip."""
    simulator = Simulator(whole.diagram)
    context = simulator.get_mutable_context()
    give_candidates(whole.diagram, context, (load_clip(clip),))
    set_initial_state(whole.execution, context, whole.diagram.GetOutputPort("plan").Eval(context))
    simulator.Initialize()
    return simulator


def bytes_of(whole: Whole, context: Context) -> bytes:
    """Everything that may change from tick to tick."""
    parts = [
        context.get_discrete_state(i).value() for i in range(context.num_discrete_state_groups())
    ]
    parts.append(whole.diagram.GetOutputPort("sample").Eval(context))
    return b"".join(part.tobytes() for part in parts)


def test_every_port_is_named(robot, scenario):
    plan = build_plan_diagram(robot, scenario)
    execute = build_execute_diagram(robot, scenario).diagram
    whole = build_pipeline(robot, scenario).diagram

    def ports(diagram) -> tuple[set[str], set[str]]:
        return (
            {diagram.get_input_port(i).get_name() for i in range(diagram.num_input_ports())},
            {diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())},
        )

    planned = {"candidates", "references", "failures", "reference", "plan"}
    executed = {"state", "torque", "diagnostics", "sample", "fall_time"}
    assert ports(plan) == ({"command"}, planned)
    assert ports(execute) == ({"reference"}, executed)
    assert ports(whole) == ({"command"}, planned | executed)


def test_words_become_references_without_physics(robot, scenario):
    diagram = build_plan_diagram(robot, scenario)
    context = diagram.CreateDefaultContext()
    give_command(diagram, context, "a person bows")
    candidates = diagram.GetOutputPort("candidates").Eval(context)
    references = diagram.GetOutputPort("references").Eval(context)
    plan = diagram.GetOutputPort("plan").Eval(context)
    assert len(candidates) == 2
    assert references[0] == diagram.GetOutputPort("reference").Eval(context)
    assert plan.planned
    assert plan.source == references[0].source == candidates[0].source
    assert np.diff(plan.time) == pytest.approx(1 / 60)
    # The same command again gives the same bytes, another one something else.
    give_command(diagram, context, "a person bows")
    assert diagram.GetOutputPort("plan").Eval(context) == plan
    give_command(diagram, context, "a person waves")
    assert diagram.GetOutputPort("candidates").Eval(context) != candidates


def test_the_whole_runs_a_real_walk_and_replays_it_to_the_byte(robot, scenario):
    whole = build_pipeline(robot, scenario, "candidates")
    simulator = started(whole, "walk_forward")
    simulator.AdvanceTo(1.3)
    snapshot = simulator.get_context().Clone()
    simulator.AdvanceTo(1.8)
    first = bytes_of(whole, simulator.get_context())

    # Restored in the same context, …
    simulator.get_mutable_context().SetTimeStateAndParametersFrom(snapshot)
    go_on = InitializeParams(suppress_initialization_events=True)
    simulator.Initialize(go_on)
    simulator.AdvanceTo(1.8)
    assert bytes_of(whole, simulator.get_context()) == first
    # … and branched off in the snapshot itself.
    branch = Simulator(whole.diagram, snapshot)
    branch.Initialize(go_on)
    branch.AdvanceTo(1.8)
    assert bytes_of(whole, branch.get_context()) == first


def test_the_whole_does_what_its_two_halves_do(robot, scenario):
    whole = run(scenario.model_copy(update={"command": "clip:turn_left0"}))
    assert whole.reference.planned
    assert not whole.outcome.fell
    alone = rollout(robot, whole.reference, scenario.simulation, scenario.seed)
    assert alone == whole.execution
    friction = scenario.simulation.friction
    assert evaluate(alone, robot.effort_limits, friction) == whole.outcome


def test_execute_takes_a_reference_through_its_port(robot, scenario):
    diagram, systems = build_execute_diagram(robot, scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plan = build_plan_diagram(robot, scenario, "candidates")
    plan_context = plan.CreateDefaultContext()
    give_candidates(plan, plan_context, (load_clip("walk_forward"),))
    reference = plan.GetOutputPort("plan").Eval(plan_context)
    give_reference(diagram, context, reference)
    set_initial_state(systems, context, reference)
    simulator.AdvanceTo(0.2)
    state = diagram.GetOutputPort("state").Eval(context)
    assert np.abs(state[:30] - reference.q[12]).max() < 0.05
    assert np.isinf(diagram.GetOutputPort("fall_time").Eval(context)).all()
