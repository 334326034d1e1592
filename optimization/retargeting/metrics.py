"""How well any joint trajectory meets a retargeting problem; no solver is asked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.kinematics import (
    Capsules,
    Points,
    Tree,
    configuration_poses,
    distances,
    make_capsules,
    make_points,
    make_tree,
    positions,
)
from robomirror_drake.optimization.retargeting.targets import (
    RATE,
    Proportions,
    Targets,
    proportions,
)
from robomirror_drake.robot import FEET, Robot


class RobotTables(NamedTuple):
    """Everything about a robot that retargeting reads, as arrays.

    Attributes:
        tree: Its bodies.
        keypoints: The points that follow the human's.
        corners: The 8 sole corners, left foot first.
        capsules: Its self-collision pairs.
        body: Its proportions.
        lower, upper: (J,) joint limits [rad].
        speed: (J,) joint velocity limits [rad/s].
        knees: (J,) which joints are knees.
    """

    tree: Tree
    keypoints: Points
    corners: Points
    capsules: Capsules
    body: Proportions
    lower: Array
    upper: Array
    speed: Array
    knees: BoolArray


def make_tables(robot: Robot) -> RobotTables:
    """The tables of a robot."""
    spec = robot.spec
    lower, upper = robot.position_limits
    soles = [(spec.feet[f].link, corner) for f in FEET for corner in spec.feet[f].corners]
    return RobotTables(
        tree=make_tree(robot),
        keypoints=make_points(robot, [(k.link, k.point) for k in spec.keypoints.values()]),
        corners=make_points(robot, soles),
        capsules=make_capsules(robot),
        body=proportions(robot),
        lower=lower,
        upper=upper,
        speed=robot.velocity_limits,
        knees=robot.knees,
    )


def residuals(tables: RobotTables, targets: Targets, q: Array, v: Array) -> dict[str, float]:
    """Figures of a trajectory sampled at the targets' times.

    Args:
        tables: The robot.
        targets: What it was to follow.
        q, v: (T, 30), (T, 29) in Drake's order.

    Returns:
        ``keypoint_error``: mean distance of keypoints from their targets [m];
        ``stance_drift``: most that a sole corner moves over the floor from where its
        phase of contact began, beside its foothold [m];
        ``penetration``: depth of a sole corner below the floor [m];
        ``self_penetration``: depth of two capsules in each other [m];
        ``limit_violation``: most that a joint exceeds its position [rad] or its
        velocity [rad/s] limit, whichever figure is the greater;
        ``jerk_rms``: root mean square of the joints' third differences [rad/s³].
    """
    R, p = configuration_poses(tables.tree, q)
    miss = np.linalg.norm(positions(tables.keypoints, R, p) - targets.keypoints, axis=2)
    jerk = np.diff(q[:, 7:], 3, axis=0) * RATE**3
    return {
        "keypoint_error": float(miss.mean()),
        **own_residuals(tables, (R, p), q, v, targets.contact, jerk, targets.anchor),
    }


def own_residuals(
    tables: RobotTables,
    poses: tuple[Array, Array],
    q: Array,
    v: Array,
    contact: BoolArray,
    jerk: Array,
    anchor: Array | None = None,
) -> dict[str, float]:
    """Those of :func:`residuals` that need no targets to follow.

    Args:
        tables: The robot.
        poses: (T, B, 3, 3), (T, B, 3) its bodies' in world.
        q, v: (T, 30), (T, 29) in Drake's order.
        contact: (T, 2, 4) schedule.
        jerk: (N, J) the joints' third derivatives [rad/s³].
        anchor: (T, 2, 4, 3) footholds; None for one place each over the whole motion [m].
    """
    corners = positions(tables.corners, *poses)
    beside = corners if anchor is None else corners - anchor.reshape(-1, 8, 3)
    joints, speed = q[:, 7:], np.abs(v[:, 6:])
    limits = (tables.lower - joints, joints - tables.upper, speed - tables.speed)
    return {
        "stance_drift": _drift(beside, contact.reshape(-1, 8)),
        "penetration": max(0.0, -float(corners[..., 2].min())),
        "self_penetration": max(0.0, -float(distances(tables.capsules, *poses).min())),
        "limit_violation": max(0.0, *(float(excess.max()) for excess in limits)),
        "jerk_rms": float(np.sqrt(np.mean(jerk**2))) if len(jerk) else 0.0,
    }


def _drift(offset: Array, standing: BoolArray) -> float:
    """Most that offsets (T, 8, 3) move in x, y from the start of a run of ``standing``."""
    moved = [
        float(np.linalg.norm(offset[a:b, k, :2] - offset[a, k, :2], axis=1).max())
        for k in range(standing.shape[1])
        for a, b in runs(standing[:, k])
    ]
    return max(moved, default=0.0)
