"""The plots of a report, as plotly figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from robomirror_drake.messages import Array, BoolArray, Execution, Outcome, RobotReference
from robomirror_drake.outcome import HEIGHT_DROP, LEAN, lean_angle, until_fall

TOLD = "#9aa5b1"
DONE = "#1f6feb"
LEFT, RIGHT = "#0f8a7e", "#c2571a"
FAULT = "#d1242f"
GRID = "#e7ebf0"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def limbs(model: pin.Model) -> tuple[tuple[str, ...], ...]:
    """The unbranched chains of the kinematic tree, each as the names of its joints.

    Of a humanoid: each leg, the waist, each arm.
    """
    children: dict[int, list[int]] = {}
    for joint in range(2, model.njoints):
        children.setdefault(int(model.parents[joint]), []).append(joint)
    chains = []
    for joint in range(2, model.njoints):
        parent = int(model.parents[joint])
        if parent != 1 and len(children[parent]) == 1:
            continue
        chain = [joint]
        while len(children.get(chain[-1], [])) == 1:
            chain += children[chain[-1]]
        chains.append(tuple(str(model.names[j]) for j in chain))
    return tuple(chains)


def root_path(execution: Execution, outcome: Outcome) -> go.Figure:
    """The root seen from above: as told and as done."""
    figure = go.Figure()
    for name, q, style in (
        ("reference", execution.q_ref, {"color": TOLD, "dash": "dot", "width": 3}),
        ("executed", execution.q, {"color": DONE, "width": 2.5}),
    ):
        figure.add_scatter(x=q[:, 4], y=q[:, 5], name=name, mode="lines", line=style)
    for name, index, symbol in (("start", 0, "circle"), ("end", -1, "square")):
        x, y = execution.q[index, 4:6]
        figure.add_scatter(
            x=[x],
            y=[y],
            name=name,
            mode="markers",
            marker={"color": DONE, "symbol": symbol, "size": 9},
        )
    cross(figure, execution, outcome)
    return styled(from_above(figure, (execution.q, execution.q_ref)), height=440)


def cross(figure: go.Figure, execution: Execution, outcome: Outcome) -> None:
    """Marks where the root was when the robot fell, seen from above; nothing if it did not."""
    if outcome.fall_time_s is not None:
        x, y = execution.q[np.searchsorted(execution.time, outcome.fall_time_s), 4:6]
        marker = {"color": FAULT, "symbol": "x", "size": 13}
        figure.add_scatter(x=[x], y=[y], name="fall", mode="markers", marker=marker)


def from_above(figure: go.Figure, motions: Sequence[Array]) -> go.Figure:
    """Axes x and y of one scale, with room for the roots of motions (T, 30)."""
    every = np.concatenate([q[:, 4:6] for q in motions])
    low, high = every.min(axis=0), every.max(axis=0)
    half = max(0.25, 0.55 * float(np.max(high - low)))  # a robot on the spot stays a point
    x, y = 0.5 * (low + high)
    figure.update_xaxes(title="x [m]", range=[x - half, x + half])
    figure.update_yaxes(title="y [m]", range=[y - half, y + half], scaleanchor="x", scaleratio=1)
    return figure


def root_errors(execution: Execution, outcome: Outcome) -> go.Figure:
    """Height of the root, its distance from the reference, and the lean, over time."""
    t, q, q_ref = execution.time, execution.q, execution.q_ref
    figure = make_subplots(rows=3, shared_xaxes=True, vertical_spacing=0.05)
    line(figure, t, q_ref[:, 6], "reference", TOLD, row=1, dash="dot")
    line(figure, t, q[:, 6], "executed", DONE, row=1)
    _limit(figure, t, q_ref[:, 6] - HEIGHT_DROP, row=1)
    line(figure, t, np.linalg.norm(q[:, 4:7] - q_ref[:, 4:7], axis=1), "distance", DONE, row=2)
    line(figure, t, np.rad2deg(lean_angle(q[:, :4], q_ref[:, :4])), "lean", DONE, row=3)
    _limit(figure, t, np.full(len(t), np.rad2deg(LEAN)), row=3)
    for row, title in enumerate(("height [m]", "distance [m]", "lean [°]"), start=1):
        figure.update_yaxes(title=title, row=row)
    figure.update_yaxes(rangemode="tozero", exponentformat="none", row=2)
    figure.update_yaxes(rangemode="tozero", row=3)
    figure.update_xaxes(title="time [s]", row=3)
    return styled(events(figure, execution, outcome), height=440, legend=False)


def contacts(execution: Execution, reference: RobotReference, outcome: Outcome) -> go.Figure:
    """The contact schedule above the ground forces that were measured."""
    t = execution.time
    own = reference.time <= t[-1]
    # The crash after a fall would dwarf all that led to it.
    highest = until_fall(execution).foot_force[..., 2].max(initial=1.0)
    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.3, 0.7])
    parts = (("toe", slice(0, 2)), ("heel", slice(2, 4)))
    for foot, (side, color) in enumerate((("left", LEFT), ("right", RIGHT))):
        for part, corners in parts:
            loaded = np.asarray(execution.contact_ref[:, foot, corners].any(axis=1))
            _bar(figure, t, loaded, f"{side} {part}", color)
        line(figure, t, execution.foot_force[:, foot, 2], f"{side} foot", color, row=2, legend=True)
        if reference.planned and reference.foot_force is not None:
            planned = reference.foot_force[own, foot, 5]
            name = f"{side}, planned"
            line(figure, reference.time[own], planned, name, color, row=2, dash="dot", legend=True)
    line(figure, t, execution.other_force, "other links", FAULT, row=2, legend=True)
    figure.update_yaxes(autorange="reversed", row=1)
    figure.update_yaxes(title="ground force [N]", range=[-0.05 * highest, 1.25 * highest], row=2)
    figure.update_xaxes(title="time [s]", row=2)
    return styled(events(figure, execution, outcome), height=460)


def joint_angles(
    names: Sequence[str], columns: Sequence[int], execution: Execution, outcome: Outcome
) -> go.Figure:
    """Small multiples of joint angles, as told and as done [rad]."""
    figure = _grid(names)
    for number, column in enumerate(columns):
        row, col = _cell(number)
        for name, q, color, dash in (
            ("reference", execution.q_ref, TOLD, "dot"),
            ("executed", execution.q, DONE, "solid"),
        ):
            y, shown = q[:, 7 + column], number == 0
            line(figure, execution.time, y, name, color, row, col, dash=dash, legend=shown)
    return _finished_grid(events(figure, execution, outcome), len(names), "angle [rad]")


def joint_torques(
    names: Sequence[str],
    columns: Sequence[int],
    execution: Execution,
    outcome: Outcome,
    effort_limit: Array,
) -> go.Figure:
    """Small multiples of joint torques with their limits [N·m]."""
    figure = _grid(names)
    ends = execution.time[[0, -1]]
    for number, column in enumerate(columns):
        row, col = _cell(number)
        y, shown = execution.torque[:, column], number == 0
        line(figure, execution.time, y, "torque", DONE, row, col, legend=shown)
        for sign in (-1.0, 1.0):
            _limit(figure, ends, np.full(2, sign * effort_limit[column]), row, col)
    return _finished_grid(events(figure, execution, outcome), len(names), "torque [N·m]")


def _grid(names: Sequence[str]) -> go.Figure:
    rows = -(-len(names) // 3)
    return make_subplots(
        rows=rows,
        cols=3,
        subplot_titles=list(names),
        shared_xaxes=True,
        shared_yaxes=True,
        horizontal_spacing=0.03,
        vertical_spacing=0.28 / rows if rows > 1 else 0.0,
    )


def _cell(number: int) -> tuple[int, int]:
    return number // 3 + 1, number % 3 + 1


def _finished_grid(figure: go.Figure, panels: int, unit: str) -> go.Figure:
    rows = -(-panels // 3)
    for row in range(1, rows + 1):
        figure.update_yaxes(title=unit, row=row, col=1)
    for col in range(1, 4):
        figure.update_xaxes(title="time [s]", row=rows, col=col)
    figure.update_annotations(font={"size": 13})
    return styled(figure, height=110 + 190 * rows, top=60)


def line(
    figure: go.Figure,
    x: Array,
    y: Array,
    name: str,
    color: str,
    row: int,
    col: int = 1,
    *,
    dash: str = "solid",
    legend: bool = False,
) -> None:
    """A line in one of several panels; those of one name share their entry in the legend."""
    figure.add_scatter(
        x=x.astype(np.float32),
        y=y.astype(np.float32),
        name=name,
        mode="lines",
        line={"color": color, "width": 1.8, "dash": dash},
        showlegend=legend,
        legendgroup=name,
        row=row,
        col=col,
    )


def _limit(figure: go.Figure, x: Array, y: Array, row: int, col: int = 1) -> None:
    line(figure, x, y, "limit", FAULT, row, col, dash="dash")


def _bar(figure: go.Figure, time: Array, loaded: BoolArray, name: str, color: str) -> None:
    """A row of the contact schedule: a bar for as long as load is meant to be borne."""
    figure.add_scatter(
        x=time,
        y=[name if on else None for on in loaded],
        name=name,
        mode="lines",
        line={"color": color, "width": 9},
        connectgaps=False,
        showlegend=False,
        row=1,
        col=1,
    )


def events(
    figure: go.Figure, execution: Execution, outcome: Outcome, row: int | Literal["all"] = "all"
) -> go.Figure:
    """Marks the end of the motion and the fall, in every panel or in those of a row."""
    if 0.0 < execution.motion_end < execution.time[-1]:
        figure.add_vline(execution.motion_end, line={"color": TOLD, "width": 1}, row=row)
    if outcome.fall_time_s is not None:
        figure.add_vline(outcome.fall_time_s, line={"color": FAULT, "width": 1.5}, row=row)
    return figure


def styled(figure: go.Figure, *, height: int, top: int = 36, legend: bool = True) -> go.Figure:
    axis: dict[str, Any] = {"gridcolor": GRID, "zeroline": False, "linecolor": GRID}
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    return figure.update_layout(
        height=height,
        margin={"l": 64, "r": 12, "t": top, "b": 48},
        font={"family": FONT, "size": 12, "color": "#24292f"},
        plot_bgcolor="white",
        paper_bgcolor="white",
        hovermode="closest",
        showlegend=legend,
        legend={"orientation": "h", "x": 0, "y": 1, "yanchor": "top", "yref": "container"},
    )
