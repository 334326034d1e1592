"""What lies over a playback: P(fall) over time, with a line that moves along."""

from __future__ import annotations

from typing import Any

import numpy as np

from robomirror_drake.messages import Execution, Foresight, Outcome
from robomirror_drake.report.page import render
from robomirror_drake.results import Result

WIDTH, HEIGHT = 460.0, 120.0
"""Of the plot [px]."""


def render_overlay(result: Result) -> str:
    """The overlay as HTML, empty where nothing was foreseen.

    Its script reads the time from the page's viewer, and a click into the plot goes there.
    """
    run = result.adaptation
    if run is None:
        return ""
    original = run.original
    last = float(result.execution.time[-1])
    if original is not None:
        last = max(last, float(original.execution.time[-1]))
    curves = [_curve("adapted", run.foresight, result.execution, result.outcome, last)]
    if original is not None:
        curves.insert(
            0,
            _curve("original", original.foresight, original.execution, original.outcome, last),
        )
    return render(
        "playback_overlay.html",
        record=run.record,
        compared=original is not None,
        curves=curves,
        allowed=HEIGHT * (1.0 - run.record.allowed),
        horizon=run.foresight.horizon,
        width=WIDTH,
        height=HEIGHT,
        last=last,
        handovers=[WIDTH * h.start / last for h in run.record.handovers if h.done],
    )


def _curve(
    kind: str, seen: Foresight, execution: Execution, outcome: Outcome, last: float
) -> dict[str, Any]:
    """A line of the plot, and where on it the fall and the end of the motion are [px]."""
    x, y = WIDTH * seen.time / last, HEIGHT * (1.0 - seen.underway)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    fall, end = outcome.fall_time_s, execution.motion_end
    level = 0.0 if fall is None else float(np.interp(fall, seen.time, seen.underway))
    return {
        "kind": kind,
        "points": points,
        "fall": None if fall is None else WIDTH * fall / last,
        "fall_level": HEIGHT * (1.0 - level),
        "fall_time": fall,
        "end": WIDTH * end / last if 0.0 < end < last and fall is None else None,
    }
