"""A study as a table at the prompt, and as a page with plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import plotly.graph_objects as go
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robomirror_drake.report.figures import DONE, FAULT, TOLD, styled
from robomirror_drake.report.page import plot, render
from robomirror_drake.study.options import FORESEEING
from robomirror_drake.study.records import CAUSES, variant_of
from robomirror_drake.study.run import Study

Figures = Mapping[str, Any]

_METHODS: Final = {
    "none": "none",
    "random": "random candidate",
    "selection": "selection",
    "optimisation": "optimisation",
    "selection_optimisation": "selection, then optimisation",
    "closed_loop": "the same, then closed loop",
    "closed_loop_alone": "closed loop alone",
    "oracle": "oracle",
}
_COLORS: Final = {
    "none": TOLD,
    "random": "#8a6d3b",
    "selection": "#1f9ede",
    "optimisation": "#e8760c",
    "selection_optimisation": "#2da44e",
    "closed_loop": "#0f8a7e",
    "closed_loop_alone": DONE,
    "oracle": "#bf5af2",
}
_OF_CAUSES: Final = dict(
    zip(
        CAUSES,
        (TOLD, "#bf5af2", "#1f9ede", "#e8760c", "#e3b341", "#0f8a7e", "#54aeff", FAULT, "#1f2328"),
        strict=True,
    )
)
_SETTINGS: Final = {
    "level": "",
    "t_safe": "T_safe",
    "pool": "pool",
    "variables": "",
    "qp_solver": "",
}
"""What a variant depends on, in their order, and what is said before a value."""

_AXES: Final = {"pool": "candidates in the pool", "t_safe": "threshold T_safe"}
"""Settings that saved commands are drawn over, where a study has several values of them."""


def print_study(figures: Figures, console: Console) -> None:
    """Prints a line for each variant, and why commands were not saved."""
    commands = figures["commands"]
    console.print(_told(commands), highlight=False)
    words = (
        "saved [%]",
        "task done [%]",
        "deviation [cm]",
        "time [s]",
        "changed [%]",
        "broken [%]",
    )
    table = Table(
        *map(escape, ("method", *words)),
        "not saved because",
        title="commands whose own motion falls; changed and broken: of those whose own does not",
    )
    names = labels(figures["methods"])
    for name, one in zip(names, figures["methods"], strict=True):
        fine = one["succeeding"] or {}
        table.add_row(
            name,
            share(one, "saved"),
            share(one, "task_done"),
            number(one["deviation"], 100.0, 1),
            number(one["time_s"], 1.0, 2),
            share(fine, "changed"),
            share(fine, "broken"),
            ", ".join(f"{why.replace('_', ' ')} {n:g}" for why, n in one["causes"].items()),
        )
    console.print(table)
    if splits := _splits(figures["methods"]):
        apart = Table("method", *(f"{name} ({n})" for name, n in splits.items()),
                      title="saved [%], by split of the corpus (commands)")  # fmt: skip
        for name, one in zip(names, figures["methods"], strict=True):
            apart.add_row(name, *(share(one["splits"].get(part, {}), "saved") for part in splits))
        console.print(apart)
    best = figures["best"]
    if best is not None and best["times_random"] is not None:
        low, high = best["times_random_interval"]
        console.print(
            f"{_METHODS[best['variant']['method']]} saves {best['times_random']:.2f} "
            f"({low:.2f} to {high:.2f}) times as many as a random candidate",
            highlight=False,
        )


def render_study(study: Study, figures: Figures) -> str:
    """The page, with plotly.js and all data inside."""
    methods = figures["methods"]
    names = labels(methods)
    sweeps = [
        {"title": words, "plot": plot(_sweep(methods, setting, words), f"sweep_{setting}")}
        for setting, words in _AXES.items()
        if len({one[setting] for one in methods} - {None}) > 1
    ]
    return render(
        "study.html",
        figures=figures,
        told=_told(figures["commands"]),
        lines=list(zip(names, methods, strict=True)),
        methods=_METHODS,
        saved=plot(_saved(methods, names), "saved"),
        causes=plot(_causes(methods, names), "causes"),
        groups=plot(_parts(methods, names, "groups"), "groups"),
        splits=plot(_parts(methods, names, "splits"), "splits") if _splits(methods) else None,
        sweeps=sweeps,
        rows=_changes(study),
        share=share,
        number=number,
    )


def labels(methods: Sequence[Figures]) -> list[str]:
    """What to call each variant: its method, and what it has that others have otherwise."""
    varied = [key for key in _SETTINGS if len({one[key] for one in methods} - {None}) > 1]
    return [
        ", ".join(
            [_METHODS[one["method"]]]
            + [f"{_SETTINGS[key]} {one[key]}".strip() for key in varied if one[key] is not None]
        )
        for one in methods
    ]


def share(figures: Figures, name: str) -> str:
    """A share and its interval [%]; empty where it is not known."""
    if figures.get(name) is None:
        return ""
    low, high = (100.0 * x for x in figures[f"{name}_interval"])
    return f"{100.0 * figures[name]:.1f} ({low:.0f} to {high:.0f})"


def number(value: float | None, factor: float, digits: int) -> str:
    """A figure; empty where it is not known."""
    return "" if value is None else f"{factor * value:.{digits}f}"


def _told(commands: Figures) -> str:
    """Which commands, in a sentence."""

    def of(which: str) -> str:
        groups = ", ".join(f"{n} {name}" for name, n in commands[which]["groups"].items() if name)
        return f"{commands[which]['commands']}" + (f" ({groups})" if groups else "")

    return (
        f"{commands['screened']} commands looked at; {of('failing')} whose own motion falls and "
        f"{of('succeeding')} whose own does not are compared."
    )


def _saved(methods: Sequence[Figures], names: Sequence[str]) -> go.Figure:
    """Saved, and saved with the task done, of each variant."""
    figure = go.Figure()
    own = [(name, one) for name, one in zip(names, methods, strict=True) if one["commands"]]
    middle, error = _percentages([one for _, one in own])
    figure.add_bar(
        y=[name for name, _ in own],
        x=middle,
        name="saved",
        orientation="h",
        marker={"color": [_COLORS[one["method"]] for _, one in own], "opacity": 0.45},
        error_x=error | {"thickness": 1.6},
        hovertemplate="%{y}: %{x:.1f} % saved<extra></extra>",
    )
    figure.add_bar(
        y=[name for name, _ in own],
        x=[100.0 * one["saved"] * (one["task_done"] or 0.0) for _, one in own],
        name="saved and task done",
        orientation="h",
        marker={"color": [_COLORS[one["method"]] for _, one in own]},
        hovertemplate="%{y}: %{x:.1f} % saved and task done<extra></extra>",
    )
    figure.update_layout(barmode="overlay")
    figure.update_xaxes(title="of the commands whose own motion falls [%]", range=[0, 102])
    figure.update_yaxes(autorange="reversed", automargin=True)
    return styled(figure, height=150 + 34 * len(own), legend=False)


def _causes(methods: Sequence[Figures], names: Sequence[str]) -> go.Figure:
    """Why commands were not saved, of each variant."""
    figure = go.Figure()
    own = [(name, one) for name, one in zip(names, methods, strict=True) if one["commands"]]
    for cause, color in _OF_CAUSES.items():
        counts = [one["causes"].get(cause, 0.0) for _, one in own]
        if not any(counts):
            continue
        figure.add_bar(
            y=[name for name, _ in own],
            x=[100.0 * n / one["commands"] for n, (_, one) in zip(counts, own, strict=True)],
            name=cause.replace("_", " "),
            text=[f"{n:g}" if n else "" for n in counts],
            textposition="inside",
            insidetextanchor="middle",
            orientation="h",
            marker={"color": color},
            hovertemplate="%{y}: %{text}<extra>" + cause.replace("_", " ") + "</extra>",
        )
    figure.update_layout(barmode="stack")
    figure.update_xaxes(title="not saved [%]", range=[0, 102])
    figure.update_yaxes(autorange="reversed", automargin=True)
    return styled(figure, height=170 + 34 * len(own), top=60)


def _splits(methods: Sequence[Figures]) -> dict[str, int]:
    """How many commands of each split there are; nothing where all are of one."""
    found = {split: int(own["commands"]) for one in methods for split, own in one["splits"].items()}
    return found if len(found) > 1 else {}


def _parts(methods: Sequence[Figures], names: Sequence[str], by: str) -> go.Figure:
    """Saved commands by ``groups`` of actions or ``splits`` of the corpus."""
    figure = go.Figure()
    for name, one in zip(names, methods, strict=True):
        parts = one[by]
        if not parts:
            continue
        middle, error = _percentages(list(parts.values()))
        figure.add_bar(
            x=[words.replace("_", " ") for words in parts],
            y=middle,
            name=name,
            marker={"color": _COLORS[one["method"]]},
            error_y=error | {"thickness": 1.2},
            customdata=[own["commands"] for own in parts.values()],
            hovertemplate="%{x}: %{y:.0f} % of %{customdata}<extra>%{fullData.name}</extra>",
        )
    figure.update_layout(barmode="group")
    figure.update_yaxes(title="saved [%]", range=[0, 102])
    return styled(figure, height=380, top=40 + 12 * len(methods), legend=len(methods) <= 8)


def _sweep(methods: Sequence[Figures], setting: str, words: str) -> go.Figure:
    """Saved commands over a setting, a line for each method with all else alike."""
    figure = go.Figure()
    others = [key for key in _SETTINGS if key != setting]
    own = [one for one in methods if one[setting] is not None and one["commands"]]
    names = labels([{**one, setting: None} for one in own])
    series = dict.fromkeys((one["method"], *(one[key] for key in others)) for one in own)
    for which in series:
        line = sorted(
            (one for one in own if (one["method"], *(one[key] for key in others)) == which),
            key=lambda one: one[setting],
        )
        middle, error = _percentages(line)
        figure.add_scatter(
            x=[one[setting] for one in line],
            y=middle,
            name=names[own.index(line[0])],
            mode="lines+markers",
            line={"color": _COLORS.get(which[0], DONE)},
            error_y=error | {"thickness": 1.2},
        )
    logarithmic = setting == "pool"
    figure.update_xaxes(
        title=words,
        type="log" if logarithmic else "linear",
        tickvals=sorted({one[setting] for one in own}),
    )
    figure.update_yaxes(title="saved [%]", range=[0, 102])
    return styled(figure, height=420, top=40 + 12 * len(series))


def _percentages(saved: Sequence[Figures]) -> tuple[list[float], dict[str, Any]]:
    """Shares that were saved and how far their intervals reach above and below them [%]."""
    middle = [100.0 * one["saved"] for one in saved]
    ends = [[100.0 * x for x in one["saved_interval"]] for one in saved]
    return middle, {
        "array": [high - at for (_, high), at in zip(ends, middle, strict=True)],
        "arrayminus": [at - low for (low, _), at in zip(ends, middle, strict=True)],
    }


def _changes(study: Study) -> list[dict[str, Any]]:
    """What was done with each command by each method that foresees."""
    rows = [row for row in study.results if row["method"] in FORESEEING]
    variants = list(dict.fromkeys(variant_of(row) for row in rows))
    names = dict(zip(variants, labels([vars(one) for one in variants]), strict=True))
    return [{**row, "name": names[variant_of(row)]} for row in rows]
