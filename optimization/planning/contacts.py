"""Where the feet stand in a plan, and which wrenches the ground can give there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.retargeting.footholds import TURNS, heading, planar_rotation

ROWS = 16
"""Rows of one wrench cone: normal force, friction 4, yaw 2, hull edges up to 8, one spare."""

_SEGMENT_WIDTH = 0.01  # an edge of a sole that bears alone counts as a strip this wide [m]
_SPINS = 0.015  # a foot that turns by more from sample to sample slides on its spot [rad]
_SLIDING = 0.5  # share of its friction that such a foot has for anything else
_MARGIN_SHARE = 0.3  # a margin takes this share of the hull's width at most, on either side


class Cones(NamedTuple):
    """Linear bounds on contact wrenches, lower ≤ rows · wrench ≤ upper.

    Attributes:
        rows: (T, 16, 6) on [moment about the world's origin N·m, force N].
        lower, upper: (T, 16); infinite where a row has no such side.
    """

    rows: Array
    lower: Array
    upper: Array


class ConeOptions(NamedTuple):
    """Friction coefficient, CoP margin [m], largest normal force [weights], weight [N]."""

    friction: float
    margin: float
    max_normal_force: float
    weight: float


def anchors(corners: Array, contact: BoolArray, sole: Array, path: Array) -> Array:
    """(T, 2, 4, 3) where the corners of each foot stand, flat on z = 0, over each contact phase.

    The pose of a phase is the mean over its frames with the whole sole down, or over all of
    them if there is none; the heading is that of the sole's lateral axis. A foot that pivots
    follows its path over the floor, put where it is nearest to the corners. Outside contact
    they are given back as they are.

    Args:
        corners: (T, 2, 4, 3) corners in world [m].
        contact: (T, 2, 4) schedule.
        sole: (2, 4, 3) corners in the frames of the feet [m].
        path: (T, 2, 4, 3) corners of the kinematic reference [m].
    """
    placed = corners.copy()
    for foot in range(2):
        flat = sole[foot, :, :2] - sole[foot, :, :2].mean(axis=0)
        for start, end in runs(np.asarray(contact[:, foot].any(axis=1))):
            run, stands = slice(start, end), contact[start:end, foot]
            whole = np.asarray(stands.all(axis=1))
            weight = whole.astype(np.float64) if whole.any() else np.ones(end - start)
            weight /= weight.sum()
            share = weight[:, None] * stands / stands.sum(axis=1, keepdims=True)
            yaw, led = (np.unwrap(heading(c[run, foot])) for c in (corners, path))
            if np.ptp(led) < TURNS:
                turned = (flat @ planar_rotation(weight @ yaw).T)[None].repeat(end - start, axis=0)
            else:
                turned = flat @ np.swapaxes(planar_rotation(led), -1, -2)
                each = stands[..., None] / stands.sum(axis=1)[:, None, None]
                turned += ((path[run, foot, :, :2] - turned) * each).sum(axis=1, keepdims=True)
                turned = turned @ planar_rotation(weight @ np.unwrap(yaw - led)).T
            center = np.einsum("tc,tci->i", share, corners[run, foot, :, :2] - turned)
            placed[run, foot, :, :2] = turned + center
            placed[run, foot, :, 2] = 0.0
    return placed


def clearance(contact: BoolArray, height: float, rate: float) -> Array:
    """(T, 2, 4) least height of each corner [m]: an arch over each swing, 0 where a foot stands.

    Args:
        contact: (T, 2, 4) schedule.
        height: Clearance in mid-swing [m]; swings shorter than 0.4 s get less.
        rate: Samples per second.
    """
    least = np.zeros(contact.shape)
    for foot in range(2):
        for start, end in runs(np.asarray(~contact[:, foot].any(axis=1))):
            phase = np.arange(1, end - start + 1) / (end - start + 1)
            peak = height * min(1.0, (end - start) / rate / 0.4)
            least[start:end, foot] = peak * np.sin(np.pi * phase)[:, None] ** 4
    return least


def wrench_cones(standing: Array, loaded: BoolArray, options: ConeOptions) -> Cones:
    """Bounds on the contact wrench at each sample; all six rows are zero in flight.

    The centre of pressure stays a margin inside the convex hull of the loaded corners: for
    each edge with inward normal (a, b) and a x + b y ≥ d inside it, b n_x − a n_y ≥
    (d + margin) f_z, which has no division by f_z. The friction of a foot that pivots alone
    does not drive it.

    Args:
        standing: (T, 2, 4, 3) corners at their anchors [m].
        loaded: (T, 2, 4) corners that may bear load.
        options: See :class:`ConeOptions`.
    """
    T, spins = len(standing), _spins(standing, loaded)
    cones = Cones(np.zeros((T, ROWS, 6)), np.full((T, ROWS), -np.inf), np.full((T, ROWS), np.inf))
    known: dict[bytes, tuple[Array, Array, Array]] = {}
    for t in range(T):
        points = standing[t, ..., :2][loaded[t]]
        key = points.tobytes() + spins[t].tobytes()
        if key not in known:
            known[key] = _cone(points, spins[t], options) if len(points) else _flight(options)
        cones.rows[t], cones.lower[t], cones.upper[t] = known[key]
    return cones


def _spins(standing: Array, loaded: BoolArray) -> Array:
    """(T,) sense in which the only foot that bears load turns, or 0."""
    spin = np.zeros(len(standing))
    for foot in range(2):
        alone = loaded[:, foot].any(axis=1) & ~loaded[:, 1 - foot].any(axis=1)
        turn = np.gradient(np.unwrap(heading(standing[:, foot]))) if len(spin) > 1 else spin
        spin = np.where(alone & (np.abs(turn) > _SPINS), np.sign(turn), spin)
    return spin


def _flight(options: ConeOptions) -> tuple[Array, Array, Array]:
    rows, lower, upper = np.zeros((ROWS, 6)), np.full(ROWS, -np.inf), np.full(ROWS, np.inf)
    rows[:6] = np.eye(6) / options.weight
    lower[:6] = upper[:6] = 0.0
    return rows, lower, upper


def hull_edges(points: Array) -> tuple[Array, Array]:
    """(E, 2), (E,) inward normals n and offsets d of a convex hull: n · p ≥ d inside it [m]."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        # Corners in one line, or a single one, bear as a narrow strip.
        along = points[-1] - points[0]
        length = np.linalg.norm(along)
        u = along / length if length > 1e-6 else np.array([1.0, 0.0])
        side = np.array([-u[1], u[0]]) * _SEGMENT_WIDTH / 2
        tip = u * (0.0 if length > 1e-6 else _SEGMENT_WIDTH / 2)
        ends = np.array([points[0] - tip, points[-1] + tip])
        hull = ConvexHull(np.concatenate([ends + side, ends - side]))
    return -hull.equations[:, :2], hull.equations[:, 2]


def _cone(points: Array, spin: float, options: ConeOptions) -> tuple[Array, Array, Array]:
    mu, margin, strongest, weight = options
    rows, lower, upper = np.zeros((ROWS, 6)), np.full(ROWS, -np.inf), np.full(ROWS, np.inf)
    rows[0, 5] = 1.0
    lower[0], upper[0] = 0.0, strongest * weight
    for row, (axis, sign) in enumerate([(3, 1.0), (3, -1.0), (4, 1.0), (4, -1.0)], start=1):
        rows[row, axis], rows[row, 5] = sign, mu if spin == 0.0 else _SLIDING * mu
    center = points.mean(axis=0)
    arm = mu * float(np.mean(np.linalg.norm(points - center, axis=1)))
    for row, sign in ((5, 1.0), (6, -1.0)):
        rows[row] = [
            0.0,
            0.0,
            sign,
            sign * center[1],
            -sign * center[0],
            0.0 if sign == -spin else arm,
        ]
    normals, offsets = hull_edges(points)
    width = np.max(points @ normals.T - offsets, axis=0)
    inset = offsets + np.minimum(margin, _MARGIN_SHARE * width)
    edges = slice(7, 7 + len(normals))
    rows[edges, 0], rows[edges, 1], rows[edges, 5] = normals[:, 1], -normals[:, 0], -inset
    lower[1 : edges.stop] = 0.0
    # Forces count as moments on an arm of 0.3 m, so that all rows are of one size.
    rows[:5] *= 0.3
    upper[0] *= 0.3
    return rows / weight, lower, upper / weight


def outside(cones: Cones, wrench: Array) -> Array:
    """(T, 16) distance of each row from its bounds, 0 within them."""
    y = np.einsum("trw,tw->tr", cones.rows, wrench)
    return np.asarray(np.abs(y - np.clip(y, cones.lower, cones.upper)))
