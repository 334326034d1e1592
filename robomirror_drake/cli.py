"""The ``robomirror`` command.

Exit codes: 0 done (the robot may have fallen: that is a result), 2 bad input,
1 internal error. Heavy modules are imported inside the commands, so that
``--help`` answers at once.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import traceback
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from robomirror_drake import __version__
from robomirror_drake.commands.bench import app as bench_app
from robomirror_drake.commands.dataset import app as dataset_app
from robomirror_drake.commands.generator import app as generator_app
from robomirror_drake.commands.learning import evaluate, train, train_torques
from robomirror_drake.commands.run import run
from robomirror_drake.commands.study import study
from robomirror_drake.commands.survey import survey
from robomirror_drake.commands.terminal import (
    ScenarioOption,
    check_file,
    complain,
    out,
    scenario_of,
    slug,
    write_json,
)
from robomirror_drake.exceptions import (
    InputError,
    PlanningError,
    ResultError,
    RetargetingError,
    RoboMirrorError,
)

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(bench_app, name="bench")
app.add_typer(generator_app, name="generator")
app.add_typer(dataset_app, name="dataset")


def _print_version(wanted: bool) -> None:
    if wanted:
        out.print(f"robomirror {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """A humanoid that judges a commanded motion before it moves."""


app.command()(run)


@app.command()
def motions(
    explain: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Show how a command is understood.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="As JSON; into a file where one is named after it.")
    ] = False,
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", hidden=True)] = None,
) -> None:
    """List the actions and the recorded clips that the library knows, or explain a command."""
    from robomirror_drake.motion import explanation

    if file is not None and not as_json:
        raise InputError(f"{file}: say --json before the file to write, or --explain before words")
    check_file(file)
    figures = explanation.listing() if explain is None else explanation.of(explain)
    if as_json and file is None:
        out.print_json(json.dumps(figures))
    elif explain is not None:
        explanation.print_clauses(figures, out)
    elif file is None:
        explanation.print_listing(out)
    write_json(file, figures)


@app.command("scenario")
def print_scenario(
    name: Annotated[str, typer.Argument(help="Name or path.")] = "default",
) -> None:
    """Print a scenario with every key, its value and what it is for: copy and change it."""
    from robomirror_drake.yaml_file import to_yaml

    out.print(to_yaml(scenario_of(name)), end="", markup=False, highlight=False, soft_wrap=True)


@app.command()
def retarget(
    file: Annotated[str, typer.Argument(help="A motion file, or clip:NAME.")],
    folder: Annotated[Path | None, typer.Option("--out", help="Where to write.")] = None,
    scenario: ScenarioOption = "default",
) -> None:
    """Retarget one recorded motion, kinematically, and write the reference as Parquet."""
    from robomirror_drake.messages import RESIDUAL_UNITS
    from robomirror_drake.results import check_place
    from robomirror_drake.run import retarget_motion
    from robomirror_drake.tables import write_message

    settings = scenario_of(scenario, command=file)
    path = folder / "reference.parquet" if folder else Path(f"{slug(file)}.reference.parquet")
    check_place(path)
    if path.exists():
        raise ResultError(f"{path} exists; name another place with --out")
    reference = retarget_motion(settings)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_message(path, reference)
    table = Table("residual", "value", "unit")
    for name, value in reference.residuals.items():
        table.add_row(name, f"{value:.4g}", RESIDUAL_UNITS.get(name, ""))
    out.print(table)
    out.print(str(path), soft_wrap=True)


@app.command()
def play(result: Annotated[Path, typer.Argument(help="A result folder.")]) -> None:
    """Show a saved result in a browser."""
    from robomirror_drake.playback.playback import play as open_viewer
    from robomirror_drake.results import load_result
    from robomirror_drake.robot import load_robot

    loaded = load_result(result)
    viewer = open_viewer(loaded, load_robot(loaded.robot))
    out.print(f"{viewer.url()}\nEnter ends it.")
    sys.stdin.readline()


app.command()(survey)
app.command()(train)
app.command()(train_torques)
app.command()(evaluate)
app.command()(study)


def main() -> None:
    """Entry point: turns errors into exit codes, so that bad input shows no traceback."""
    # The progress bars here are enough; libraries speak up only when something is wrong.
    os.environ.setdefault("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    logging.getLogger("drake").addFilter(lambda record: record.levelno >= logging.ERROR)
    try:
        app()
    except (InputError, RetargetingError, PlanningError) as error:
        complain(str(error))
        raise SystemExit(2) from None
    except RoboMirrorError as error:
        complain(str(error))
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except Exception as error:
        traceback.print_exc()
        complain(f"internal error: {error}")
        raise SystemExit(1) from None
