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
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.table import Table

from robomirror_drake import __version__
from robomirror_drake.commands.dataset import app as dataset_app
from robomirror_drake.commands.generator import app as generator_app
from robomirror_drake.commands.learning import evaluate, train
from robomirror_drake.commands.study import study
from robomirror_drake.commands.terminal import (
    JsonOption,
    check_file,
    complain,
    console,
    out,
    print_outcome,
    progress_bars,
    slug,
    write_json,
    write_text,
)
from robomirror_drake.exceptions import (
    InputError,
    PlanningError,
    ResultError,
    RetargetingError,
    RoboMirrorError,
)

if TYPE_CHECKING:
    from robomirror_drake.config import Scenario
    from robomirror_drake.results import Result
    from robomirror_drake.run import Stage

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
bench = typer.Typer(help="Measure a stage; beside a peer where there is one.", no_args_is_help=True)
app.add_typer(bench, name="bench")
app.add_typer(generator_app, name="generator")
app.add_typer(dataset_app, name="dataset")

Method = Literal["none", "selection", "optimisation", "selection_optimisation"]

ADAPTING = "worn"
"""Scenario in which commands are adapted."""

ScenarioOption = Annotated[
    str, typer.Option(help="Scenario YAML, or the name of one in assets/scenarios.")
]


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


@app.command()
def run(
    command: Annotated[
        str,
        typer.Argument(
            metavar="TEXT|FILE",
            help="What to do, in words; or a motion file (.bvh, .npy, mocap .txt); or clip:NAME.",
        ),
    ] = "",
    candidates: Annotated[
        int | None, typer.Option("-n", "--candidates", help="Human motions to generate.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all that is drawn.")] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", help="Result folder; numbered if it exists.")
    ] = None,
    live: Annotated[bool, typer.Option("--live", help="Watch it in a browser.")] = False,
    method: Annotated[
        Method | None, typer.Option(help="What may be done with what the robot cannot do.")
    ] = None,
    weights: Annotated[
        str | None,
        typer.Option(
            help="Of what foresees falls beforehand: a name in assets/ppn, or a file of your own. "
            "Those that look while it moves are adaptation.adapter.predictor of the scenario."
        ),
    ] = None,
    closed_loop: Annotated[
        bool | None, typer.Option(help="Adapt the motion while it runs, too.")
    ] = None,
    compare: Annotated[
        bool, typer.Option(help="Where the motion was changed, execute the original as well.")
    ] = True,
    scenario: Annotated[
        str | None,
        typer.Option(help="Scenario YAML, or the name of one; by default worn, which adapts."),
    ] = None,
    graphviz: Annotated[
        Path | None, typer.Option(help="Write the diagram's picture (.dot) here and stop.")
    ] = None,
) -> None:
    """Run a command end to end: motion, reference, adaptation, physics, report.

    Example: robomirror run "a person strides forward"

    What the robot is foreseen to fall with is changed before it moves: another of the
    candidates is taken, or the motion is done otherwise, as little as it takes. Says what was
    changed and why, and what would have happened.
    """
    from robomirror_drake.results import check_place

    name = scenario or _run_scenario(weights)
    settings = _scenario(name, command=command, seed=seed, candidates=candidates)
    settings = _adapting(settings, method, weights, closed_loop)
    if graphviz is not None:
        check_file(graphviz)
        _write_graphviz(settings, graphviz)
        return
    place = folder or Path("results") / slug(settings.command)
    check_place(place)
    result = _run(settings, live, compare)
    saved = _save(result, place)
    print_outcome(result, saved)


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
def print_scenario(name: Annotated[str, typer.Argument(help="Name or path.")] = "default") -> None:
    """Print a scenario with every key, its value and what it is for: copy and change it."""
    from robomirror_drake.yaml_file import to_yaml

    out.print(to_yaml(_scenario(name)), end="", markup=False, highlight=False, soft_wrap=True)


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

    settings = _scenario(scenario, command=file)
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


@app.command()
def survey(
    actions: Annotated[
        str, typer.Option(help="Comma-separated actions or clip:NAMEs; all of them by default.")
    ] = "",
    seeds: Annotated[
        int, typer.Option(help="Executions of each, with disturbance seeds 0, 1, …")
    ] = 1,
    candidates: Annotated[
        int, typer.Option(help="Of each action: its nominal motion, and others of a drawn style.")
    ] = 1,
    slowest: Annotated[
        float | None,
        typer.Option(help="Do all again, slowed down to this tempo at most where need be."),
    ] = None,
    json_file: JsonOption = None,
    html: Annotated[Path | None, typer.Option(help="Write a page with plots here.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 2,
    scenario: ScenarioOption = "default",
) -> None:
    """Execute every action and every clip on its feet, and say which ones the robot can do.

    Ctrl-C ends it with what is done.
    """
    from robomirror_drake.survey.page import print_survey, render_survey
    from robomirror_drake.survey.survey import survey_rows, survey_tasks

    check_file(json_file)
    check_file(html)
    wanted = tuple(name.strip() for name in actions.split(",") if name.strip())
    name = Path(scenario).stem
    tasks = survey_tasks(_scenario(scenario), wanted, seeds, name, slowest, candidates)
    rows = []
    interrupted = False
    with progress_bars() as progress:
        bar = progress.add_task("survey", total=len(tasks))
        try:
            for done in survey_rows(tasks, jobs):
                rows += done
                progress.advance(bar)
        except KeyboardInterrupt:
            interrupted = True
    order = {(t.action, t.slowest, t.candidate): number for number, t in enumerate(tasks)}
    rows.sort(key=lambda row: (order[row.action, row.slowest, row.candidate], row.seed))
    print_survey(rows, out)
    write_json(json_file, {"rows": [asdict(row) for row in rows]})
    if html is not None:
        write_text(html, render_survey(rows))
        console.print(f"wrote {html}", highlight=False)
    if interrupted:
        console.print(f"interrupted: {len(rows)} of {len(tasks) * seeds} executions are done")
        raise typer.Exit(130)


app.command()(train)
app.command()(evaluate)
app.command()(study)


@bench.command("retarget")
def bench_retarget(json_file: JsonOption = None) -> None:
    """The retargeter beside mink's per-frame IK, on every clip that keeps to the feet."""
    from robomirror_drake.bench import retarget

    _measure(retarget, json_file)


@bench.command("controller")
def bench_controller(json_file: JsonOption = None) -> None:
    """The controller's tick by QP solver: assembly and solve, median and 99th percentile."""
    from robomirror_drake.bench import controller

    _measure(controller, json_file)


@bench.command("plan")
def bench_plan(json_file: JsonOption = None) -> None:
    """The dynamic planner: whole motions from nothing, and windows of one second that go on."""
    from robomirror_drake.bench import plan

    _measure(plan, json_file)


@bench.command("adaptation")
def bench_adaptation(json_file: JsonOption = None) -> None:
    """An adaptation stage by stage, from words to a choice, and what the network takes of it."""
    from robomirror_drake.bench import adaptation

    _measure(adaptation, json_file)


@bench.command("pushes")
def bench_pushes(
    scenario: ScenarioOption = "default",
    seed: Annotated[int | None, typer.Option(help="Of all that is drawn.")] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="Processes.")] = 2,
    json_file: JsonOption = None,
) -> None:
    """How hard a walking robot can be pushed: two sizes, four directions, three instants."""
    from robomirror_drake.bench import pushes

    check_file(json_file)
    with progress_bars() as progress:
        task = progress.add_task("pushing", total=None)
        figures = pushes.run(
            _scenario(scenario, seed=seed),
            jobs=jobs,
            report=lambda done, total: progress.update(task, completed=done, total=total),
        )
    pushes.print_table(figures, out)
    write_json(json_file, figures)


def _measure(stage: Any, json_file: Path | None) -> None:
    """Runs a bench, prints its table and writes its figures."""
    check_file(json_file)
    figures = stage.run()
    stage.print_table(figures, out)
    write_json(json_file, figures)


def _scenario(name: str, **changes: Any) -> Scenario:
    """The scenario of that name with what the command line says instead."""
    from robomirror_drake.config import load_scenario
    from robomirror_drake.yaml_file import changed

    return changed(load_scenario(name), **changes)


def _run_scenario(given: str | None) -> str:
    """The scenario of ``run``: the one that adapts, if there are weights for it."""
    from robomirror_drake.config import load_scenario

    folder = resources.files("robomirror_drake.assets") / "ppn"
    used = load_scenario(ADAPTING).adaptation.predictor
    there = given or all((folder / f"{weights}.safetensors").is_file() for weights in used)
    return ADAPTING if there else "default"


def _adapting(
    scenario: Scenario, method: str | None, weights: str | None, closed_loop: bool | None = None
) -> Scenario:
    """The scenario with what the command line says of adaptation instead."""
    from robomirror_drake.yaml_file import changed

    given = {"method": method, "predictor": weights, "closed_loop": closed_loop}
    adaptation = changed(scenario.adaptation, **given)
    return scenario.model_copy(update={"adaptation": adaptation})


def _run(scenario: Scenario, live: bool, compare: bool) -> Result:
    from robomirror_drake.run import STAGES, run, stages, start_viewer

    viewer = start_viewer() if live else None
    if viewer is not None:
        out.print(f"watch it at {viewer.web_url()}")
    with progress_bars() as progress:
        tasks = {
            stage: progress.add_task(STAGES[stage], total=1.0, start=False)
            for stage in stages(scenario, compare)
        }
        order = list(tasks)

        def report(stage: Stage, share: float) -> None:
            for earlier in order[: order.index(stage)]:
                progress.update(tasks[earlier], completed=1.0)
                progress.stop_task(tasks[earlier])
            if not progress.tasks[tasks[stage]].started:
                progress.start_task(tasks[stage])
            progress.update(tasks[stage], completed=share)

        try:
            return run(scenario, report, viewer, compare)
        except RoboMirrorError:
            for task in tasks.values():  # the message alone says what happened
                progress.update(task, visible=False)
            raise


def _save(result: Result, folder: Path) -> Path:
    from robomirror_drake.playback.playback import render_playback
    from robomirror_drake.report.report import render_report
    from robomirror_drake.results import save_result
    from robomirror_drake.robot import load_robot

    robot = load_robot(result.robot)
    with console.status("writing the report and the playback"):
        pages = {
            "report.html": render_report(result, robot),
            "playback.html": render_playback(result, robot),
        }
        return save_result(folder, result, pages)


def _write_graphviz(scenario: Scenario, path: Path) -> None:
    from robomirror_drake.pipeline import build_pipeline
    from robomirror_drake.robot import load_robot

    diagram = build_pipeline(load_robot(scenario.robot), scenario).diagram
    write_text(path, diagram.GetGraphvizString(max_depth=1))
    out.print(f"{path} (dot -Tsvg draws it)")


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
