"""The tasks of whole-body control as weighted rows on the accelerations, compiled."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit

from robomirror_drake.optimization.control.pinocchio_kernels import cross, turn

FLOOR = 0.005
"""Height below which a foot of the reference is on the floor [m]."""

PIVOTING = 1.0
"""Rate of turning from which on a foot on the floor pivots altogether [rad/s]."""

PIVOT_STIFFNESS = 200.0
"""With which it follows the reference's then [1/s²]."""


@njit(cache=True)
def rotation_error(R_ref, R):
    """(3,) rotation vector in world axes that turns R into R_ref; zero where it is ambiguous."""
    E, axis = np.zeros((3, 3)), np.empty(3)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                E[i, j] += R_ref[i, k] * R[j, k]
    square = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        axis[i] = 0.5 * (E[k, j] - E[j, k])
        square += axis[i] ** 2
    sine = np.sqrt(square)
    if sine >= 1e-9:
        angle = np.arctan2(sine, 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0))
        for i in range(3):
            axis[i] *= angle / sine
    return axis


@njit(cache=True)
def _moved_point(v, a, r, v_r, a_r):
    """Velocity and acceleration (6,) of the point at r (world axes) of a moving frame."""
    spin, surge, bend = np.empty(3), np.empty(3), np.empty(3)
    cross(v[3:], r, spin)
    cross(a[3:], r, surge)
    cross(v[3:], spin, bend)
    for i in range(3):
        v_r[i], v_r[3 + i] = v[i] + spin[i], v[3 + i]
        a_r[i], a_r[3 + i] = a[i] + surge[i] + bend[i], a[3 + i]


@njit(cache=True)
def _slide(height, v, a, error, slide_v, slide_a):
    """Velocity (6,) over the floor of a foot's point at a height, acceleration (6,) to follow it.

    Zero for a foot in the air: what it does there is nothing for one that stands already.
    One that pivots or slides makes good its error (6,), one that stands does not.
    """
    moving = min(1.0, abs(v[5]) / PIVOTING)
    for i in range(6):
        slide_v[i] = slide_a[i] = 0.0
        if height < FLOOR and i in (0, 1, 5):
            slide_v[i] = v[i]
            slide_a[i] = a[i] + moving * PIVOT_STIFFNESS * error[i]


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
    for c in range(J.shape[2]):
        for i in range(3):
            T[i, c], T[3 + i, c] = momentum[i, c] / mass, momentum[3 + i, c]
            T[6 + i, c], T[9 + i, c] = J[0, 3 + i, c], J[1, 3 + i, c]
    for i in range(3):
        weight, stiffness, damping = gains[1 if i == 2 else 0]
        w[i] = weight
        t[i] = (
            ref_com[2, i]
            - com[2, i]
            + stiffness * (ref_com[0, i] - com[0, i])
            + damping * (ref_com[1, i] - com[1, i])
        )
        w[3 + i] = gains[2, 0]
        t[3 + i] = ref_angular[1, i] - angular[1, i]
        t[3 + i] += gains[2, 2] * (ref_angular[0, i] - angular[0, i])
    for k in range(2):
        weight, stiffness, damping = gains[3 + k]
        error = rotation_error(ref_R[k], R[k])
        for i in range(3):
            w[6 + 3 * k + i] = weight
            t[6 + 3 * k + i] = (
                ref_a[k, 3 + i]
                - a[k, 3 + i]
                + stiffness * error[i]
                + damping * (ref_v[k, 3 + i] - v[k, 3 + i])
            )
    for foot in range(2):
        _foot_rows(
            *(gains, J[2 + foot], R[2 + foot], p[2 + foot], v[2 + foot], a[2 + foot]),
            *(ref_R[2 + foot], ref_p[2 + foot], ref_v[2 + foot], ref_a[2 + foot]),
            *(corners[foot], load[foot], anchor[foot], swing_limit),
            *(T[12 + 6 * foot : 18 + 6 * foot], t[12 + 6 * foot :], w[12 + 6 * foot :]),
        )
    return T, t, w


@njit(cache=True)
def _foot_rows(
    gains, J, R, p, v, a, ref_R, ref_p, ref_v, ref_a, corners, load, anchor, swing_limit, T, t, w
):  # fmt: skip
    """The six rows of a foot, into T, t, w."""
    middle, loaded = np.zeros(3), 0
    for corner in range(4):
        if load[corner] > 0.0:
            loaded += 1
            for i in range(3):
                middle[i] += corners[corner, i]
    if loaded > 0:
        middle /= loaded
    r, ref_r, away = np.empty(3), np.empty(3), np.empty(6)
    turn(R, middle, r)
    turn(ref_R, middle, ref_r)
    v_r, a_r, ref_v_r, ref_a_r = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    _moved_point(v, a, r, v_r, a_r)
    _moved_point(ref_v, ref_a, ref_r, ref_v_r, ref_a_r)
    for c in range(J.shape[1]):
        x, y, z = J[3, c], J[4, c], J[5, c]
        T[0, c], T[3, c] = J[0, c] + y * r[2] - z * r[1], x
        T[1, c], T[4, c] = J[1, c] + z * r[0] - x * r[2], y
        T[2, c], T[5, c] = J[2, c] + x * r[1] - y * r[0], z
    error = rotation_error(ref_R, R)
    for i in range(3):
        away[i], away[3 + i] = ref_p[i] + ref_r[i] - p[i] - r[i], error[i]
    slide_v, slide_a = np.empty(6), np.empty(6)
    _slide(ref_p[2] + ref_r[2], ref_v_r, ref_a_r, away, slide_v, slide_a)
    weight, stiffness, damping = gains[6 if loaded > 0 else 5]
    if loaded > 0:
        for i in range(3):
            lag = stiffness * (anchor[i] - p[i] - r[i]) + damping * (slide_v[i] - v_r[i])
            t[i] = lag + slide_a[i] - a_r[i]
    else:
        square = 0.0
        for i in range(3):
            t[i] = stiffness * (ref_p[i] - p[i]) + damping * (ref_v[i] - v_r[i])
            square += t[i] ** 2
        share = min(1.0, swing_limit / max(np.sqrt(square), 1e-9))
        for i in range(3):
            t[i] = ref_a[i] - a_r[i] + share * t[i]
    for i in range(3):
        w[i] = weight
    weight, stiffness, damping = gains[6 if loaded == 4 else 5]
    for i in range(3):
        w[3 + i] = weight
        if loaded == 4:
            # Turns the sole's normal upright, and with the reference over the floor.
            tilt = R[1, 2] if i == 0 else -R[0, 2] if i == 1 else 0.0
            t[3 + i] = stiffness * tilt - damping * v_r[3 + i] - a_r[3 + i]
            t[3 + i] += damping * slide_v[3 + i] + slide_a[3 + i]
        else:
            rate = ref_v[3 + i] - v_r[3 + i]
            t[3 + i] = ref_a[3 + i] - a_r[3 + i] + stiffness * error[i] + damping * rate
