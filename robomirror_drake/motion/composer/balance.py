"""The path of the centre of mass that a schedule of footprints allows."""

from __future__ import annotations

import numba
import numpy as np
from scipy.linalg import solveh_banded

from robomirror_drake.messages import Array

GRAVITY = 9.81


def center_of_mass_path(
    zmp: Array, height: Array, angular: Array, dt: float, jerk_weight: float = 2e-6
) -> Array:
    """Horizontal path of the centre of mass whose zero-moment point follows a reference.

    Least squares over all samples c_k of one path per horizontal axis::

        min  Σ [(1 + z̈/g)(c − p) − (z/g) c̈ + l]² + w Σ (d³c/dt³)²,   at rest over p at both ends

    The first term is the moment about the reference p divided by m·g: on flat ground it is the
    linear inverted pendulum (S. Kajita et al., "Biped walking pattern generation by using preview
    control of zero-moment point", ICRA 2003), with what the limbs add, and in flight, where
    z̈ = −g, it asks for c̈ = 0.

    Args:
        zmp: (T, 2) reference of the zero-moment point [m].
        height: (T,) height of the centre of mass above the floor [m].
        angular: (T, 2) l, the change of angular momentum about the centre of mass as it moves
            the zero-moment point, see :func:`angular_moment` [m].
        dt: Sampling time [s].
        jerk_weight: w [m⁻²s⁶ per m²], smoothness against exactness.

    Returns:
        (T, 2) path [m].
    """
    n = len(zmp)
    upward = np.zeros(n)
    upward[1:-1] = np.diff(height, 2) / dt**2
    weight = 1.0 + upward / GRAVITY
    # Rows of the moment: tridiagonal; of the jerk: four entries. Both fit a band of 3 above.
    spring = height / (GRAVITY * dt**2)
    moment = np.stack([-spring, weight + 2.0 * spring, -spring], axis=1)[1:-1]
    target = (weight[:, None] * zmp - np.clip(weight, 0.0, 1.0)[:, None] * angular)[1:-1]
    jerk = np.tile(np.sqrt(jerk_weight) / dt**3 * np.array([-1.0, 3.0, -3.0, 1.0]), (n - 3, 1))
    band = np.zeros((4, n))
    rhs = np.zeros((n, 2))
    for rows in (moment, jerk):
        width = rows.shape[1]
        for i in range(width):
            for j in range(i, width):
                band[3 - (j - i), j : j + len(rows)] += rows[:, i] * rows[:, j]
    for i in range(3):
        rhs[i : i + n - 2] += moment[:, i, None] * target
    # Rest at both ends: three equal samples, as stiff rows.
    stiff = 1e6
    ends = np.r_[0:3, n - 3 : n]
    band[3, ends] += stiff
    rhs[ends] += stiff * zmp[ends]
    path: Array = solveh_banded(band, rhs)
    return path


def angular_moment(points: Array, masses: Array, dt: float) -> Array:
    """What limbs add to the moment about the floor beside the centre of mass, per weight.

    Args:
        points: (T, n, 3) point masses [m].
        masses: (n,) share of each in the whole, with sum 1.
        dt: Sampling time [s].

    Returns:
        (T, 2) moment divided by m·g, as a shift of the zero-moment point along x and y [m].
    """

    shift = np.zeros((len(points), 2))
    _limb_moment(points, masses, dt, shift)
    return shift


@numba.njit(cache=True)
def _limb_moment(points: Array, masses: Array, dt: float, out: Array) -> None:
    """Moment of each point mass less that of all of them at their centre."""
    com, acceleration = np.empty(3), np.empty(3)
    for t in range(1, len(points) - 1):
        com[:], acceleration[:] = 0.0, 0.0
        for j in range(len(masses)):
            before, now, after = points[t - 1, j], points[t, j], points[t + 1, j]
            lifted = (after[2] - 2.0 * now[2] + before[2]) / (dt * dt) / GRAVITY + 1.0
            for i in range(3):
                a = (after[i] - 2.0 * now[i] + before[i]) / (dt * dt)
                com[i] += masses[j] * now[i]
                acceleration[i] += masses[j] * a
                if i < 2:
                    out[t, i] += masses[j] * (lifted * now[i] - now[2] * a / GRAVITY)
        lifted = acceleration[2] / GRAVITY + 1.0
        for i in range(2):
            out[t, i] -= lifted * com[i] - com[2] * acceleration[i] / GRAVITY
