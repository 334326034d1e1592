"""What is recorded of an execution: its row among the episodes, and its frames."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from robomirror_drake.config import Scenario
from robomirror_drake.dataset.alignment import Commanded
from robomirror_drake.dataset.columns import frame_columns, frames_table
from robomirror_drake.dataset.options import DatasetOptions
from robomirror_drake.dataset.prompts import Prompt
from robomirror_drake.disturbance import DisturbanceOptions
from robomirror_drake.messages import Execution, HumanMotion, RobotReference

Row = dict[str, Any]
"""Of the table of episodes, by column."""

Frames = dict[str, npt.NDArray[Any]]
"""Of one episode, by column."""


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


class StageFailure(Exception):
    """Carries the stage that failed with what it failed of."""

    def __init__(self, stage: str, error: BaseException) -> None:
        kind = type(error).__name__
        super().__init__(f"{kind}: {error}")
        self.stage = stage


def new_row(job: Job, candidate: int, number: int, motion: HumanMotion | None) -> Row:
    """The row of an execution before it."""
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


def failed_rows(
    job: Job, candidate: int, motion: HumanMotion | None, failure: StageFailure
) -> list[Row]:
    """A row for each execution that there is not."""
    fault = {"failed_stage": failure.stage, "failure": str(failure)}
    return [
        new_row(job, candidate, number, motion) | fault for number in range(job.options.executions)
    ]


def described(raw: RobotReference, plan: RobotReference, done: Execution) -> Row:
    """What there is to say of a motion and its plan."""
    return {
        "frames": len(done.time),
        "raw_q": raw.q.astype(np.float32).ravel(),
        "raw_contact": raw.contact.ravel(),
        "raw_duration_s": raw.duration,
        "lead_s": plan.lead,
        "motion_end_s": done.motion_end,
        "keypoint_error": raw.residuals.get("keypoint_error"),
        "distance_to_raw": plan.residuals.get("distance_to_raw"),
        "dynamic_violation": plan.residuals.get("dynamic_violation"),
    }


def push_of(disturbance: DisturbanceOptions) -> Row:
    """When, how hard and where to the robot is pushed first, if it is."""
    for push in disturbance.pushes:
        if push.speed is not None:
            return {
                "push_time_s": push.time,
                "push_speed": math.hypot(*push.speed),
                "push_direction": math.atan2(push.speed[1], push.speed[0]),
            }
    return {}


def frames_of(episode: int, done: Execution, said: Commanded) -> Frames:
    """All columns of an execution's frames."""
    count = len(done.time)
    raw = {f"{name}_raw": value for name, value in said._asdict().items()}
    own = {"episode": np.full(count, episode), "frame": np.arange(count)}
    recorded = {
        column.name: getattr(done, column.name)
        for column in frame_columns(done.torque.shape[1])
        if column.name not in raw and column.name not in own
    }
    return own | raw | recorded


def all_frames(frames: Sequence[Frames], joints: int) -> Any:
    """All episodes' frames in one table, in single precision."""
    arrays = {
        column.name: np.concatenate([part[column.name] for part in frames])
        if frames
        else np.zeros((0, *column.shape))
        for column in frame_columns(joints)
    }
    return frames_table(arrays, joints)
