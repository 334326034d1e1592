"""A score: everything a motion does, as minimum-jerk moves of a few channels over time.

A channel is its neutral value plus the sum of its moves. Each move is a quintic in time that is
constant before and after, so channels are C² whatever moves overlap, and actions, arm gestures
that go with them, and sequences of both compose by adding moves.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
import numpy.typing as npt

from robomirror_drake.messages import Array
from robomirror_drake.motion.body import SIDES

STANCE_WIDTH = 0.20
"""Distance of the feet in neutral stance [m]."""

CHANNELS: tuple[str, ...] = (
    "pelvis_z", "pelvis_yaw", "pelvis_pitch", "pelvis_roll",
    "chest_yaw", "chest_pitch", "chest_roll", "head_yaw", "head_pitch", "head_roll",
    *(f"{s}_{c}" for s in SIDES for c in ("flexion", "abduction", "rotation", "elbow")),
    *(f"{s}_foot_{c}" for s in SIDES for c in ("x", "y", "z", "yaw", "heel")),
    "load", "ballistic",
)  # fmt: skip
"""Angles [rad] and positions [m]; ``load`` is the left foot's share of the weight, and
``ballistic`` is 1 where ``pelvis_z`` tells the height of the centre of mass."""

CHANNEL_INDEX: dict[str, int] = {name: i for i, name in enumerate(CHANNELS)}

NEUTRAL: dict[str, float] = {
    "load": 0.5,
    "left_foot_y": 0.5 * STANCE_WIDTH,
    "right_foot_y": -0.5 * STANCE_WIDTH,
    **{f"{s}_{c}": a for s in SIDES for c, a in (("abduction", 0.16), ("elbow", 0.30))},
}
"""Channels whose value in neutral stance is not zero."""


def quintic(start: tuple[float, float, float], end: tuple[float, float, float], T: float) -> Array:
    """(6,) coefficients, in u = t/T, with given position, velocity, acceleration at both ends."""
    p0, v0, a0 = start[0], start[1] * T, start[2] * T * T
    p1, v1, a1 = end[0], end[1] * T, end[2] * T * T
    d = p1 - p0
    return np.array(
        [
            p0,
            v0,
            0.5 * a0,
            10 * d - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1,
            -15 * d + 8 * v0 + 7 * v1 + 1.5 * a0 - a1,
            6 * d - 3 * v0 - 3 * v1 - 0.5 * a0 + 0.5 * a1,
        ]
    )


MINIMUM_JERK: Array = quintic((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)
"""From rest to rest: T. Flash, N. Hogan, J. Neuroscience 5(7), 1985."""


@dataclass(frozen=True)
class Footprint:
    """Where a foot stands: ankle x, y [m] and heading [rad] in world."""

    x: float
    y: float
    yaw: float


def ahead(stance: Footprint, x: float, y: float, yaw: float = 0.0) -> Footprint:
    """The footprint at (x, y) and heading ``yaw`` as seen from ``stance``."""
    c, s = np.cos(stance.yaw), np.sin(stance.yaw)
    return Footprint(stance.x + c * x - s * y, stance.y + s * x + c * y, stance.yaw + yaw)


@dataclass
class Score:
    """Moves written so far, the time where the next action begins, and where the feet stand."""

    now: float = 0.0
    feet: dict[str, Footprint] = field(
        default_factory=lambda: {
            "left": Footprint(0.0, 0.5 * STANCE_WIDTH, 0.0),
            "right": Footprint(0.0, -0.5 * STANCE_WIDTH, 0.0),
        }
    )
    load: float = 0.5
    _moves: list[tuple[int, float, float, Array]] = field(default_factory=list)
    _settled: Array = field(default_factory=lambda: np.zeros(len(CHANNELS)))

    def settled(self, channel: str) -> float:
        """What a channel comes to after all its moves so far, over its neutral value."""
        return float(self._settled[CHANNEL_INDEX[channel]])

    def to(self, channel: str, value: float, start: float, end: float) -> None:
        """Move a channel, from where its moves so far leave it, to ``value`` over neutral."""
        delta = value - self.settled(channel)
        if abs(delta) > 1e-9:
            self.move(channel, delta, start, end)

    def move(self, channel: str, delta: float, start: float, end: float) -> None:
        """Add a minimum-jerk move by ``delta`` between two times."""
        self.curve(channel, delta * MINIMUM_JERK, start, end)

    def curve(self, channel: str, coefficients: Array, start: float, end: float) -> None:
        """Add a quintic in normalised time; before and after, it holds its end values."""
        self._moves.append((CHANNEL_INDEX[channel], start, end, coefficients))
        self._settled[CHANNEL_INDEX[channel]] += coefficients.sum()

    def pulse(self, channel: str, delta: float, start: float, top: float, end: float) -> None:
        """Go by ``delta`` and come back."""
        self.move(channel, delta, start, top)
        self.move(channel, -delta, top, end)

    def shift_load(self, left_share: float, start: float, end: float) -> None:
        """Move the weight until the left foot bears ``left_share`` of it."""
        self.move("load", left_share - self.load, start, end)
        self.load = left_share

    def carry(self, side: str, to: Footprint, start: float, end: float) -> None:
        """Bring a foot over the floor to where it is to stand."""
        was = self.feet[side]
        for name, delta in (("x", to.x - was.x), ("y", to.y - was.y), ("yaw", to.yaw - was.yaw)):
            if delta:
                self.move(f"{side}_foot_{name}", delta, start, end)
        self.feet[side] = to

    def swing(
        self, side: str, to: Footprint, start: float, end: float, height: float, heel: float = 0.15
    ) -> None:
        """Lift a foot, carry it and set it down; it leaves and meets the floor vertically."""
        duration = end - start
        self.carry(side, to, start + 0.09 * duration, end - 0.09 * duration)
        self.pulse(f"{side}_foot_z", height, start, 0.5 * (start + end), end)
        # The heel leaves first; the toe is clear of the floor all the while.
        self.pulse(f"{side}_foot_heel", heel, start, start + 0.4 * duration, start + 0.8 * duration)

    def center(self) -> Footprint:
        """Midway between the feet, with their mean heading."""
        left, right = self.feet["left"], self.feet["right"]
        return Footprint(
            0.5 * (left.x + right.x), 0.5 * (left.y + right.y), 0.5 * (left.yaw + right.yaw)
        )

    def sample(self, time: Array) -> dict[str, Array]:
        """Value of every channel at the times (T,): name -> (T,)."""
        values = np.zeros((len(CHANNELS), len(time)))
        for name, value in NEUTRAL.items():
            values[CHANNEL_INDEX[name]] = value
        if self._moves:
            channel, start, end, coefficients = (
                np.array(column) for column in zip(*self._moves, strict=True)
            )
            _add_curves(time, channel, start, end, coefficients, values)
        return dict(zip(CHANNELS, values, strict=True))


@numba.njit(cache=True, error_model="numpy")
def _add_curves(
    time: Array,
    channel: npt.NDArray[np.int64],
    start: Array,
    end: Array,
    coefficients: Array,
    values: Array,
) -> None:
    """Add each curve to its channel's values (C, T), by Horner's rule."""
    for m in range(len(channel)):
        for t in range(len(time)):
            u = min(max((time[t] - start[m]) / (end[m] - start[m]), 0.0), 1.0)
            value = 0.0
            for k in range(coefficients.shape[1] - 1, -1, -1):
                value = value * u + coefficients[m, k]
            values[channel[m], t] += value
