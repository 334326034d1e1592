"""Files of commands: a CSV with what is known of each, or plain text with one a line."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robomirror_drake.exceptions import InputError

Split = Literal["train", "validation", "test", "held_out"]


class Prompt(BaseModel):
    """One command of a corpus."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    text: str = Field(min_length=1, description="the command")
    split: Split = Field("train", description="which commands it is learned or judged with")
    group: str = Field("", description="of its first action")
    family: str = Field("", description="family of actions that it is held out for")
    actions: tuple[str, ...] = Field((), description="its actions in their order")
    origin: str = Field("", description="grammar or hand")


def read_prompts(file: str | Path) -> tuple[Prompt, ...]:
    """Reads commands.

    Args:
        file: Name of a corpus in ``assets/prompts`` without suffix, or the path of a ``.csv``,
            or of a text with one command a line.

    Raises:
        InputError: There is no such file, or it is malformed, empty or has a command twice.
    """
    path = _find(file)
    try:
        with path.open(encoding="utf-8", newline="") as lines:
            if path.suffix == ".csv":
                prompts = [_prompt(row) for row in csv.DictReader(lines)]
            else:
                prompts = [Prompt(text=line.strip()) for line in lines if line.strip()]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: {error}") from error
    except ValidationError as error:
        fault = error.errors()[0]
        raise InputError(f"{path}: {fault['loc']}: {fault['msg']}") from error
    if not prompts:
        raise InputError(f"{path} has no commands")
    texts = [prompt.text for prompt in prompts]
    if len(set(texts)) < len(texts):
        twice = next(text for text in texts if texts.count(text) > 1)
        raise InputError(f"{path} has {twice!r} twice")
    return tuple(prompts)


def write_prompts(path: Path, prompts: Sequence[Prompt]) -> None:
    """Writes a CSV with a column for each field of :class:`Prompt`; actions have blanks between.

    Raises:
        InputError: It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, tuple(Prompt.model_fields), lineterminator="\n")
            writer.writeheader()
            for prompt in prompts:
                writer.writerow({**prompt.model_dump(), "actions": " ".join(prompt.actions)})
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}") from error


def _prompt(row: dict[str, str]) -> Prompt:
    actions = tuple((row.get("actions") or "").split())
    return Prompt.model_validate({**row, "actions": actions})


def _find(file: str | Path) -> Path:
    """A path as it is, a name in the package's own folder."""
    path = Path(file)
    if path.suffix or path.is_file():
        return path
    folder = Path(str(resources.files("robomirror_drake.assets") / "prompts"))
    shipped = folder / f"{file}.csv"
    if not shipped.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.csv")))
        raise InputError(f"no prompts {str(file)!r}; known: {known}; or give a path")
    return shipped
