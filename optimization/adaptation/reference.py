"""From variables back to the reference that the robot is to follow."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.adaptation.motion import sample
from robomirror_drake.optimization.adaptation.problem import Problem
from robomirror_drake.optimization.centroidal import drake_velocities
from robomirror_drake.optimization.floating_base import continuous
from robomirror_drake.optimization.kinematics import positions
from robomirror_drake.optimization.retargeting.metrics import RobotTables, own_residuals


def adapted_reference(tables: RobotTables, problem: Problem, z: Array) -> RobotReference:
    """The motion of variables z (X,) at the command's rate, with its residuals anew.

    Its duration is a whole number of samples, for which the tempo gives way a little. Beside the
    residuals of retargeting it has ``distance_to_command``: the mean distance of the keypoints
    from the command's at the same point of the motion [m]. ``keypoint_error`` stays the command's.

    Args:
        tables: The robot.
        problem: Whose variables.
        z: Their values.
    """
    command, path, layout = problem.reference, problem.path, problem.layout
    dt = path.duration / (len(path.time) - 1)
    sigma = layout.changes(z)[0]
    most = float(path.stretched(path.duration))
    count = round((path.duration + sigma * most) / dt)
    if "tempo" in layout.blocks and most > 0.0:
        column = layout.blocks["tempo"].start
        z = z.copy()
        sigma = (count * dt - path.duration) / most
        z[column] = sigma / layout.scale[column]
    time = np.arange(count + 1, dtype=np.float64) * dt
    made = sample(problem.legs, path, layout, z, time, derivatives=False)
    spline = CubicSpline(time, continuous(made.q))
    v, a = drake_velocities(spline(time), spline(time, 1), spline(time, 2))
    tau, _, _ = path.tau(time, sigma)
    led = sample(problem.legs, path, layout, 0.0 * z, tau, derivatives=False)
    poses = made.rotation, made.origin
    apart = positions(tables.keypoints, *poses)
    apart -= positions(tables.keypoints, led.rotation, led.origin)
    return RobotReference(
        time=time,
        q=made.q,
        v=v,
        a=a,
        contact=made.contact,
        text=command.text,
        source=command.source,
        residuals={
            **command.residuals,
            **own_residuals(tables, poses, made.q, v, made.contact, spline(time, 3)[:, 7:]),
            "distance_to_command": float(np.linalg.norm(apart, axis=2).mean()),
        },
    )
