"""Kinodynamic planning: makes a kinematic reference dynamically consistent.

The plan keeps as near to the reference as the laws of motion allow: at every sample the
contact wrench that it needs lies within what the soles on the ground can give, the feet
stand where they stand, and it starts and ends at rest.
"""

from __future__ import annotations

from robomirror_drake.messages import RobotReference
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.plan_options import PlanOptions
from robomirror_drake.optimization.plan_problem import rest_at_both_ends
from robomirror_drake.optimization.plan_result import planned_reference
from robomirror_drake.optimization.plan_setup import first_guess, limits, pad, problem
from robomirror_drake.optimization.plan_solver import solve
from robomirror_drake.robot import Robot

__all__ = ["PlanOptions", "plan_dynamics"]


def plan_dynamics(
    robot: Robot, reference: RobotReference, options: PlanOptions | None = None
) -> RobotReference:
    """The dynamically consistent motion nearest to a kinematic reference.

    Time is added where the reference starts or ends in mid-motion. A motion that cannot be
    made consistent gives the best plan found, with its violation among the residuals:
    ``dynamic_violation`` (largest distance of the contact wrench from what the soles can give
    with the friction of the robot's feet and no margin, in body weights and body weights times
    metres) and ``distance_to_raw`` (mean distance of the keypoints from the reference [m]).

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
    padded = pad(robot, reference, options)
    duration = float(padded.time[-1])
    intervals = max(5, round(duration / options.knot_spacing))
    spacing = duration / intervals
    made, standing = problem(robot, padded, spacing, intervals, options)
    solution = solve(
        made,
        standing,
        first_guess(padded, spacing, intervals),
        limits(robot, options),
        iterations=options.iterations,
        tolerance=options.tolerance,
    )
    at_frames = rest_at_both_ends(spline.basis(padded.time, spacing, intervals + 3))
    return planned_reference(robot, reference, padded, at_frames, solution.control, options)
