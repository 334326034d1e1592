"""A folder that one run at a time fills, and that says what it holds."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from robomirror_drake.exceptions import InputError, ResultError
from robomirror_drake.results import check_place


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds the folder for one run; the system lets go of it however the run ends.

    Raises:
        InputError: Another run is writing to it.
        ResultError: It cannot be written to.
    """
    check_place(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ".lock").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(f"another run is writing to {folder}") from None
            yield
    except (FileExistsError, NotADirectoryError, PermissionError) as error:
        raise ResultError(f"cannot write to {folder}: {error}") from error


def describe(folder: Path, name: str, told: Mapping[str, Any], kind: str) -> None:
    """Writes what the folder holds, or makes sure that it is the same as what is there.

    Args:
        folder: Where.
        name: Of the JSON file.
        told: What it shall hold.
        kind: What to call that, ``data set`` or ``study``.

    Raises:
        InputError: It holds another one; the message names the first difference.
        ResultError: The description that is there cannot be read.
    """
    path = folder / name
    if path.exists():
        there = description(folder, name)
        if found := difference(there, json.loads(json.dumps(told))):
            raise InputError(f"{folder} holds another {kind}: {found}; name a new folder")
        return
    if any(folder.glob("*/*.parquet")):
        raise InputError(f"{folder} has files of a {kind} but no {name}")
    work = path.with_suffix(".partial")
    work.write_text(json.dumps(told, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    work.rename(path)


def description(folder: Path, name: str = "dataset.json") -> dict[str, Any]:
    """What a folder says that it holds.

    Raises:
        ResultError: The file that says so is missing or damaged.
    """
    path = folder / name
    try:
        told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: {error}") from error
    return told


def difference(there: Any, here: Any, name: str = "") -> str | None:
    """The first value in which two descriptions differ, in words."""
    if isinstance(there, dict) and isinstance(here, dict):
        pairs = ((key, there.get(key), here.get(key)) for key in [*there, *here])
        found = (difference(a, b, f"{name}.{key}".strip(".")) for key, a, b in pairs)
        return next((words for words in found if words), None)
    return None if there == here else f"{name} is {there!r} there and {here!r} here"
