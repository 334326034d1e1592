"""The whole-body QP's matrices in one compiled call; :mod:`.qp` says what they are."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.optimization.control.kernels import (
    contact_generators,
    cost,
    eliminate_base,
    joint_bounds,
)
from robomirror_drake.optimization.control.task_kernels import task_rows


class Scalars(NamedTuple):
    """The fields of the same names of :class:`.qp.WholeBodyOptions`."""

    swing_feedback: float
    posture_stiffness: float
    posture_damping: float
    planned_force: float
    acceleration_cost: float
    force_cost: float
    friction: float
    corner_force: float
    limit_horizon: float
    acceleration_limit: float


@njit(cache=True)
def assemble(gains, posture, limits, scalars, robot, terms, targets, apart):
    """P, q, G, h, lb, ub, N, n, S, s, W of :class:`.qp.QP`.

    Args:
        gains, posture: As in :class:`.qp.Tuning`.
        limits: (23,), (23,), (23,) lower and upper joint limits [rad], torque limits [N·m].
        scalars: Weights, gains and limits that are one number each.
        robot: (2, 4, 3) sole corners in the frames of the soles [m], mass [kg].
        terms: The robot's DynamicsTerms.
        targets: What is asked for, :class:`.qp.Targets`.
        apart: What keeps links apart, :class:`.collision.ApartRows`.
    """
    (lower, upper, effort), (corners, mass), (A, b) = limits, robot, apart
    at, wanted = terms.motion, targets.motion
    W, cap = contact_generators(
        at.R[2:], corners, targets.load, scalars.friction, scalars.corner_force
    )
    N, n, S, s = eliminate_base(terms.M, terms.h, terms.J[2:], W)
    T, t, w = task_rows(
        *(gains, terms.momentum, terms.J, mass, at.com, at.angular, at.R, at.p, at.v, at.a),
        *(wanted.com, wanted.angular, wanted.R, wanted.p, wanted.v, wanted.a),
        *(corners, targets.load, targets.anchor, scalars.swing_feedback),
    )
    joints, size, near = len(posture), N.shape[1], len(b)
    tracking = np.empty(joints)
    for j in range(joints):
        tracking[j] = (
            targets.a[j]
            + scalars.posture_stiffness * (targets.q[j] - terms.joints[j])
            + scalars.posture_damping * (targets.v[j] - terms.rates[j])
        )
    force_weight = scalars.planned_force if targets.planned else 0.0
    P, q = cost(
        *(T, t, w, N, n, posture, tracking, W, targets.force),
        *(force_weight, scalars.acceleration_cost, scalars.force_cost),
    )
    lb, ub = np.zeros(size), np.empty(size)
    lb[:joints], ub[:joints] = joint_bounds(
        *(terms.joints, terms.rates, lower, upper),
        *(scalars.limit_horizon, scalars.acceleration_limit),
    )
    ub[joints:] = cap
    G, h = np.zeros((2 * joints + near, size)), np.empty(2 * joints + near)
    G[:joints], h[:joints] = S, effort - s
    G[joints : 2 * joints], h[joints : 2 * joints] = -S, effort + s
    G[2 * joints :, :joints], h[2 * joints :] = -A, -b
    return P, q, G, h, lb, ub, N, n, S, s, W
