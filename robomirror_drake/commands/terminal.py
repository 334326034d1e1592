"""What commands have in common: how they speak at the prompt and write files."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from robomirror_drake.exceptions import ResultError

if TYPE_CHECKING:
    from robomirror_drake.config import Scenario
    from robomirror_drake.messages import Outcome
    from robomirror_drake.results import Result

JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")]
HtmlOption = Annotated[Path | None, typer.Option(help="Write a page with plots here.")]
WorkersOption = Annotated[
    int | None,
    typer.Option(min=0, help="Processes; one a core by default; 0: this one, without Ray."),
]
AddressOption = Annotated[
    str | None, typer.Option(help="Of a Ray cluster whose machines have this package.")
]

ScenarioOption = Annotated[
    str, typer.Option(help="Scenario YAML, or the name of one in assets/scenarios.")
]

console = Console(stderr=True)
# Tables keep their width in a file or a pipe.
out = Console(width=None if sys.stdout.isatty() else 140)


def scenario_of(name: str, **changes: Any) -> Scenario:
    """The scenario of that name with what the command line says instead."""
    from robomirror_drake.config import load_scenario
    from robomirror_drake.yaml_file import changed

    return changed(load_scenario(name), **changes)


def progress_bars() -> Progress:
    """Bars for the tasks of a command, one line each."""
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        console=console,
        transient=False,
    )


def print_outcome(result: Result, folder: Path) -> None:
    """How a run went, what was changed for it, and where its pages are."""
    outcome, adapted = result.outcome, result.adaptation
    if adapted is not None:
        for warning in adapted.record.warnings:
            out.print(f"warning: {warning}", style="yellow", markup=False, highlight=False)
        out.print(adapted.record.reason, style="bold", markup=False, highlight=False)
        for handover in (h for h in adapted.record.handovers if h.done):
            out.print(f"at {handover.time:.1f} s: {handover.reason}", markup=False, highlight=False)
        if adapted.original is not None:
            out.print("As commanded: ", end="")
            _print_end(adapted.original.outcome)
            out.print("As adapted: ", end="")
    _print_end(outcome)
    if adapted is not None and adapted.record.done is False:
        missed = next(task for task in adapted.record.tasks if task.done is False)
        words = f"{missed.sentence}; it was {missed.executed:.2f} {missed.unit}".rstrip()
        out.print(f"The task was not done: {words}.", markup=False, highlight=False)
    if adapted is not None and adapted.record.stopped:
        out.print("It was brought to a halt on the way, and did not do what it was told.")
    out.print(
        f"mean error: joints {outcome.A_q:.4f} rad, root {100 * outcome.A_p:.1f} cm, "
        f"{outcome.A_theta:.3f} rad"
    )
    for page in ("report.html", "playback.html"):
        out.print(f"{folder / page}", soft_wrap=True, highlight=False)


def _print_end(outcome: Outcome) -> None:
    if outcome.fell:
        out.print(f"[red]The robot fell at {outcome.fall_time_s:.2f} s[/] ({outcome.fall_cause}).")
        out.print(f"{outcome.cause}: {outcome.cause_evidence}", markup=False, highlight=False)
    else:
        out.print(f"[green]The robot stayed on its feet[/] for {outcome.duration_s:.1f} s.")


def check_file(path: Path | None) -> None:
    """Refuses a file that could not be written, before the work whose figures it shall hold."""
    from robomirror_drake.results import check_place

    if path is not None:
        check_place(path)
        if path.is_dir():
            raise ResultError(f"{path} is a folder; name a file")


def write_text(path: Path, text: str) -> None:
    """Writes a file and the folders above it.

    Raises:
        ResultError: It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultError(f"cannot write {path}: {error}") from error


def write_page(path: Path, text: str) -> None:
    """Writes a file that the user has asked for, and says so."""
    write_text(path, text)
    console.print(f"wrote {path}", highlight=False)


def write_json(path: Path | None, figures: dict[str, Any]) -> None:
    """Writes figures where the user wants them in a file."""
    if path is not None:
        write_page(path, json.dumps(figures, indent=2, allow_nan=False) + "\n")


def slug(command: str) -> str:
    """A short name for files from a command: ``a person bows`` gives ``a-person-bows``."""
    return re.sub(r"[^a-z0-9]+", "-", Path(command).stem.lower()).strip("-")[:60] or "run"


def complain(message: str) -> None:
    """An error in one sentence, in red."""
    console.print(f"robomirror: {message}", style="red", markup=False, highlight=False)
