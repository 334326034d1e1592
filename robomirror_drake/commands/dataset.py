"""``robomirror dataset``: commands executed at scale, and what came of it."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bars
from rich.table import Table

from robomirror_drake.commands.terminal import (
    AddressOption,
    JsonOption,
    WorkersOption,
    check_file,
    console,
    out,
    progress_bars,
    write_json,
)

if TYPE_CHECKING:
    from robomirror_drake.dataset.generate import Progress
    from robomirror_drake.dataset.options import DatasetOptions

app = typer.Typer(help="Executions at scale, as Parquet files.", no_args_is_help=True)

PromptsOption = Annotated[
    str, typer.Option(help="CSV or text with one command a line, or a corpus in assets/prompts.")
]
SettingsOption = Annotated[
    str,
    typer.Option(help="YAML with pushes, disturbances …, or the name of one in assets/datasets."),
]
SeedOption = Annotated[int | None, typer.Option(help="Of all that is drawn.")]
PerPromptOption = Annotated[int | None, typer.Option(help="Motions of each command.")]
ExecutionsOption = Annotated[
    int | None, typer.Option(help="Of each motion: nominal, pushed, disturbed start or dynamics, …")
]
ScenarioOption = Annotated[str, typer.Option(help="Scenario for all that is set elsewhere.")]


@app.command()
def prompts(
    file: Annotated[Path, typer.Option("--out", help="CSV to write.")],
    count: Annotated[int, typer.Option(min=1, help="How many commands.")] = 9000,
    seed: Annotated[int, typer.Option(help="Of all choices.")] = 0,
) -> None:
    """Write a corpus of commands from the library's actions; takes some minutes.

    Example: robomirror dataset prompts --out assets/prompts/corpus.csv
    """
    from robomirror_drake.dataset.corpus import make_corpus
    from robomirror_drake.dataset.prompts import write_prompts

    check_file(file)
    with progress_bars() as progress:
        task = progress.add_task("commands", total=count)
        corpus = make_corpus(count, seed, lambda done: progress.update(task, completed=done))
    write_prompts(file, corpus.prompts)
    refused = corpus.refused.total()
    out.print(
        f"{file}: {len(corpus.prompts)} commands; {refused} of {corpus.proposed} proposals were "
        "not understood as meant",
        highlight=False,
    )
    for name, tallies in (
        ("group", Counter(prompt.group for prompt in corpus.prompts)),
        ("split", Counter(prompt.split for prompt in corpus.prompts)),
        ("origin", Counter(prompt.origin for prompt in corpus.prompts)),
        ("refused", corpus.refused),
    ):
        said = ", ".join(f"{value} {number}" for value, number in tallies.most_common(12))
        out.print(f"{name}: {said}", highlight=False)
    for text in corpus.lost:
        out.print(f"left out: {text}", style="yellow", markup=False, highlight=False)


@app.command()
def generate(
    folder: Annotated[Path, typer.Option("--out", help="Folder of the data set; goes on there.")],
    prompts: PromptsOption = "corpus",
    per_prompt: PerPromptOption = None,
    executions: ExecutionsOption = None,
    seed: SeedOption = None,
    settings: SettingsOption = "default",
    limit: Annotated[int | None, typer.Option(min=1, help="The first so many commands.")] = None,
    workers: WorkersOption = None,
    address: AddressOption = None,
    scenario: ScenarioOption = "default",
) -> None:
    """Execute commands and write what happens; after a kill the same command goes on.

    Example: robomirror dataset generate --limit 20 --per-prompt 2 --out results/data
    """
    from robomirror_drake.config import load_scenario
    from robomirror_drake.dataset.generate import generate_dataset
    from robomirror_drake.dataset.printing import print_cost, progress_words, tally_words
    from robomirror_drake.dataset.prompts import read_prompts
    from robomirror_drake.dataset.summary import summarise

    options = _options(settings, seed=seed, per_prompt=per_prompt, executions=executions)
    commands, base = read_prompts(prompts), load_scenario(scenario)
    bars = Bars(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[said]}"),
        console=console,
    )
    with bars:
        task = bars.add_task("commands", total=None, said="starting")

        def report(progress: Progress) -> None:
            bars.update(
                task, total=progress.total, completed=progress.done, said=progress_words(progress)
            )

        done = generate_dataset(
            commands,
            options,
            base,
            folder,
            workers=workers,
            address=address,
            limit=limit,
            report=report,
        )
        report(done)
    for fault in done.damaged:
        console.print(f"made anew: {fault}", style="yellow", markup=False, highlight=False)
    summary = summarise(folder)
    out.print(f"{folder}: {tally_words(summary.total)}", highlight=False)
    print_cost(summary.cost, out)


@app.command()
def info(
    folder: Annotated[Path, typer.Argument(help="Folder of a data set.")],
    json_file: JsonOption = None,
) -> None:
    """Balance, falls by action and cause, failures, hours, and what the making took."""
    from robomirror_drake.dataset.printing import plain, print_summary
    from robomirror_drake.dataset.summary import summarise

    check_file(json_file)
    summary = summarise(folder)
    print_summary(summary, out)
    figures = asdict(summary)
    figures["cost"] |= {"rate": summary.cost.rate(), "paper_core_hours": summary.cost.paper_hours()}
    write_json(json_file, plain(figures))


@app.command()
def scaling(
    prompts: PromptsOption = "corpus",
    commands: Annotated[int, typer.Option(min=1, help="How many commands.")] = 4,
    per_prompt: PerPromptOption = 1,
    executions: ExecutionsOption = None,
    seed: SeedOption = None,
    settings: SettingsOption = "default",
    workers: Annotated[int, typer.Option(min=2, help="The larger number of workers.")] = 2,
    scenario: ScenarioOption = "default",
    json_file: JsonOption = None,
) -> None:
    """Measure what more workers bring: the same commands with one and with more of them."""
    from robomirror_drake.config import load_scenario
    from robomirror_drake.dataset.prompts import read_prompts
    from robomirror_drake.dataset.records import Job
    from robomirror_drake.dataset.scaling import measure_scaling

    check_file(json_file)
    options = _options(settings, seed=seed, per_prompt=per_prompt, executions=executions)
    base, chosen = load_scenario(scenario), read_prompts(prompts)[:commands]
    jobs = [Job(number, prompt, options, base) for number, prompt in enumerate(chosen)]
    with console.status("measuring"):
        measured = measure_scaling(jobs, (1, workers))
    table = Table("workers", "simulated s / s", "a core [CPU time]", "times one worker")
    first = measured[0].simulated_s / measured[0].wall_s
    for row in measured:
        rate = row.simulated_s / row.wall_s
        table.add_row(
            str(row.workers),
            f"{rate:.2f}",
            f"{row.simulated_s / row.cpu_s:.2f}",
            f"{rate / first:.2f}",
        )
    out.print(table)
    write_json(json_file, {"rows": [row._asdict() for row in measured]})


def _options(name: str, **changes: int | None) -> DatasetOptions:
    """The settings of that name with what the command line says instead."""
    from robomirror_drake.dataset.options import DatasetOptions
    from robomirror_drake.yaml_file import changed, load_yaml

    return changed(load_yaml(DatasetOptions, "datasets", name), **changes)
