"""``robomirror study``: methods of adaptation side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robomirror_drake.commands.terminal import (
    AddressOption,
    HtmlOption,
    JsonOption,
    WorkersOption,
    check_file,
    console,
    out,
    progress_bars,
    write_json,
    write_page,
)

if TYPE_CHECKING:
    from rich.progress import TaskID


def study(
    scenario: Annotated[
        str,
        typer.Argument(
            help="A study's YAML, or the name of one in assets/scenarios: table2_quick, table2, "
            "pool_size, selection_against_optimisation, closed_loop, falls."
        ),
    ] = "table2_quick",
    limit: Annotated[
        int | None,
        typer.Option(min=1, help="Failing and succeeding commands, so many of each at most."),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", help="Folder of the study; goes on there. By default results/NAME."),
    ] = None,
    json_file: JsonOption = None,
    html: HtmlOption = None,
    workers: WorkersOption = None,
    address: AddressOption = None,
    screened: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a study of other weights or methods: what falls is known, and how the"
            " candidates end that it has simulated."
        ),
    ] = None,
    predictor: Annotated[
        str | None, typer.Option(help="Weights in place of the study's: a name, or a file.")
    ] = None,
) -> None:
    """Compare methods of adaptation on commands whose own motion falls, and on some that do not.

    Killed at any moment, the same command goes on; with a larger --limit it goes on as well.

    Example: robomirror study table2_quick --json table2.json --html table2.html
    """
    from robomirror_drake.dataset.printing import plain
    from robomirror_drake.study.options import StudyOptions, study_scenario
    from robomirror_drake.study.page import print_study, render_study
    from robomirror_drake.study.run import commands_of, run_study
    from robomirror_drake.study.summary import summarise
    from robomirror_drake.yaml_file import changed, load_yaml

    check_file(json_file)
    check_file(html)
    options = load_yaml(StudyOptions, "scenarios", scenario)
    settings = study_scenario(options)
    if predictor is not None:
        other = changed(settings.adaptation, predictor=predictor)
        settings = settings.model_copy(update={"adaptation": other})
    place = folder or Path("results") / Path(scenario).stem
    with progress_bars() as progress:
        tasks: dict[str, TaskID] = {}

        def report(words: str, done: int, total: int) -> None:
            if words not in tasks:
                tasks[words] = progress.add_task(words, total=total)
            said = f"{words}: {done} of {total}"
            progress.update(tasks[words], completed=done, total=total, description=said)

        found = run_study(
            options,
            settings,
            commands_of(options),
            place,
            workers=workers,
            address=address,
            limit=limit,
            report=report,
            screened_in=screened,
        )
    for fault in found.damaged:
        console.print(f"made anew: {fault}", style="yellow", markup=False, highlight=False)
    figures = plain(summarise(found))
    print_study(figures, out)
    out.print(f"{place}: every command and method, as Parquet", highlight=False, soft_wrap=True)
    write_json(json_file, figures)
    if html is not None:
        write_page(html, render_study(found, figures))
