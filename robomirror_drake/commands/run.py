"""``robomirror run``: one command through everything, to a result with its pages."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robomirror_drake.commands.terminal import (
    check_file,
    console,
    out,
    print_outcome,
    progress_bars,
    scenario_of,
    slug,
    write_text,
)
from robomirror_drake.exceptions import RoboMirrorError

if TYPE_CHECKING:
    from robomirror_drake.config import Scenario
    from robomirror_drake.results import Result
    from robomirror_drake.run import Stage

Method = Literal["none", "selection", "optimisation", "selection_optimisation"]

ADAPTING = "worn"
"""Scenario in which commands are adapted."""


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

    name = scenario or default_scenario(weights)
    settings = scenario_of(name, command=command, seed=seed, candidates=candidates)
    settings = adapting(settings, method, weights, closed_loop)
    if graphviz is not None:
        check_file(graphviz)
        _write_graphviz(settings, graphviz)
        return
    place = folder or Path("results") / slug(settings.command)
    check_place(place)
    result = _run(settings, live, compare)
    saved = _save(result, place)
    print_outcome(result, saved)


def default_scenario(given: str | None) -> str:
    """The scenario of ``run``: the one that adapts, if there are weights for it."""
    from robomirror_drake.config import load_scenario

    folder = resources.files("robomirror_drake.assets") / "ppn"
    used = load_scenario(ADAPTING).adaptation.predictor
    there = given or all((folder / f"{weights}.safetensors").is_file() for weights in used)
    return ADAPTING if there else "default"


def adapting(
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
