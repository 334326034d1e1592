"""Compiled arithmetic of the whole-body QP; :mod:`whole_body_qp` says what it is for."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit

GENERATORS = 4
"""Edges of the friction pyramid in each corner."""

FORCE_UNIT = 100.0
"""Normal force of a generator at 1 [N]; brings forces and accelerations to one magnitude."""


FLOOR = 0.005
"""Height below which a foot of the reference is on the floor [m]."""

PIVOTING = 1.0
"""Rate of turning from which on a foot on the floor pivots altogether [rad/s]."""

PIVOT_STIFFNESS = 200.0
"""With which it follows the reference's then [1/s²]."""


@njit(cache=True)
def rotation_error(R_ref, R):
    """(3,) rotation vector in world axes that turns R into R_ref; zero where it is ambiguous."""
    E = R_ref @ R.T
    axis = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    sine = np.sqrt(np.sum(axis * axis))
    if sine < 1e-9:
        return axis
    return axis * (np.arctan2(sine, 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0)) / sine)


@njit(cache=True)
def _shift_matrix(J, v, a, r):
    """Jacobian, velocity, acceleration of the point at r (world axes) of a moving frame."""
    J, v, a = J.copy(), v.copy(), a.copy()
    for c in range(J.shape[1]):
        J[0, c] += J[4, c] * r[2] - J[5, c] * r[1]
        J[1, c] += J[5, c] * r[0] - J[3, c] * r[2]
        J[2, c] += J[3, c] * r[1] - J[4, c] * r[0]
    omega = v[3:].copy()
    spin = np.cross(omega, r)
    v[:3] += spin
    a[:3] += np.cross(a[3:], r) + np.cross(omega, spin)
    return J, v, a


@njit(cache=True)
def _slide(p, v, a, r, error):
    """Velocity (6,) over the floor of a foot at its point p + r, acceleration (6,) to follow it.

    Zero for a foot in the air: what it does there is nothing for one that stands already.
    One that pivots or slides makes good its error (6,), one that stands does not.
    """
    slide_v, slide_a = np.zeros(6), np.zeros(6)
    if p[2] + r[2] < FLOOR:
        spin = np.cross(v[3:], r)
        slide_v[:2] = (v[:3] + spin)[:2]
        slide_a[:2] = (a[:3] + np.cross(a[3:], r) + np.cross(v[3:], spin))[:2]
        slide_v[5], slide_a[5] = v[5], a[5]
        moving = min(1.0, abs(v[5]) / PIVOTING)
        slide_a[:2] += moving * PIVOT_STIFFNESS * error[:2]
        slide_a[5] += moving * PIVOT_STIFFNESS * error[5]
    return slide_v, slide_a


@njit(cache=True)
def contact_generators(R, corners, load, friction, corner_force):
    """Wrenches of the force generators of all loaded corners.

    Returns:
        (2, 6, g) wrench about each sole's centre [force, moment] of a unit generator,
        (g,) the most that each may bear.
    """
    count = GENERATORS * int(np.sum(load > 0.0))
    W, cap = np.zeros((2, 6, count)), np.empty(count)
    g = 0
    for foot in range(2):
        for corner in range(4):
            if load[foot, corner] <= 0.0:
                continue
            r = R[foot] @ corners[foot, corner]
            for edge in range(GENERATORS):
                d = np.array([0.0, 0.0, 1.0])
                d[edge // 2] = friction * (1.0 - 2.0 * (edge % 2))
                W[foot, :3, g] = FORCE_UNIT * d
                W[foot, 3:, g] = FORCE_UNIT * np.cross(r, d)
                cap[g] = load[foot, corner] * corner_force / FORCE_UNIT
                g += 1
    return W, cap


@njit(cache=True)
def task_rows(
    gains, momentum, J, mass, com, angular, R, p, v, a,
    ref_com, ref_angular, ref_R, ref_p, ref_v, ref_a,
    corners, load, anchor, swing_limit,
):  # fmt: skip
    """The tasks as rows ``T q̈ = t`` with weights.

    Rows: centre of mass 3, angular momentum 3, pelvis 3, trunk 3, left foot 6, right
    foot 6. A foot's linear rows are those of the middle of its loaded corners, or of
    its sole's centre in swing. A foot that stands moves as the reference's over the floor,
    which is not at all unless it pivots.
    """
    T, t, w = np.empty((24, J.shape[2])), np.empty(24), np.empty(24)
    T[:3] = momentum[:3] / mass
    T[3:6] = momentum[3:]
    for i in range(3):
        weight, stiffness, damping = gains[1 if i == 2 else 0]
        w[i] = weight
        t[i] = (
            ref_com[2, i]
            - com[2, i]
            + stiffness * (ref_com[0, i] - com[0, i])
            + damping * (ref_com[1, i] - com[1, i])
        )
    weight, stiffness, damping = gains[2]
    w[3:6] = weight
    t[3:6] = ref_angular[1] - angular[1] + damping * (ref_angular[0] - angular[0])
    for k in range(2):
        rows = slice(6 + 3 * k, 9 + 3 * k)
        weight, stiffness, damping = gains[3 + k]
        T[rows] = J[k, 3:]
        w[rows] = weight
        t[rows] = (
            ref_a[k, 3:]
            - a[k, 3:]
            + stiffness * rotation_error(ref_R[k], R[k])
            + damping * (ref_v[k, 3:] - v[k, 3:])
        )
    for foot in range(2):
        k = 2 + foot
        first = 12 + 6 * foot
        linear, turning = slice(first, first + 3), slice(first + 3, first + 6)
        middle, loaded = np.zeros(3), 0
        for corner in range(4):
            if load[foot, corner] > 0.0:
                middle += corners[foot, corner]
                loaded += 1
        if loaded > 0:
            middle /= loaded
        r = R[k] @ middle
        J_k, v_k, a_k = _shift_matrix(J[k], v[k], a[k], r)
        T[first : first + 6] = J_k
        ref_r = ref_R[k] @ middle
        away = np.concatenate((ref_p[k] + ref_r - p[k] - r, rotation_error(ref_R[k], R[k])))
        slide_v, slide_a = _slide(ref_p[k], ref_v[k], ref_a[k], ref_r, away)
        weight, stiffness, damping = gains[6 if loaded > 0 else 5]
        w[linear] = weight
        if loaded > 0:
            error = anchor[foot] - p[k] - r
            t[linear] = (
                stiffness * error + damping * (slide_v[:3] - v_k[:3]) + slide_a[:3] - a_k[:3]
            )
        else:
            error = ref_p[k] - p[k]
            rate = ref_v[k, :3] - v_k[:3]
            feedback = stiffness * error + damping * rate
            feedback *= min(1.0, swing_limit / max(np.sqrt(np.sum(feedback**2)), 1e-9))
            t[linear] = ref_a[k, :3] - a_k[:3] + feedback
        weight, stiffness, damping = gains[6 if loaded == 4 else 5]
        w[turning] = weight
        if loaded == 4:
            tilt = np.array([R[k][1, 2], -R[k][0, 2], 0.0])  # turns the sole's normal upright
            t[turning] = stiffness * tilt - damping * v_k[3:] - a_k[3:]
            t[first + 5] += damping * slide_v[5] + slide_a[5]
        else:
            error = rotation_error(ref_R[k], R[k])
            rate = ref_v[k, 3:] - v_k[3:]
            t[turning] = ref_a[k, 3:] - a_k[3:] + stiffness * error + damping * rate
    return T, t, w


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
