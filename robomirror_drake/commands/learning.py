"""``robomirror train`` and ``robomirror evaluate``: performance predictors from executions."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from robomirror_drake.commands.terminal import (
    HtmlOption,
    JsonOption,
    check_file,
    console,
    out,
    progress_bars,
    write_json,
    write_page,
)
from robomirror_drake.exceptions import ConfigError

if TYPE_CHECKING:
    from robomirror_drake.learning.train import Epoch
    from robomirror_drake.ppn.options import TrainOptions

_SHOWN = 20  # epochs, of those that are over


def train(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="YAML, or the name of one in assets/training."),
    ],
    data: Annotated[Path | None, typer.Option(help="Folder of a data set.")] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", help="For checkpoint, log and weights; goes on there.")
    ] = None,
    epochs: Annotated[int | None, typer.Option(help="At most.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of weights, batches and dropout.")] = None,
    device: Annotated[str | None, typer.Option(help="cpu or cuda.")] = None,
    threads: Annotated[int | None, typer.Option(help="Of the processor.")] = None,
    shares: Annotated[
        str, typer.Option(help="For a learning curve: shares of the commands, as 0.25,0.5,1.")
    ] = "",
) -> None:
    """Train a performance predictor on executions; if it was begun before, go on.

    Example: robomirror train ppn_1s --data results/data

    Several processes share the work when torchrun starts them:
    torchrun --nproc-per-node 2 -m robomirror_drake train ppn_1s
    """
    from robomirror_drake.ppn.options import TrainOptions
    from robomirror_drake.results import check_place
    from robomirror_drake.yaml_file import changed, load_yaml

    options = changed(
        load_yaml(TrainOptions, "training", scenario),
        data=data, out=folder, epochs=epochs, seed=seed, device=device, threads=threads,
    )  # fmt: skip
    check_place(options.out)
    from torch import distributed

    try:
        for part in _parts(options, shares):
            _train(part)
    finally:
        if distributed.is_initialized():
            distributed.destroy_process_group()


def _parts(options: TrainOptions, shares: str) -> list[TrainOptions]:
    """A training for each share, in folders beside the one of all commands.

    Epochs are as many more as there are fewer commands: all trainings take as many steps.

    Raises:
        ConfigError: A share is no number from 0 to 1.
    """
    from robomirror_drake.yaml_file import changed

    made = []
    for text in shares.split(",") if shares else []:
        try:
            share = float(text)
        except ValueError as error:
            raise ConfigError(f"--shares {shares}: {text!r} is not a number") from error
        place = options.out if share == 1.0 else Path(f"{options.out}_share_{share:g}")
        part = changed(options, share=share, out=place)
        epochs, patience = (math.ceil(n / share) for n in (options.epochs, options.patience))
        made.append(changed(part, epochs=epochs, patience=patience))
    return made or [options]


def _train(options: TrainOptions) -> None:
    """Trains, and shows how it goes; of several processes, the first one speaks."""
    from robomirror_drake.learning.train import LOG
    from robomirror_drake.learning.train import train as run

    if os.environ.get("RANK", "0") != "0":
        run(options)
        return
    epochs: list[Epoch] = []
    bars = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console,
    )  # fmt: skip
    reading = bars.add_task("episodes read", total=None)
    learning = bars.add_task("steps", total=None, visible=False)
    with Live(bars, console=console, refresh_per_second=4) as live:

        def report(epoch: Epoch) -> None:
            epochs.append(epoch)
            if console.is_terminal:
                live.update(Group(_table(epochs[-_SHOWN:]), bars))
            else:
                number, loss, validation, accuracy, seconds = _words(epoch)
                console.print(
                    f"epoch {number}: loss {loss}, validation {validation}, "
                    f"accuracy {accuracy} %, {seconds} s",
                    highlight=False,
                )

        def read(count: int) -> None:
            bars.update(reading, completed=count)

        def stepped(done: int, total: int) -> None:
            bars.update(reading, visible=False)
            bars.update(learning, visible=True, completed=done, total=total)

        try:
            path = run(options, report, read, stepped)
        except KeyboardInterrupt:
            console.print("interrupted; the same command goes on")
            raise
    print_weights(path)
    out.print(f"log: {options.out / LOG}", soft_wrap=True, highlight=False)


def train_torques(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="YAML, or the name of one in assets/training."),
    ] = "leg_torques",
    data: Annotated[Path | None, typer.Option(help="Folder of a data set.")] = None,
    folder: Annotated[Path | None, typer.Option("--out", help="For the weights.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of weights and batches.")] = None,
) -> None:
    """Train a small network on the largest torques of whole motions: a minute, mostly reading.

    It is asked about motions that were changed until the large networks took them for safe.

    Example: robomirror train-torques --data results/data
    """
    from robomirror_drake import checkpoint
    from robomirror_drake.learning.torques import train_torques as run
    from robomirror_drake.ppn.options import TrainTorquesOptions
    from robomirror_drake.results import check_place
    from robomirror_drake.yaml_file import changed, load_yaml

    options = changed(
        load_yaml(TrainTorquesOptions, "training", scenario), data=data, out=folder, seed=seed
    )
    check_place(options.out)
    with progress_bars() as progress:
        task = progress.add_task("motions are read", total=None)
        path = run(
            options,
            lambda done, total: progress.update(
                task, completed=done, total=total, description="epochs"
            ),
        )
    _, header = checkpoint.load(path, checkpoint.TORQUES)
    told = header["data"]
    out.print(f"weights: {path}", soft_wrap=True, highlight=False)
    out.print(
        f"learned from {told['motions_learned']} motions ({100 * told['falls_learned']:.1f} % with "
        f"a fall) of {told['commands_learned']} commands",
        highlight=False,
    )


def _table(epochs: list[Epoch]) -> Table:
    table = Table("epoch", "loss", "validation", "accuracy [%]", "time [s]")
    for epoch in epochs:
        number, loss, validation, accuracy, seconds = _words(epoch)
        style = "green" if epoch.best else None
        table.add_row(number, loss, validation, accuracy, seconds, style=style)
    return table


def _words(epoch: Epoch) -> tuple[str, str, str, str, str]:
    return (
        f"{epoch.epoch}/{epoch.epochs}",
        f"{epoch.loss:.4f}",
        f"{epoch.validation:.4f}{' best' if epoch.best else ''}",
        f"{100.0 * epoch.accuracy:.2f}",
        f"{epoch.seconds:.1f}",
    )


def print_weights(path: Path) -> None:
    """Says where weights are and what they were trained on."""
    from robomirror_drake import checkpoint

    _, header = checkpoint.load(path, checkpoint.PREDICTOR)
    data = header["data"]
    out.print(f"weights: {path}", soft_wrap=True, highlight=False)
    out.print(
        f"learned from {data['windows_learned']} windows ({100 * data['falls_learned']:.1f} % with "
        f"a fall) of {data['executions_learned']} executions of {data['commands_learned']} "
        f"commands; data set {data['fingerprint']} of {data['executions']} executions",
        highlight=False,
    )


def evaluate(
    more: Annotated[
        list[Path] | None, typer.Argument(metavar="[WEIGHTS]...", help="As --weights.")
    ] = None,
    data: Annotated[Path, typer.Option(help="Folder of a data set.")] = Path("results/data"),
    weights: Annotated[
        list[Path] | None,
        typer.Option(help="Files of weights, or folders that hold some; by default the packaged."),
    ] = None,
    baselines: Annotated[bool, typer.Option(help="Train and judge the baselines too.")] = True,
    spacing: Annotated[
        float, typer.Option(help="Between windows of an execution [s]; the trees take their time.")
    ] = 0.1,
    draws: Annotated[int, typer.Option(help="Of the bootstrap.")] = 2000,
    seed: Annotated[int, typer.Option(help="Of the bootstrap and the baselines.")] = 0,
    threads: Annotated[int, typer.Option(help="Of the processor.")] = 1,
    robot: Annotated[str, typer.Option(help="Robot of the data set.")] = "jvrc1",
    json_file: JsonOption = None,
    html: HtmlOption = None,
    card: Annotated[
        Path | None, typer.Option(help="Write a card for the weights here, in Markdown.")
    ] = None,
) -> None:
    """How good predictors are on commands they have not seen, beside two baselines.

    Example: robomirror evaluate --data results/data --weights results --html ppn.html
    """
    for file in (json_file, html, card):
        check_file(file)
    from robomirror_drake.dataset.printing import plain
    from robomirror_drake.learning.evaluate import EvaluateOptions
    from robomirror_drake.learning.evaluate import evaluate as run
    from robomirror_drake.learning.page import (
        print_evaluation,
        render_card,
        render_evaluation,
    )
    from robomirror_drake.yaml_file import validate

    given = {
        "data": data, "robot": robot, "baselines": baselines, "spacing": spacing,
        "draws": draws, "seed": seed, "threads": threads,
    }  # fmt: skip
    options = validate(EvaluateOptions, given, "command line")
    with progress_bars() as progress:
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int | None) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            words = stage if total else f"{stage} {done}"
            progress.update(tasks[stage], completed=done, total=total, description=words)

        figures, judged = run([*(weights or []), *(more or [])], options, report)
    print_evaluation(figures, out)
    write_json(json_file, plain(figures))
    if html is not None:
        write_page(html, render_evaluation(figures, judged))
    if card is not None:
        write_page(card, render_card(figures))
