"""Where the feet stand, and what follows from that for the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization.dynamics_terms import TaskMotion

SHIFT_TIME = 0.15
"""Time constant with which the reference follows the feet's offset [s]."""


@dataclass(frozen=True)
class Stance:
    """Memory of the contacts.

    Attributes:
        loaded: (2,) 1 where a foot was in contact at the last tick.
        anchor_p: (2, 3) where its sole touched down [m].
        anchor_R: (2, 3, 3) and how.
        offset: (2,) horizontal way from where the reference's feet stand to where the
            robot's do [m].
    """

    loaded: Array
    anchor_p: Array
    anchor_R: Array
    offset: Array

    def pack(self) -> Array:
        """(28,) everything in one vector."""
        parts = (self.loaded, self.anchor_p.ravel(), self.anchor_R.ravel(), self.offset)
        return np.concatenate(parts)

    @staticmethod
    def unpack(vector: Array) -> Stance:
        """The inverse of :meth:`pack`."""
        return Stance(
            vector[:2], vector[2:8].reshape(2, 3), vector[8:26].reshape(2, 3, 3), vector[26:28]
        )

    def shift(self, motion: TaskMotion) -> TaskMotion:
        """A reference moved by the offset, so that it stands on the robot's own feet."""
        com, p = motion.com.copy(), motion.p.copy()
        com[0, :2] += self.offset
        p[:, :2] += self.offset
        return motion._replace(com=com, p=p)


def initial_stance() -> Stance:
    """Nothing has touched the ground yet."""
    return Stance(np.zeros(2), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.zeros(2))


def update_stance(
    last: Stance, motion: TaskMotion, reference: TaskMotion, load: Array, period: float
) -> Stance:
    """The stance one tick later.

    A foot that begins its contact is anchored where it is, at the reference's height
    and, like the reference, flat; the offset follows the loaded feet's with a time
    constant, a foot that takes up its load counting in proportion.

    Args:
        last: One tick before.
        motion, reference: Where the robot and the reference are.
        load: (2, 4) share of its full force that each corner may bear.
        period: Time since the last tick [s].
    """
    share = load.mean(axis=1)
    loaded = (share > 0.0).astype(np.float64)
    p, R = last.anchor_p.copy(), last.anchor_R.copy()
    for foot in np.flatnonzero(loaded > last.loaded):
        p[foot, :2], p[foot, 2] = motion.p[2 + foot, :2], reference.p[2 + foot, 2]
        R[foot] = motion.R[2 + foot]
    offset = last.offset
    if share.sum() > 0.0:
        apart = motion.p[2:, :2] - reference.p[2:, :2]
        follow = min(1.0, period / SHIFT_TIME)
        offset = offset + follow * (share @ apart / share.sum() - offset)
    return Stance(loaded, p, R, offset)
