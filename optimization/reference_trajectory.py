"""A reference as a function of time, for a controller that samples it at its own rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization.floating_base import continuous
from robomirror_drake.optimization.plan_frames import Frames, soles
from robomirror_drake.robot import Robot

LEAST_SHARE = 0.02
"""Share of its full force that a corner may bear at the ends of its contact."""

AIRBORNE = 0.008
"""Height from which on a corner bears nothing, whatever the reference's contacts say [m]."""


class ReferenceTrajectory(NamedTuple):
    """A reference in Pinocchio's order, with what interpolation needs.

    Attributes:
        time: (T,) [s].
        q: (T, 30) positions; successive quaternions lie in the same hemisphere.
        qdot: (T, 30) their time derivatives.
        v: (T, 29) velocities.
        a: (T, 29) time derivatives of v.
        force: (T, 2, 6) planned wrench about each sole's centre, world axes, [force, moment].
        on: (T, 2, 4) when the current contact of a corner began, or the next one will, +inf
            if none does [s].
        off: (T, 2, 4) when it will end, or when the last one did, -inf if there was none [s].
        contact: (T, 2, 4) whether the corner is on the ground.
        planned: Whether ``force`` means something.
    """

    time: Array
    q: Array
    qdot: Array
    v: Array
    a: Array
    force: Array
    on: Array
    off: Array
    contact: BoolArray
    planned: bool


class ReferenceSample(NamedTuple):
    """A reference at one time, in Pinocchio's order.

    Attributes:
        q, v, a: (30,), (29,), (29,).
        force: (2, 6) planned wrench about each sole's centre, world axes, [force, moment].
        load: (2, 4) share of its full force that each corner may bear, 0 without contact.
        wait: (2, 4) time until the next contact of a corner without one [s].
        left: (2, 4) time until a corner's contact ends, negative since the last one did [s].
    """

    q: Array
    v: Array
    a: Array
    force: Array
    load: Array
    wait: Array
    left: Array


def reference_trajectory(robot: Robot, reference: RobotReference) -> ReferenceTrajectory:
    """Prepares a reference for :func:`sample_reference`."""
    q = robot.to_pinocchio(continuous(reference.q))
    v = robot.v_to_pinocchio(reference.q, reference.v)
    a = robot.a_to_pinocchio(reference.q, reference.v, reference.a)
    qdot = np.concatenate(
        [reference.v[:, 3:6], _quaternion_rate(q[:, 3:7], v[:, 3:6]), v[:, 6:]], 1
    )
    assert reference.foot_force is not None  # always set by the message itself
    contact = reference.contact & (corner_heights(robot, reference.q) < AIRBORNE)
    on, off = _contact_times(reference.time, contact)
    return ReferenceTrajectory(
        time=reference.time,
        q=q,
        qdot=qdot,
        v=v,
        a=a,
        force=np.roll(reference.foot_force, 3, axis=-1),
        on=on,
        off=off,
        contact=contact,
        planned=reference.planned,
    )


def corner_heights(robot: Robot, q: Array) -> Array:
    """(T, 2, 4) heights of the soles' corners at configurations (T, 30) in Drake's order [m]."""
    return soles(Frames.of(robot).points_of(robot, q))[..., 2]


def _quaternion_rate(quaternion: Array, omega: Array) -> Array:
    """(T, 4) time derivative of quaternions xyzw, ½ q ⊗ ω with ω (T, 3) in the body's frame."""
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    rate = scalar * omega + np.cross(vector, omega)
    return 0.5 * np.concatenate([rate, -np.sum(vector * omega, axis=1, keepdims=True)], axis=1)


def _contact_times(time: Array, contact: BoolArray) -> tuple[Array, Array]:
    """Begin and end of the contact that each corner is in, see :class:`ReferenceTrajectory`.

    A contact that is there at the first sample has been there always; one that is
    there at the last stays.
    """
    stamps = np.broadcast_to(time[:, None, None], contact.shape)
    # Latest sample without contact at or before each sample; the contact began one later.
    last_free = np.maximum.accumulate(np.where(contact, -np.inf, stamps), axis=0)
    following = np.concatenate([stamps[1:], np.full((1, *contact.shape[1:]), np.inf)])
    began = np.maximum.accumulate(np.where(contact, -np.inf, following), axis=0)
    coming = np.minimum.accumulate(np.where(contact, stamps, np.inf)[::-1], axis=0)[::-1]
    on = np.where(contact, np.where(np.isinf(last_free), -np.inf, began), coming)
    ends = np.minimum.accumulate(np.where(contact, np.inf, stamps)[::-1], axis=0)[::-1]
    left = np.maximum.accumulate(np.where(contact, following, -np.inf), axis=0)
    return on, np.where(contact, ends, left)


def sample_reference(trajectory: ReferenceTrajectory, time: float, ramp: float) -> ReferenceSample:
    """The reference at a time; before its start and after its end it stands still.

    Positions follow cubic Hermite polynomials through the samples, velocities too,
    accelerations and forces are linear in between.

    Args:
        trajectory: From :func:`reference_trajectory`.
        time: Since the reference's own zero [s].
        ramp: Time in which a corner takes up, and gives off, its full load [s].
    """
    samples = trajectory
    last = len(samples.time) - 1
    inside = samples.time[0] <= time < samples.time[last]
    clamped = min(max(time, samples.time[0]), samples.time[last])
    right = min(max(int(np.searchsorted(samples.time, clamped, side="right")), 1), last)
    q, v, a, force = _interpolate(
        clamped,
        samples.time[right - 1 : right + 1],
        samples.q[right - 1 : right + 1],
        samples.qdot[right - 1 : right + 1],
        samples.v[right - 1 : right + 1],
        samples.a[right - 1 : right + 1],
        samples.force[right - 1 : right + 1],
    )
    if not inside:
        v, a = np.zeros_like(v), np.zeros_like(a)
    row = right if clamped >= samples.time[right] else right - 1
    since, left = time - samples.on[row], samples.off[row] - time
    ramped = np.clip(np.minimum(since, left) / ramp, LEAST_SHARE, 1.0)
    load = np.where(samples.contact[row], ramped, 0.0)
    return ReferenceSample(q, v, a, force, load, -since, left)


@njit(cache=True)
def _interpolate(  # type: ignore[no-untyped-def]
    time, span, q, qdot, v, a, force
):
    step = span[1] - span[0]
    s = (time - span[0]) / step
    h00 = (1.0 + 2.0 * s) * (1.0 - s) ** 2
    h10 = s * (1.0 - s) ** 2 * step
    h01 = s * s * (3.0 - 2.0 * s)
    h11 = s * s * (s - 1.0) * step
    position = h00 * q[0] + h10 * qdot[0] + h01 * q[1] + h11 * qdot[1]
    position[3:7] /= np.sqrt(np.sum(position[3:7] ** 2))
    velocity = h00 * v[0] + h10 * a[0] + h01 * v[1] + h11 * a[1]
    acceleration = (1.0 - s) * a[0] + s * a[1]
    return position, velocity, acceleration, (1.0 - s) * force[0] + s * force[1]
