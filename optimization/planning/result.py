"""From a plan's control points to the reference that the robot executes."""

from __future__ import annotations

import numpy as np

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization import centroidal, spline
from robomirror_drake.optimization.planning.collision import gaps
from robomirror_drake.optimization.planning.contacts import (
    anchors,
    outside,
    wrench_cones,
)
from robomirror_drake.optimization.planning.forces import share_wrench
from robomirror_drake.optimization.planning.frames import Frames, soles
from robomirror_drake.optimization.planning.options import PlanOptions
from robomirror_drake.optimization.planning.schedule import loaded_corners
from robomirror_drake.optimization.planning.setup import Padded
from robomirror_drake.robot import Robot


def planned_reference(
    robot: Robot,
    reference: RobotReference,
    padded: Padded,
    basis: spline.Basis,
    control: Array,
    options: PlanOptions,
) -> RobotReference:
    """The plan at the reference's rate, with the force on each foot and its residuals.

    Args:
        robot: The robot.
        reference: The kinematic reference.
        padded: The same at its tempo, with standing time at its ends.
        basis: Spline basis at the padded frames.
        control: (K, 30) control points.
        options: Options of the plan.

    Raises:
        PlanningError: No foot forces were found.
    """
    x, xd, xdd = (spline.evaluate(basis, control, order) for order in range(3))
    frames = Frames.of(robot)
    samples = centroidal.sample(robot, frames.links, x, xd, xdd, derivatives=False)
    points = frames.points(samples.links)
    corners, led = soles(points), frames.points_of(robot, padded.q)
    placed = anchors(corners, padded.contact, robot.sole_corners, soles(led))
    cone = options.cone(robot)
    loaded = loaded_corners(padded.contact, np.arange(len(x), dtype=np.float64), 0.0)
    hard = cone._replace(friction=robot.spec.contact.friction, margin=0.0)
    away = np.linalg.norm((points - led)[padded.kept, 8:], axis=-1)
    v, a = centroidal.drake_velocities(x, xd, xdd)
    q = centroidal.unit_quaternions(x)
    low, high = robot.position_limits
    joints, speed = q[:, 7:], np.abs(v[:, 6:])
    excess = (low - joints, joints - high, speed - robot.velocity_limits)
    residuals = {
        **reference.residuals,
        "dynamic_violation": float(
            outside(wrench_cones(placed, loaded, hard), samples.wrench).max()
        ),
        "distance_to_raw": float(away.mean()),
        "time_scale": reference.duration / float(np.ptp(padded.time[padded.kept])),
        "stance_drift": float(
            np.max(np.linalg.norm(corners - placed, axis=-1)[padded.contact], initial=0.0)
        ),
        "penetration": float(max(0.0, -corners[..., 2].min())),
        "self_penetration": float(max(0.0, -gaps(frames.capsules, samples.links).distance.min())),
        "limit_violation": max(0.0, *(float(part.max()) for part in excess)),
        "jerk_rms": float(np.sqrt(np.mean(spline.evaluate(basis, control, 3)[:, 7:] ** 2))),
    }
    return RobotReference(
        time=padded.time,
        q=q,
        v=v,
        a=a,
        contact=padded.contact,
        text=reference.text,
        source=reference.source,
        residuals=residuals,
        foot_force=share_wrench(samples.wrench, placed, padded.contact, cone),
        planned=True,
        lead=float(padded.time[padded.kept.start]),
    )
