"""How good predictors are, as a table at the prompt, a page with plots, and a card."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robomirror_drake.learning import plots
from robomirror_drake.learning.evaluate import Judgement
from robomirror_drake.learning.judge import EARLY, UNITS
from robomirror_drake.learning.metrics import BINS
from robomirror_drake.report.page import plot, render


def print_evaluation(figures: dict[str, Any], console: Console) -> None:
    """Prints the paper's Table 1, then what a balanced test set hides."""
    rows = figures["rows"]
    squares = [f"{name} [{squared(unit)}]" for name, unit in UNITS.items()]
    _print(
        console,
        "unseen commands, as many falls as not: accuracy, mean squared errors",
        ("fall accuracy [%]", *squares),
        rows,
        lambda row: [
            accuracy(row),
            *(f"{row['errors'][name]['mse_balanced']:.3g}" for name in UNITS),
        ],
    )
    _print(
        console,
        f"windows as they come; early: at least {EARLY:g} s before a fall",
        ("false alarms [%]", "AUROC", "early [%]", "lead [s]", "missed [%]", "ECE",
         "held-out families [%]"),
        rows,
        lambda row: [
            percent(row["false_positive_rate"]),
            f"{row['auroc']:.4f}",
            percent(row["fall_accuracy_early"]),
            f"{row['lead_time']['median_s']:.2f}",
            percent(row["lead_time"]["missed"], 1),
            f"{row['calibration_error']:.4f}",
            accuracy(row["held_out"]) if row["held_out"] else "",
        ],
    )  # fmt: skip
    _print(
        console,
        "share of the variance of each error that is explained, R²",
        tuple(UNITS),
        rows,
        lambda row: [f"{row['errors'][name]['r2']:.3f}" for name in UNITS],
    )
    for split, name in (("test", "unseen commands"), ("held_out", "held-out families")):
        told = [row for row in figures["whole_motions"] if row["motions"][split]]
        if told:
            _print(
                console,
                f"whole motions before they begin, {name}; told: more than 1 - T_safe",
                tuple(MOTION_FIGURES),
                told,
                lambda row: [write(row["motions"][split]) for write in MOTION_FIGURES.values()],  # noqa: B023
            )
    for row in rows:
        if "trained_on" in row:
            console.print(
                f"{row['model']}, {row['horizon_s']:g} s: {row['weights']}, {trained(row)}",
                markup=False, highlight=False, soft_wrap=True,
            )  # fmt: skip
    for row in rows:
        if not row.get("same_data", True):
            console.print(
                f"{row['model']}, {row['horizon_s']:g} s: learned from other data than these; "
                "whether it knows these commands cannot be told",
                style="yellow", highlight=False,
            )  # fmt: skip


MOTION_FIGURES: Mapping[str, Callable[[dict[str, Any]], str]] = {
    "motions": lambda told: f"{told['motions']}",
    "with a fall": lambda told: f"{told['falls']}",
    "AUROC": lambda told: "{:.3f} ({:.3f}–{:.3f})".format(told["auroc"], *told["auroc_interval"]),
    "falls told [%]": lambda told: percent(told["true_positive_rate"], 1),
    "false alarms [%]": lambda told: percent(told["false_positive_rate"], 1),
    "commands that can be chosen for": lambda told: f"{told['commands_mixed']}",
    "chosen stands [%]": lambda told: percent(told["chosen_upright"], 1),
    "drawn stands [%]": lambda told: percent(told["drawn_upright"], 1),
}
"""What is said of motions that have yet to begin, and how."""


def _print(
    console: Console,
    title: str,
    columns: Sequence[str],
    rows: Sequence[dict[str, Any]],
    values: Callable[[dict[str, Any]], list[str]],
) -> None:
    """Prints a table with a line for each model and horizon."""
    table = Table("model", "horizon", *map(escape, columns), title=title)
    table.columns[0].no_wrap = True
    for row in rows:
        horizon = "" if row["horizon_s"] is None else f"{row['horizon_s']:g} s"
        table.add_row(row["model"], horizon, *values(row))
    console.print(table)


def accuracy(figures: dict[str, Any]) -> str:
    """Accuracy and its interval [%]."""
    low, high = (100.0 * x for x in figures["fall_accuracy_interval"])
    return f"{100.0 * figures['fall_accuracy']:.2f} ({low:.2f}–{high:.2f})"


def percent(share: float, digits: int = 2) -> str:
    """A share of 1 [%]; nothing where there is none."""
    return "" if np.isnan(share) else f"{100.0 * share:.{digits}f}"


def squared(unit: str) -> str:
    """A unit's square."""
    return f"({unit})²" if "/" in unit else f"{unit}²"


def trained(row: dict[str, Any]) -> str:
    """What weights learned from."""
    data = row["trained_on"]
    return (
        f"learned from {data['windows_learned']} windows of {data['executions_learned']} "
        f"executions of {data['commands_learned']} commands, data set {data['fingerprint']}, "
        f"seed {row['seed']}"
    )


def render_card(figures: dict[str, Any]) -> str:
    """A card for weights, in Markdown; every number in it is from the figures."""
    return _render(
        "ppn_card.md",
        figures,
        networks=[row for row in figures["rows"] if "trained_on" in row],
    )


def render_evaluation(figures: dict[str, Any], judged: Sequence[Judgement]) -> str:
    """The page: tables, and for each horizon ROC, reliability and errors."""
    sections = []
    for horizon in sorted({judgement.row["horizon_s"] for judgement in judged}):
        own = [judgement for judgement in judged if judgement.row["horizon_s"] == horizon]
        name = f"{horizon:g}".replace(".", "_")
        sections.append(
            {
                "horizon": f"{horizon:g}",
                "accuracies": plot(plots.accuracies(own), f"accuracies_{name}"),
                "roc": plot(plots.roc(own), f"roc_{name}"),
                "reliability": plot(plots.reliability(own), f"reliability_{name}"),
                "errors": plot(plots.errors(own[0]), f"errors_{name}"),
                "model": own[0].row["model"],
            }
        )
    curve = plots.learning_curve(figures["rows"])
    return _render(
        "evaluation.html",
        figures,
        sections=sections,
        bins=BINS,
        trained=trained,
        curve=None if curve is None else plot(curve, "learning_curve"),
    )


def _render(template: str, figures: dict[str, Any], **values: Any) -> str:
    """A template with the figures, what they are in, and how they are written."""
    return render(
        template,
        figures=figures,
        units=UNITS,
        early=EARLY,
        accuracy=accuracy,
        percent=percent,
        squared=squared,
        motion_figures=MOTION_FIGURES,
        **values,
    )
