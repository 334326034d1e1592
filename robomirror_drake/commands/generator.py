"""``robomirror generator``: corpus, training and figures of what makes motions from text."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from robomirror_drake.commands.terminal import (
    JsonOption,
    check_file,
    console,
    out,
    progress_bars,
    write_json,
    write_text,
)

app = typer.Typer(help="Text to motion: measure it, train it.", no_args_is_help=True)


@app.command()
def corpus(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="New folder for it.")],
    commands: Annotated[int, typer.Option(help="Different commands.")] = 1000,
    candidates: Annotated[int, typer.Option(help="Motions of each.")] = 4,
    seed: Annotated[int, typer.Option(help="Of all that is drawn.")] = 0,
    clips: Annotated[bool, typer.Option(help="The recorded clips as well.")] = True,
) -> None:
    """Write motions and captions in HumanML3D's layout, from the composer and the clips."""
    from robomirror_drake.motion.learned.corpus import CorpusOptions, write_corpus
    from robomirror_drake.results import check_place
    from robomirror_drake.yaml_file import validate

    given = {"commands": commands, "candidates": candidates, "seed": seed, "clips": clips}
    options = validate(CorpusOptions, given, "command line")
    check_place(folder)
    with progress_bars() as progress:
        task = progress.add_task("commands", total=options.commands)
        sizes = write_corpus(folder, options, lambda done, _: progress.update(task, completed=done))
    out.print(f"{folder}: " + ", ".join(f"{name} {size}" for name, size in sizes.items()))


@app.command()
def train(
    dataset: Annotated[
        str, typer.Argument(metavar="DATASET", help="YAML, or the name of one in assets/generator.")
    ],
) -> None:
    """Train on a data set in HumanML3D's layout; if it was begun before, go on.

    Example: robomirror generator train small
    """
    from robomirror_drake.motion.learned.options import TrainOptions
    from robomirror_drake.results import check_place
    from robomirror_drake.yaml_file import load_yaml

    options = load_yaml(TrainOptions, "generator", dataset)
    check_place(options.out)
    with progress_bars() as progress:
        started = progress.add_task("loading data and encoder", total=None)
        from robomirror_drake.motion.learned.train import train as run

        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int, loss: float) -> None:
            progress.update(started, visible=False)
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            label = f"{stage:<11} {done}/{total} loss {loss:.4f}"
            progress.update(tasks[stage], completed=done, description=label)

        folder = run(options, report)
    out.print(f"{folder / 'generator.safetensors'}", soft_wrap=True)


@app.command()
def evaluate(
    data: Annotated[Path, typer.Argument(help="Data set in HumanML3D's layout.")],
    weights: Annotated[
        str, typer.Option(help="generator.safetensors of a training, or packaged.")
    ] = "packaged",
    steps: Annotated[int, typer.Option(help="Evaluations of the network for a motion.")] = 2,
    guidance: Annotated[float, typer.Option(help="How strongly the text pulls.")] = 1.5,
    json_file: JsonOption = None,
) -> None:
    """R-precision, FID, diversity, foot skate and time on the test split of a data set."""
    check_file(json_file)
    from robomirror_drake.motion.learned.evaluate import (
        EvaluateOptions,
        evaluate,
        load_evaluator,
    )
    from robomirror_drake.motion.learned.generator import load_generator
    from robomirror_drake.motion.learned.options import SamplingOptions
    from robomirror_drake.yaml_file import validate

    given = {"weights": weights, "steps": steps, "guidance": guidance}
    sampling = validate(SamplingOptions, given, "command line")
    model, evaluator = load_generator(weights), load_evaluator(weights)
    with progress_bars() as progress:
        task = progress.add_task("motions", total=None)
        figures = evaluate(
            model,
            evaluator,
            data,
            sampling,
            EvaluateOptions(),
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    print_figures(figures)
    write_json(json_file, figures)


@app.command()
def measure(
    sentences: Annotated[
        str, typer.Option(help="YAML of [sentence, clauses]; packaged: 400 held apart.")
    ] = "packaged",
    texts: Annotated[int, typer.Option(help="How many of these get pools of motions.")] = 100,
    candidates: Annotated[int, typer.Option("-n", "--candidates", help="Motions in a pool.")] = 8,
    sources: Annotated[
        str, typer.Option(help="Comma-separated: composer, learned.")
    ] = "composer,learned",
    data: Annotated[
        Path | None,
        typer.Option(help="Data set whose test split the learned generator is measured on."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of all that is drawn.")] = 0,
    json_file: JsonOption = None,
    html: Annotated[
        Path | None, typer.Option(help="Write a page with the contact sheet here.")
    ] = None,
) -> None:
    """Text to motion, all in one: intent, diversity, R-precision, how human, how quick.

    Example: robomirror generator measure --html motions.html
    """
    check_file(json_file)
    check_file(html)
    from robomirror_drake.measure.measure import MeasureOptions
    from robomirror_drake.measure.measure import measure as run
    from robomirror_drake.measure.page import print_measures, render_measures
    from robomirror_drake.yaml_file import validate

    kinds = tuple(name.strip() for name in sources.split(",") if name.strip())
    given = {"sentences": sentences, "texts": texts, "candidates": candidates, "seed": seed}
    options = validate(MeasureOptions, given | {"sources": kinds}, "command line")
    with progress_bars() as progress:
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            progress.update(tasks[stage], completed=done, total=total)

        figures, sheets = run(options, data, report)
    print_measures(figures, out)
    write_json(json_file, figures)
    if html is not None:
        write_text(html, render_measures(figures, sheets))
        console.print(f"wrote {html}", highlight=False)


def print_figures(figures: dict[str, Any]) -> None:
    """The figures of an evaluation as a table."""
    table = Table("", "real", "generated", title=f"{figures['motions']} test motions, "
                  f"{figures['commands']} commands")  # fmt: skip
    for name, value in figures["generated"].items():
        real = figures["real"].get(name)
        table.add_row(name, _spread(real) if real else "", _spread(value))
    table.add_row("fid", "", f"{figures['fid']:.4f}")
    out.print(table)
    time = figures["time"]
    out.print(
        f"{time['candidates']:.0f} candidates in {1e3 * time['median_s']:.0f} ms, "
        f"of which one core worked {1e3 * time['core_s']:.0f} ms"
    )


def _spread(value: dict[str, float]) -> str:
    return f"{value['mean']:.4f} ± {value['ci95']:.4f}"
