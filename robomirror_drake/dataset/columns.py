"""What a data set holds: a row a frame, and a row an episode.

An episode is one execution of one candidate motion for one command. Every column of the
Parquet files carries its unit, its meaning and the shape of one row (flattened in C
order) as field metadata; all real numbers are float32.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from robomirror_drake.messages import Execution
from robomirror_drake.tables import COLUMNS, FOOT_FORCE, column_notes, to_column


class Column(NamedTuple):
    """One column.

    Attributes:
        name: As in the file.
        type: Of one element.
        unit: Empty where there is none.
        description: What it means.
        shape: Of one row; empty for a number.
    """

    name: str
    type: pa.DataType
    unit: str
    description: str
    shape: tuple[int, ...] = ()


def _recorded(name: str, shape: tuple[int, ...], element: pa.DataType | None = None) -> Column:
    unit, description = {**COLUMNS, "foot_force": FOOT_FORCE[Execution]}[name]
    return Column(name, element or pa.float32(), unit, description, shape)


def frame_columns(joints: int = 23) -> tuple[Column, ...]:
    """Columns of the frames of a robot with so many joints."""
    nq, nv = joints + 7, joints + 6
    return (
        Column("episode", pa.int64(), "", "which episode; the key of the table of episodes"),
        Column("frame", pa.int32(), "", "index of the frame in its episode"),
        _recorded("time", ()),
        _recorded("q", (nq,)),
        _recorded("v", (nv,)),
        Column("q_raw", pa.float32(), "1, m, rad", "q as the kinematic reference has it", (nq,)),
        Column(
            "v_raw",
            pa.float32(),
            "rad/s, m/s, rad/s",
            "v as the kinematic reference has it; 0 in time that the plan has added",
            (nv,),
        ),
        Column(
            "contact_raw", pa.bool_(), "", "contact_ref as the kinematic reference has it", (2, 4)
        ),
        _recorded("q_ref", (nq,)),
        _recorded("v_ref", (nv,)),
        _recorded("contact_ref", (2, 4), pa.bool_()),
        _recorded("torque", (joints,)),
        _recorded("foot_force", (2, 3)),
        _recorded("other_force", ()),
        _recorded("contact_scheduled", (2,)),
        _recorded("contact_measured", (2,)),
        _recorded("torque_limit", (joints,), pa.int8()),
        _recorded("qp_status", ()),
        _recorded("qp_slack", ()),
    )


EPISODE_COLUMNS: Final = (
    Column("episode", pa.int64(), "", "key of the episode"),
    Column("prompt_index", pa.int32(), "", "row of the command among the prompts"),
    Column("prompt", pa.string(), "", "the command"),
    Column("actions", pa.list_(pa.string()), "", "its actions in their order"),
    Column("group", pa.string(), "", "locomotion, dynamic or expressive"),
    Column("family", pa.string(), "", "family of actions that the command is held out for"),
    Column("split", pa.string(), "", "train, validation, test or held_out"),
    Column("candidate", pa.int32(), "", "which of the command's motions; 0 is in nominal style"),
    Column("execution", pa.int32(), "", "which execution of the candidate; 0 is undisturbed"),
    Column("kind", pa.string(), "", "nominal, pushed, start or dynamics: what was disturbed"),
    Column("seed", pa.int64(), "", "of the disturbances"),
    Column("source", pa.string(), "", "provenance of the motion"),
    Column("style", pa.string(), "", "style parameters of the motion, as JSON"),
    Column("frames", pa.int32(), "", "how many frames the episode has; 0 where it failed"),
    Column("failed_stage", pa.string(), "", "stage that failed, null where none did"),
    Column("failure", pa.string(), "", "why"),
    Column(
        "raw_q",
        pa.list_(pa.float32()),
        "1, m, rad",
        "q of the whole kinematic reference, past a fall too: 60 rows of 30 a second",
    ),
    Column(
        "raw_contact",
        pa.list_(pa.bool_()),
        "",
        "which sole corners it means to bear load: 60 rows of 2 x 4 a second",
    ),
    Column("raw_duration_s", pa.float32(), "s", "length of the kinematic reference"),
    Column("lead_s", pa.float32(), "s", "when it begins"),
    Column("motion_end_s", pa.float32(), "s", "when the plan ends and its last pose is held"),
    Column("duration_s", pa.float32(), "s", "length of the execution"),
    Column("keypoint_error", pa.float32(), "m", "of the kinematic reference"),
    Column("distance_to_raw", pa.float32(), "m", "of the plan from the kinematic reference"),
    Column("dynamic_violation", pa.float32(), "body weights", "that is left in the plan"),
    Column("fell", pa.bool_(), "", "whether the robot fell"),
    Column("fall_time_s", pa.float32(), "s", "when"),
    Column("fall_cause", pa.string(), "", "by which condition: contact, height or tilt"),
    Column("cause", pa.string(), "", "why: what went wrong first"),
    Column("cause_evidence", pa.string(), "", "the figures that say so"),
    Column("A_q", pa.float32(), "rad", "mean joint position error"),
    Column("A_qd", pa.float32(), "rad/s", "mean joint velocity error"),
    Column("A_qdd", pa.float32(), "rad/s²", "mean joint acceleration error"),
    Column("A_p", pa.float32(), "m", "mean root position error"),
    Column("A_theta", pa.float32(), "rad", "mean root orientation error"),
    Column("torque_saturation", pa.float32(), "", "share of joint samples at the torque limit"),
    Column("friction_margin", pa.float32(), "", "least µ - |f_t|/f_n over loaded feet"),
    Column("energy_j", pa.float32(), "J", "positive mechanical work of the joints"),
    Column("push_time_s", pa.float32(), "s", "when the push begins, null without one"),
    Column("push_speed", pa.float32(), "m/s", "impulse of the push / mass of the robot"),
    Column("push_direction", pa.float32(), "rad", "of the push, about z from x"),
    Column("friction", pa.float32(), "", "between soles and ground"),
    Column("mass_factor", pa.float32(), "", "true mass / mass known to the controller"),
    Column("latency_s", pa.float32(), "s", "of the actuators"),
    Column("strength", pa.float32(), "", "true torque limits / those known to the controller"),
)
"""Columns of the episodes; what a failed episode does not have is null."""


def frames_table(arrays: Mapping[str, npt.NDArray[Any]], joints: int) -> pa.Table:
    """Frames as a table; ``arrays`` has one array a column, rows first."""
    columns = frame_columns(joints)
    made = [to_column(arrays[c.name].astype(c.type.to_pandas_dtype())) for c in columns]
    return pa.Table.from_arrays(made, schema=_schema(columns))


def episodes_table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Episodes as a table; a row is a mapping, in which null columns may be missing.

    Raises:
        ValueError: A row has a key that is no column.
    """
    return rows_table(rows, EPISODE_COLUMNS)


def rows_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> pa.Table:
    """Rows as a table of these columns; a row is a mapping, in which null columns may be missing.

    Raises:
        ValueError: A row has a key that is no column.
    """
    names = [column.name for column in columns]
    if extra := {key for row in rows for key in row} - set(names):
        raise ValueError(f"no column for {', '.join(sorted(extra))}")
    arrays = [
        pa.array([row.get(column.name) for row in rows], type=column.type) for column in columns
    ]
    return pa.Table.from_arrays(arrays, schema=_schema(columns))


def _schema(columns: Sequence[Column]) -> pa.Schema:
    return pa.schema(
        [
            pa.field(
                column.name,
                pa.list_(column.type, int(np.prod(column.shape))) if column.shape else column.type,
                metadata=column_notes(column.unit, column.description, column.shape),
            )
            for column in columns
        ]
    )
