"""Messages as Parquet files whose columns say what they hold.

Every column carries its ``unit``, ``description`` and the ``shape`` of one row
(flattened in C order) as field metadata. What is not an array stands as JSON under
the key ``message`` of the schema metadata. Arrays come back bit for bit.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from robomirror_drake.exceptions import ResultError
from robomirror_drake.messages import Execution, Foresight, HumanMotion, RobotReference

COLUMNS: Mapping[str, tuple[str, str]] = {
    "candidate": ("", "index of the candidate that the frame belongs to"),
    "positions": ("m", "positions of the 22 joints in world, z up, HumanML3D joint order"),
    "time": ("s", "time from the start"),
    "q": ("1, m, rad", "base quaternion wxyz, base position in world, joint angles"),
    "v": ("rad/s, m/s, rad/s", "base angular and linear velocity in world, joint velocities"),
    "a": ("rad/s², m/s², rad/s²", "time derivative of v"),
    "q_ref": ("1, m, rad", "q as the reference has it"),
    "v_ref": ("rad/s, m/s, rad/s", "v as the reference has it"),
    "contact": ("", "whether a sole corner is meant to bear load: left, right foot × 4 corners"),
    "contact_ref": (
        "",
        "whether a sole corner is meant to bear load: left, right foot × 4 corners",
    ),
    "torque": ("N·m", "joint torques applied"),
    "other_force": ("N", "norm of the ground force on all links but the feet"),
    "qp_status": ("", "0, or how many ticks in a row the controller's QP had not been solved"),
    "qp_slack": ("rad/s²", "by how much joint accelerations had to leave their bounds"),
    "contact_scheduled": ("", "share of the left, right foot's corners wanted on the ground"),
    "contact_measured": ("", "whether the left, right foot is felt on the ground"),
    "torque_limit": ("", "+1 where a joint's highest torque is asked for, -1 for its lowest"),
    "beforehand": ("", "P(fall) within the horizon, as it looked before the robot moved"),
    "underway": ("", "P(fall) within the horizon, by what the robot had really done until then"),
}
"""Unit and description of the columns."""

FOOT_FORCE = {
    RobotReference: ("N·m, N", "planned moment and force on the left and right foot, world axes"),
    Execution: ("N", "measured ground force on the left and right foot, world axes"),
}
"""The one column whose meaning depends on the file."""

_Message = TypeVar("_Message", RobotReference, Execution, Foresight)


def write_message(path: Path, message: RobotReference | Execution | Foresight) -> None:
    """Writes one row a sample, one column an array field."""
    values = {f.name: getattr(message, f.name) for f in dataclasses.fields(message)}
    docs = {**COLUMNS, "foot_force": FOOT_FORCE.get(type(message), ("", ""))}
    columns = {n: (v, docs[n]) for n, v in values.items() if isinstance(v, np.ndarray)}
    rest = {n: v for n, v in values.items() if not isinstance(v, np.ndarray)}
    plain = {n: dict(v) if isinstance(v, Mapping) else v for n, v in rest.items()}
    pq.write_table(_table(columns, plain), path)


def read_message(path: Path, kind: type[_Message]) -> _Message:
    """Reads what :func:`write_message` wrote.

    Raises:
        ResultError: The file is missing, damaged or holds something else.
    """
    arrays, rest = _read_table(path)
    try:
        return kind(**arrays, **rest)
    except (TypeError, ValueError) as error:
        raise ResultError(f"{path}: {error}") from error


def write_candidates(path: Path, candidates: tuple[HumanMotion, ...]) -> None:
    """Writes human motions one after the other, one row a frame."""
    owner = np.repeat(np.arange(len(candidates)), [len(c.positions) for c in candidates])
    positions = np.concatenate([c.positions for c in candidates])
    columns = {
        "candidate": (owner.astype(np.int32), COLUMNS["candidate"]),
        "positions": (positions, COLUMNS["positions"]),
    }
    described = [
        {"fps": c.fps, "text": c.text, "source": c.source, "style": dict(c.style)}
        for c in candidates
    ]
    pq.write_table(_table(columns, described), path)


def read_candidates(path: Path) -> tuple[HumanMotion, ...]:
    """Reads what :func:`write_candidates` wrote.

    Raises:
        ResultError: The file is missing, damaged or holds something else.
    """
    arrays, described = _read_table(path)
    try:
        owner, positions = arrays["candidate"], arrays["positions"]
        return tuple(
            HumanMotion(positions=positions[owner == number], **rest)
            for number, rest in enumerate(described)
        )
    except (TypeError, ValueError, KeyError) as error:
        raise ResultError(f"{path}: {error}") from error


def to_column(array: npt.NDArray[Any]) -> pa.Array:
    """An array as a column, rows first; what a row has more than one number of is a list."""
    flat = pa.array(array.reshape(-1))
    if array.ndim == 1:
        return flat
    return pa.FixedSizeListArray.from_arrays(flat, int(np.prod(array.shape[1:])))


def column_notes(unit: str, description: str, shape: tuple[int, ...]) -> dict[str, str]:
    """What a column's metadata say; ``shape`` is that of one row."""
    return {"unit": unit, "description": description, "shape": json.dumps(shape)}


def rows_in_shape(table: pa.Table, name: str) -> npt.NDArray[Any]:
    """A column of a table as an array, rows first and in the shape that its metadata say."""
    column = table.schema.field(name)
    values = table[name].combine_chunks()
    flat = values.flatten() if pa.types.is_fixed_size_list(column.type) else values
    shape = json.loads(column.metadata[b"shape"])
    return np.asarray(flat.to_numpy(zero_copy_only=False).reshape(len(table), *shape))


def _table(
    columns: Mapping[str, tuple[npt.NDArray[Any], tuple[str, str]]], message: Any
) -> pa.Table:
    """A table of arrays whose first axis is the rows, with documented columns."""
    arrays, schema = [], []
    for name, (array, (unit, description)) in columns.items():
        arrays.append(to_column(array))
        notes = column_notes(unit, description, array.shape[1:])
        schema.append(pa.field(name, arrays[-1].type, nullable=False, metadata=notes))
    text = json.dumps(message, ensure_ascii=False, default=float)  # numpy scalars are floats
    return pa.Table.from_arrays(arrays, schema=pa.schema(schema, metadata={"message": text}))


def _read_table(path: Path) -> tuple[dict[str, Any], Any]:
    """The columns of a file with their rows in shape, and its message."""
    try:
        table = pq.read_table(path)
        arrays = {name: rows_in_shape(table, name) for name in table.column_names}
        return arrays, json.loads(table.schema.metadata[b"message"])
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise ResultError(f"{path}: {error}") from error
