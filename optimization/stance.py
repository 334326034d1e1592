"""Where the feet stand, and what follows from that for the reference."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization.dynamics_terms import TaskMotion
from robomirror_drake.optimization.reference_trajectory import ReferenceSample

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


@dataclass(frozen=True)
class Stance:
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
        return np.concatenate([np.ravel(getattr(self, part.name)) for part in fields(self)])

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

    def moved(self, reference: TaskMotion) -> TaskMotion:
        """A reference moved by the offset, so that it stands on the robot's own feet."""
        com = reference.com.copy()
        com[0] += self.offset
        return reference._replace(com=com, p=reference.p + self.offset)

    def shift(self, reference: TaskMotion, motion: TaskMotion) -> TaskMotion:
        """A reference, moved already, with its feet where they shall be.

        A foot that is late goes down until it meets the ground, wherever that is.

        Args:
            reference, motion: Where the reference and the robot are.
        """
        p, v, a = reference.p.copy(), reference.v.copy(), reference.a.copy()
        p[2:, :2] += self.steps
        for foot in np.flatnonzero(self.late) + 2:
            p[foot, 2] = motion.p[foot, 2]
            v[foot, 2] = min(motion.com[1, 2], 0.0) - DESCENT
            a[foot, 2] = 0.0
        return reference._replace(p=p, v=v, a=a)


def initial_stance() -> Stance:
    """Nothing is known yet; the feet are taken to have stood where they are for long."""
    return Stance.unpack(np.concatenate([np.zeros(17), np.ones(2), np.zeros(6)]))


def feel(last: Array, force: Array | None, height: Array, period: float) -> Array:
    """(2,) how long each foot has been on the ground, 0 in the air [s].

    A foot is on the ground from when its force says so until both force and height deny it.

    Args:
        last: The same one tick before.
        force: (2, 3) of the ground on each foot, in world [N]; None to go by the height.
        height: (2, 4) of the corners [m].
        period: Time since the last tick [s].
    """
    low = height.min(axis=1) < TOUCHING
    if force is None:
        touching = low
    else:
        touching = (force[:, 2] > np.where(last > 0.0, LOST, FELT)) | (low & (last > 0.0))
    return np.where(touching, last + period, 0.0)


def bearing(sample: ReferenceSample, touching: Array, height: Array, ramp: float) -> Array:
    """(2, 4) share of its full force that each corner may bear, where it really is.

    A foot in the air bears nothing, whatever is planned, nor does a corner that hangs above
    the lowest of its sole; a foot that has come down a little before its time does. The
    last foot on the ground is not relieved of its load while another is late.

    Args:
        sample: The reference.
        touching: (2,) how long each foot has been on the ground [s].
        height: (2, 4) of the corners [m].
        ramp: Time in which a foot takes up its full load [s].
    """
    on_ground = touching > 0.0
    # A foot that is felt stands on its lowest corner, whatever its height seems to be.
    above = height - height.min(axis=1, keepdims=True)
    near = np.minimum(np.maximum((HANGING - above) / (HANGING - TOUCHING), 0.0), 1.0)
    # Not a foot that has yet to leave the ground: in the second half of its swing.
    soon = (sample.wait > 0.0) & (sample.wait < np.minimum(EARLY, -sample.left))
    whole = (sample.load == 0.0).all(axis=1, keepdims=True)
    planned = np.where(whole & soon, 1.0, sample.load)
    scheduled = planned.any(axis=1)
    if (scheduled & ~on_ground).any() and not (scheduled & on_ground).any():
        planned = np.where(on_ground[:, None], 1.0, planned)
    taken = np.minimum(touching / ramp, 1.0)
    return np.asarray(planned * near * taken[:, None])


def update_stance(
    last: Stance,
    motion: TaskMotion,
    reference: TaskMotion,
    sample: ReferenceSample,
    corners: Array,
    period: float,
    ramp: float,
    force: Array | None = None,
) -> Stance:
    """The stance one tick later.

    A sole whose set of loaded corners has changed is anchored where it is, on the floor;
    the offset follows the loaded feet's with a time constant, a foot that takes up its
    load counting in proportion. In flight, where nothing can change the path of the
    centre of mass, the offset is that of its own.

    Args:
        last: One tick before.
        motion, reference: Where the robot and the reference are.
        sample: The reference now.
        corners: (2, 4, 3) corners of the soles in their own frames [m].
        period: Time since the last tick [s].
        ramp: Time in which a foot takes up its full load [s].
        force: (2, 3) of the ground on each foot, in world [N], where it is measured.
    """
    world = motion.p[2:, None] + corners @ motion.R[2:].transpose(0, 2, 1)
    touching = feel(last.touching, force, world[..., 2], period)
    load = bearing(sample, touching, world[..., 2], ramp)
    anchor = last.anchor.copy()
    for foot in range(2):
        loaded = load[foot] > 0.0
        if loaded.any() and (loaded != (last.load[foot] > 0.0)).any():
            anchor[foot, :2] = world[foot, loaded, :2].mean(axis=0)
    share = load.mean(axis=1)
    offset = last.offset.copy()
    if share.sum() > 0.0:
        apart = motion.p[2:, :2] - reference.p[2:, :2]
        follow = min(1.0, period / SHIFT_TIME)
        offset[:2] += follow * (share @ apart / share.sum() - offset[:2])
        offset[2] = 0.0
    elif not (touching > 0.0).any():
        offset = motion.com[0] - reference.com[0]
    offset = np.minimum(np.maximum(offset, -FARTHEST), FARTHEST)
    late = (sample.load > 0.0).any(axis=1) & (touching == 0.0)
    return Stance(load, anchor, offset, touching, 1.0 * late, last.steps)
