"""Compiled arithmetic of the whole-body QP; :mod:`.qp` says what it is for."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit

from robomirror_drake.optimization.control.pinocchio_kernels import cross, turn

GENERATORS = 4
"""Edges of the friction pyramid in each corner."""

FORCE_UNIT = 100.0
"""Normal force of a generator at 1 [N]; brings forces and accelerations to one magnitude."""


@njit(cache=True)
def finite(vector):
    """Whether all of a vector's elements are finite numbers."""
    return np.isfinite(vector).all()


@njit(cache=True)
def contact_generators(R, corners, load, friction, corner_force):
    """Wrenches of the force generators of all loaded corners.

    Returns:
        (2, 6, g) wrench about each sole's centre [force, moment] of a unit generator,
        (g,) the most that each may bear.
    """
    count = 0
    for foot in range(2):
        for corner in range(4):
            count += GENERATORS * (load[foot, corner] > 0.0)
    W, cap = np.zeros((2, 6, count)), np.empty(count)
    r, force, moment = np.empty(3), np.empty(3), np.empty(3)
    g = 0
    for foot in range(2):
        for corner in range(4):
            if load[foot, corner] <= 0.0:
                continue
            turn(R[foot], corners[foot, corner], r)
            for edge in range(GENERATORS):
                force[0] = force[1] = 0.0
                force[edge // 2] = FORCE_UNIT * friction * (1.0 - 2.0 * (edge % 2))
                force[2] = FORCE_UNIT
                cross(r, force, moment)
                for i in range(3):
                    W[foot, i, g], W[foot, 3 + i, g] = force[i], moment[i]
                cap[g] = load[foot, corner] * corner_force / FORCE_UNIT
                g += 1
    return W, cap


@njit(cache=True)
def joint_bounds(joints, rates, lower, upper, horizon, limit):
    """Accelerations that keep the joints within their limits over a horizon, (23,), (23,)."""
    low = 2.0 * (lower - joints - rates * horizon) / horizon**2
    high = 2.0 * (upper - joints - rates * horizon) / horizon**2
    return np.minimum(np.maximum(low, -limit), 0.9 * limit), np.maximum(
        np.minimum(high, limit), -0.9 * limit
    )


@njit(cache=True)
def eliminate_base(M, h, J_feet, W):
    """Solves the floating base's rows for its acceleration.

    Returns:
        N (29, x), n (29,) with q̈ = N x + n; S (23, x), s (23,) with τ = S x + s, over
        x = (joint accelerations, generators).
    """
    nv = M.shape[0]
    joints, count = nv - 6, W.shape[2]
    F = J_feet[0].T @ W[0] + J_feet[1].T @ W[1]  # generalised forces of the generators
    inverse = np.linalg.inv(M[:6, :6])
    N, n = np.zeros((nv, joints + count)), np.zeros(nv)
    N[:6, :joints] = -inverse @ np.ascontiguousarray(M[:6, 6:])
    N[:6, joints:] = inverse @ np.ascontiguousarray(F[:6])
    n[:6] = -inverse @ h[:6]
    for j in range(joints):
        N[6 + j, j] = 1.0
    M_jb = np.ascontiguousarray(M[6:, :6])
    S = M_jb @ N[:6]
    S[:, :joints] += M[6:, 6:]
    S[:, joints:] -= F[6:]
    return N, n, S, M_jb @ n[:6] + h[6:]


@njit(cache=True)
def cost(
    T, t, w, N, n, posture, posture_target, W, force, force_weight, acceleration_cost, force_cost
):
    """P (x, x) and q (x,) of the weighted sum of squares."""
    joints, size = posture.shape[0], N.shape[1]
    base = np.ascontiguousarray(T[:, :6])
    E = base @ N[:6]
    E[:, :joints] += T[:, 6:]
    e = (t - base @ n[:6]) * w
    for row in range(E.shape[0]):
        E[row] *= w[row]
    P = E.T @ E
    q = -(E.T @ e)
    for j in range(joints):
        P[j, j] += posture[j] ** 2 + acceleration_cost
        q[j] -= posture[j] ** 2 * posture_target[j]
    for g in range(joints, size):
        P[g, g] += force_cost * FORCE_UNIT**2
    if force_weight > 0.0:
        F, f = np.empty((12, size - joints)), np.empty(12)
        for row in range(12):
            foot, axis = row // 6, row % 6
            # A moment counts like the force at 0.1 m that makes it.
            weight = force_weight if axis < 3 else 10.0 * force_weight
            F[row] = weight * W[foot, axis]
            f[row] = weight * force[foot, axis]
        P[joints:, joints:] += F.T @ F
        q[joints:] -= F.T @ f
    return P, q
