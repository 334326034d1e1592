"""Legs that carry the pelvis from where the feet are: inverse kinematics, compiled.

A leg of six joints has one posture near the last for any pose of pelvis and foot, and with
twists [angular, linear at the foot] in world axes, V_f of the foot and V_b of the pelvis,

    J q̇ = V_f − V_b,

J (6, 6) being the leg's Jacobian. So pelvis, feet and the other joints are coordinates as good
as the joints, in which a foot that stands is one that does not change.

Source: K. M. Lynch, F. C. Park, "Modern Robotics", 2017, ch. 6.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.exceptions import RobotModelError
from robomirror_drake.messages import Array
from robomirror_drake.optimization.kinematics import Indices, Points, Tree, make_points, make_tree
from robomirror_drake.robot import FEET, Robot

LEG, KNEE = 6, 3
"""Joints of a leg, three of them in the hip, and which is the knee."""

_STEPS, _LARGEST, _SOLVED = 12, 0.25, 1e-12
_DAMPING = 1e-8  # added to J Jᵀ: bends the way near a straight leg, not its end


class Legs(NamedTuple):
    """The robot's legs.

    Attributes:
        tree: All bodies.
        chain: (2, 6) bodies of each leg, hip first; the last is the foot. Body b is moved by
            joint b − 1.
        upper: (U,) joints that are in no leg.
        corners: The 8 sole corners, left foot first.
    """

    tree: Tree
    chain: Indices
    upper: Indices
    corners: Points


def make_legs(robot: Robot) -> Legs:
    """The legs of a robot.

    Raises:
        RobotModelError: A leg has not six joints.
    """
    tree = make_tree(robot)
    points = make_points(
        robot,
        [(robot.spec.feet[f].link, corner) for f in FEET for corner in robot.spec.feet[f].corners],
    )
    chains = []
    for foot, body in zip(FEET, points.body[[0, 4]], strict=True):
        chain = [int(body)]
        while tree.parent[chain[0]] > 0:
            chain.insert(0, int(tree.parent[chain[0]]))
        if len(chain) != LEG:
            raise RobotModelError(
                f"the {foot} leg of robot {robot.spec.name!r} has {len(chain)} joints: adapting "
                f"by optimisation needs legs of {LEG}"
            )
        chains.append(chain)
    made = np.array(chains, dtype=np.int64)
    rest = np.setdiff1d(np.arange(len(tree.parent) - 1), made - 1)
    return Legs(tree, made, rest, points)


def solve_legs(
    legs: Legs, base: tuple[Array, Array], feet: tuple[Array, Array], joints: Array
) -> tuple[Array, Array]:
    """Leg joints for poses of pelvis and feet.

    Args:
        legs: The robot's legs.
        base: (N, 3, 3) rotations and (N, 3) positions of the pelvis in world [m].
        feet: (N, 2, 3, 3) and (N, 2, 3) likewise of the feet's bodies.
        joints: (N, J) where to start; what is in no leg stays.

    Returns:
        (N, J) joints, and (N, 2) how far the feet are from where they should be [m, rad].
    """
    solved = joints.copy()
    miss = np.empty((len(joints), 2))
    _solve(legs.tree, legs.chain, *base, *feet, solved, miss)
    return solved, miss


@njit(cache=True)
def _place(tree, chain, R0, p0, q, R, axes, origins, p):  # type: ignore[no-untyped-def]
    """Pose R (3, 3), p (3,) of the foot; world axes and origins (6, 3) of the leg's joints."""
    R[:] = R0
    p[:] = p0
    A, E = np.empty((3, 3)), np.empty((3, 3))
    for i in range(6):
        b = chain[i]
        for r in range(3):
            for c in range(3):
                p[r] += R[r, c] * tree.offset[b, c]
                A[r, c] = 0.0
                for k in range(3):
                    A[r, c] += R[r, k] * tree.rotation[b, k, c]
        s, c = np.sin(q[b - 1]), np.cos(q[b - 1])
        u = tree.axis[b]
        for r in range(3):
            for k in range(3):
                E[r, k] = (1 - c) * u[r] * u[k]
            E[r, r] += c
        for r in range(3):
            k, m = (r + 1) % 3, (r + 2) % 3
            E[r, k] -= s * u[m]
            E[k, r] += s * u[m]
        for r in range(3):
            origins[i, r] = p[r]
            axes[i, r] = 0.0
            for k in range(3):
                axes[i, r] += A[r, k] * u[k]
                R[r, k] = A[r, 0] * E[0, k] + A[r, 1] * E[1, k] + A[r, 2] * E[2, k]


@njit(cache=True)
def _solve(tree, chains, base_R, base_p, foot_R, foot_p, joints, miss):  # type: ignore[no-untyped-def]
    R, p = np.empty((3, 3)), np.empty(3)
    axes, origins = np.empty((6, 3)), np.empty((6, 3))
    J, error = np.empty((6, 6)), np.empty(6)
    for t in range(joints.shape[0]):
        for leg in range(2):
            for _ in range(_STEPS):
                _place(tree, chains[leg], base_R[t], base_p[t], joints[t], R, axes, origins, p)
                _error(R, p, foot_R[t, leg], foot_p[t, leg], error)
                miss[t, leg] = np.sqrt(np.sum(error**2))
                if miss[t, leg] < _SOLVED:
                    break
                for i in range(6):
                    for r in range(3):
                        k, m = (r + 1) % 3, (r + 2) % 3
                        J[r, i] = axes[i, r]
                        J[3 + r, i] = axes[i, k] * (p[m] - origins[i, m]) - axes[i, m] * (
                            p[k] - origins[i, k]
                        )
                damped = J @ J.T
                for i in range(6):
                    damped[i, i] += _DAMPING
                step = J.T @ np.linalg.solve(damped, error)
                most = np.max(np.abs(step))
                share = min(1.0, _LARGEST / most) if most > 0.0 else 1.0
                for i in range(6):
                    joints[t, chains[leg, i] - 1] += share * step[i]


@njit(cache=True)
def _error(R, p, R_to, p_to, error):  # type: ignore[no-untyped-def]
    """Rotation vector and translation (6,) in world from one pose to another."""
    trace = 0.0
    for r in range(3):
        k, m = (r + 1) % 3, (r + 2) % 3
        error[r] = 0.0
        for i in range(3):  # of R_to Rᵀ: entry (m, k) less (k, m), twice sin times the axis
            error[r] += 0.5 * (R_to[m, i] * R[k, i] - R_to[k, i] * R[m, i])
            trace += R_to[r, i] * R[r, i]
        error[3 + r] = p_to[r] - p[r]
    sine = np.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
    if sine > 1e-9:
        factor = np.arctan2(sine, 0.5 * (trace - 1.0)) / sine
        for r in range(3):
            error[r] *= factor
