"""What a seed draws from the disturbance options.

Every random number is a function of the seed, of what it is for and of a count (a
control tick, an interval of time), never of what was drawn before. So a Context that is
restored, or evaluated in another order, sees the same, and a new range for one quantity
changes no other.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, get_args

import numpy as np
import pinocchio as pin

from robomirror_drake.disturbance import (
    DisturbanceOptions,
    Push,
    RandomPushes,
    SensorNoise,
    StartErrors,
)
from robomirror_drake.messages import Array

Stream = Literal[
    "friction",
    "mass",
    "center_of_mass",
    "latency",
    "lag",
    "strength",
    "sensors",
    "random_pushes",
    "start",
]


class Drawn(NamedTuple):
    """What is constant during a run.

    Attributes:
        friction: Between soles and ground, None to leave it alone.
        mass: Factor of every link's mass.
        center_of_mass: (links, 3) shifts of the links' centres of mass in their frames [m].
        latency: Of the actuators [s].
        lag: Time constant of the actuators [s].
        strength: Factor of the torque limits.
        start: (2 n + 13,) what is added to the state of n joints that the robot starts in.
    """

    friction: float | None
    mass: float
    center_of_mass: Array
    latency: float
    lag: float
    strength: float
    start: Array


def stream_rng(seed: int, stream: Stream, count: int = 0) -> np.random.Generator:
    """A generator that depends on these three alone."""
    return np.random.default_rng([get_args(Stream).index(stream), count, seed])


def draw(options: DisturbanceOptions, seed: int, links: int) -> Drawn:
    """Draws what is constant during a run, for a robot of so many links."""

    def one(stream: Stream, ends: tuple[float, float]) -> float:
        return float(stream_rng(seed, stream).uniform(*ends))

    actuators, shift = options.actuators, options.center_of_mass
    return Drawn(
        friction=None if options.friction is None else one("friction", options.friction),
        mass=1.0 + one("mass", options.mass),
        center_of_mass=stream_rng(seed, "center_of_mass").uniform(-shift, shift, (links, 3)),
        latency=one("latency", actuators.latency),
        lag=one("lag", actuators.lag),
        strength=one("strength", actuators.strength),
        start=start_error(options.start, seed, links - 1),
    )


def start_error(errors: StartErrors, seed: int, joints: int) -> Array:
    """(2 joints + 13,) what is added to the first state, Drake order; the base stays in place."""
    angle, rate, spin, shift = np.split(
        stream_rng(seed, "start").standard_normal(2 * joints + 5),
        np.cumsum([joints, joints, 3]),
    )
    return np.concatenate(
        [
            np.zeros(7),
            errors.joint_position * angle,
            errors.angular_velocity * spin,
            errors.linear_velocity * shift,
            [0.0],
            errors.joint_velocity * rate,
        ]
    )


def random_push(options: RandomPushes, seed: int, interval: int) -> Push:
    """The push that falls into an interval of time, counted from 0."""
    rng = stream_rng(seed, "random_pushes", interval)
    # It ends where its interval does at the latest.
    start = interval * options.interval + rng.uniform(0.0, options.interval - options.duration)
    direction = rng.uniform(0.0, 2.0 * math.pi)
    speed = rng.uniform(*options.speed)
    return Push(
        time=start,
        duration=options.duration,
        speed=(speed * math.cos(direction), speed * math.sin(direction), 0.0),
    )


def measured(state: Array, noise: SensorNoise, seed: int, tick: int) -> Array:
    """The state as the sensors give it.

    Args:
        state: (2 n + 13,) base quaternion wxyz, base position, n joints, angular and linear
            velocity of the base in world, n joint velocities.
        noise: Standard deviations.
        seed: Of the run.
        tick: Of the controller.
    """
    joints = (len(state) - 13) // 2
    rng = stream_rng(seed, "sensors", tick)
    drawn = rng.standard_normal(6 + 2 * joints)
    seen = state.copy()
    seen[:4] = _turned(state[:4], noise.orientation * drawn[:3])
    seen[7 : 7 + joints] += noise.joint_position * drawn[6 : 6 + joints]
    seen[7 + joints : 10 + joints] += noise.angular_velocity * drawn[3:6]
    seen[13 + joints :] += noise.joint_velocity * drawn[6 + joints :]
    return seen


def _turned(quaternion: Array, by: Array) -> Array:
    """(4,) a quaternion wxyz turned by a rotation vector (3,) of its own frame."""
    turned = pin.Quaternion(*quaternion) * pin.Quaternion(pin.exp3_quat(by))
    return np.asarray(turned.coeffs()[[3, 0, 1, 2]])  # xyzw in Pinocchio
