"""Kinodynamic planning: makes a kinematic reference dynamically consistent.

The plan keeps as near to the reference as the laws of motion allow: at every sample the
contact wrench that it needs lies within what the soles on the ground can give, the feet
stand where they stand, and it starts and ends at rest.
"""

from __future__ import annotations

from typing import NamedTuple

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.planning.options import PlanOptions
from robomirror_drake.optimization.planning.result import planned_reference
from robomirror_drake.optimization.planning.setup import Knots, first_guess, limits, pad, problem
from robomirror_drake.optimization.planning.solver import NEAR, solve
from robomirror_drake.robot import Robot

__all__ = ["PlanOptions", "plan_dynamics"]

_HALVINGS = 3  # of the range of tempos


class _Plan(NamedTuple):
    """A plan, its control points, and its tempo where the feet stand."""

    reference: RobotReference
    control: Array
    tempo: float

    def excess(self, options: PlanOptions) -> float:
        """By which factor it is too hard, or below 1."""
        figures = self.reference.residuals
        return max(
            figures["dynamic_violation"] / options.feasible,
            figures["distance_to_raw"] / options.farthest,
        )


def plan_dynamics(
    robot: Robot, reference: RobotReference, options: PlanOptions | None = None
) -> RobotReference:
    """The dynamically consistent motion nearest to a kinematic reference.

    Time is added where the reference starts or ends in mid-motion. A motion that cannot be
    made consistent, or not near enough to its reference, is slowed down as far as it must and
    ``slowest`` allows; what flies keeps its tempo. If that does not help it gives the best plan
    found. Among the residuals are
    ``dynamic_violation`` (largest distance of the contact wrench from what the soles can give
    with the friction of the robot's feet and no margin, in body weights and body weights times
    metres), ``distance_to_raw`` (mean distance of the keypoints from the reference [m]) and
    ``time_scale`` (duration of the reference by that of its plan, added time apart).

    Args:
        robot: The robot.
        reference: Kinematic reference at a constant rate.
        options: See :class:`PlanOptions`.

    Raises:
        PlanningError: The reference cannot be used, being too short or at no constant rate, or
            the numerics failed on it.
    """
    options = options or PlanOptions()
    if options.strength == 0.0:
        return reference
    plan = _at_tempo(robot, reference, options, options.time_scale)
    if plan.excess(options) <= 1.0 or options.slowest >= options.time_scale:
        return plan.reference
    fast, slow = plan, _at_tempo(robot, reference, options, options.slowest, plan)
    if slow.excess(options) > 1.0:
        return min(fast, slow, key=lambda one: one.excess(options)).reference
    for _ in range(_HALVINGS):
        middle = _at_tempo(robot, reference, options, 0.5 * (fast.tempo + slow.tempo), slow)
        fast, slow = (fast, middle) if middle.excess(options) <= 1.0 else (middle, slow)
    return slow.reference


def _at_tempo(
    robot: Robot,
    reference: RobotReference,
    options: PlanOptions,
    tempo: float,
    near: _Plan | None = None,
) -> _Plan:
    """The plan at one tempo, which may start from that at another."""
    padded = pad(robot, reference, options, tempo)
    duration = float(padded.time[-1])
    intervals = max(5, round(duration / options.knot_spacing))
    knots = Knots(duration / intervals, intervals)
    made, standing = problem(robot, padded, knots, options)
    basis = knots.basis(padded.time)
    if near is None:
        guess = first_guess(padded, knots)
    else:
        # Most of the way from the reference to its plan is the same at any tempo.
        guess = spline.stretched(near.control, basis.points)
    solution = solve(
        made,
        standing,
        guess,
        limits(robot, options),
        iterations=options.iterations,
        tolerance=options.tolerance,
        level=0 if near is None else NEAR,
    )
    plan = planned_reference(robot, reference, padded, basis, solution.control, options)
    return _Plan(plan, solution.control, tempo)
