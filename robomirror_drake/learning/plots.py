"""The plots of an evaluation of predictors, as plotly figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from robomirror_drake.learning import metrics
from robomirror_drake.learning.baselines import LOGISTIC, TREES
from robomirror_drake.learning.evaluate import Judgement
from robomirror_drake.learning.judge import UNITS
from robomirror_drake.report.figures import DONE, FAULT, TOLD, styled

_COLORS = (DONE, "#2da44e", "#bf5af2", "#e8760c", "#0f8a7e", "#8a6d3b")
_OF_BASELINES = {LOGISTIC: TOLD, TREES: FAULT}
_POINTS = 1500  # of a cloud
_STEPS = 400  # of a curve


def _color(judged: Sequence[Judgement], number: int) -> str:
    name = judged[number].row["model"]
    return _OF_BASELINES.get(name, _COLORS[number % len(_COLORS)])


def accuracies(judged: Sequence[Judgement]) -> go.Figure:
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


def roc(judged: Sequence[Judgement]) -> go.Figure:
    """Falls told against false alarms; dots where the threshold is."""
    figure = go.Figure()
    for number, judgement in enumerate(judged):
        row, color = judgement.row, _color(judged, number)
        false, hit = metrics.roc(judgement.told.logit, judgement.truth.fall)
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


def reliability(judged: Sequence[Judgement]) -> go.Figure:
    """How often what was said to be so probable came to pass."""
    figure = go.Figure()
    figure.add_scatter(
        x=[0, 1], y=[0, 1], mode="lines", line={"color": TOLD, "dash": "dot"}, showlegend=False
    )
    for number, judgement in enumerate(judged):
        found = metrics.reliability(judgement.told.probability, judgement.truth.fall)
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


def errors(judgement: Judgement) -> go.Figure:
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


def learning_curve(rows: Sequence[dict[str, Any]]) -> go.Figure | None:
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
