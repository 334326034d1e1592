"""Dynamic planning of one window of a motion that goes on, for a loop that plans anew.

A window starts in a given state of motion and need not end at rest. Its knots continue those
of the window before, so that three kept control points make it go on from that with equal
position, velocity and acceleration.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.floating_base import continuous
from robomirror_drake.optimization.planning.frames import Frames, soles
from robomirror_drake.optimization.planning.options import PlanOptions
from robomirror_drake.optimization.planning.result import planned_reference
from robomirror_drake.optimization.planning.setup import (
    Knots,
    Padded,
    first_guess,
    limits,
    problem,
    time_step,
)
from robomirror_drake.optimization.planning.solver import WARM, solve
from robomirror_drake.optimization.planning.tempo import chart_acceleration, chart_rate
from robomirror_drake.robot import Robot

_KEPT = spline.ORDER - 1  # control points that give position, velocity and acceleration


class State(NamedTuple):
    """A state of motion in Drake's order: q (30,), v (29,), a (29,)."""

    q: Array
    v: Array
    a: Array


class Warm(NamedTuple):
    """The window before, from which a new one goes on.

    Attributes:
        control: (K, 30) its control points.
        shift: By how many knots the new window begins later.
    """

    control: Array
    shift: int


class PlannedWindow(NamedTuple):
    """The plan of a window, and its control points (K, 30) for the next one."""

    reference: RobotReference
    control: Array


def plan_window(
    robot: Robot,
    window: RobotReference,
    start: State | Warm,
    options: PlanOptions | None = None,
    *,
    last: bool = False,
) -> PlannedWindow:
    """The dynamically consistent motion nearest to a window, from where the robot is.

    Args:
        robot: The robot.
        window: Kinematic reference at a constant rate, whose contacts are believed as they are.
            A foot that stands at its start stands on where it is.
        start: The state at the window's start, or the window before.
        options: See :class:`PlanOptions`; the tempo is left as it is.
        last: Whether the motion ends with the window, at rest.

    Raises:
        PlanningError: See :func:`~robomirror_drake.optimization.planning.plan.plan_dynamics`.
    """
    options = options or PlanOptions()
    padded, knots = _laid_out(window, options.knot_spacing, last)
    guess = first_guess(padded, knots)
    if not last:
        end = State(window.q[-1], window.v[-1], window.a[-1])
        late = knots.intervals * knots.spacing - window.duration
        guess[-_KEPT:] = _at_knot(end, knots.spacing, padded.q[-1], late)
    if isinstance(start, Warm):
        guess, ending = _continued(guess, start)
        iterations, level = options.window_iterations, WARM
    else:
        ending = guess[-_KEPT:].copy()
        guess[:_KEPT] = _at_knot(start, knots.spacing, padded.q[0])
        iterations, level = options.iterations, 0
    made, standing = problem(robot, padded, knots, options)
    x = spline.evaluate(knots.basis(padded.time[:1]), guess)
    solution = solve(
        replace(made, fixed=_KEPT, ending=None if last else ending),
        standing._replace(held=soles(Frames.of(robot).points_of(robot, x))[0]),
        guess,
        limits(robot, options),
        iterations=iterations,
        tolerance=options.tolerance,
        level=level,
    )
    plan = planned_reference(
        robot, window, padded, knots.basis(padded.time), solution.control, options
    )
    return PlannedWindow(
        plan, np.concatenate([solution.control, solution.control[-1:].repeat(2 * last, 0)])
    )


def _laid_out(window: RobotReference, spacing: float, last: bool) -> tuple[Padded, Knots]:
    """The window's frames and knots; rest is reached at a knot."""
    dt = time_step(window)
    intervals = max(2, int(np.ceil(window.duration / spacing - 1e-9)))
    more = int(np.ceil(intervals * spacing / dt - 1e-9)) - len(window.q) + 1 if last else 0
    count = len(window.q) + max(0, more)
    padded = Padded(
        time=np.arange(count, dtype=np.float64) * dt,
        q=np.pad(continuous(window.q), ((0, count - len(window.q)), (0, 0)), mode="edge"),
        contact=np.pad(window.contact, ((0, count - len(window.q)), (0, 0), (0, 0)), mode="edge"),
        kept=slice(0, len(window.q)),
    )
    return padded, Knots(spacing, intervals, (False, last))


def _at_knot(state: State, spacing: float, near: Array, later: float = 0.0) -> Array:
    """(3, 30) control points that pass a knot in a state, or go on from it until the knot.

    Args:
        state: The state.
        spacing: Distance of the knots [s].
        near: (30,) configuration whose sign the quaternion is to have.
        later: How long after the state the knot is [s].
    """
    q = state.q.copy()
    q[:4] *= 1.0 if q[:4] @ near[:4] >= 0.0 else -1.0
    x, v, a = q[None], state.v[None], state.a[None]
    xd, xdd = chart_rate(x, v), chart_acceleration(x, v, a)
    x, xd = x + later * xd + 0.5 * later**2 * xdd, xd + later * xdd
    middle, bend = x - spacing**2 * xdd / 6.0, 0.5 * spacing**2 * xdd
    return np.concatenate([middle - spacing * xd + bend, middle, middle + spacing * xd + bend])


def _continued(guess: Array, warm: Warm) -> tuple[Array, Array]:
    """Control points of the window before and what follows, and the last three to come to.

    What follows is moved over the floor to where those of the window before end.
    """
    old = warm.control[warm.shift :][: len(guess)]
    end = len(old) - 1
    sign = 1.0 if old[end, :4] @ guess[end, :4] >= 0.0 else -1.0
    guess = np.concatenate([sign * guess[:, :4], guess[:, 4:]], axis=1)
    ending = guess[-_KEPT:].copy()
    guess[:, 4:6] += old[end, 4:6] - guess[end, 4:6]
    guess[: len(old)] = old
    return guess, ending
