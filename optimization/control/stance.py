"""Where the feet stand, and what follows from that for the reference; all of it compiled."""

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array
from robomirror_drake.optimization.control.dynamics_terms import TaskMotion

SHIFT_TIME = 0.15
"""Time constant with which the reference follows the feet's offset [s]."""

TOUCHING, HANGING = 0.003, 0.010
"""Height of a corner below which it bears all it may, above which it bears nothing [m]."""

EARLY = 0.10
"""How long before its planned contact a foot may touch down [s]."""

FELT, LOST = 30.0, 10.0
"""Normal force from which on a foot is felt on the ground, and below which no more [N]."""

DESCENT = 0.3
"""Speed at which a foot that is late is moved down, faster than the body's own fall [m/s]."""

FARTHEST = 1.0
"""How far along each axis the reference is moved at most [m]."""


class Stance(NamedTuple):
    """Memory of the contacts. The floor is at z = 0.

    Attributes:
        load: (2, 4) share of its full force that each corner may bear.
        anchor: (2, 3) where the middle of each sole's loaded corners stands [m].
        offset: (3,) way from where the reference is to where the robot's feet stand, or
            its centre of mass is in flight [m].
        touching: (2,) how long each foot has been on the ground, 0 in the air [s].
        late: (2,) 1 where the ground should have been felt and is not, else 0.
        steps: (2, 2) how far each foot is moved besides, to catch the robot [m].
    """

    load: Array
    anchor: Array
    offset: Array
    touching: Array
    late: Array
    steps: Array

    def pack(self) -> Array:
        """(25,) everything in one vector."""
        load, anchor, steps = self.load.ravel(), self.anchor.ravel(), self.steps.ravel()
        return np.concatenate([load, anchor, self.offset, self.touching, self.late, steps])

    @staticmethod
    def unpack(vector: Array) -> Stance:
        """The inverse of :meth:`pack`."""
        return Stance(
            load=vector[:8].reshape(2, 4),
            anchor=vector[8:14].reshape(2, 3),
            offset=vector[14:17],
            touching=vector[17:19],
            late=vector[19:21],
            steps=vector[21:25].reshape(2, 2),
        )


def initial_stance() -> Stance:
    """Nothing is known yet; the feet are taken to have stood where they are for long."""
    return Stance.unpack(np.concatenate([np.zeros(17), np.ones(2), np.zeros(6)]))


@njit(cache=True)
def moved(reference, offset):
    """A reference (TaskMotion) moved by an offset (3,), so that it stands on the robot's feet."""
    com = reference.com.copy()
    com[0] += offset
    p = reference.p + offset
    return TaskMotion(com, reference.angular, reference.R, p, reference.v, reference.a)


@njit(cache=True)
def shifted(reference, motion, late, steps):
    """A reference, moved already, with its feet where they shall be.

    A foot that is late goes down until it meets the ground, wherever that is.

    Args:
        reference, motion: TaskMotion of the reference and of the robot.
        late, steps: As in :class:`Stance`.
    """
    p, v, a = reference.p.copy(), reference.v.copy(), reference.a.copy()
    p[2:, :2] += steps
    for foot in range(2):
        if late[foot] != 0.0:
            p[2 + foot, 2] = motion.p[2 + foot, 2]
            v[2 + foot, 2] = min(motion.com[1, 2], 0.0) - DESCENT
            a[2 + foot, 2] = 0.0
    return TaskMotion(reference.com, reference.angular, reference.R, p, v, a)


@njit(cache=True)
def feel(last, force, height, period):
    """(2,) how long each foot has been on the ground, 0 in the air [s].

    A foot is on the ground from when its force says so until both force and height deny it.

    Args:
        last: (2,) the same one tick before.
        force: (2, 3) of the ground on each foot, in world [N]; NaN to go by the height.
        height: (2, 4) of the corners [m].
        period: Time since the last tick [s].
    """
    touching = np.zeros(2)
    for foot in range(2):
        low = height[foot].min() < TOUCHING
        was = last[foot] > 0.0
        if np.isnan(force[foot, 2]):
            on = low
        else:
            on = force[foot, 2] > (LOST if was else FELT) or (low and was)
        if on:
            touching[foot] = last[foot] + period
    return touching


@njit(cache=True)
def bearing(sample, touching, height, ramp):
    """(2, 4) share of its full force that each corner may bear, where it really is.

    A foot in the air bears nothing, whatever is planned, nor does a corner that hangs above
    the lowest of its sole; a foot that has come down a little before its time does. The
    last foot on the ground is not relieved of its load while another is late.

    Args:
        sample: The reference, a ReferenceSample.
        touching: (2,) how long each foot has been on the ground [s].
        height: (2, 4) of the corners [m].
        ramp: Time in which a foot takes up its full load [s].
    """
    planned = sample.load.copy()
    missed = kept = False
    for foot in range(2):
        if not np.any(sample.load[foot] != 0.0):
            for corner in range(4):
                # Not a foot that has yet to leave the ground: in the second half of its swing.
                wait, left = sample.wait[foot, corner], sample.left[foot, corner]
                if 0.0 < wait < min(EARLY, -left):
                    planned[foot, corner] = 1.0
        if np.any(planned[foot] != 0.0):
            missed = missed or not touching[foot] > 0.0
            kept = kept or touching[foot] > 0.0
    for foot in range(2):
        if missed and not kept and touching[foot] > 0.0:
            planned[foot] = 1.0
        taken = min(touching[foot] / ramp, 1.0)
        lowest = height[foot].min()
        for corner in range(4):
            # A foot that is felt stands on its lowest corner, whatever its height seems to be.
            above = height[foot, corner] - lowest
            near = min(max((HANGING - above) / (HANGING - TOUCHING), 0.0), 1.0)
            planned[foot, corner] *= near * taken
    return planned


@njit(cache=True)
def update_stance(last, motion, reference, sample, corners, period, ramp, force):
    """The stance one tick later, but for the steps, which stay.

    A sole whose set of loaded corners has changed is anchored where it is, on the floor;
    the offset follows the loaded feet's with a time constant, a foot that takes up its
    load counting in proportion. In flight, where nothing can change the path of the
    centre of mass, the offset is that of its own.

    Args:
        last: The stance one tick before.
        motion, reference: TaskMotion of the robot and of the reference.
        sample: The reference now, a ReferenceSample.
        corners: (2, 4, 3) corners of the soles in their own frames [m].
        period: Time since the last tick [s].
        ramp: Time in which a foot takes up its full load [s].
        force: (2, 3) of the ground on each foot, in world [N]; NaN where it is not measured.
    """
    world = np.empty((2, 4, 3))
    for foot in range(2):
        for corner in range(4):
            world[foot, corner] = motion.p[2 + foot] + motion.R[2 + foot] @ corners[foot, corner]
    height = world[:, :, 2].copy()
    touching = feel(last.touching, force, height, period)
    load = bearing(sample, touching, height, ramp)
    anchor, offset, late = last.anchor.copy(), last.offset.copy(), np.zeros(2)
    apart, total = np.zeros(2), 0.0
    for foot in range(2):
        middle, loaded, changed = np.zeros(2), 0, False
        for corner in range(4):
            bears = load[foot, corner] > 0.0
            changed = changed or bears != (last.load[foot, corner] > 0.0)
            if bears:
                middle += world[foot, corner, :2]
                loaded += 1
        if loaded > 0 and changed:
            anchor[foot, :2] = middle / loaded
        share = np.sum(load[foot]) / 4.0
        total += share
        apart += share * (motion.p[2 + foot, :2] - reference.p[2 + foot, :2])
        if np.any(sample.load[foot] > 0.0) and touching[foot] == 0.0:
            late[foot] = 1.0
    if total > 0.0:
        offset[:2] += min(1.0, period / SHIFT_TIME) * (apart / total - offset[:2])
        offset[2] = 0.0
    elif not np.any(touching > 0.0):
        offset = motion.com[0] - reference.com[0]
    offset = np.minimum(np.maximum(offset, -FARTHEST), FARTHEST)
    return Stance(load, anchor, offset, touching, late, last.steps)
