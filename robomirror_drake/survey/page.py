"""A survey as a table at the prompt, and as a page with plots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape as escape_html

import numpy as np
import plotly.graph_objects as go
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robomirror_drake.report.figures import DONE, FAULT, TOLD, styled
from robomirror_drake.report.page import plot, render
from robomirror_drake.survey.styles import gentle, sampled, splits, unexplained
from robomirror_drake.survey.survey import Row

UPRIGHT, NOT_DONE = "upright", "not executed"

COLORS = {
    UPRIGHT: "#2da44e",
    "controller": FAULT,
    "contact_mismatch": "#bf5af2",
    "torque_saturated": "#e8760c",
    "friction_lost": "#1f9ede",
    "reference_infeasible": "#8a6d3b",
    NOT_DONE: TOLD,
}
"""How an execution ends, and its colour."""

_DECADES = [step * 10.0**decade for decade in range(-5, 2) for step in (1, 2, 5)]


@dataclass(frozen=True)
class Line:
    """All executions of an action's nominal motion, or of the others."""

    label: str
    group: str
    rows: tuple[Row, ...]

    @property
    def upright(self) -> int:
        """How many stayed upright."""
        return sum(row.fell is False for row in self.rows)

    @property
    def causes(self) -> str:
        """Why the others fell, most frequent first."""
        ends = [ending(row) for row in self.rows]
        found = sorted(set(ends) - {UPRIGHT}, key=lambda end: (-ends.count(end), end))
        return ", ".join(end.replace("_", " ") for end in found)

    @property
    def evidence(self) -> str:
        """What is said of the first that did not stay upright."""
        return next(
            (row.error or row.cause_evidence or "" for row in self.rows if row.fell is not False),
            "",
        )

    def median(self, value: Callable[[Row], float | None], factor: float = 1.0) -> float | None:
        """Median of a figure over the executions; None where nobody has it."""
        known = [x for row in self.rows if (x := value(row)) is not None]
        return factor * float(np.median(known)) if known else None


def ending(row: Row) -> str:
    """``upright``, the cause of the fall, or ``not executed``."""
    if row.fell is None:
        return NOT_DONE
    return (row.cause or "controller") if row.fell else UPRIGHT


def lines(rows: Sequence[Row]) -> list[Line]:
    """One line for each action and tempo, in the order of the rows."""
    keys = dict.fromkeys((row.action, bool(row.candidate), row.slowest) for row in rows)
    made = []
    for action, drawn, slowest in keys:
        wanted = (action, drawn, slowest)
        own = tuple(row for row in rows if (row.action, bool(row.candidate), row.slowest) == wanted)
        made.append(Line(f"{action}{_kind(own[0])}", own[0].group, own))
    return made


def _kind(row: Row) -> str:
    """What tells an execution from that of the nominal motion, as it stands behind a name."""
    return f"{', sampled' if row.candidate else ''}{', slowed' if row.slowest is not None else ''}"


def print_survey(rows: Sequence[Row], console: Console) -> None:
    """Prints a line for each action and tempo, and how many of each group stayed upright."""
    words = ("action", "group", "upright", "fell [s]", "cause", "tempo")
    errors = ("joints [rad]", "from raw", "root [cm]", "from raw", "saturated [%]")
    table = Table(
        *map(escape, words + errors), title="errors: mean, to the plan and to its raw reference"
    )
    for line in lines(rows):
        color = (
            "green" if line.upright == len(line.rows) else "red" if not line.upright else "yellow"
        )
        table.add_row(
            line.label,
            line.group,
            f"[{color}]{line.upright}/{len(line.rows)}",
            _number(line.median(lambda row: row.fall_time_s)),
            escape(line.causes),
            _number(line.median(lambda row: row.time_scale)),
            _number(line.median(lambda row: row.A_q)),
            _number(line.median(lambda row: row.raw_A_q)),
            _number(line.median(lambda row: row.A_p, 100.0)),
            _number(line.median(lambda row: row.raw_A_p, 100.0)),
            _number(line.median(lambda row: row.torque_saturation, 100.0)),
        )
    console.print(table)
    for line in lines(rows):
        if line.evidence:
            console.print(
                f"{line.label}: {line.evidence}", markup=False, highlight=False, emoji=False
            )
    for name, upright, total in _groups(rows):
        console.print(f"{name}: {upright} of {total} upright")
    if sampled(rows):
        _print_styles(rows, console)


def _print_styles(rows: Sequence[Row], console: Console) -> None:
    """How sampled candidates ended, by what was drawn for them."""
    table = Table(
        "style", "upright, up to nominal", "upright, above nominal", "p by chance",
        title="sampled candidates",
    )  # fmt: skip
    for split in splits(rows):
        sides = [f"{upright} of {total}" for upright, total in (split.below, split.above)]
        table.add_row(split.parameter.replace("_", " "), *sides, f"{split.p:.2g}")
    console.print(table)
    drawn = [row for row in sampled(rows) if gentle(row)]
    console.print(
        f"no faster, larger or longer than the nominal motion: "
        f"{sum(row.fell is False for row in drawn)} of {len(drawn)} upright"
    )
    for row in unexplained(rows):
        console.print(
            f"falls all the same, and its nominal motion does not: {row.action}, {_run(row)}",
            highlight=False,
        )


def _groups(rows: Sequence[Row]) -> list[tuple[str, int, int]]:
    """Name, executions upright, executions, of each group and tempo."""
    names = [_group(row) for row in rows]
    return [
        (
            name,
            sum(row.fell is False for row, own in zip(rows, names, strict=True) if own == name),
            names.count(name),
        )
        for name in dict.fromkeys(names)
    ]


def _group(row: Row) -> str:
    return f"{row.group}{_kind(row)}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def render_survey(rows: Sequence[Row]) -> str:
    """A page with plots and all rows, with plotly.js and all data inside."""
    return render(
        "survey.html",
        rows=rows,
        lines=lines(rows),
        groups=_groups(rows),
        scenario=rows[0].scenario if rows else "",
        seeds=sorted({row.seed for row in rows}),
        endings=plot(_endings(rows), "endings"),
        grid=plot(_grid(rows), "grid"),
        errors=plot(_errors(rows), "errors"),
        colors=COLORS,
        ending=ending,
        splits=splits(rows) if sampled(rows) else [],
        gentle=[row for row in sampled(rows) if gentle(row)],
        unexplained=[f"{row.action}, {_run(row)}" for row in unexplained(rows)],
    )


def _endings(rows: Sequence[Row]) -> go.Figure:
    """How the executions of each group ended, as shares."""
    figure = go.Figure()
    groups = _groups(rows)
    names = [name for name, _, _ in groups]
    for end, color in COLORS.items():
        count = [sum(ending(row) == end and _group(row) == name for row in rows) for name in names]
        if not any(count):
            continue
        figure.add_bar(
            y=names,
            x=[100.0 * n / total for n, (_, _, total) in zip(count, groups, strict=True)],
            name=end.replace("_", " "),
            text=[str(n) if n else "" for n in count],
            textposition="inside",
            insidetextanchor="middle",
            orientation="h",
            width=min(0.65, 0.2 * len(names)),
            marker={"color": color},
            hovertemplate="%{y}: %{text}<extra>" + end.replace("_", " ") + "</extra>",
        )
    figure.update_layout(barmode="stack")
    figure.update_xaxes(title="share of executions [%]", range=[0, 100])
    figure.update_yaxes(autorange="reversed")
    height = max(400, 110 + 46 * len(names))
    return styled(figure, height=height, top=50).update_layout(margin={"l": 130})


def _grid(rows: Sequence[Row]) -> go.Figure:
    """How each execution ended: a column an action, a line a seed and tempo."""
    figure = go.Figure()
    actions = list(dict.fromkeys(row.action for row in rows))
    runs = list(dict.fromkeys(_run(row) for row in rows))
    for end, color in COLORS.items():
        own = [row for row in rows if ending(row) == end]
        if not own:
            continue
        figure.add_scatter(
            x=[row.action for row in own],
            y=[_run(row) for row in own],
            name=end.replace("_", " "),
            mode="markers",
            marker={"color": color, "symbol": "square", "size": 9 if len(actions) > 50 else 13},
            customdata=[escape_html(row.error or row.cause_evidence or "") for row in own],
            hovertemplate="%{x}, %{y}<br>%{customdata}<extra>%{fullData.name}</extra>",
        )
    figure.update_xaxes(
        categoryarray=actions,
        categoryorder="array",
        tickangle=-90,
        dtick=1,
        tickfont={"size": 10},
        automargin=True,
        range=[-0.7, len(actions) - 0.3],
    )
    figure.update_yaxes(categoryarray=runs, categoryorder="array", autorange="reversed", dtick=1)
    figure = styled(figure, height=210 + 26 * len(runs), top=50)
    return figure.update_layout(margin={"l": 110})


def _run(row: Row) -> str:
    candidate = f", candidate {row.candidate}" if row.candidate else ""
    return f"seed {row.seed}{candidate}{', slowed' if row.slowest is not None else ''}"


def _errors(rows: Sequence[Row]) -> go.Figure:
    """Joint error against the plan and against the reference before planning."""
    figure = go.Figure()
    groups = list(dict.fromkeys(row.group for row in rows))
    series = (
        ("to the plan", DONE, [row.A_q for row in rows]),
        ("to the raw reference", TOLD, [row.raw_A_q for row in rows]),
    )
    for name, color, values in series:
        figure.add_box(
            x=[row.group for row in rows],
            y=values,
            text=[row.action for row in rows],
            name=name,
            boxpoints="all",
            jitter=0.5,
            pointpos=0.0,
            marker={"color": color, "size": 5},
            line={"width": 1.2},
            fillcolor="rgba(0,0,0,0)",
            hovertemplate="%{text}: %{y:.4f} rad<extra></extra>",
        )
    figure.update_layout(boxmode="group")
    figure.update_xaxes(categoryarray=groups, categoryorder="array")
    figure.update_yaxes(title="mean joint error [rad]", type="log", tickvals=_DECADES)
    return styled(figure, height=400, top=50)
