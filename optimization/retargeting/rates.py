"""Limits of the joints' speed and acceleration, as augmented-Lagrangian hinges.

A B-spline's derivatives lie in the hull of the differences of its control points c_k (J,), so
with knots h apart the rows are (c_{k+1} − c_k)/h and (c_{k+2} − 2 c_{k+1} + c_k)/h². They are
linear: which of them will be active where a step leads can be told before it is taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from robomirror_drake.messages import Array
from robomirror_drake.optimization.retargeting.limits import Limits

SPEED_PENALTY, ACCELERATION_PENALTY = 1.0, 1e-3
"""Per second of a squared excess [s²/rad², s⁴/rad²]."""

Signs = tuple[npt.NDArray[np.int8], npt.NDArray[np.int8]]


class Rates(NamedTuple):
    """Per difference of the joints' control points, a multiplier or an excess: ``speed``
    (K−1, J) and ``acceleration`` (K−2, J)."""

    speed: Array
    acceleration: Array


def zero(points: int, joints: int) -> Rates:
    """Multipliers to begin with."""
    return Rates(np.zeros((points - 1, joints)), np.zeros((points - 2, joints)))


def excess(limits: Limits, spacing: float, multipliers: Rates, joints: Array) -> Rates:
    """How far the rows of control points (K, J), shifted by λ/ρ, are outside their bounds."""
    speed, bend = _shifted(spacing, multipliers, joints)
    return Rates(
        speed - np.clip(speed, -limits.speed, limits.speed),
        bend - np.clip(bend, -limits.acceleration, limits.acceleration),
    )


def cost(spacing: float, over: Rates) -> float:
    """Cost of what :func:`excess` found."""
    square = SPEED_PENALTY * np.vdot(over.speed, over.speed)
    square += ACCELERATION_PENALTY * np.vdot(over.acceleration, over.acceleration)
    return 0.5 * spacing * float(square)


def updated(spacing: float, over: Rates) -> Rates:
    """The next multipliers, from the excess with the last."""
    return Rates(
        SPEED_PENALTY * spacing * over.speed, ACCELERATION_PENALTY * spacing * over.acceleration
    )


def active(over: Rates) -> Signs:
    """Which rows are outside their upper (1) or lower (−1) bound."""
    return np.sign(over.speed).astype(np.int8), np.sign(over.acceleration).astype(np.int8)


def add(
    limits: Limits,
    spacing: float,
    multipliers: Rates,
    joints: Array,
    rows: Signs,
    gradient: Array,
    band: Array,
) -> None:
    """Adds the active rows, as seen from control points (K, J), to the normal equations.

    Args:
        limits, spacing, multipliers: As for :func:`excess`.
        joints: (K, J) where gradient and band are taken.
        rows: What :func:`active` found where the step is to lead.
        gradient: (K, n) of all coordinates, the joints last; changed in place.
        band: (K n, 4 n) Hessian, changed in place.
    """
    speed, bend = _shifted(spacing, multipliers, joints)
    _add_speed(speed, limits.speed, spacing, rows[0], gradient, band)
    _add_bend(bend, limits.acceleration, spacing, rows[1], gradient, band)


def _shifted(spacing: float, multipliers: Rates, joints: Array) -> tuple[Array, Array]:
    step = joints[1:] - joints[:-1]
    return (
        step / spacing + multipliers.speed / (SPEED_PENALTY * spacing),
        (step[1:] - step[:-1]) / spacing**2
        + multipliers.acceleration / (ACCELERATION_PENALTY * spacing),
    )


@njit(cache=True)
def _add_speed(speed, limit, h, rows, gradient, band):  # type: ignore[no-untyped-def]
    n = gradient.shape[1]
    base = n - speed.shape[1]
    weight = SPEED_PENALTY / h
    for k in range(speed.shape[0]):
        for j in range(speed.shape[1]):
            if rows[k, j] != 0:
                force = SPEED_PENALTY * (speed[k, j] - rows[k, j] * limit[j])
                i = base + j
                gradient[k, i] -= force
                gradient[k + 1, i] += force
                band[k * n + i, 0] += weight
                band[k * n + i, n] -= weight
                band[(k + 1) * n + i, 0] += weight


@njit(cache=True)
def _add_bend(bend, limit, h, rows, gradient, band):  # type: ignore[no-untyped-def]
    n = gradient.shape[1]
    base = n - bend.shape[1]
    weight = ACCELERATION_PENALTY / h**3
    for k in range(bend.shape[0]):
        for j in range(bend.shape[1]):
            if rows[k, j] != 0:
                force = ACCELERATION_PENALTY / h * (bend[k, j] - rows[k, j] * limit[j])
                i = base + j
                gradient[k, i] += force
                gradient[k + 1, i] -= 2.0 * force
                gradient[k + 2, i] += force
                band[k * n + i, 0] += weight
                band[(k + 1) * n + i, 0] += 4.0 * weight
                band[(k + 2) * n + i, 0] += weight
                band[k * n + i, n] -= 2.0 * weight
                band[(k + 1) * n + i, n] -= 2.0 * weight
                band[k * n + i, 2 * n] += weight
