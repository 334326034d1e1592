"""Which ends of which feet stand on the floor, read off a human motion.

The most plausible sequence of contact states, found by dynamic programming
(A. Viterbi, 1967). A frame's state says for each foot whether heel and toe bear;
an end that bears pays for its height and speed, one that does not pays 1, every
change pays too, so short flickers vanish. Flight must be earned: both feet off
the floor is only possible where the pelvis falls or both feet are high.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from robomirror_drake.messages import Array, BoolArray, HumanMotion
from robomirror_drake.motion.ground import FEET, clearance
from robomirror_drake.motion.skeleton import INDEX

_HEIGHT = 0.06  # clearance at which an end is as likely off the floor as on it [m]
_SPEED = 0.8  # likewise its speed [m/s]
_SWITCH = 0.02  # cost of changing one end's state [s of being wrong by 1]
_TAKEOFF = 0.15  # cost of leaving the floor altogether, likewise [s]
_FALLING = -5.0  # pelvis z̈ below which nothing can be bearing the body [m/s²]
_HIGH = 0.20  # clearance of both feet above which nothing can be [m]
_FALSE_FLIGHT = 100.0  # cost of flight without either, above all others
_SMOOTHING = 0.03  # standard deviation of the filter before derivatives [s]

# (16, 2, 2) every contact state of (left, right) × (heel, toe)
_STATES = np.array([[(s >> b) & 1 for b in range(4)] for s in range(16)], bool).reshape(-1, 2, 2)


def foot_contacts(motion: HumanMotion) -> BoolArray:
    """(T, 2, 2) contact of (left, right) foot × (heel, toe).

    Both feet are free of the floor only where the pelvis accelerates downwards faster
    than 5 m/s² or both feet are 20 cm above it; elsewhere the likelier foot bears,
    however badly the motion floats or slides.
    """
    positions = motion.positions
    height = clearance(positions)
    dt = 1.0 / motion.fps
    step = np.linalg.norm(
        np.diff(_smooth(positions[:, FEET], dt, _SMOOTHING / 2.0), axis=0), axis=-1
    )
    # The slower side counts, so that the frames of touchdown and lift-off still bear.
    speed = np.minimum(np.concatenate([step[:1], step]), np.concatenate([step, step[-1:]])) / dt
    doubt = np.log2(1.0 + (np.maximum(height, 0.0) / _HEIGHT) ** 2 + (speed / _SPEED) ** 2)

    falling = pelvis_acceleration(motion) < _FALLING
    flight_possible = falling | (height.min(axis=(1, 2)) > _HIGH)

    cost = np.where(_STATES, doubt[:, None], 1.0).sum(axis=(2, 3))
    airborne = ~_STATES.any(axis=(1, 2))
    cost[np.ix_(~flight_possible, airborne)] += _FALSE_FLIGHT
    switch = _SWITCH * (_STATES[:, None] != _STATES[None]).sum(axis=(2, 3))
    switch[np.ix_(~airborne, airborne)] += _TAKEOFF
    contact: BoolArray = _STATES[_cheapest_path(cost * dt, switch)]
    return contact


def pelvis_acceleration(motion: HumanMotion) -> Array:
    """(T,) vertical acceleration of the pelvis, smoothed over 30 ms [m/s²]."""
    dt = 1.0 / motion.fps
    z = _smooth(motion.positions[:, INDEX["pelvis"], 2], dt, _SMOOTHING)
    return np.asarray(np.gradient(np.gradient(z, dt), dt))


def _smooth(x: Array, dt: float, sigma: float) -> Array:
    return np.asarray(gaussian_filter1d(x, sigma / dt, axis=0, mode="nearest"))


@numba.njit(cache=True)
def _cheapest_path(cost: Array, switch: Array) -> npt.NDArray[np.int64]:
    """(T,) states that minimise the sum of cost (T, S) and of switch (S, S) between them."""
    frames, states = cost.shape
    best = cost[0].copy()
    before = np.zeros((frames, states), np.int64)
    for t in range(1, frames):
        total = np.empty(states)
        for s in range(states):
            arrive = best + switch[:, s]
            before[t, s] = np.argmin(arrive)
            total[s] = arrive[before[t, s]] + cost[t, s]
        best = total
    path = np.empty(frames, np.int64)
    path[-1] = np.argmin(best)
    for t in range(frames - 1, 0, -1):
        path[t - 1] = before[t, path[t]]
    return path
