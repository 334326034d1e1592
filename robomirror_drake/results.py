"""A run's result as a folder of plain files, written whole or not at all.

=====================  ===========================================================
``outcome.json``       how it went, the command, the seeds and the versions
``scenario.yaml``      the scenario, complete: what to give to repeat the run
``candidates.parquet`` the human motions that were generated, one row a frame
``reference.parquet``  what the robot was told, one row a sample
``execution.parquet``  what it did, one row a sample
``report.html``        the same as plots
``playback.html``      the same as a moving picture
=====================  ===========================================================

Where the robot could adapt the command, the files of
:mod:`robomirror_drake.adaptation.record` stand beside these. The columns of the Parquet files
are documented in :mod:`robomirror_drake.tables`, and in the files themselves.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from robomirror_drake.adaptation.record import AdaptedRun, read_adaptation, write_adaptation
from robomirror_drake.exceptions import ResultError
from robomirror_drake.messages import Execution, HumanMotion, Outcome, RobotReference
from robomirror_drake.tables import (
    read_candidates,
    read_message,
    write_candidates,
    write_message,
)

PACKAGES = ("robomirror_drake", "drake", "pin", "numpy", "scipy", "qpsolvers", "torch")


def installed_versions() -> dict[str, str]:
    """Versions of this package and of those that its results depend on."""
    return {name: metadata.version(name) for name in PACKAGES}


@dataclass(frozen=True)
class Result:
    """All that is known of one run.

    Attributes:
        command: The text or file that was asked for.
        scenario: The whole scenario as YAML.
        candidates: The human motions that were generated.
        chosen: Index of the candidate that was executed.
        reference: What the robot was told.
        execution: What it did.
        outcome: How it went.
        robot: Name of the robot's YAML.
        seeds: The seeds of the run, by what they seed.
        versions: Versions of the packages that made it.
        adaptation: What was made of the command and why; None where nothing might be.
    """

    command: str
    scenario: str
    candidates: tuple[HumanMotion, ...]
    chosen: int
    reference: RobotReference
    execution: Execution
    outcome: Outcome
    robot: str = "jvrc1"
    seeds: Mapping[str, int] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=installed_versions)
    adaptation: AdaptedRun | None = None


class _Summary(BaseModel):
    """The part of outcome.json that is not the outcome itself."""

    model_config = ConfigDict(extra="forbid")

    format: Literal[1] = 1
    command: str
    robot: str
    chosen: int
    seeds: dict[str, int]
    versions: dict[str, str]


def check_place(path: Path) -> None:
    """Makes sure that a file or folder can be written, before the work that fills it.

    Raises:
        ResultError: The path has no name of its own, or leads to no writable folder.
    """
    if path.name in ("", ".."):
        raise ResultError(f"{str(path)!r} has no name of its own; give one, as results/walk")
    parent = next(p for p in Path(os.path.abspath(path)).parents if os.path.exists(p))
    if not parent.is_dir():
        raise ResultError(f"cannot write {path}: {parent} is no folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise ResultError(f"cannot write {path}: no permission to write to {parent}")


def save_result(folder: Path, result: Result, pages: Mapping[str, str] | None = None) -> Path:
    """Writes a result as a new folder; it appears under its name only when it is complete.

    Args:
        folder: Where; if that is taken, ``-2``, ``-3`` … is appended to the name.
        result: What.
        pages: Further text files by name, as ``report.html``.

    Returns:
        The folder that was written.

    Raises:
        ResultError: The place cannot be written to.
    """
    folder = Path(os.path.abspath(folder))
    work = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}.partial")
    try:
        work.mkdir(parents=True)
        try:
            _write(work, result, pages or {})
            return _move_to_free_name(work, folder)
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
    except OSError as error:
        raise ResultError(f"cannot write the result to {folder}: {error}") from error


def load_result(folder: Path) -> Result:
    """Reads a folder that :func:`save_result` wrote; arrays come back bit for bit.

    Raises:
        ResultError: A file is missing or damaged; the message names it.
    """
    folder = Path(folder)
    if not (folder / "outcome.json").is_file():
        raise ResultError(f"{folder} is no result folder: there is no outcome.json in it")
    summary, outcome = _read_outcome(folder / "outcome.json")
    candidates = read_candidates(folder / "candidates.parquet")
    if not 0 <= summary.chosen < len(candidates):
        raise ResultError(
            f"{folder / 'outcome.json'}: candidate {summary.chosen} was chosen, "
            f"but there are {len(candidates)}"
        )
    return Result(
        command=summary.command,
        scenario=_read_text(folder / "scenario.yaml"),
        candidates=candidates,
        chosen=summary.chosen,
        reference=read_message(folder / "reference.parquet", RobotReference),
        execution=read_message(folder / "execution.parquet", Execution),
        outcome=outcome,
        robot=summary.robot,
        seeds=summary.seeds,
        versions=summary.versions,
        adaptation=read_adaptation(folder),
    )


def _move_to_free_name(work: Path, folder: Path) -> Path:
    """Renames, which the file system does in one step, to the first name that is free."""
    number = 1
    while True:
        target = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        if not os.path.lexists(target):
            try:
                return work.rename(target)
            except OSError:
                if not os.path.lexists(target):  # not a race for the name: a real fault
                    raise
        number += 1


def _write(folder: Path, result: Result, pages: Mapping[str, str]) -> None:
    summary = _Summary(
        command=result.command,
        robot=result.robot,
        chosen=result.chosen,
        seeds=dict(result.seeds),
        versions=dict(result.versions),
    )
    outcome = dataclasses.asdict(result.outcome) | summary.model_dump()
    texts = {
        "outcome.json": json.dumps(outcome, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
        "scenario.yaml": result.scenario,
        **pages,
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    write_candidates(folder / "candidates.parquet", result.candidates)
    write_message(folder / "reference.parquet", result.reference)
    write_message(folder / "execution.parquet", result.execution)
    if result.adaptation is not None:
        write_adaptation(folder, result.adaptation)


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ResultError(f"{path}: {error}") from error


def _read_outcome(path: Path) -> tuple[_Summary, Outcome]:
    try:
        data = json.loads(_read_text(path))
        names = {f.name for f in dataclasses.fields(Outcome)}
        outcome = {name: value for name, value in data.items() if name in names}
        rest = {name: value for name, value in data.items() if name not in names}
        return _Summary.model_validate(rest), TypeAdapter(Outcome).validate_python(outcome)
    except (ValueError, AttributeError, ValidationError) as error:
        raise ResultError(f"{path}: {error}") from error
