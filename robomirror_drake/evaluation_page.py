"""How good predictors are, as a table at the prompt, a page with plots, and a card."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robomirror_drake.figures import DONE, FAULT, TOLD, styled
from robomirror_drake.learning.baselines import LOGISTIC, TREES
from robomirror_drake.learning.evaluate import Judgement
from robomirror_drake.learning.judge import EARLY, UNITS
from robomirror_drake.learning.metrics import BINS, Reliability, reliability, roc
from robomirror_drake.page import plot, render

_COLORS = (DONE, "#2da44e", "#bf5af2", "#e8760c", "#0f8a7e", "#8a6d3b")
_OF_BASELINES = {LOGISTIC: TOLD, TREES: FAULT}
_POINTS = 1500  # of a cloud
_STEPS = 400  # of a curve


def print_evaluation(figures: dict[str, Any], console: Console) -> None:
    """Prints the paper's Table 1, then what a balanced test set hides."""
    rows = figures["rows"]
    errors = [f"{name} [{squared(unit)}]" for name, unit in UNITS.items()]
    table = Table(
        *map(escape, ("model", "horizon", "fall accuracy [%]", *errors)),
        title="unseen commands, as many falls as not: accuracy, mean squared errors",
    )
    for row in rows:
        squares = [f"{row['errors'][name]['mse_balanced']:.3g}" for name in UNITS]
        table.add_row(row["model"], f"{row['horizon_s']:g} s", accuracy(row), *squares)
    console.print(table)
    words = ("false alarms [%]", "AUROC", f"≥ {EARLY:g} s before [%]", "lead [s]", "missed [%]")
    table = Table(
        *map(escape, ("model", "horizon", *words, "ECE", "held-out families [%]", *UNITS)),
        title="windows as they come; A: R² of each error",
    )
    for row in rows:
        table.add_row(
            row["model"],
            f"{row['horizon_s']:g} s",
            percent(row["false_positive_rate"]),
            f"{row['auroc']:.4f}",
            percent(row["fall_accuracy_early"]),
            f"{row['lead_time']['median_s']:.2f}",
            percent(row["lead_time"]["missed"], 1),
            f"{row['calibration_error']:.4f}",
            accuracy(row["held_out"]) if row["held_out"] else "",
            *(f"{row['errors'][name]['r2']:.2f}" for name in UNITS),
        )
    console.print(table)
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


def accuracy(figures: dict[str, Any]) -> str:
    """Accuracy and its interval [%]."""
    low, high = (100.0 * x for x in figures["fall_accuracy_interval"])
    return f"{100.0 * figures['fall_accuracy']:.2f} ({low:.2f} to {high:.2f})"


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
    return render(
        "ppn_card.md",
        figures=figures,
        units=UNITS,
        squared=squared,
        accuracy=accuracy,
        percent=percent,
        early=EARLY,
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
                "accuracies": plot(_accuracies(own), f"accuracies_{name}"),
                "roc": plot(_roc(own), f"roc_{name}"),
                "reliability": plot(_reliability(own), f"reliability_{name}"),
                "errors": plot(_errors(own[0]), f"errors_{name}"),
                "model": own[0].row["model"],
            }
        )
    curve = _learning_curve(figures["rows"])
    return render(
        "evaluation.html",
        figures=figures,
        sections=sections,
        units=UNITS,
        early=EARLY,
        bins=BINS,
        accuracy=accuracy,
        percent=percent,
        squared=squared,
        trained=trained,
        curve=None if curve is None else plot(curve, "learning_curve"),
    )


def _color(judged: Sequence[Judgement], number: int) -> str:
    name = judged[number].row["model"]
    return _OF_BASELINES.get(name, _COLORS[number % len(_COLORS)])


def _accuracies(judged: Sequence[Judgement]) -> go.Figure:
    """Fall accuracy of each model, with its interval."""
    figure = go.Figure()
    for number, judgement in enumerate(judged):
        row = judgement.row
        middle = 100.0 * row["fall_accuracy"]
        low, high = (100.0 * x for x in row["fall_accuracy_interval"])
        figure.add_scatter(
            x=[middle],
            y=[row["model"]],
            error_x={"array": [high - middle], "arrayminus": [middle - low], "thickness": 1.6},
            mode="markers",
            marker={"color": _color(judged, number), "size": 10},
            hovertemplate="%{y}: %{x:.2f} %<extra></extra>",
        )
    figure.update_xaxes(title="fall accuracy, as many falls as not [%]")
    figure.update_yaxes(autorange="reversed", automargin=True)
    return styled(figure, height=110 + 34 * len(judged), legend=False)


def _roc(judged: Sequence[Judgement]) -> go.Figure:
    """Falls told against false alarms; dots where the threshold is."""
    figure = go.Figure()
    for number, judgement in enumerate(judged):
        row, color = judgement.row, _color(judged, number)
        false, hit = roc(judgement.told.logit, judgement.truth.fall)
        some = np.unique(np.linspace(0, len(false) - 1, min(_STEPS, len(false))).astype(np.int64))
        some = some[false[some] > 0.0]  # the axis is logarithmic
        figure.add_scatter(
            x=false[some],
            y=hit[some],
            name=row["model"],
            legendgroup=row["model"],
            mode="lines",
            line={"color": color, "width": 1.8},
        )
        figure.add_scatter(
            x=[row["false_positive_rate"]],
            y=[row["true_positive_rate"]],
            name=row["model"],
            legendgroup=row["model"],
            showlegend=False,
            mode="markers",
            marker={"color": color, "size": 8},
        )
    figure.update_xaxes(title="false alarms", type="log", tickvals=[0.0001, 0.001, 0.01, 0.1, 1])
    figure.update_yaxes(title="falls told", range=[0.0, 1.02])
    return styled(figure, height=440, top=36 + 11 * len(judged))


def _reliability(judged: Sequence[Judgement]) -> go.Figure:
    """How often what was said to be so probable came to pass."""
    figure = go.Figure()
    figure.add_scatter(
        x=[0, 1], y=[0, 1], mode="lines", line={"color": TOLD, "dash": "dot"}, showlegend=False
    )
    for number, judgement in enumerate(judged):
        found: Reliability = reliability(judgement.told.probability, judgement.truth.fall)
        figure.add_scatter(
            x=found.said,
            y=found.happened,
            customdata=found.windows,
            name=judgement.row["model"],
            mode="lines+markers",
            line={"color": _color(judged, number), "width": 1.6},
            hovertemplate="said %{x:.2f}, happened %{y:.2f}, %{customdata} windows"
            "<extra>%{fullData.name}</extra>",
        )
    figure.update_xaxes(title="probability of a fall, as predicted", range=[-0.02, 1.02])
    figure.update_yaxes(title="share of falls", range=[-0.02, 1.02])
    return styled(figure, height=440, top=36 + 11 * len(judged))


def _errors(judgement: Judgement) -> go.Figure:
    """Predicted against true errors, of some of the windows."""
    truth, told = judgement.truth, judgement.told
    some = np.random.default_rng(0).permutation(len(truth.fall))[:_POINTS]
    titles = [f"{name} [{unit}]" for name, unit in UNITS.items()]
    figure = make_subplots(cols=len(UNITS), subplot_titles=titles, horizontal_spacing=0.045)
    for column in range(len(UNITS)):
        true, said = (np.exp(x[some, column]) for x in (truth.errors, told.errors))
        ends = [min(true.min(), said.min()), max(true.max(), said.max())]
        figure.add_scatter(
            x=ends, y=ends, mode="lines", line={"color": TOLD, "dash": "dot"}, showlegend=False,
            row=1, col=column + 1,
        )  # fmt: skip
        for name, which, color in (
            ("upright", ~truth.fall[some], DONE),
            ("fall", truth.fall[some], FAULT),
        ):
            figure.add_scattergl(
                x=true[which].astype(np.float32),
                y=said[which].astype(np.float32),
                name=name,
                legendgroup=name,
                showlegend=column == 0,
                mode="markers",
                marker={"color": color, "size": 3, "opacity": 0.5},
                row=1,
                col=column + 1,
            )
    figure.update_xaxes(type="log", title="true", nticks=4)
    figure.update_yaxes(type="log", nticks=5)
    figure.update_yaxes(title="predicted", col=1)
    figure.update_annotations(font={"size": 13})
    return styled(figure, height=330, top=70)


def _learning_curve(rows: Sequence[dict[str, Any]]) -> go.Figure | None:
    """Accuracy over executions learned from, of full models; None where there is no curve."""
    figure, drawn = go.Figure(), False
    networks = [row for row in rows if "trained_on" in row and "without" not in row["model"]]
    for number, horizon in enumerate(sorted({row["horizon_s"] for row in networks})):
        own = [row for row in networks if row["horizon_s"] == horizon]
        own.sort(key=lambda row: row["trained_on"]["executions_learned"])
        if len({row["share"] for row in own}) < 2:
            continue
        drawn = True
        middle = np.array([row["fall_accuracy"] for row in own])
        low, high = np.array([row["fall_accuracy_interval"] for row in own]).T
        figure.add_scatter(
            x=[row["trained_on"]["executions_learned"] for row in own],
            y=100 * middle,
            error_y={"array": 100 * (high - middle), "arrayminus": 100 * (middle - low)},
            name=f"{horizon:g} s",
            mode="lines+markers",
            line={"color": _COLORS[number % len(_COLORS)]},
        )
    figure.update_xaxes(title="executions learned from", type="log", exponentformat="none")
    figure.update_yaxes(title="fall accuracy [%]")
    return styled(figure, height=380) if drawn else None
