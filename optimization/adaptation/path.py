"""A reference as a path in its own time τ, with the directions in which it can be changed.

Coordinates are poses of pelvis and feet and the joints that are in no leg (see
:mod:`.legs`). Beside them stand two directions of change, both zero at the start:

* the *excursion* E of pelvis, swinging feet and upper joints from a smooth posture that starts
  and ends where they do; a foot's posture goes straight from foothold to foothold, so that it
  has none where it stands;
* the *way* S of pelvis and feet over the floor. A standing foot shares the pelvis' way at one
  moment of its stance, so that it too stands still while its steps shrink.

Tempo: with a rate of stretching w(τ) from 0 to 1, which is zero in flight and where the motion
is already under way at the start, time is t = τ + σ W(τ), W = ∫ w, and a tempo is 1/(1 + σ).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization import rotations
from robomirror_drake.optimization.adaptation.legs import Legs
from robomirror_drake.optimization.adaptation.options import AdaptOptions
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.floating_base import continuous
from robomirror_drake.optimization.kinematics import center_of_mass, configuration_poses
from robomirror_drake.optimization.planning.tempo import flying
from robomirror_drake.robot import rotation_matrix

LINKS = 3
"""Pelvis, left foot, right foot: the links whose poses are coordinates."""

_LIFT = 0.25  # share of a swing in which its excursion begins to count, and ceases
_EASE = 0.3  # time in which tempo changes where a motion is under way at its start [s]
_SHORTEST = 0.12  # shorter swings are flicker of the labels [s]
_MOVING = 0.2  # speed that is no rest [m/s, rad/s]


class PathPoint(NamedTuple):
    """The path at N times τ; where an attribute is a pair, its second is the derivative by τ.

    Attributes:
        position: (N, 3, 3) of the links [m].
        rotation: (N, 3, 3, 3) of the links.
        spin: (N, 3, 3) angular velocities of the links in world [rad/s].
        upper: (N, U) upper joints [rad].
        joints: (N, J) all joints, to start inverse kinematics from.
        excursion: (N, 3, 3) E of the positions [m].
        turn: (N, 3, 3) E of the rotations, as vectors in world [rad].
        bend: (N, U) E of the upper joints [rad].
        way: (N, 3, 3) S [m].
        swing: (N, 2) 1 in the middle of a foot's swing, 0 where it stands.
        load: (N, 2) share of the weight on each foot.
        base: (N, 4) the pelvis' rotation as a quaternion wxyz, continuous in time.
    """

    position: tuple[Array, Array]
    rotation: Array
    spin: Array
    upper: tuple[Array, Array]
    joints: Array
    excursion: tuple[Array, Array]
    turn: tuple[Array, Array]
    bend: tuple[Array, Array]
    way: tuple[Array, Array]
    swing: tuple[Array, Array]
    load: tuple[Array, Array]
    base: Array


class MotionPath(NamedTuple):
    """A reference as a path.

    Attributes:
        duration: Of the reference [s].
        curve: All columns of :class:`PathPoint`, rotations as quaternions wxyz.
        stretch: w(τ).
        stretched: W(τ) [s].
        contact: (T, 2, 4) the reference's schedule.
        time: (T,) its times from 0 [s].
        resting: Whether it is at rest at its start and at its end.
        upper: U.
    """

    duration: float
    curve: CubicSpline
    stretch: PchipInterpolator
    stretched: PchipInterpolator
    contact: BoolArray
    time: Array
    resting: tuple[bool, bool]
    upper: int

    def at(self, tau: Array) -> PathPoint:
        """The path at times (N,) [s], within 0 and ``duration``."""
        u = self.upper
        ends = np.cumsum([9, 12, u, 9, 9, u, 9, 2, 2])
        value, rate = (np.split(self.curve(tau, order), ends, axis=1) for order in (0, 1))
        quaternion, spun = (part[1].reshape(-1, 4) for part in (value, rate))
        norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
        q, qd = quaternion / norm, spun / norm
        w, v, wd, vd = q[:, :1], q[:, 1:], qd[:, :1], qd[:, 1:]
        spin = 2.0 * (w * vd - wd * v + np.cross(v, vd))  # 2 vec(q̇ q*)

        def pair(column: int, *shape: int) -> tuple[Array, Array]:
            return value[column].reshape(-1, *shape), rate[column].reshape(-1, *shape)

        return PathPoint(
            position=pair(0, 3, 3),
            rotation=rotation_matrix(q).reshape(-1, 3, 3, 3),
            spin=spin.reshape(-1, 3, 3),
            upper=pair(2, u),
            joints=value[9],
            excursion=pair(3, 3, 3),
            turn=pair(4, 3, 3),
            bend=pair(5, u),
            way=pair(6, 3, 3),
            swing=pair(7, 2),
            load=pair(8, 2),
            base=q.reshape(-1, 3, 4)[:, 0],
        )

    def tau(self, time: Array, sigma: float) -> tuple[Array, Array, Array]:
        """τ at times (N,) [s], dτ/dt and dτ/dσ; after its end the path stands still."""
        tau = np.minimum(time / (1.0 + max(sigma, 0.0)), self.duration)
        for _ in range(30):
            miss = time - tau - sigma * self.stretched(tau)
            step = miss / (1.0 + sigma * self.stretch(tau))
            tau = np.clip(tau + step, 0.0, self.duration)
            if np.abs(step[tau < self.duration]).max(initial=0.0) < 1e-11:
                break
        over = time > self.duration + sigma * self.stretched(self.duration) - 1e-12
        rate = np.where(over, 0.0, 1.0 / (1.0 + sigma * self.stretch(tau)))
        return tau, rate, -self.stretched(tau) * rate


def make_path(legs: Legs, reference: RobotReference, options: AdaptOptions) -> MotionPath:
    """The path of a reference.

    Raises:
        InputError: It has less than five samples.
    """
    q = continuous(reference.q)
    if len(q) < 5:
        raise InputError(
            f"a reference of {len(q)} samples cannot be adapted: give one of five at least"
        )
    time = np.asarray(reference.time - reference.time[0])
    dt = time[-1] / (len(time) - 1)
    links = np.array([0, *legs.chain[:, -1]])
    R, p = configuration_poses(legs.tree, q)
    center = center_of_mass(legs.tree, R, p)
    R, p = R[:, links], p[:, links]
    upper = q[:, 7:][:, legs.upper]
    stands = _steady(np.asarray(reference.contact.any(axis=2)), round(_SHORTEST / dt))
    broad, narrow = options.smoothing / dt, options.path_smoothing / dt

    excursion, turn, way = np.zeros_like(p), np.zeros_like(p), np.zeros_like(p)
    moving = [bool(np.abs(reference.v[end]).max() > _MOVING) for end in (0, -1)]
    # A motion that is under way at its start goes on as it did.
    eased = _ease(np.minimum(time / _EASE, 1.0))[:, None] if moving[0] else np.ones((len(q), 1))
    way[:, 0, :2] = eased * (_smooth(p[:, 0, :2], narrow) - p[0, 0, :2])
    excursion[:, 0, :2] = p[:, 0, :2] - _smooth(p[:, 0, :2], narrow)
    excursion[:, 0, 2] = p[:, 0, 2] - _smooth(p[:, 0, 2:], broad)[:, 0]
    turn[:, 0] = _tilt(R[:, 0])
    turn[:, 0] -= _smooth(turn[:, 0], broad)
    swing = np.zeros((len(q), 2))
    for foot in range(2):
        way[:, 1 + foot, :2] = _foot_way(way[:, 0, :2], stands[:, foot])
        for a, b in _swings(stands[:, foot]):
            part = slice(a, b + 1)
            u = np.linspace(0.0, 1.0, b + 1 - a)[:, None]
            s, aloft = _ease(u), _ease(np.minimum(np.minimum(u, 1.0 - u) / _LIFT, 1.0))
            ends = p[[a, b], 1 + foot]
            straight = (1.0 - s) * ends[0] + s * ends[1]
            excursion[part, 1 + foot] = aloft * (p[part, 1 + foot] - straight)
            start = R[a, 1 + foot]
            between = rotations.log(R[b, 1 + foot] @ start.T)
            turn[part, 1 + foot] = aloft * rotations.log(
                R[part, 1 + foot] @ (rotations.exp(s * between) @ start).swapaxes(1, 2)
            )
            swing[part, foot] = (4.0 * s * (1.0 - s))[:, 0]
    quaternions = [continuous(rotations.quaternion(R[:, link])) for link in range(LINKS)]
    bend = eased * (upper - _smooth(upper, broad))
    excursion, turn = eased[..., None] * excursion, eased[..., None] * turn
    rows = [p, *quaternions, upper, excursion, turn, bend, way, swing]
    rows.append(_loads(center, p[:, 1:], stands, _SHORTEST / dt))
    columns = np.hstack([row.reshape(len(q), -1) for row in [*rows, q[:, 7:]]])
    w = (1.0 - flying(reference, time)) * eased[:, 0]
    stretch = PchipInterpolator(time, w)
    return MotionPath(
        duration=float(time[-1]),
        curve=CubicSpline(time, columns),
        stretch=stretch,
        stretched=stretch.antiderivative(),
        contact=reference.contact,
        time=time,
        resting=(not moving[0], not moving[1]),
        upper=len(legs.upper),
    )


def _steady(stands: BoolArray, shortest: int) -> BoolArray:
    """(T, 2) which feet stand, without swings of less than so many samples."""
    steady = stands.copy()
    for foot in range(2):
        for a, b in runs(~stands[:, foot]):
            steady[a:b, foot] |= b - a < shortest
    return steady


def _loads(center: Array, feet: Array, stands: BoolArray, ramp: float) -> Array:
    """(T, 2) share of the weight on each foot, by where the centre of mass (T, 3) is."""
    apart = (feet[:, 0] - feet[:, 1])[:, :2]
    along = np.sum((center - feet[:, 1])[:, :2] * apart, axis=1)
    left = np.clip(along / np.maximum(np.sum(apart**2, axis=1), 1e-6), 0.0, 1.0)
    share = np.stack([left, 1.0 - left], axis=1)
    share[stands.sum(axis=1) < 2] = 1.0
    return np.asarray(gaussian_filter1d(share * stands, 0.3 * ramp, axis=0, mode="nearest"))


def _smooth(x: Array, width: float) -> Array:
    """(T, n) smoothed columns that start and end where x does."""
    mean = gaussian_filter1d(x, width, axis=0, mode="nearest")
    s = np.linspace(0.0, 1.0, len(x))[:, None]
    return np.asarray(mean + (1.0 - s) * (x[0] - mean[0]) + s * (x[-1] - mean[-1]))


def _ease(s: Array) -> Array:
    """A minimum-jerk step from 0 to 1."""
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _tilt(R: Array) -> Array:
    """(T, 3) the shortest turns in world that bring the body's upward axis upright to it."""
    up = R[:, :, 2]
    sine = np.cross([0.0, 0.0, 1.0], up)
    size = np.linalg.norm(sine, axis=1, keepdims=True)
    angle = np.arctan2(size, up[:, 2:])
    return np.asarray(sine * np.where(size > 1e-9, angle / np.maximum(size, 1e-9), 1.0))


def _swings(stands: BoolArray) -> list[tuple[int, int]]:
    """First and last sample of each swing, those on the ground before and after included."""
    last = len(stands) - 1
    return [(max(a - 1, 0), min(b, last)) for a, b in runs(~stands)]


def _foot_way(way: Array, stands: BoolArray) -> Array:
    """(T, 2) a foot's share of the pelvis' way (T, 2): constant while it stands."""
    last = len(stands) - 1
    held = {0: way[0], last: way[last]}
    made = np.zeros_like(way)
    for a, b in runs(stands):
        at = 0 if a == 0 else last if b > last else (a + b) // 2
        made[a:b] = way[at]
        held[a] = held[b - 1] = way[at]
    for a, b in _swings(stands):
        s = _ease(np.linspace(0.0, 1.0, b + 1 - a))[:, None]
        made[a : b + 1] = (1.0 - s) * held[a] + s * held[b]
    return made
