"""Brings what Pinocchio wrote into world axes and the controller's order, in one call each."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def cross(a, b, out):
    """The cross product of two vectors (3,) into a third."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def turn(R, x, out):
    """A vector (3,) turned by a rotation (3, 3) into another one."""
    for i in range(3):
        out[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@njit(cache=True)
def motion_in_world(seen, arms, mass):
    """The fields of :class:`.dynamics_terms.TaskMotion`, of what Pinocchio wrote.

    Args:
        seen: MotionViews of it.
        arms: (4, 3) origins of the task frames in the axes of their joints [m].
        mass: Of the robot [kg].
    """
    com, angular = np.empty((3, 3)), np.empty((2, 3))
    R, p, v, a = np.empty((4, 3, 3)), np.empty((4, 3)), np.empty((4, 6)), np.empty((4, 6))
    for i in range(3):
        com[0, i] = seen.com[i]
        com[1, i], com[2, i] = seen.momentum[i] / mass, seen.force[i] / mass
        angular[0, i], angular[1, i] = seen.momentum[3 + i], seen.force[3 + i]
    spin, surge = np.empty(3), np.empty(3)
    for k in range(4):
        arm, joint_R, joint_v, joint_a = arms[k], seen.joint_R[k], seen.joint_v[k], seen.joint_a[k]
        cross(joint_v[3:], arm, spin)
        cross(joint_a[3:], arm, surge)
        v[k], a[k] = 0.0, 0.0
        for i in range(3):
            p[k, i] = seen.p[k][i]
            for j in range(3):
                R[k, i, j] = seen.R[k][i, j]
                v[k, i] += joint_R[i, j] * (joint_v[j] + spin[j])
                v[k, 3 + i] += joint_R[i, j] * joint_v[3 + j]
                a[k, i] += joint_R[i, j] * (joint_a[j] + surge[j])
                a[k, 3 + i] += joint_R[i, j] * joint_a[3 + j]
        cross(v[k, 3:], v[k, :3], spin)  # from the spatial to the classical acceleration
        for i in range(3):
            a[k, i] += spin[i]
    return com, angular, R, p, v, a


@njit(cache=True)
def dynamics_in_world(seen, p, support, damping, v):
    """M, h, momentum and J of :class:`.dynamics_terms.DynamicsTerms`, of what Pinocchio wrote.

    Args:
        seen: DynamicsViews of it.
        p: (4, 3) origins of the task frames [m].
        support: (4, 29) which velocities move each frame.
        damping, v: (29,) viscous friction [N·m·s/rad] and velocities.
    """
    size = len(v)
    M, h, momentum, J = np.empty((size, size)), np.empty(size), np.empty((6, size)), seen.J
    frames = np.zeros((4, 6, size))
    for c in range(size):
        h[c] = seen.h[c] + damping[c] * v[c]
        for row in range(c + 1):
            M[row, c] = M[c, row] = seen.M[row, c]
        for row in range(6):
            momentum[row, c] = seen.momentum[row, c]
        for k in range(4):
            if support[k, c]:
                x, y, z = p[k]
                frames[k, 0, c] = J[0, c] + J[4, c] * z - J[5, c] * y
                frames[k, 1, c] = J[1, c] + J[5, c] * x - J[3, c] * z
                frames[k, 2, c] = J[2, c] + J[3, c] * y - J[4, c] * x
                for i in range(3, 6):
                    frames[k, i, c] = J[i, c]
    return M, h, momentum, frames
