"""The unit of work: one command, all its motions, all their executions."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from robomirror_drake.config import Scenario
from robomirror_drake.dataset.alignment import commanded
from robomirror_drake.dataset.columns import episodes_table, frame_columns, frames_table
from robomirror_drake.dataset.options import DatasetOptions, draw_disturbance, seed_of, stream
from robomirror_drake.dataset.prompts import Prompt
from robomirror_drake.dataset.shards import encode
from robomirror_drake.disturbance import DisturbanceOptions
from robomirror_drake.disturbance_draw import draw
from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.fall_cause import judge
from robomirror_drake.messages import Execution, HumanMotion, RobotReference
from robomirror_drake.motion.generate import generate
from robomirror_drake.optimization.plan import plan_dynamics
from robomirror_drake.optimization.retarget import retarget_batch
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout

STAGES = ("generate", "retarget", "plan", "simulate", "write")

Row = dict[str, Any]


class Job(NamedTuple):
    """What a unit of work is told.

    Attributes:
        number: Row of the command among the prompts.
        prompt: The command.
        options: Of the data set.
        scenario: All other settings.
    """

    number: int
    prompt: Prompt
    options: DatasetOptions
    scenario: Scenario


class Made(NamedTuple):
    """What a unit of work gives.

    Attributes:
        episodes, frames: Its two files.
        timing: What it took, for the log: ``prompt_index``, processor time of each stage
            and in all [s], wall time [s], simulated time [s], counts.
    """

    episodes: bytes
    frames: bytes
    timing: dict[str, Any]


class _Failure(Exception):
    """Carries the stage that failed with what it failed of."""

    def __init__(self, stage: str, error: BaseException) -> None:
        kind = type(error).__name__
        super().__init__(f"{kind}: {error}")
        self.stage = stage


def make(job: Job) -> Made:
    """Executes all that a command asks for; what fails is recorded and goes on."""
    clock, wall = _Clock(), time.perf_counter()
    robot = load_robot(job.scenario.robot)
    rows: list[Row] = []
    frames: list[Mapping[str, npt.NDArray[Any]]] = []
    for candidate, motion, raw in _references(job, robot, clock):
        try:
            if isinstance(raw, _Failure):
                raise raw
            with clock.stage("plan"):
                plan = plan_dynamics(robot, raw, job.scenario.planner)
        except _Failure as failure:
            rows += _failed(job, candidate, motion, failure)
            continue
        for number in range(job.options.executions):
            row = _row(job, candidate, number, motion)
            rows.append(row)
            try:
                with clock.stage("simulate"):
                    done = _execute(job, robot, plan, row)
                    said = commanded(raw, plan, done.time)
            except _Failure as failure:
                row.update(failed_stage=failure.stage, failure=str(failure))
                continue
            row.update(_described(raw, plan, done))
            frames.append(_frames(row["episode"], done, said._asdict(), robot))
    with clock.stage("write"):
        files = encode(episodes_table(rows), _together(frames, len(robot.joint_names)))
    timing = _timing(job, rows, clock, time.perf_counter() - wall)
    return Made(*files, timing)


def failed(job: Job, error: BaseException) -> Made:
    """What is recorded of a command whose worker died of it."""
    failure, joints = _Failure("worker", error), len(load_robot(job.scenario.robot).joint_names)
    rows = [
        row
        for candidate in range(job.options.per_prompt)
        for row in _failed(job, candidate, None, failure)
    ]
    files = encode(episodes_table(rows), _together([], joints))
    return Made(*files, _timing(job, rows, _Clock(), 0.0))


def _references(
    job: Job, robot: Robot, clock: _Clock
) -> Iterator[tuple[int, HumanMotion | None, RobotReference | _Failure]]:
    """Number, motion and kinematic reference of each candidate, or why there is none."""
    count = job.options.per_prompt
    seed = seed_of(stream(job.options, job.prompt.text))
    motions: tuple[HumanMotion | None, ...] = (None,) * count
    try:
        with clock.stage("generate"):
            given = generate(job.prompt.text, count, seed, job.scenario.generator)
        motions = given
        with clock.stage("retarget"):
            results = retarget_batch(robot, given, options=job.scenario.retargeter)
    except _Failure as failure:
        yield from ((k, motion, failure) for k, motion in enumerate(motions))
        return
    for k, (motion, result) in enumerate(zip(given, results, strict=True)):
        if isinstance(result, RetargetingError):
            yield k, motion, _Failure("retarget", result)
        else:
            yield k, motion, result.reference


def _execute(job: Job, robot: Robot, plan: RobotReference, row: Row) -> Execution:
    """Executes a plan once, and enters into the row how it was disturbed and how it went."""
    rng = stream(job.options, job.prompt.text, row["candidate"], row["execution"])
    seed = seed_of(rng)
    kind, disturbance = draw_disturbance(job.options, row["execution"], plan.duration, rng)
    simulation = job.scenario.simulation
    if kind == "nominal":
        disturbance = simulation.disturbance
    simulation = simulation.model_copy(update={"disturbance": disturbance})
    drawn = draw(disturbance, seed, 1 + len(robot.joint_names))
    friction = simulation.friction if drawn.friction is None else drawn.friction
    row.update(
        kind=kind,
        seed=seed,
        friction=friction,
        mass_factor=drawn.mass,
        latency_s=drawn.latency,
        strength=drawn.strength,
        **_push(disturbance),
    )
    done = rollout(robot, plan, simulation, seed)
    row.update(dataclasses.asdict(judge(robot, done, plan, simulation)))
    return done


def _push(disturbance: DisturbanceOptions) -> Row:
    for push in disturbance.pushes:
        if push.speed is not None:
            return {
                "push_time_s": push.time,
                "push_speed": math.hypot(*push.speed),
                "push_direction": math.atan2(push.speed[1], push.speed[0]),
            }
    return {}


def _row(job: Job, candidate: int, number: int, motion: HumanMotion | None) -> Row:
    options, prompt = job.options, job.prompt
    unit = options.per_prompt * options.executions
    return {
        "episode": job.number * unit + candidate * options.executions + number,
        "prompt_index": job.number,
        "prompt": prompt.text,
        "actions": list(prompt.actions),
        "group": prompt.group,
        "family": prompt.family,
        "split": prompt.split,
        "candidate": candidate,
        "execution": number,
        "source": None if motion is None else motion.source,
        "style": None if motion is None else json.dumps(dict(motion.style)),
        "frames": 0,
    }


def _failed(job: Job, candidate: int, motion: HumanMotion | None, failure: _Failure) -> list[Row]:
    """A row for each execution that there is not."""
    fault = {"failed_stage": failure.stage, "failure": str(failure)}
    return [
        _row(job, candidate, number, motion) | fault for number in range(job.options.executions)
    ]


def _described(raw: RobotReference, plan: RobotReference, done: Execution) -> Row:
    return {
        "frames": len(done.time),
        "raw_duration_s": raw.duration,
        "lead_s": plan.lead,
        "motion_end_s": done.motion_end,
        "keypoint_error": raw.residuals.get("keypoint_error"),
        "distance_to_raw": plan.residuals.get("distance_to_raw"),
        "dynamic_violation": plan.residuals.get("dynamic_violation"),
    }


def _frames(
    episode: int, done: Execution, said: Mapping[str, Any], robot: Robot
) -> dict[str, npt.NDArray[Any]]:
    count = len(done.time)
    raw = {f"{name}_raw": value for name, value in said.items()}
    own = {"episode": np.full(count, episode), "frame": np.arange(count)}
    recorded = {
        column.name: getattr(done, column.name)
        for column in frame_columns(len(robot.joint_names))
        if column.name not in raw and column.name not in own
    }
    return own | raw | recorded


def _together(frames: list[Mapping[str, npt.NDArray[Any]]], joints: int) -> Any:
    """All episodes' frames in one table, in single precision."""
    arrays = {
        column.name: np.concatenate([part[column.name] for part in frames])
        if frames
        else np.zeros((0, *column.shape))
        for column in frame_columns(joints)
    }
    return frames_table(arrays, joints)


def _timing(job: Job, rows: list[Row], clock: _Clock, wall: float) -> dict[str, Any]:
    return {
        "prompt_index": job.number,
        "wall_s": wall,
        "cpu_s": {stage: round(clock.spent[stage], 4) for stage in STAGES},
        "simulated_s": float(sum(row.get("duration_s", 0.0) for row in rows)),
        "episodes": len(rows),
        "fell": sum(bool(row.get("fell")) for row in rows),
        "failed": sum("failure" in row for row in rows),
    }


class _Clock:
    """Processor time by stage, and the stage that an error comes from."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        before = time.process_time()
        try:
            yield
        except Exception as error:  # whatever it is, the run goes on and the record says so
            raise _Failure(name, error) from error
        finally:
            self.spent[name] += time.process_time() - before
