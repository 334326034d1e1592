"""The plots of what adaptation changed, as plotly figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from robomirror_drake.adaptation.motion_measures import Measure, courses
from robomirror_drake.messages import Execution, Foresight, Outcome, RobotReference
from robomirror_drake.report.figures import (
    DONE,
    FAULT,
    TOLD,
    cross,
    events,
    from_above,
    line,
    styled,
)
from robomirror_drake.robot import Robot

OWN = "#c2571a"
"""Of the command's own motion."""

HANDOVER = "#8250df"
HAPPENS = "rgba(209, 36, 47, 0.13)"


def paths(
    own: RobotReference,
    commanded: RobotReference,
    execution: Execution,
    original: tuple[Execution, Outcome] | None,
    outcome: Outcome,
) -> go.Figure:
    """The root from above: of both motions, as meant and as done; a cross where it fell."""
    figure = go.Figure()
    lines = [
        ("as commanded, meant", own.q, OWN, "dot"),
        ("as adapted, meant", commanded.q, DONE, "dot"),
    ]
    ends = [(execution, outcome)]
    if original is not None:
        lines.append(("as commanded, executed", original[0].q, OWN, "solid"))
        ends.append(original)
    lines.append(("as adapted, executed", execution.q, DONE, "solid"))
    for name, q, color, dash in lines:
        style = {"color": color, "dash": dash, "width": 2.5}
        figure.add_scatter(x=q[:, 4], y=q[:, 5], name=name, mode="lines", line=style)
    for done, end in ends:
        cross(figure, done, end)
    return styled(from_above(figure, [q for _, q, _, _ in lines]), height=440, top=70)


def risks(
    curves: Sequence[tuple[str, Foresight, Execution, Outcome]],
    allowed: float,
    handovers: Sequence[float] = (),
) -> go.Figure:
    """P(fall) over time for one or two executions, and what happened.

    Args:
        curves: Name of the execution, what was foreseen, the execution and its outcome.
        allowed: P(fall) up to which a motion is safe.
        handovers: When the last of them was given another motion [s].
    """
    figure = make_subplots(
        rows=len(curves),
        shared_xaxes=True,
        vertical_spacing=0.14,
        subplot_titles=[name for name, *_ in curves],
    )
    last = max(float(execution.time[-1]) for _, _, execution, _ in curves)
    for row, (_, seen, execution, outcome) in enumerate(curves, start=1):
        for name, y, color, dash in (
            ("foreseen before it moved", seen.beforehand, TOLD, "dot"),
            ("foreseen on the way", seen.underway, DONE, "solid"),
        ):
            style = {"color": color, "dash": dash, "width": 2.2}
            figure.add_scatter(
                x=seen.time, y=y, name=name, mode="lines", line=style,
                showlegend=row == 1, legendgroup=name, row=row, col=1,
            )  # fmt: skip
        figure.add_hline(allowed, line={"color": FAULT, "width": 1, "dash": "dash"}, row=row, col=1)
        if outcome.fall_time_s is not None:
            begins = max(0.0, outcome.fall_time_s - seen.horizon)
            figure.add_vrect(
                begins, outcome.fall_time_s, fillcolor=HAPPENS, line_width=0, row=row, col=1
            )
        events(figure, execution, outcome, row)
        figure.update_yaxes(title="P(fall)", range=[-0.03, 1.03], row=row, col=1)
    for start in handovers:
        style = {"color": HANDOVER, "width": 1.5, "dash": "dashdot"}
        figure.add_vline(start, line=style, row=len(curves), col=1)
    figure.update_xaxes(range=[0.0, last])
    figure.update_xaxes(title="time [s]", row=len(curves), col=1)
    figure.update_annotations(font={"size": 13})
    return styled(figure, height=120 + 170 * len(curves), top=70)


def changes(measures: Sequence[Measure]) -> go.Figure:
    """What became more and what less, as shares of the command's own motion."""
    shown = [m for m in reversed(measures) if np.isfinite(m.share)]
    share = [100.0 * (m.share - 1.0) for m in shown]
    colors = [DONE if m.different else TOLD for m in shown]
    bars = go.Bar(x=share, y=[str(m) for m in shown], orientation="h", marker={"color": colors})
    most = max((abs(value) for value in share), default=0.0)
    styled(figure := go.Figure(bars), height=110 + 30 * len(shown), legend=False, top=12)
    reach = 1.1 * max(most, 20.0)
    figure.update_xaxes(title="change [%]", range=[-reach, reach])
    figure.add_vline(0.0, line={"color": TOLD, "width": 1})
    return figure.update_layout(margin={"l": 250})


def over_time(robot: Robot, own: RobotReference, commanded: RobotReference) -> go.Figure:
    """Small multiples of what both motions do over time, as meant."""
    was, now = courses(robot, own), courses(robot, commanded)
    names = list(was)
    figure = make_subplots(
        rows=2, cols=2, subplot_titles=names, shared_xaxes=True,
        horizontal_spacing=0.07, vertical_spacing=0.14,
    )  # fmt: skip
    for number, name in enumerate(names):
        row, col = number // 2 + 1, number % 2 + 1
        for label, time, y, color in (
            ("as commanded", own.time, was[name], OWN),
            ("as adapted", commanded.time, now[name], DONE),
        ):
            line(figure, time, y, label, color, row, col, legend=number == 0)
    for col in (1, 2):
        figure.update_xaxes(title="time [s]", row=2, col=col)
    figure.update_annotations(font={"size": 13})
    return styled(figure, height=420, top=60)
