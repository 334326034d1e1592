"""How far a motion is from another one that means the same."""

from __future__ import annotations

import numpy as np

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.kinematics import body_poses, positions
from robomirror_drake.optimization.retargeting.retarget import robot_tables
from robomirror_drake.robot import Robot, rotation_matrix


def deviation(robot: Robot, one: RobotReference, other: RobotReference) -> float:
    """Mean distance of the keypoints at the same share of both motions [m].

    Tempo alone is no deviation. Both are taken where they stand in the world: candidates of a
    command begin at the same place.
    """
    share = np.linspace(0.0, 1.0, max(len(one.time), len(other.time)))
    a, b = (_keypoints(robot, motion, share) for motion in (one, other))
    return float(np.linalg.norm(a - b, axis=2).mean())


def _keypoints(robot: Robot, motion: RobotReference, share: Array) -> Array:
    """(S, K, 3) at (S,) shares of the motion."""
    tables, q = robot_tables(robot), motion.q[np.rint(share * (len(motion.time) - 1)).astype(int)]
    x = np.hstack([q[:, 4:7], np.zeros((len(q), 3)), q[:, 7:]])
    return positions(tables.keypoints, *body_poses(tables.tree, rotation_matrix(q[:, :4]), x))
