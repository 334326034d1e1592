"""One command or motion file through the whole diagram, to a result."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator

from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import InputError
from robomirror_drake.fall_cause import judge
from robomirror_drake.messages import HumanMotion, RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.load import load_motion
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.retarget import retarget
from robomirror_drake.pipeline import Source, build_pipeline, give_candidates, give_command
from robomirror_drake.results import Result
from robomirror_drake.robot import load_robot
from robomirror_drake.rollout import execution, set_initial_state, simulate
from robomirror_drake.yaml_file import to_yaml

Stage = Literal["generate", "retarget", "plan", "simulate"]
STAGES: dict[Stage, str] = {
    "generate": "words to human motions",
    "retarget": "human motions to robot references",
    "plan": "reference to dynamic plan",
    "simulate": "physics",
}
"""The stages of a run in their order, with what to call them on a screen."""

Report = Callable[[Stage, float], None]
"""Called with a stage and the share of it that is done, 0 to 1."""


def run(scenario: Scenario, report: Report | None = None, meshcat: Meshcat | None = None) -> Result:
    """Runs ``scenario.command``: generate, retarget, plan, simulate, judge.

    Args:
        scenario: What to do and how.
        report: Told about progress.
        meshcat: Where to show the simulation while it runs, at the speed of real time.

    Raises:
        InputError: The command or file cannot be used.
        RetargetingError: The robot cannot follow any of the candidates.
    """
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
    chosen: RobotReference = diagram.GetOutputPort("reference").Eval(context)
    tell("plan", 0.0)
    plan: RobotReference = diagram.GetOutputPort("plan").Eval(context)
    tell("simulate", 0.0)
    set_initial_state(systems, context, plan)
    if meshcat is not None:
        simulator.set_target_realtime_rate(1.0)
    end = plan.duration + options.hold
    simulate(simulator, systems, end, options, lambda now, _: tell("simulate", now / end))
    done = execution(systems, context, plan, scenario.seed)
    tell("simulate", 1.0)
    return Result(
        command=scenario.command,
        scenario=to_yaml(scenario),
        candidates=candidates,
        chosen=[motion.source for motion in candidates].index(chosen.source),
        reference=plan,
        execution=done,
        outcome=judge(robot, done, plan, options),
        robot=scenario.robot,
        seeds={"generator": scenario.seed, "disturbance": scenario.seed},
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
