"""Where the feet stand, and what follows from that for the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization.dynamics_terms import TaskMotion
from robomirror_drake.optimization.reference_trajectory import ReferenceSample

SHIFT_TIME = 0.15
"""Time constant with which the reference follows the feet's offset [s]."""

TOUCHING, HANGING = 0.003, 0.010
"""Height of a corner below which it bears all it may, above which it bears nothing [m]."""

EARLY = 0.10
"""How long before its planned contact a corner may touch down [s]."""

FELT, LOST = 30.0, 10.0
"""Normal force from which on a foot is felt on the ground, and below which no more [N]."""


@dataclass(frozen=True)
class Stance:
    """Memory of the contacts. The floor is at z = 0.

    Attributes:
        load: (2, 4) share of its full force that each corner may bear.
        anchor: (2, 3) where the middle of each sole's loaded corners stands [m].
        offset: (2,) horizontal way from where the reference's feet stand to where the
            robot's do [m].
        touching: (2,) 1 where the foot is felt to be on the ground, else 0.
    """

    load: Array
    anchor: Array
    offset: Array
    touching: Array

    def pack(self) -> Array:
        """(18,) everything in one vector."""
        return np.concatenate([self.load.ravel(), self.anchor.ravel(), self.offset, self.touching])

    @staticmethod
    def unpack(vector: Array) -> Stance:
        """The inverse of :meth:`pack`."""
        load, anchor, offset, touching = np.split(vector, [8, 14, 16])
        return Stance(load.reshape(2, 4), anchor.reshape(2, 3), offset, touching)

    def shift(self, motion: TaskMotion) -> TaskMotion:
        """A reference moved by the offset, so that it stands on the robot's own feet."""
        com, p = motion.com.copy(), motion.p.copy()
        com[0, :2] += self.offset
        p[:, :2] += self.offset
        return motion._replace(com=com, p=p)


def initial_stance() -> Stance:
    """Nothing has touched the ground yet."""
    return Stance(np.zeros((2, 4)), np.zeros((2, 3)), np.zeros(2), np.zeros(2))


def feel(last: Array, force: Array | None, height: Array) -> Array:
    """(2,) 1 where a foot is on the ground, else 0.

    Args:
        last: The same one tick before.
        force: (2, 3) of the ground on each foot, in world [N]; None to go by the height.
        height: (2, 4) of the corners [m].
    """
    if force is None:
        return np.asarray(1.0 * (height.min(axis=1) < TOUCHING))
    threshold = np.where(last > 0.0, LOST, FELT)
    return np.asarray(1.0 * (force[:, 2] > threshold))


def bearing(load: Array, wait: Array, height: Array) -> Array:
    """(2, 4) share of its full force that each corner may bear, where it really is.

    A corner that hangs in the air bears nothing, whatever is planned; one that has come
    down a little before its time does.

    Args:
        load: (2, 4) what the reference plans.
        wait: (2, 4) time until the planned contact [s].
        height: (2, 4) of the corners [m].
    """
    near = np.clip((HANGING - height) / (HANGING - TOUCHING), 0.0, 1.0)
    early = (load == 0.0) & (wait > 0.0) & (wait < EARLY) & (height < 0.0)
    return np.where(early, 0.5, load * near)


def update_stance(
    last: Stance,
    motion: TaskMotion,
    reference: TaskMotion,
    sample: ReferenceSample,
    corners: Array,
    period: float,
    force: Array | None = None,
) -> Stance:
    """The stance one tick later.

    A sole whose set of loaded corners has changed is anchored where it is, on the floor;
    the offset follows the loaded feet's with a time constant, a foot that takes up its
    load counting in proportion.

    Args:
        last: One tick before.
        motion, reference: Where the robot and the reference are.
        sample: The reference now.
        corners: (2, 4, 3) corners of the soles in their own frames [m].
        period: Time since the last tick [s].
        force: (2, 3) of the ground on each foot, in world [N], where it is measured.
    """
    world = motion.p[2:, None] + corners @ motion.R[2:].transpose(0, 2, 1)
    load = bearing(sample.load, sample.wait, world[..., 2])
    anchor = last.anchor.copy()
    for foot in range(2):
        loaded = load[foot] > 0.0
        if loaded.any() and (loaded != (last.load[foot] > 0.0)).any():
            anchor[foot, :2] = world[foot, loaded, :2].mean(axis=0)
    share = load.mean(axis=1)
    offset = last.offset
    if share.sum() > 0.0:
        apart = motion.p[2:, :2] - reference.p[2:, :2]
        follow = min(1.0, period / SHIFT_TIME)
        offset = offset + follow * (share @ apart / share.sum() - offset)
    return Stance(load, anchor, offset, feel(last.touching, force, world[..., 2]))
