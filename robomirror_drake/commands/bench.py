"""``robomirror bench``: stages measured, beside a peer where there is one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from robomirror_drake.commands.terminal import (
    JsonOption,
    ScenarioOption,
    check_file,
    out,
    progress_bars,
    scenario_of,
    write_json,
)

app = typer.Typer(help="Measure a stage; beside a peer where there is one.", no_args_is_help=True)


@app.command("retarget")
def bench_retarget(json_file: JsonOption = None) -> None:
    """The retargeter beside mink's per-frame IK, on every clip that keeps to the feet."""
    from robomirror_drake.bench import retarget

    _measure(retarget, json_file)


@app.command("controller")
def bench_controller(json_file: JsonOption = None) -> None:
    """The controller's tick by QP solver: assembly and solve, median and 99th percentile."""
    from robomirror_drake.bench import controller

    _measure(controller, json_file)


@app.command("plan")
def bench_plan(json_file: JsonOption = None) -> None:
    """The dynamic planner: whole motions from nothing, and windows of one second that go on."""
    from robomirror_drake.bench import plan

    _measure(plan, json_file)


@app.command("adaptation")
def bench_adaptation(json_file: JsonOption = None) -> None:
    """An adaptation stage by stage, from words to a choice, and what the network takes of it."""
    from robomirror_drake.bench import adaptation

    _measure(adaptation, json_file)


@app.command("pushes")
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
            scenario_of(scenario, seed=seed),
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
