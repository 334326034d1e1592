"""Kinematics of a floating-base robot over all frames of a trajectory at once, compiled.

A frame is x (6 + J,): base position [m], base orientation as a rotation vector φ
[rad] in R = R_ref exp(φ) with a given reference rotation, J joint angles [rad].
So every coordinate is a joint with an axis: three sliding, three turning at the
base, then the robot's own. Body 0 is the base, body i is moved by joint i − 1.

The sum of squares of weighted point errors has a Gauss–Newton Hessian that is
assembled here as the mass matrix is by the composite rigid body algorithm: with
all twists taken about the base's origin, in world axes, each body gathers the
weight matrix W (6, 6) and wrench f (6,) of its points, children are added to
parents, and then H_ij = T_iᵀ W_j T_j for j in the subtree of i, g_i = T_iᵀ f_i.

Source: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from numba import njit

from robomirror_drake.messages import Array
from robomirror_drake.robot import Robot, rotation_matrix

Indices = npt.NDArray[np.int64]


class Tree(NamedTuple):
    """The robot's bodies, parents before children.

    Attributes:
        parent: (B,) index of each body's parent; -1 for the base.
        rotation: (B, 3, 3) pose of the body in its parent at joint angle zero.
        offset: (B, 3) likewise the origin [m].
        axis: (B, 3) the joint's axis in the body's frame.
        mass: (B,) mass [kg].
        center: (B, 3) centre of mass in the body's frame [m].
    """

    parent: Indices
    rotation: Array
    offset: Array
    axis: Array
    mass: Array
    center: Array


class Points(NamedTuple):
    """Points fixed to bodies: ``body`` (P,) and ``local`` (P, 3) in its frame [m]."""

    body: Indices
    local: Array


class Capsules(NamedTuple):
    """Capsules fixed to bodies and which of them to keep apart.

    Attributes:
        body: (C,) body of each.
        ends: (C, 2, 3) ends of its axis in the body's frame [m].
        radius: (C,) [m].
        pairs: (M, 2) indices of two capsules.
    """

    body: Indices
    ends: Array
    radius: Array
    pairs: Indices


def make_tree(robot: Robot) -> Tree:
    """The tables of a robot, from its Pinocchio model (free-flyer, then revolute joints)."""
    model = robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    placements = model.jointPlacements[1:]
    # A revolute joint's Jacobian column in its own frame is (0, axis).
    axes = [
        pin.computeJointJacobian(model, data, pin.neutral(model), i)[3:, model.joints[i].idx_v]
        for i in range(2, model.njoints)
    ]
    return Tree(
        parent=np.array([p - 1 for p in model.parents[1:]]),
        rotation=np.array([placement.rotation for placement in placements]),
        offset=np.array([placement.translation for placement in placements]),
        axis=np.array([np.zeros(3), *axes]),
        mass=np.array([inertia.mass for inertia in model.inertias[1:]]),
        center=np.array([inertia.lever for inertia in model.inertias[1:]]),
    )


def body_point(robot: Robot, link: str, point: npt.ArrayLike) -> tuple[int, Array]:
    """Index of the body that a link belongs to, and a point of the link in the body's frame."""
    frame = robot.model.frames[robot.frame_id(link)]
    return frame.parentJoint - 1, frame.placement.act(np.asarray(point, dtype=np.float64))


def make_points(robot: Robot, points: list[tuple[str, npt.ArrayLike]]) -> Points:
    """Points given as (link, position in the link's frame [m])."""
    made = [body_point(robot, link, point) for link, point in points]
    return Points(np.array([body for body, _ in made]), np.array([local for _, local in made]))


def make_capsules(robot: Robot) -> Capsules:
    """The capsules of the robot's YAML and the pairs that must not meet."""
    spec = robot.spec
    names = list(spec.collision)
    ends = [
        [body_point(robot, capsule.link, end) for end in capsule.ends]
        for capsule in spec.collision.values()
    ]
    return Capsules(
        body=np.array([both[0][0] for both in ends]),
        ends=np.array([[local for _, local in both] for both in ends]),
        radius=np.array([capsule.radius for capsule in spec.collision.values()]),
        pairs=np.array([[names.index(a), names.index(b)] for a, b in spec.collision_pairs]),
    )


def body_poses(tree: Tree, reference: Array, x: Array) -> tuple[Array, Array]:
    """Poses of all bodies in world.

    Args:
        tree: The robot.
        reference: (T, 3, 3) R_ref.
        x: (T, 6 + J) frames.

    Returns:
        (T, B, 3, 3) rotations, (T, B, 3) origins [m].
    """
    R, p = _body_poses(tree, reference, x)
    return np.asarray(R), np.asarray(p)


def configuration_poses(tree: Tree, q: Array) -> tuple[Array, Array]:
    """Poses of all bodies at configurations (T, 30) in Drake's order, as :func:`body_poses`."""
    # Without an offset the frame's orientation is the reference's.
    x = np.hstack([q[:, 4:7], np.zeros((len(q), 3)), q[:, 7:]])
    return body_poses(tree, rotation_matrix(q[:, :4]), x)


def positions(points: Points, R: Array, p: Array) -> Array:
    """(T, P, 3) points in world, of body poses from :func:`body_poses` [m]."""
    return np.asarray(
        p[:, points.body] + np.einsum("tpij,pj->tpi", R[:, points.body], points.local)
    )


def center_of_mass(tree: Tree, R: Array, p: Array) -> Array:
    """(T, 3) centre of mass in world [m]."""
    centers = p + np.einsum("tbij,bj->tbi", R, tree.center)
    return np.asarray(np.einsum("b,tbi->ti", tree.mass / tree.mass.sum(), centers))


def distances(capsules: Capsules, R: Array, p: Array) -> Array:
    """(T, M) signed distance between the capsules of each pair [m]."""
    return np.asarray(_distances(capsules, R, p))


@njit(cache=True)
def rotation_exp(phi, E, J):  # type: ignore[no-untyped-def]
    """exp(φ) into E and its left Jacobian into J, both (3, 3)."""
    square = phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2
    angle = np.sqrt(square)
    if angle < 1e-4:
        a, b, c = 1 - square / 6, 0.5 - square / 24, 1 / 6 - square / 120
    else:
        a, b = np.sin(angle) / angle, (1 - np.cos(angle)) / square
        c = (1 - a) / square
    for i in range(3):
        for j in range(3):
            outer = phi[i] * phi[j]
            E[i, j] = b * outer
            J[i, j] = c * outer
        E[i, i] += 1 - b * square
        J[i, i] += 1 - c * square
    for i in range(3):  # cross-product part: entry (i, i+1) of [φ]× is -φ_{i+2}
        j, k = (i + 1) % 3, (i + 2) % 3
        E[i, j] -= a * phi[k]
        E[j, i] += a * phi[k]
        J[i, j] -= b * phi[k]
        J[j, i] += b * phi[k]


@njit(cache=True)
def _forward(tree, reference, x, R, p, turn):  # type: ignore[no-untyped-def]
    """One frame: rotations R (B, 3, 3), origins p (B, 3), base turning axes turn (3, 3)."""
    E, J = np.empty((3, 3)), np.empty((3, 3))
    rotation_exp(x[3:6], E, J)
    for i in range(3):
        p[0, i] = x[i]
        for j in range(3):
            R[0, i, j] = 0.0
            turn[i, j] = 0.0
            for k in range(3):
                R[0, i, j] += reference[i, k] * E[k, j]
                turn[i, j] += reference[i, k] * J[k, j]
    A = np.empty((3, 3))
    for b in range(1, len(tree.parent)):
        up = tree.parent[b]
        s, c = np.sin(x[5 + b]), np.cos(x[5 + b])
        u, v, w = tree.axis[b]
        E[0, 0], E[0, 1], E[0, 2] = (
            c + u * u * (1 - c),
            u * v * (1 - c) - w * s,
            u * w * (1 - c) + v * s,
        )
        E[1, 0], E[1, 1], E[1, 2] = (
            u * v * (1 - c) + w * s,
            c + v * v * (1 - c),
            v * w * (1 - c) - u * s,
        )
        E[2, 0], E[2, 1], E[2, 2] = (
            u * w * (1 - c) - v * s,
            v * w * (1 - c) + u * s,
            c + w * w * (1 - c),
        )
        for i in range(3):
            p[b, i] = p[up, i]
            for j in range(3):
                p[b, i] += R[up, i, j] * tree.offset[b, j]
                A[i, j] = 0.0
                for k in range(3):
                    A[i, j] += R[up, i, k] * tree.rotation[b, k, j]
        for i in range(3):
            for j in range(3):
                R[b, i, j] = A[i, 0] * E[0, j] + A[i, 1] * E[1, j] + A[i, 2] * E[2, j]


@njit(cache=True)
def _body_poses(tree, reference, x):  # type: ignore[no-untyped-def]
    frames, bodies = x.shape[0], len(tree.parent)
    R, p, turn = np.empty((frames, bodies, 3, 3)), np.empty((frames, bodies, 3)), np.empty((3, 3))
    for t in range(frames):
        _forward(tree, reference[t], x[t], R[t], p[t], turn)
    return R, p


@njit(cache=True)
def act(R, p, local, out):  # type: ignore[no-untyped-def]
    """A point of a body at pose R, p into ``out``."""
    for i in range(3):
        out[i] = p[i] + R[i, 0] * local[0] + R[i, 1] * local[1] + R[i, 2] * local[2]


@njit(cache=True, inline="always")
def closest_points(a0, a1, b0, b1, pa, pb):  # type: ignore[no-untyped-def]
    """Closest points of two segments into pa and pb (C. Ericson, "Real-Time Collision
    Detection", 2005, §5.1.9); returns their distance."""
    a = b = c = e = f = 0.0
    for i in range(3):
        d1, d2, r = a1[i] - a0[i], b1[i] - b0[i], a0[i] - b0[i]
        a += d1 * d1
        b += d1 * d2
        c += d1 * r
        e += d2 * d2
        f += d2 * r
    if a < 1e-12 and e < 1e-12:
        s, t = 0.0, 0.0
    elif a < 1e-12:
        s, t = 0.0, min(max(f / e, 0.0), 1.0)
    elif e < 1e-12:
        s, t = min(max(-c / a, 0.0), 1.0), 0.0
    else:
        # Where the segments are parallel any s will do; the middle keeps the point still.
        det = a * e - b * b
        s = min(max((b * f - c * e) / det, 0.0), 1.0) if det > 1e-9 * a * e else 0.5
        t = (b * s + f) / e
        if t < 0.0:
            s, t = min(max(-c / a, 0.0), 1.0), 0.0
        elif t > 1.0:
            s, t = min(max((b - c) / a, 0.0), 1.0), 1.0
    square = 0.0
    for i in range(3):
        pa[i] = a0[i] + s * (a1[i] - a0[i])
        pb[i] = b0[i] + t * (b1[i] - b0[i])
        square += (pa[i] - pb[i]) ** 2
    return np.sqrt(square)


@njit(cache=True)
def _capsule_ends(capsules, R, p, ends):  # type: ignore[no-untyped-def]
    for k in range(len(capsules.body)):
        b = capsules.body[k]
        act(R[b], p[b], capsules.ends[k, 0], ends[k, 0])
        act(R[b], p[b], capsules.ends[k, 1], ends[k, 1])


@njit(cache=True)
def _distances(capsules, R, p):  # type: ignore[no-untyped-def]
    frames, pairs = R.shape[0], len(capsules.pairs)
    distance = np.empty((frames, pairs))
    ends = np.empty((len(capsules.body), 2, 3))
    pa, pb = np.empty(3), np.empty(3)
    for t in range(frames):
        _capsule_ends(capsules, R[t], p[t], ends)
        for m in range(pairs):
            a, b = capsules.pairs[m]
            gap = closest_points(ends[a, 0], ends[a, 1], ends[b, 0], ends[b, 1], pa, pb)
            distance[t, m] = gap - capsules.radius[a] - capsules.radius[b]
    return distance
