"""``robomirror survey``: what the robot can do of all that the library knows."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from robomirror_drake.commands.terminal import (
    HtmlOption,
    JsonOption,
    ScenarioOption,
    check_file,
    console,
    out,
    progress_bars,
    scenario_of,
    write_json,
    write_page,
)


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
    html: HtmlOption = None,
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
    tasks = survey_tasks(scenario_of(scenario), wanted, seeds, name, slowest, candidates)
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
        write_page(html, render_survey(rows))
    if interrupted:
        console.print(f"interrupted: {len(rows)} of {len(tasks) * seeds} executions are done")
        raise typer.Exit(130)
