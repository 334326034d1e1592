"""The part of a report that tells what was changed of a command, and why."""

from __future__ import annotations

from typing import Any

import numpy as np

from robomirror_drake.adaptation.motion_measures import compare, told
from robomirror_drake.adaptation.record import AdaptedRun
from robomirror_drake.messages import DIMENSIONS, Execution
from robomirror_drake.optimization.adaptation.explain import Change
from robomirror_drake.report import adaptation_figures as figures
from robomirror_drake.report.page import plot
from robomirror_drake.report.robot_strips import strip
from robomirror_drake.results import Result
from robomirror_drake.robot import Robot

SHOWN = 10
"""Rows of a table of changes or limits, at most."""


def adaptation_values(result: Result, robot: Robot) -> dict[str, Any] | None:
    """What ``adaptation.html`` shows; None where the robot could not adapt."""
    run = result.adaptation
    if run is None:
        return None
    record, original = run.record, run.original
    curves = [("as executed", run.foresight, result.execution, result.outcome)]
    tried = None
    if original is not None:
        tried = (original.execution, original.outcome)
        curves = [
            ("as commanded", original.foresight, *tried),
            ("as adapted", run.foresight, result.execution, result.outcome),
        ]
    measures = compare(robot, run.own, run.commanded) if record.changed else []
    starts = [handover.start for handover in record.handovers if handover.done]
    risk = figures.risks(curves, record.allowed, starts)
    values: dict[str, Any] = {
        "record": record,
        "original": original,
        "strips": _strips(result, run, robot),
        "risk": plot(risk, "risk"),
        "horizon": run.foresight.horizon,
        "told": "" if record.explanation is None else told(measures),
        "dimensions": DIMENSIONS,
        "candidates": sorted(record.candidates, key=lambda c: c.place),
        "changes": [_change(c) for c in record.explanation.changes[:SHOWN]]
        if record.explanation
        else [],
        "active": record.explanation.active[:SHOWN] if record.explanation else (),
    }
    if record.changed:
        paths = figures.paths(run.own, run.commanded, result.execution, tried, result.outcome)
        values["paths"] = plot(paths, "paths")
        values["measures"] = plot(figures.changes(measures), "measures")
        values["courses"] = plot(figures.over_time(robot, run.own, run.commanded), "courses")
    return values


def _strips(result: Result, run: AdaptedRun, robot: Robot) -> list[dict[str, Any]]:
    """Both motions as stick figures, as executed; the original as meant where it was not."""
    made = []
    if run.original is not None:
        fall = run.original.outcome.fall_time_s
        made.append(_strip("As commanded", run.original.execution, robot, fall))
    elif run.record.changed:
        own = run.own
        drawn = strip(robot, own.time, own.q, own.q)
        made.append({"title": "As commanded (not executed)", "fell": False, "strip": drawn})
    title = "As adapted" if run.record.changed else "As commanded"
    return [*made, _strip(title, result.execution, robot, result.outcome.fall_time_s)]


def _strip(title: str, execution: Execution, robot: Robot, fall: float | None) -> dict[str, Any]:
    until = execution.time <= execution.motion_end if fall is None else execution.time >= 0.0
    until |= not until.any()
    drawn = strip(robot, execution.time[until], execution.q[until], execution.q_ref[until], fall)
    return {"title": title, "fell": fall is not None, "strip": drawn}


def _change(change: Change) -> dict[str, str]:
    """How far a part was moved, in the units of a reader."""
    metres = change.unit == "m"
    return {
        "part": change.part,
        "most": f"{100.0 * change.most:+.1f}" if metres else f"{np.degrees(change.most):+.0f}",
        "unit": "cm" if metres else "°",
        "time": f"{change.time_s:.1f}",
    }
