"""What a study records: how each command's own motion ends, and what each variant makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any, Final, NamedTuple

import pyarrow as pa

from robomirror_drake.config import Scenario
from robomirror_drake.dataset.columns import Column
from robomirror_drake.dataset.prompts import Prompt
from robomirror_drake.study.options import StudyOptions, Variant

Row = dict[str, Any]
"""Of a table, by column."""

CAUSES: Final = (
    "not_adapted",
    "no_survivor",
    "survivor_misranked",
    "optimiser_failed",
    "fall_unforeseen",
    "transition_failed",
    "stopped",
    "failed",
    "unknown",
)
"""Why a command was not saved, see :func:`robomirror_drake.study.causes.cause`."""


class Job(NamedTuple):
    """What a unit of work is told.

    Attributes:
        number: Row of the command among those of the study.
        prompt: The command.
        options: Of the study.
        scenario: All other settings.
        screened: How the command's own motion ended; None while that is to be found out.
        earlier: What another study has found out that does not depend on what is foreseen.
    """

    number: int
    prompt: Prompt
    options: StudyOptions
    scenario: Scenario
    screened: Row | None = None
    earlier: tuple[Row, ...] = ()


_COMMAND = (
    Column("command", pa.int32(), "", "row of the command among those of the study"),
    Column("prompt", pa.string(), "", "the command"),
    Column("actions", pa.list_(pa.string()), "", "its actions in their order"),
    Column("group", pa.string(), "", "locomotion, dynamic or expressive"),
    Column("split", pa.string(), "", "of the corpus"),
)

SCREENED: Final = (
    *_COMMAND,
    Column("state", pa.string(), "", "how its own motion ends: fell, stood, long, failed"),
    Column("duration_s", pa.float64(), "s", "length of the kinematic reference"),
    Column("fall_time_s", pa.float64(), "s", "when it fell"),
    Column("why_fell", pa.string(), "", "what went wrong first"),
    Column("done", pa.bool_(), "", "whether the task was done; null after a fall"),
    Column("missed", pa.string(), "", "what of the task was not done"),
    Column("cpu_s", pa.float64(), "s", "processor time of its plan and simulation"),
    Column("failure", pa.string(), "", "why nothing was executed"),
)
"""Columns of the commands' own motions."""

RESULTS: Final = (
    *_COMMAND,
    Column("set", pa.string(), "", "failing or succeeding: how its own motion ends"),
    Column("method", pa.string(), "", "see robomirror_drake.study.options"),
    Column("level", pa.string(), "", "of disturbance"),
    Column("t_safe", pa.float64(), "", "threshold, null where the method has none"),
    Column("pool", pa.int32(), "", "candidates, null where the method looks at one motion"),
    Column("variables", pa.string(), "", "of the optimiser, null where there is none"),
    Column("qp_solver", pa.string(), "", "of the optimiser, null where there is none"),
    Column("how", pa.string(), "", "kept, selected, optimised, unsafe"),
    Column("candidate", pa.int32(), "", "which one what was taken comes from"),
    Column("reason", pa.string(), "", "what was done and why"),
    Column("risk_before", pa.float64(), "", "P(fall) predicted for the command's own motion"),
    Column("risk", pa.float64(), "", "P(fall) predicted for what was taken"),
    Column("changed", pa.bool_(), "", "whether that is another motion than the command's own"),
    Column("saved", pa.float64(), "", "1 where the robot did not fall; of random the mean"),
    Column("done", pa.float64(), "", "1 where it did not fall and did the task; null: unknown"),
    Column("missed", pa.string(), "", "what of the task was not done"),
    Column("fall_time_s", pa.float64(), "s", "when it fell"),
    Column("why_fell", pa.string(), "", "what went wrong first"),
    Column("deviation", pa.float64(), "m", "mean keypoint distance from the command's own motion"),
    Column("tempo", pa.float64(), "", "duration of the command's own motion / of what was taken"),
    Column("generate_s", pa.float64(), "s", "processor time of making the human motions"),
    Column("retarget_s", pa.float64(), "s", "of making references of them"),
    Column("adapt_s", pa.float64(), "s", "of judging, ranking and optimising"),
    Column("time_s", pa.float64(), "s", "of all that is needed to choose"),
    Column("handovers", pa.int32(), "", "changes on the way; null where there can be none"),
    Column("stopped", pa.bool_(), "", "whether it came to a halt on the way"),
    Column("since_s", pa.float64(), "s", "from the last change on the way to the fall"),
    Column("lead_s", pa.float64(), "s", "from the first alarm to the fall without a change"),
    Column("look_s", pa.float64(), "s", "median time of a look ahead, by the clock"),
    Column("survivor", pa.bool_(), "", "whether a candidate of the pool survives; null: unknown"),
    Column("simulated", pa.int32(), "", "candidates of the pool that were simulated"),
    Column("cause", pa.string(), "", "why the command was not saved; null where it was"),
    Column("failure", pa.string(), "", "the error where a stage failed"),
)
"""Columns of what the variants make of the commands."""


def about(job: Job) -> Row:
    """What is recorded of the command itself."""
    prompt = job.prompt
    return {
        "command": job.number,
        "prompt": prompt.text,
        "actions": list(prompt.actions),
        "group": prompt.group,
        "split": prompt.split,
    }


def of_variant(variant: Variant) -> Row:
    """A variant as columns."""
    return asdict(variant)


def variant_of(row: Mapping[str, Any]) -> Variant:
    """The variant that a row is of."""
    return Variant(**{field.name: row[field.name] for field in fields(Variant)})


def of_earlier(job: Job, variant: Variant) -> Row | None:
    """The row of a variant that an earlier study has."""
    return next((dict(row) for row in job.earlier if variant_of(row) == variant), None)


def pool_earlier(job: Job, variant: Variant) -> Row | None:
    """A row of an earlier study that tells how the pool of a variant ends."""
    return next(
        (
            row
            for row in job.earlier
            if (row["pool"], row["level"]) == (variant.pool, variant.level)
            and row["survivor"] is not None
        ),
        None,
    )
