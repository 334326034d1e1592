"""What a dynamic plan costs: whole motions from nothing, and windows that go on."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.planning.window import State, Warm, plan_window
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

CLIPS = ("walk", "jump", "kick")
WINDOW = 60
"""Length of a window [frames]."""

STEP, SHIFT = 6, 2
"""From one window to the next [frames, knots]."""


def run(clips: tuple[str, ...] = CLIPS) -> dict[str, Any]:
    """Measures planning by the time of one processor.

    Returns:
        ``rows``, one per clip: ``clip``, ``duration_s`` of its plan, ``plan_s`` for a plan
        from nothing, ``dynamic_violation`` [body weights], ``distance_to_raw`` [m], and
        ``window_ms_median``, ``window_ms_worst`` for windows of 1 s along that plan, each
        from the one before.
    """
    robot = load_robot()
    rows = []
    for clip in clips:
        motion = load_clip(clip)
        reference = retarget(robot, motion, foot_contacts(motion))
        plan_dynamics(robot, reference)  # compiles what is not compiled yet
        begin = time.process_time()
        plan = plan_dynamics(robot, reference)
        taken = time.process_time() - begin
        made = plan_window(robot, _window(plan, 0), State(plan.q[0], plan.v[0], plan.a[0]))
        windows = []
        for start in range(STEP, len(plan.time) - WINDOW, STEP):
            begin = time.process_time()
            made = plan_window(robot, _window(plan, start), Warm(made.control, SHIFT))
            windows.append(1e3 * (time.process_time() - begin))
        rows.append(
            {
                "clip": clip,
                "duration_s": plan.duration,
                "plan_s": taken,
                "dynamic_violation": plan.residuals["dynamic_violation"],
                "distance_to_raw": plan.residuals["distance_to_raw"],
                "window_ms_median": float(np.median(windows)),
                "window_ms_worst": float(np.max(windows)),
            }
        )
    return {"rows": rows}


def _window(plan: RobotReference, start: int) -> RobotReference:
    part = slice(start, start + WINDOW + 1)
    return RobotReference(
        time=plan.time[part] - plan.time[start],
        q=plan.q[part],
        v=plan.v[part],
        a=plan.a[part],
        contact=plan.contact[part],
    )


def print_table(figures: dict[str, Any], console: Console) -> None:
    """Prints what :func:`run` has measured."""
    table = Table(
        "clip",
        "duration [s]",
        "plan [s]",
        "violation",
        "distance [cm]",
        "window [ms]",
        title="plans from nothing, and windows of 1 s from the one before: median / worst",
    )
    for row in figures["rows"]:
        table.add_row(
            row["clip"],
            f"{row['duration_s']:.1f}",
            f"{row['plan_s']:.2f}",
            f"{row['dynamic_violation']:.3f}",
            f"{100 * row['distance_to_raw']:.1f}",
            f"{row['window_ms_median']:.0f} / {row['window_ms_worst']:.0f}",
        )
    console.print(table)
