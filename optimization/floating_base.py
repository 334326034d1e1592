"""From spline coordinates to a robot's q, v and a, exactly.

The base's orientation is R = R_ref exp(φ): R_ref is the normalised blend of
control quaternions on the same knots, φ a spline like every other coordinate.
Quaternions are wxyz; with q = q_ref ⊗ e(φ) smooth in time, the angular velocity
in the base's frame is ω = 2 vec(q* ⊗ q̇) and its derivative 2 vec(q* ⊗ q̈).
"""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from robomirror_drake.messages import Array
from robomirror_drake.optimization import spline

# e(φ) = (cos(‖φ‖/2), h(σ) φ), σ = φ·φ; h as a series, exact to rounding for ‖φ‖ < π.
_H = Polynomial([(-1) ** k / (2.0 ** (2 * k + 1) * factorial(2 * k + 1)) for k in range(12)])
_C = Polynomial([(-1) ** k / (2.0 ** (2 * k) * factorial(2 * k)) for k in range(13)])


class Path(NamedTuple):
    """A robot's trajectory as splines on one knot grid.

    Attributes:
        control: (K, 29) control points: base position [m], φ [rad], joints [rad].
        reference: (K, 4) control quaternions of R_ref, wxyz, neighbours in one hemisphere.
        spacing: Distance of the knots [s].
    """

    control: Array
    reference: Array
    spacing: float


class Motion(NamedTuple):
    """A path sampled at T times, in Drake's order: ``q`` (T, 30), ``v``, ``a`` (T, 29)."""

    q: Array
    v: Array
    a: Array


def reference_rotation(basis: spline.Basis, reference: Array) -> Array:
    """(T, 3, 3) R_ref at the samples, of control quaternions (K, 4)."""
    w, x, y, z = _unit(spline.evaluate(basis, reference)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), -1, 0))


def sample(path: Path, time: Array) -> Motion:
    """Positions, velocities and accelerations of a path at times (T,) from its start [s]."""
    basis = spline.basis(time, path.spacing, len(path.control))
    x, xd, xdd = (spline.evaluate(basis, path.control, d) for d in range(3))
    y, yd, ydd = (spline.evaluate(basis, path.reference, d) for d in range(3))
    e, ed, edd = _exponential(x[:, 3:6], xd[:, 3:6], xdd[:, 3:6])
    q = product(y, e)
    qd = product(yd, e) + product(y, ed)
    qdd = product(ydd, e) + 2.0 * product(yd, ed) + product(y, edd)
    # R_ref's blend is not of unit length, which the division and the last term undo.
    square = np.sum(q * q, axis=1, keepdims=True)
    inverse = q * [1, -1, -1, -1] / square
    omega = 2.0 * product(inverse, qd)[:, 1:]
    alpha = 2.0 * product(inverse, qdd)[:, 1:]
    alpha -= omega * 2.0 * np.sum(q * qd, axis=1, keepdims=True) / square
    unit = _unit(q)
    return Motion(
        q=np.hstack([unit, x[:, :3], x[:, 6:]]),
        v=np.hstack([_rotate(unit, omega), xd[:, :3], xd[:, 6:]]),
        a=np.hstack([_rotate(unit, alpha), xdd[:, :3], xdd[:, 6:]]),
    )


def continuous(q: Array) -> Array:
    """(T, n) configurations, quaternion first, whose successive quaternions lie in one hemisphere.

    Args:
        q: (T, n) positions in Drake's order, or quaternions alone.
    """
    flips = np.where(np.sum(q[1:, :4] * q[:-1, :4], axis=1) < 0.0, -1.0, 1.0)
    signs = np.cumprod(np.concatenate([[1.0], flips]))
    return np.hstack([signs[:, None] * q[:, :4], q[:, 4:]])


def product(a: Array, b: Array) -> Array:
    """(T, 4) quaternion products a ⊗ b."""
    w, u = a[:, :1], a[:, 1:]
    s, v = b[:, :1], b[:, 1:]
    real = w * s - np.sum(u * v, axis=1, keepdims=True)
    return np.hstack([real, w * v + s * u + np.cross(u, v)])


def _exponential(phi: Array, phid: Array, phidd: Array) -> tuple[Array, Array, Array]:
    """(T, 4) e(φ) and its first and second time derivative."""
    s = np.sum(phi * phi, axis=1, keepdims=True)
    sd = 2.0 * np.sum(phi * phid, axis=1, keepdims=True)
    sdd = 2.0 * np.sum(phid * phid + phi * phidd, axis=1, keepdims=True)
    c, cd, cdd = _C(s), _C.deriv()(s), _C.deriv(2)(s)
    h, hd, hdd = _H(s), _H.deriv()(s), _H.deriv(2)(s)
    rate = hd * sd
    return (
        np.hstack([c, h * phi]),
        np.hstack([cd * sd, rate * phi + h * phid]),
        np.hstack(
            [
                cdd * sd**2 + cd * sdd,
                (hdd * sd**2 + hd * sdd) * phi + 2.0 * rate * phid + h * phidd,
            ]
        ),
    )


def _unit(q: Array) -> Array:
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def _rotate(q: Array, x: Array) -> Array:
    """(T, 3) vectors turned by unit quaternions."""
    t = 2.0 * np.cross(q[:, 1:], x)
    return np.asarray(x + q[:, :1] * t + np.cross(q[:, 1:], t))
