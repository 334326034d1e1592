"""References at another tempo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.floating_base import continuous

_EASE = 0.15  # time around a flight in which the tempo changes [s]
_FINE = 8  # steps of the time integral between two samples


def slowed(reference: RobotReference, tempo: float) -> RobotReference:
    """The same motion at a slower tempo, at the same rate of samples.

    Where a foot stands, time is stretched; what flies falls as fast as ever, so around a
    flight the motion keeps its tempo. With the reference's own time τ and rate r = dτ/dt,

        x(t) = x_ref(τ),   v = r v_ref,   a = r² a_ref + r (dr/dτ) v_ref.

    Args:
        reference: Kinematic reference at a constant rate.
        tempo: r where the feet stand, 0 to 1; 1.0 gives the reference back.
    """
    if tempo == 1.0:
        return reference
    own, dt = reference.time - reference.time[0], float(reference.time[1] - reference.time[0])
    fine = np.linspace(0.0, own[-1], _FINE * (len(own) - 1) + 1)
    rate = tempo + (1.0 - tempo) * flying(reference, fine)
    # t(τ) = ∫ dτ / r by the trapezoidal rule, inverted with its known slope.
    middle = 0.5 * (1.0 / rate[1:] + 1.0 / rate[:-1])
    at = np.concatenate([[0.0], np.cumsum(middle * np.diff(fine))])
    # The last sample falls on the motion's end: up to half a time step more or less.
    count = round(at[-1] / dt)
    at, rate = at * (count * dt / at[-1]), rate * (at[-1] / (count * dt))
    time = np.arange(count + 1, dtype=np.float64) * dt
    tau = np.clip(CubicHermiteSpline(at, fine, rate)(time), 0.0, own[-1])
    r = np.interp(tau, fine, rate)[:, None]
    bend = np.interp(tau, fine, np.gradient(rate, fine))[:, None]
    x = continuous(reference.q)
    velocity = CubicHermiteSpline(own, reference.v, reference.a)
    nearest = np.minimum(np.round(tau / dt).astype(int), len(own) - 1)
    q = CubicHermiteSpline(own, x, chart_rate(x, reference.v))(tau)
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    v = velocity(tau)
    assert reference.foot_force is not None  # always set by the message itself
    return replace(
        reference,
        time=time,
        q=q,
        v=r * v,
        a=r**2 * velocity.derivative()(tau) + r * bend * v,
        contact=reference.contact[nearest],
        foot_force=np.zeros((count + 1, 2, 6)),
        planned=False,
    )


def flying(reference: RobotReference, time: Array) -> Array:
    """(F,) 1 in flight, 0 from ``_EASE`` before and after it on, and smooth between."""
    air = reference.time[~reference.contact.any(axis=(1, 2))] - reference.time[0]
    if len(air) == 0:
        return np.zeros_like(time)
    away = np.abs(time[:, None] - air).min(axis=1)
    s = np.clip(1.0 - away / _EASE, 0.0, 1.0)
    return np.asarray(s**2 * (3.0 - 2.0 * s))


def chart_rate(q: Array, v: Array) -> Array:
    """(T, 30) time derivatives of positions (T, 30) from velocities (T, 29)."""
    return np.concatenate([_spun(v[:, :3], q[:, :4]), v[:, 3:]], axis=1)


def chart_acceleration(q: Array, v: Array, a: Array) -> Array:
    """(T, 30) second time derivatives of positions from velocities and accelerations (T, 29)."""
    rate = _spun(v[:, :3], q[:, :4])
    return np.concatenate([_spun(a[:, :3], q[:, :4]) + _spun(v[:, :3], rate), a[:, 3:]], axis=1)


def _spun(w: Array, r: Array) -> Array:
    """(T, 4) ½ ω r, with ω (T, 3) in world and quaternions r (T, 4) wxyz."""
    scalar = -0.5 * np.sum(w * r[:, 1:], axis=1, keepdims=True)
    return np.concatenate([scalar, 0.5 * (r[:, :1] * w + np.cross(w, r[:, 1:]))], axis=1)
