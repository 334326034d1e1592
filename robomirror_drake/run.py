"""One command or motion file through the whole diagram, to a result."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator

from robomirror_drake.adaptation.record import AdaptedRun
from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import InputError, PlanningError, SimulationError
from robomirror_drake.fall_cause import judge
from robomirror_drake.messages import Execution, Handover, HumanMotion, RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.load import load_motion
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.pipeline import Source, build_pipeline, give_candidates, give_command
from robomirror_drake.results import Result
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import execution, set_initial_state, simulate
from robomirror_drake.yaml_file import to_yaml

if TYPE_CHECKING:
    from robomirror_drake.adaptation.command import Adaptation

Stage = Literal["generate", "retarget", "adapt", "plan", "simulate", "compare"]
STAGES: dict[Stage, str] = {
    "generate": "words to human motions",
    "retarget": "human motions to robot references",
    "adapt": "what the robot can do of it",
    "plan": "reference to dynamic plan",
    "simulate": "physics",
    "compare": "what would have happened",
}
"""The stages of a run in their order, with what to call them on a screen."""

Report = Callable[[Stage, float], None]
"""Called with a stage and the share of it that is done, 0 to 1."""


def stages(scenario: Scenario, compare: bool = True) -> tuple[Stage, ...]:
    """The stages that a run has, in their order."""
    adapts = scenario.adaptation.method != "none"
    left_out = {"adapt": not adapts, "compare": not (adapts and compare)}
    return tuple(stage for stage in STAGES if not left_out.get(stage, False))


def run(
    scenario: Scenario,
    report: Report | None = None,
    meshcat: Meshcat | None = None,
    compare: bool = True,
) -> Result:
    """Runs ``scenario.command``: generate, retarget, adapt, plan, simulate, judge.

    Args:
        scenario: What to do and how.
        report: Told about progress.
        meshcat: Where to show the simulation while it runs, at the speed of real time.
        compare: Whether the command's own motion is executed as well where the robot was told
            something else.

    Raises:
        InputError: The command or file cannot be used, or a closed loop is to be watched.
        RetargetingError: The robot cannot follow any of the candidates.
    """
    if meshcat is not None and scenario.adaptation.closed_loop:
        raise InputError("a closed loop cannot be watched live; look at its playback")
    tell = report or (lambda _stage, _share: None)
    source = read_source(scenario.command)
    robot = load_robot(scenario.robot)
    kind: Source = "command" if isinstance(source, str) else "candidates"
    diagram, systems = build_pipeline(robot, scenario, kind, meshcat)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    options = scenario.simulation

    tell("generate", 0.0)
    if isinstance(source, str):
        give_command(diagram, context, source)
        candidates: tuple[HumanMotion, ...] = diagram.GetOutputPort("candidates").Eval(context)
    else:
        candidates = (source,)
        give_candidates(diagram, context, candidates)
    tell("retarget", 0.0)
    references: tuple[RobotReference, ...] = diagram.GetOutputPort("references").Eval(context)
    made: Adaptation | None = None
    if scenario.adaptation.method != "none":
        tell("adapt", 0.0)
        made = diagram.GetOutputPort("adaptation").Eval(context)
    chosen: RobotReference = diagram.GetOutputPort("reference").Eval(context)
    tell("plan", 0.0)
    plan: RobotReference = diagram.GetOutputPort("plan").Eval(context)
    tell("simulate", 0.0)
    end = plan.duration + options.hold
    ran = Ran((), plan, None)
    if scenario.adaptation.closed_loop:
        done, ran = _run_closed(robot, scenario, chosen, plan, tell)
    else:
        set_initial_state(systems, context, plan)
        if meshcat is not None:
            simulator.set_target_realtime_rate(1.0)
        simulate(simulator, systems, end, options, lambda now, _: tell("simulate", now / end))
        done = execution(systems, context, plan, scenario.seed)
    tell("simulate", 1.0)
    outcome = judge(robot, done, ran.plan, options)
    adaptation = None
    if made is not None:
        adaptation = _adapted(
            scenario, made, references, candidates, ran, done, outcome.fell, compare, tell
        )
    return Result(
        command=scenario.command,
        scenario=to_yaml(scenario),
        candidates=candidates,
        chosen=[motion.source for motion in candidates].index(chosen.source),
        reference=ran.plan,
        execution=done,
        outcome=outcome,
        robot=scenario.robot,
        seeds={"generator": scenario.seed, "disturbance": scenario.seed},
        adaptation=adaptation,
    )


class Ran(NamedTuple):
    """What was followed in an execution.

    Attributes:
        handovers: What was decided on the way.
        plan: The plan, hand-overs included.
        led: The kinematic reference in the plan's time; None where that has to be worked out.
    """

    handovers: tuple[Handover, ...]
    plan: RobotReference
    led: RobotReference | None


def _run_closed(
    robot: Robot, scenario: Scenario, chosen: RobotReference, plan: RobotReference, tell: Report
) -> tuple[Execution, Ran]:
    """An execution in which the motion is adapted while it runs."""
    # Here, since it is for the network alone that torch has to be there: seconds, else saved.
    from robomirror_drake.closed_loop import rollout_adaptive
    from robomirror_drake.ppn.predictor import load_predictor

    options = scenario.adaptation
    done = rollout_adaptive(
        robot,
        chosen,
        plan,
        load_predictor(options.adapter.predictor, robot),
        scenario.simulation,
        options.adapter.model_copy(update={"ranking": options.ranking}),
        scenario.seed,
        lambda now, end: tell("simulate", now / end),
    )
    return done.execution, Ran(done.handovers, done.plan, done.commanded)


def _adapted(
    scenario: Scenario,
    made: Adaptation,
    references: Sequence[RobotReference],
    motions: Sequence[HumanMotion],
    ran: Ran,
    done: Execution,
    fell: bool,
    compare: bool,
    tell: Report,
) -> AdaptedRun:
    """What the result says of an adaptation; executes the command's own motion where asked to."""
    # Here, for the same reason.
    from robomirror_drake.comparison import (
        Judges,
        execute_own,
        foresight,
        handover_records,
        record_of,
    )
    from robomirror_drake.differences import physics_warnings
    from robomirror_drake.optimization.adaptation.continuation import begun
    from robomirror_drake.ppn.ensemble import load_ensemble
    from robomirror_drake.ppn.predictor import load_predictor

    robot = load_robot(scenario.robot)
    beforehand = load_ensemble(scenario.adaptation.predictor, robot)
    judges = Judges(
        beforehand,
        load_predictor(scenario.adaptation.adapter.predictor, robot),
    )
    record = record_of(robot, scenario, made, references, motions, None if fell else done)
    handovers = handover_records(ran.handovers)
    record = replace(
        record,
        warnings=tuple(
            warning
            for header, weights in zip(
                beforehand.headers, scenario.adaptation.predictor, strict=True
            )
            for warning in physics_warnings(header, scenario, weights)
        ),
        handovers=handovers,
        changed=record.changed or any(handover.done for handover in handovers),
    )
    original, refused = None, "it was not asked for"
    if record.changed and compare:
        tell("compare", 0.0)
        try:
            original = execute_own(
                robot, scenario, judges, references[0],
                lambda now, end: tell("compare", now / end),
            )  # fmt: skip
            refused = ""
        except (PlanningError, SimulationError) as error:
            refused = str(error)
    if not record.changed:
        refused = "it is what was executed"
    if compare:
        tell("compare", 1.0)
    led = ran.led or begun(made.reference, ran.plan).commanded
    return AdaptedRun(
        replace(record, not_compared=refused),
        references[0],
        made.reference,
        foresight(judges, led, done),
        original,
    )


def retarget_motion(scenario: Scenario) -> RobotReference:
    """The kinematic reference of the recorded motion that ``scenario.command`` names.

    Raises:
        InputError: It names no motion, or one that cannot be read.
        RetargetingError: The robot cannot follow it.
    """
    motion = read_source(scenario.command)
    if isinstance(motion, str):
        raise InputError(f"{motion!r} is no motion file and no clip:NAME")
    robot = load_robot(scenario.robot)
    return retarget(robot, motion, foot_contacts(motion), scenario.retargeter)


def start_viewer() -> Meshcat:
    """A viewer for ``run`` that serves this machine only."""
    return Meshcat(MeshcatParams(host="localhost"))


def read_source(command: str) -> str | HumanMotion:
    """The command itself, or the recorded motion that it names.

    A motion is named by its file, or as ``clip:NAME`` where it is one of the library's.

    Raises:
        InputError: It is empty.
        MotionFileError: It names a motion that is missing or malformed.
    """
    command = command.strip()
    if not command:
        raise InputError("the command is empty; say what to do, or name a motion file")
    if command.startswith("clip:"):
        return load_clip(command.removeprefix("clip:"))
    return load_motion(command) if _names_a_file(command) else command


def _names_a_file(command: str) -> bool:
    """Whether it is one word with a suffix; words with blanks need an existing file."""
    if re.fullmatch(r"\S+\.[A-Za-z]\w*", command):
        return True
    return len(command) < 255 and Path(command).is_file()
