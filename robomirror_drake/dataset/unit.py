"""The unit of work: one command, all its motions, all their executions."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from robomirror_drake.dataset.alignment import commanded
from robomirror_drake.dataset.columns import episodes_table
from robomirror_drake.dataset.options import draw_disturbance, seed_of, stream
from robomirror_drake.dataset.records import (
    Frames,
    Job,
    Row,
    StageFailure,
    all_frames,
    described,
    failed_rows,
    frames_of,
    new_row,
    push_of,
)
from robomirror_drake.dataset.shards import encode
from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.fall_cause import judge
from robomirror_drake.messages import Execution, HumanMotion, RobotReference
from robomirror_drake.motion.generate import generate
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget_batch
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import draw_run

STAGES = ("generate", "retarget", "plan", "simulate", "write")


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


def make(job: Job) -> Made:
    """Executes all that a command asks for; what fails is recorded and goes on."""
    clock, wall = _Clock(), time.perf_counter()
    robot = load_robot(job.scenario.robot)
    rows: list[Row] = []
    frames: list[Frames] = []
    for candidate, motion, raw in _references(job, robot, clock):
        try:
            if isinstance(raw, StageFailure):
                raise raw
            with clock.stage("plan"):
                plan = plan_dynamics(robot, raw, job.scenario.planner)
        except StageFailure as failure:
            rows += failed_rows(job, candidate, motion, failure)
            continue
        for number in range(job.options.executions):
            row = new_row(job, candidate, number, motion)
            rows.append(row)
            try:
                with clock.stage("simulate"):
                    done = _execute(job, robot, plan, row)
                    said = commanded(raw, plan, done.time)
            except StageFailure as failure:
                row.update(failed_stage=failure.stage, failure=str(failure))
                continue
            row.update(described(raw, plan, done))
            frames.append(frames_of(row["episode"], done, said))
    with clock.stage("write"):
        files = encode(episodes_table(rows), all_frames(frames, len(robot.joint_names)))
    timing = _timing(job, rows, clock, time.perf_counter() - wall)
    return Made(*files, timing)


def failed(job: Job, error: BaseException) -> Made:
    """What is recorded of a command whose worker died of it."""
    failure, joints = StageFailure("worker", error), len(load_robot(job.scenario.robot).joint_names)
    rows = [
        row
        for candidate in range(job.options.per_prompt)
        for row in failed_rows(job, candidate, None, failure)
    ]
    files = encode(episodes_table(rows), all_frames([], joints))
    return Made(*files, _timing(job, rows, _Clock(), 0.0))


def _references(
    job: Job, robot: Robot, clock: _Clock
) -> Iterator[tuple[int, HumanMotion | None, RobotReference | StageFailure]]:
    """Number, motion and kinematic reference of each candidate, or why there is none."""
    count = job.options.per_prompt
    rng = stream(job.options, job.prompt.text)
    seed, vigour = seed_of(rng), float(rng.uniform(*job.options.vigour))
    styles = {"vigour": vigour, "slowest": job.options.slowest}
    generator = job.scenario.generator.model_copy(update=styles)
    motions: tuple[HumanMotion | None, ...] = (None,) * count
    try:
        with clock.stage("generate"):
            given = generate(job.prompt.text, count, seed, generator)
        motions = given
        with clock.stage("retarget"):
            results = retarget_batch(robot, given, options=job.scenario.retargeter)
    except StageFailure as failure:
        yield from ((k, motion, failure) for k, motion in enumerate(motions))
        return
    for k, (motion, result) in enumerate(zip(given, results, strict=True)):
        if isinstance(result, RetargetingError):
            yield k, motion, StageFailure("retarget", result)
        else:
            yield k, motion, result.reference


def _execute(job: Job, robot: Robot, plan: RobotReference, row: Row) -> Execution:
    """Executes a plan once, and enters into the row how it was disturbed and how it went."""
    rng = stream(job.options, job.prompt.text, row["candidate"], row["execution"])
    seed = seed_of(rng)
    simulation = job.scenario.simulation
    within = min(plan.duration, job.options.longest)
    # Candidates begin at different turns, so that few executions of each have all kinds.
    turn = row["execution"] + row["candidate"] if row["execution"] else 0
    kind, disturbance = draw_disturbance(job.options, turn, within, rng, simulation.disturbance)
    simulation = simulation.model_copy(update={"disturbance": disturbance})
    drawn, friction = draw_run(robot, simulation, seed)
    row.update(
        kind=kind,
        seed=seed,
        friction=friction,
        mass_factor=drawn.mass,
        latency_s=drawn.latency,
        strength=drawn.strength,
        **push_of(disturbance),
    )
    done = rollout(robot, plan, simulation, seed, longest=job.options.longest)
    row.update(dataclasses.asdict(judge(robot, done, plan, simulation)))
    return done


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
            raise StageFailure(name, error) from error
        finally:
            self.spent[name] += time.process_time() - before
