"""A reference as a function of time, for a controller that samples it at its own rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization.floating_base import continuous, product
from robomirror_drake.optimization.planning.frames import Frames, soles
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
    q = continuous(reference.q)
    omega = np.pad(reference.v[:, :3], ((0, 0), (1, 0)))  # in world, as a quaternion
    qdot = np.hstack([0.5 * product(omega, q[:, :4]), reference.v[:, 3:]])
    assert reference.foot_force is not None  # always set by the message itself
    contact = reference.contact & (corner_heights(robot, reference.q) < AIRBORNE)
    on, off = _contact_times(reference.time, contact)
    return ReferenceTrajectory(
        time=reference.time,
        q=robot.to_pinocchio(q),
        qdot=robot.to_pinocchio(qdot),
        v=robot.v_to_pinocchio(reference.q, reference.v),
        a=robot.a_to_pinocchio(reference.q, reference.v, reference.a),
        force=np.roll(reference.foot_force, 3, axis=-1),
        on=on,
        off=off,
        contact=contact,
        planned=reference.planned,
    )


def corner_heights(robot: Robot, q: Array) -> Array:
    """(T, 2, 4) heights of the soles' corners at configurations (T, 30) in Drake's order [m]."""
    return soles(Frames.of(robot).points_of(robot, q))[..., 2]


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


@njit(cache=True)
def latest(time, at):  # type: ignore[no-untyped-def]
    """Index of the latest of the times (T,) that is not after ``at``; 0 if all are."""
    low, high = 0, len(time)
    while high - low > 1:
        middle = (low + high) // 2
        if time[middle] <= at:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True)
def sample_reference(trajectory, time, ramp):  # type: ignore[no-untyped-def]
    """The :class:`ReferenceSample` at a time; before its start and after its end it stands still.

    Positions follow cubic Hermite polynomials through the samples, velocities too,
    accelerations and forces are linear in between.

    Args:
        trajectory: From :func:`reference_trajectory`.
        time: Since the reference's own zero [s].
        ramp: Time in which a corner takes up, and gives off, its full load [s].
    """
    _, q, qdot, v, a, force, on, off, contact, _ = trajectory
    stamps = trajectory.time
    last = len(stamps) - 1
    clamped = min(max(time, stamps[0]), stamps[last])
    right = min(latest(stamps, clamped) + 1, last)
    left = right - 1
    step = stamps[right] - stamps[left]
    s = (clamped - stamps[left]) / step
    h00 = (1.0 + 2.0 * s) * (1.0 - s) ** 2
    h10 = s * (1.0 - s) ** 2 * step
    h01 = s * s * (3.0 - 2.0 * s)
    h11 = s * s * (s - 1.0) * step
    position = h00 * q[left] + h10 * qdot[left] + h01 * q[right] + h11 * qdot[right]
    position[3:7] /= np.sqrt(np.sum(position[3:7] ** 2))
    velocity, acceleration = np.zeros_like(v[left]), np.zeros_like(a[left])
    if stamps[0] <= time < stamps[last]:
        velocity += h00 * v[left] + h10 * a[left] + h01 * v[right] + h11 * a[right]
        acceleration += (1.0 - s) * a[left] + s * a[right]
    row = right if clamped >= stamps[right] else left
    since, until = time - on[row], off[row] - time
    load = np.zeros((2, 4))
    for foot in range(2):
        for corner in range(4):
            if contact[row, foot, corner]:
                ramped = min(since[foot, corner], until[foot, corner]) / ramp
                load[foot, corner] = min(max(ramped, LEAST_SHARE), 1.0)
    wrench = (1.0 - s) * force[left] + s * force[right]
    return ReferenceSample(position, velocity, acceleration, wrench, load, -since, until)
