"""Recent states of the robot, as discrete state of the system that looks back on them."""

from __future__ import annotations

import numpy as np

from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import Array
from robomirror_drake.ppn.options import PPNOptions


class RecentStates:
    """The last states of the robot at a rate, for a predictor; all state is the caller's.

    Attributes:
        count: How many there are, the present one included.
        size: Of a state.
        period: From one to the next [s].
    """

    def __init__(self, count: int, size: int, rate: float) -> None:
        self.count, self.size, self.period = count, size, 1.0 / rate

    def unseen(self) -> Array:
        """((count − 1) · size,) what to store at first: +inf in place of what was not yet seen."""
        return np.full((self.count - 1) * self.size, np.inf)

    def pushed(self, stored: Array, state: Array) -> Array:
        """What to store after a state (size,) was seen."""
        return np.concatenate([stored[self.size :], state])

    def completed(self, stored: Array, state: Array) -> Array:
        """(count, size) recent states up to the present one.

        Where there are too few, the robot is taken to have stood as it was first seen.
        """
        rows = np.append(stored, state).reshape(self.count, self.size)
        known = np.isfinite(rows[:, 0])
        first = rows[np.argmax(known)].copy()
        first[(self.size + 1) // 2 :] = 0.0
        rows[~known] = first
        return rows


def check_measured(options: PPNOptions) -> None:
    """Raises ConfigError where a network takes what was commanded for the states of the robot."""
    if options.states == "commanded":
        raise ConfigError(
            "these weights learned with what was commanded in the place of the robot's states; "
            "while it moves, use weights that learned from measured ones"
        )
