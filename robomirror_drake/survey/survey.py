"""Every action of the library and every clip on its feet executed, to see what the robot can do."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from scipy.optimize import brentq
from threadpoolctl import threadpool_limits

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import InputError
from robomirror_drake.fall_cause import judge
from robomirror_drake.messages import HumanMotion, RobotReference
from robomirror_drake.motion.generate import check_request, generate
from robomirror_drake.motion.library import library
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS
from robomirror_drake.optimization.planning.plan import PlanOptions
from robomirror_drake.optimization.planning.tempo import slowed
from robomirror_drake.outcome import errors_to_raw
from robomirror_drake.pipeline import build_plan_diagram, give_candidates
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.run import read_source
from robomirror_drake.yaml_file import changed

RENEWED = 40
"""Tasks after which processes are renewed: Drake frees all but 2 MB of a diagram."""

SLOWEST = 0.2
"""No plan is slower than this."""

NO_SLOWER = 0.01
"""Difference of two tempi that is none."""


@dataclass(frozen=True)
class Row:
    """One execution, or the reason why there was none.

    Attributes:
        action: Name of the action, or ``clip:NAME``.
        group: ``locomotion``, ``dynamic``, ``expressive`` or ``mocap``.
        command: What was asked for.
        seed: Of the disturbances.
        scenario: Name of the scenario.
        candidate: 0 for the nominal motion, else one whose style is drawn.
        style: Of the motion; None where it has none.
        slowest: Slowest tempo that the plan was allowed; None where the scenario decides.
            ``time_scale`` is nearer to 1 where the motion flies, which keeps its tempo.
        fell, fall_time_s, fall_cause, cause, cause_evidence, A_q, A_p, torque_saturation,
        duration_s: As in :class:`~robomirror_drake.messages.Outcome`; A_q and A_p are
            against the plan.
        time_scale: Tempo of the plan, 1 for the motion's own.
        raw_A_q, raw_A_p: The same errors against the reference before planning.
        distance_to_raw: Mean distance of the plan's keypoints from that reference [m].
        dynamic_violation: Of the plan.
        error: Why nothing was executed.
    """

    action: str
    group: str
    command: str
    seed: int
    scenario: str
    candidate: int = 0
    style: Mapping[str, float] | None = None
    slowest: float | None = None
    fell: bool | None = None
    fall_time_s: float | None = None
    fall_cause: str | None = None
    cause: str | None = None
    cause_evidence: str | None = None
    time_scale: float | None = None
    A_q: float | None = None
    A_p: float | None = None
    raw_A_q: float | None = None
    raw_A_p: float | None = None
    distance_to_raw: float | None = None
    dynamic_violation: float | None = None
    torque_saturation: float | None = None
    duration_s: float | None = None
    error: str | None = None


@dataclass(frozen=True)
class Task:
    """One plan, executed once a seed.

    Attributes:
        action, group: As in :class:`Row`.
        scenario: All settings, the command among them.
        name: Of the scenario.
        seeds: Of the executions.
        slowest, candidate: As in :class:`Row`.
    """

    action: str
    group: str
    scenario: Scenario
    name: str
    seeds: tuple[int, ...]
    slowest: float | None = None
    candidate: int = 0

    def row(self, seed: int, **found: object) -> Row:
        """A row of this task."""
        return Row(
            action=self.action,
            group=self.group,
            command=self.scenario.command,
            candidate=self.candidate,
            seed=seed,
            scenario=self.name,
            slowest=self.slowest,
            **found,  # type: ignore[arg-type]
        )

    def failed(self, error: str) -> list[Row]:
        """The rows of a task that could not be done."""
        return [self.row(seed, error=error) for seed in self.seeds]


def survey_tasks(
    scenario: Scenario,
    names: Sequence[str] = (),
    seeds: int = 1,
    name: str = "default",
    slowest: float | None = None,
    candidates: int = 1,
) -> list[Task]:
    """What a survey has to do.

    Args:
        scenario: The settings.
        names: Actions, or ``clip:NAME``; empty for all actions and all clips on the feet.
        seeds: How many executions there are of each, with seeds from 0 on.
        name: Of the scenario.
        slowest: Does everything a second time, with plans that may be slowed down so far.
        candidates: Of each action: the nominal one, and others with styles that are drawn.

    Raises:
        InputError: A name is not known, or there are no seeds or candidates.
        ConfigError: The tempo is out of bounds.
    """
    if seeds < 1:
        raise InputError(f"{seeds} seeds asked for; give 1 or more")
    check_request(candidates, scenario.seed)
    known = {action: (a.group, a.paraphrases[0]) for action, a in library().items()}
    clips = [f"clip:{clip}" for clip in FEET_ONLY_CLIPS]
    commands: dict[str, tuple[str, str]] = {**known, **{clip: ("mocap", clip) for clip in clips}}
    if unknown := [action for action in names if action not in commands]:
        raise InputError(f"no actions {', '.join(unknown)}; known: {', '.join(commands)}")
    plans: dict[float | None, PlanOptions] = {None: scenario.planner}
    if slowest is not None:
        plans[slowest] = changed(scenario.planner, slowest=slowest)
    return [
        Task(
            action=action,
            group=group,
            scenario=scenario.model_copy(
                update={
                    "command": command,
                    "seed": scenario.seed + number,  # else all actions had the same styles
                    "candidates": 1,
                    "planner": planner,
                    "adaptation": AdaptationOptions(),  # how does the action itself end?
                }
            ),
            name=name,
            seeds=tuple(range(seeds)),
            slowest=tempo,
            candidate=candidate,
        )
        for number, (action, (group, command)) in enumerate(commands.items())
        if not names or action in names
        for candidate in range(1 if group == "mocap" else candidates)
        for tempo, planner in plans.items()
    ]


def survey_rows(tasks: Sequence[Task], jobs: int = 2) -> Iterator[list[Row]]:
    """Does tasks in processes of their own; yields each one's rows as soon as they are there.

    A task that fails, or takes its process with it, gives rows with an ``error``. What runs
    is ended when the generator is closed or interrupted.

    Args:
        tasks: From :func:`survey_tasks`.
        jobs: Processes.

    Raises:
        InputError: There are no processes to do it.
    """
    if jobs < 1:
        raise InputError(f"{jobs} processes asked for; give 1 or more")
    share = jobs * RENEWED
    for start in range(0, len(tasks), share):
        lost: list[Task] = []
        for task, rows in _pooled(tasks[start : start + share], jobs):
            if rows is None:
                lost.append(task)
            else:
                yield rows
        # One of them killed its process, and with it the others' work.
        for suspect in lost:
            for task, rows in _pooled((suspect,), 1):
                yield rows or task.failed("its process died")


def _pooled(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, list[Row] | None]]:
    """Tasks and their rows as they are done; None for those that were lost with a process."""
    # Spawned, not forked: Drake and numba have threads by now.
    context = multiprocessing.get_context("spawn")
    workers = min(jobs, len(tasks))
    with ProcessPoolExecutor(workers, context, _leave_interrupts_alone) as pool:
        futures = {pool.submit(execute, task): task for task in tasks}
        try:
            for future in as_completed(futures):
                try:
                    yield futures[future], future.result()
                except BrokenProcessPool:
                    yield futures[future], None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _leave_interrupts_alone() -> None:
    """Ctrl-C goes to every process of a terminal; only the first one shall answer it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def execute(task: Task) -> list[Row]:
    """Plans a task's motion once and executes it with every seed.

    A plan that may be slowed down is so as far as it must; if the robot falls all the same,
    the motion is planned and executed again, as slow as it may be.
    """
    rows = _executed(task, task.scenario)
    if task.slowest is None or not any(row.fell for row in rows):
        return rows
    if all((row.time_scale or 1.0) < task.slowest + NO_SLOWER for row in rows):
        return rows
    planner = task.scenario.planner.model_copy(update={"time_scale": task.slowest})
    return _executed(task, task.scenario.model_copy(update={"planner": planner}))


def _executed(task: Task, scenario: Scenario) -> list[Row]:
    with threadpool_limits(1):
        try:
            robot = load_robot(scenario.robot)
            motion = _motion(scenario, task.candidate)
            raw, plan = _plans(robot, scenario, motion)
        except Exception as error:  # whatever it is, the other rows shall be done
            return task.failed(f"{type(error).__name__}: {error}")
        style = dict(motion.style) or None
        return [_row(robot, task, style, raw, plan, seed) for seed in task.seeds]


def _motion(scenario: Scenario, candidate: int) -> HumanMotion:
    source = read_source(scenario.command)
    if not isinstance(source, str):
        return source
    return generate(source, candidate + 1, scenario.seed, scenario.generator)[candidate]


def _plans(
    robot: Robot, scenario: Scenario, motion: HumanMotion
) -> tuple[RobotReference, RobotReference]:
    """The reference of a motion, and its plan."""
    diagram = build_plan_diagram(robot, scenario, "candidates")
    context = diagram.CreateDefaultContext()
    give_candidates(diagram, context, (motion,))
    raw: RobotReference = diagram.GetOutputPort("reference").Eval(context)
    plan: RobotReference = diagram.GetOutputPort("plan").Eval(context)
    return raw, plan


def _at_tempo(raw: RobotReference, time_scale: float) -> RobotReference:
    """A reference slowed down to 1 / ``time_scale`` of its duration, as its plan was.

    Since flight keeps its tempo, all else is slower than the whole.
    """
    frame = float(raw.time[1] - raw.time[0])
    wanted = raw.duration / time_scale

    def missing(tempo: float) -> float:
        return wanted - slowed(raw, tempo).duration

    if missing(time_scale) <= frame:
        return slowed(raw, time_scale)
    return slowed(raw, float(brentq(missing, 0.5 * SLOWEST, time_scale, xtol=1e-3)))


def _row(
    robot: Robot,
    task: Task,
    style: Mapping[str, float] | None,
    raw: RobotReference,
    plan: RobotReference,
    seed: int,
) -> Row:
    try:
        execution = rollout(robot, plan, task.scenario.simulation, seed)
        outcome = judge(robot, execution, plan, task.scenario.simulation)
    except Exception as error:  # as above
        return task.row(seed, style=style, error=f"{type(error).__name__}: {error}")
    time_scale = min(1.0, plan.residuals.get("time_scale", 1.0))  # up to rounding
    from_raw = errors_to_raw(execution, _at_tempo(raw, time_scale), plan.lead)
    return task.row(
        seed,
        style=style,
        fell=outcome.fell,
        fall_time_s=outcome.fall_time_s,
        fall_cause=outcome.fall_cause,
        cause=outcome.cause,
        cause_evidence=outcome.cause_evidence,
        time_scale=time_scale,
        A_q=outcome.A_q,
        A_p=outcome.A_p,
        raw_A_q=None if from_raw is None else from_raw[0],
        raw_A_p=None if from_raw is None else from_raw[1],
        distance_to_raw=plan.residuals.get("distance_to_raw"),
        dynamic_violation=plan.residuals.get("dynamic_violation"),
        torque_saturation=outcome.torque_saturation,
        duration_s=outcome.duration_s,
    )
