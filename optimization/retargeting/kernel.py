"""Cost, gradient and Gauss–Newton Hessian of the retargeting problem, frame by frame.

At each sample the augmented cost of a frame x is, weights being per sample,

    ½ Σ w ‖p(x) − target‖²  +  ½ Σ w ‖R(x) d − goal‖²               keypoints, directions
  + ½ Σ w max(0, n · com(x) − b)²                                   support, where slow
  + ½ ρ ‖dead(c(x) − anchor + λ/ρ)‖²                                corners that stand
  + ½ ρ max(0, −c_z(x) + λ/ρ)²  +  ½ ρ max(0, m − d(x) + λ/ρ)²      floor, self-collision

The first two lines are the objective, the others the augmented Lagrangian of the
constraints, where dead(y) is what of y exceeds ±δ. The Hessian keeps ρ within ±δ, or steps
would run far out on the other side (J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch. 17).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.kinematics import (
    Capsules,
    Points,
    Tree,
    _capsule_ends,
    _forward,
    act,
    closest_points,
)


class Terms(NamedTuple):
    """What the frames of a window are asked to do, at S samples.

    Attributes:
        tree: The robot.
        reference: (S, 3, 3) R_ref.
        points: P keypoints.
        target: (S, P, 3) where they should be [m].
        weight: (S, P) their weights.
        directions: D unit vectors fixed to bodies.
        goal: (S, D, 3) where they should point.
        direction_weight: (S, D) their weights.
        corners: The 8 sole corners, left foot first.
        anchor: (S, 8, 3) where a standing corner stands [m].
        standing: (S, 8) which of them stand.
        support: (S, M, 3) half planes (n_x, n_y, b), n · com ≤ b.
        support_weight: (S,) their weight, 0 where the motion is not slow.
        capsules: The self-collision pairs.
        margin: Least distance of the pairs [m].
    """

    tree: Tree
    reference: Array
    points: Points
    target: Array
    weight: Array
    directions: Points
    goal: Array
    direction_weight: Array
    corners: Points
    anchor: Array
    standing: BoolArray
    support: Array
    support_weight: Array
    capsules: Capsules
    margin: float


class Multipliers(NamedTuple):
    """Lagrange multipliers λ of the frames' constraints and their penalties ρ.

    Attributes:
        stance: (S, 8, 3) of the standing corners.
        floor: (S, 8) of the corners' heights, ≥ 0.
        collision: (S, M) of the pairs' distances, ≥ 0.
        stance_penalty, floor_penalty, collision_penalty: ρ.
    """

    stance: Array
    floor: Array
    collision: Array
    stance_penalty: float
    floor_penalty: float
    collision_penalty: float


class Residuals(NamedTuple):
    """Constraint functions at the frames: zero where standing, ≥ 0 elsewhere.

    Attributes:
        stance: (S, 8, 3) standing corner from its anchor, 0 where it does not stand [m].
        height: (S, 8) of the corners [m].
        distance: (S, M) of the pairs above the margin; capped at 0.1 where far [m].
    """

    stance: Array
    height: Array
    distance: Array


def cost(terms: Terms, multipliers: Multipliers, x: Array) -> tuple[float, float, Residuals]:
    """Objective and augmented cost, summed over frames x (S, 29), and the residuals."""
    objective, augmented, residuals, _, _ = _run(terms, multipliers, x, False)
    return objective, float(augmented.sum()), residuals


def normal_equations(
    terms: Terms, multipliers: Multipliers, x: Array
) -> tuple[Array, Residuals, Array, Array]:
    """Augmented cost of each frame (S,), the residuals, gradient (S, 29), Hessian (S, 29, 29)."""
    return _run(terms, multipliers, x, True)[1:]


def _run(
    terms: Terms, multipliers: Multipliers, x: Array, derivatives: bool
) -> tuple[float, Array, Residuals, Array, Array]:
    samples, n = x.shape
    residuals = Residuals(
        np.zeros((samples, 8, 3)),
        np.empty((samples, 8)),
        np.empty((samples, len(terms.capsules.pairs))),
    )
    augmented = np.empty(samples)
    gradient = np.zeros((samples if derivatives else 0, n))
    hessian = np.zeros((samples if derivatives else 0, n, n))
    objective = _frames(
        terms,
        multipliers,
        np.ascontiguousarray(x),
        derivatives,
        augmented,
        residuals,
        gradient,
        hessian,
    )
    return objective, augmented, residuals, gradient, hessian


DEADBAND = 5e-4
"""Within which a standing corner stands: a spline cannot stand still exactly [m]."""

FAR = 0.1
"""Distance above which a pair's own is not worked out [m]."""


@njit(cache=True)
def _add_point(W, s, w0, w1, w2, F0, F1, F2):  # type: ignore[no-untyped-def]
    """Adds a point at s from the base's origin, with weights w and force F, to a body's row
    W = [diag A (3), B (9), C (6: 00 11 22 01 02 12), force (3), moment (3)]."""
    x, y, z = s[0], s[1], s[2]
    W[0] += w0
    W[1] += w1
    W[2] += w2
    W[4] += w0 * z
    W[5] -= w0 * y
    W[6] -= w1 * z
    W[8] += w1 * x
    W[9] += w2 * y
    W[10] -= w2 * x
    W[12] += w1 * z * z + w2 * y * y
    W[13] += w0 * z * z + w2 * x * x
    W[14] += w0 * y * y + w1 * x * x
    W[15] -= w2 * x * y
    W[16] -= w1 * x * z
    W[17] -= w0 * y * z
    W[18] += F0
    W[19] += F1
    W[20] += F2
    W[21] += y * F2 - z * F1
    W[22] += z * F0 - x * F2
    W[23] += x * F1 - y * F0


@njit(cache=True)
def _add_direction(W, u, w, F0, F1, F2):  # type: ignore[no-untyped-def]
    """Adds a direction u (world) with weight w and error force F to a body's row."""
    x, y, z = u[0], u[1], u[2]
    W[12] += w * (y * y + z * z)
    W[13] += w * (x * x + z * z)
    W[14] += w * (x * x + y * y)
    W[15] -= w * x * y
    W[16] -= w * x * z
    W[17] -= w * y * z
    W[21] += y * F2 - z * F1
    W[22] += z * F0 - x * F2
    W[23] += x * F1 - y * F0


@njit(cache=True)
def _composite(tree, W, twist, g, H):  # type: ignore[no-untyped-def]
    """Gradient and lower triangle of the Hessian from the bodies' rows, children first."""
    y = np.empty(6)
    for b in range(len(tree.parent) - 1, -1, -1):
        w = W[b]
        for j in range(5 + b, 4 + b, -1) if b > 0 else range(5, -1, -1):
            v0, v1, v2, a0, a1, a2 = twist[j]
            y[0] = w[0] * v0 + w[3] * a0 + w[4] * a1 + w[5] * a2
            y[1] = w[1] * v1 + w[6] * a0 + w[7] * a1 + w[8] * a2
            y[2] = w[2] * v2 + w[9] * a0 + w[10] * a1 + w[11] * a2
            y[3] = w[3] * v0 + w[6] * v1 + w[9] * v2 + w[12] * a0 + w[15] * a1 + w[16] * a2
            y[4] = w[4] * v0 + w[7] * v1 + w[10] * v2 + w[15] * a0 + w[13] * a1 + w[17] * a2
            y[5] = w[5] * v0 + w[8] * v1 + w[11] * v2 + w[16] * a0 + w[17] * a1 + w[14] * a2
            for k in range(3):
                g[j] += twist[j, k] * w[18 + k] + twist[j, 3 + k] * w[21 + k]
            up = b
            while up > 0:
                i = 5 + up
                H[j, i] += (
                    twist[i, 0] * y[0] + twist[i, 1] * y[1] + twist[i, 2] * y[2]
                    + twist[i, 3] * y[3] + twist[i, 4] * y[4] + twist[i, 5] * y[5]
                )  # fmt: skip
                up = tree.parent[up]
            for i in range(min(j, 5) + 1):
                if i < 3:
                    H[j, i] += y[i]
                else:
                    H[j, i] += twist[i, 3] * y[3] + twist[i, 4] * y[4] + twist[i, 5] * y[5]
        if b > 0:
            W[tree.parent[b]] += w


@njit(cache=True)
def _point_row(tree, twist, body, s, n, sign, row):  # type: ignore[no-untyped-def]
    """Adds sign · n · ∂p/∂x of a point at s from the base's origin to ``row``."""
    moment = np.array(
        [s[1] * n[2] - s[2] * n[1], s[2] * n[0] - s[0] * n[2], s[0] * n[1] - s[1] * n[0]]
    )
    for i in range(3):
        row[i] += sign * n[i]
    for i in range(3, 6):
        for k in range(3):
            row[i] += sign * twist[i, 3 + k] * moment[k]
    while body > 0:
        i = 5 + body
        for k in range(3):
            row[i] += sign * (twist[i, k] * n[k] + twist[i, 3 + k] * moment[k])
        body = tree.parent[body]


@njit(cache=True)
def _add_row(row, weight, force, g, H):  # type: ignore[no-untyped-def]
    """Adds a scalar row's ``force · row`` to g and ``weight · row rowᵀ`` to H's lower triangle."""
    for i in range(len(row)):
        if row[i] != 0.0:
            g[i] += force * row[i]
            for j in range(i + 1):
                H[i, j] += weight * row[i] * row[j]


@njit(cache=True)
def _frames(terms, multipliers, x, derivatives, costs, residuals, gradient, hessian):  # type: ignore[no-untyped-def]
    tree, capsules = terms.tree, terms.capsules
    bodies, n = len(tree.parent), x.shape[1]
    R, p, turn = np.empty((bodies, 3, 3)), np.empty((bodies, 3)), np.empty((3, 3))
    W, twist = np.empty((bodies, 24)), np.zeros((n, 6))
    s, u, pa, pb, row = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(n)
    ends = np.empty((len(capsules.body), 2, 3))
    subtree_mass, subtree_center = np.empty(bodies), np.empty((bodies, 3))
    total_mass = tree.mass.sum()
    for i in range(3):
        twist[i, i] = 1.0
    objective = augmented = 0.0

    for t in range(x.shape[0]):
        already = objective + augmented
        _forward(tree, terms.reference[t], x[t], R, p, turn)
        W[:] = 0.0
        for i in range(3):
            for k in range(3):
                twist[3 + i, 3 + k] = turn[k, i]
        for b in range(1, bodies):
            a = twist[5 + b]
            for k in range(3):
                a[3 + k] = (
                    R[b, k, 0] * tree.axis[b, 0]
                    + R[b, k, 1] * tree.axis[b, 1]
                    + R[b, k, 2] * tree.axis[b, 2]
                )
                s[k] = p[b, k] - p[0, k]
            a[0] = s[1] * a[5] - s[2] * a[4]
            a[1] = s[2] * a[3] - s[0] * a[5]
            a[2] = s[0] * a[4] - s[1] * a[3]
        g = gradient[t if derivatives else 0 : t + 1].reshape(-1)
        H = hessian[t] if derivatives else np.empty((0, 0))

        for k in range(len(terms.points.body)):
            w = terms.weight[t, k]
            if w > 0.0:
                b = terms.points.body[k]
                act(R[b], p[b], terms.points.local[k], s)
                square = 0.0
                for i in range(3):
                    u[i] = s[i] - terms.target[t, k, i]
                    square += u[i] * u[i]
                    s[i] -= p[0, i]
                objective += 0.5 * w * square
                _add_point(W[b], s, w, w, w, w * u[0], w * u[1], w * u[2])

        for k in range(len(terms.directions.body)):
            w = terms.direction_weight[t, k]
            if w > 0.0:
                b = terms.directions.body[k]
                s[:] = 0.0
                act(R[b], s, terms.directions.local[k], u)
                square = 0.0
                for i in range(3):
                    s[i] = u[i] - terms.goal[t, k, i]
                    square += s[i] * s[i]
                objective += 0.5 * w * square
                _add_direction(W[b], u, w, w * s[0], w * s[1], w * s[2])

        for k in range(len(terms.corners.body)):
            b = terms.corners.body[k]
            act(R[b], p[b], terms.corners.local[k], s)
            residuals.height[t, k] = s[2]
            for i in range(3):
                u[i] = s[i] - terms.anchor[t, k, i]
                s[i] -= p[0, i]
            if terms.standing[t, k]:
                rho = multipliers.stance_penalty
                for i in range(3):
                    residuals.stance[t, k, i] = u[i]
                    u[i] = u[i] * rho + multipliers.stance[t, k, i]
                    u[i] -= min(max(u[i], -rho * DEADBAND), rho * DEADBAND)
                    augmented += 0.5 * u[i] * u[i] / rho
                _add_point(W[b], s, rho, rho, rho, u[0], u[1], u[2])
            else:
                rho = multipliers.floor_penalty
                push = multipliers.floor[t, k] - rho * residuals.height[t, k]
                if push > 0.0:
                    augmented += 0.5 * push * push / rho
                    _add_point(W[b], s, 0.0, 0.0, rho, 0.0, 0.0, -push)

        if derivatives:
            _composite(tree, W, twist, g, H)

        rho = multipliers.collision_penalty
        _capsule_ends(capsules, R, p, ends)
        for m in range(len(capsules.pairs)):
            a, b = capsules.pairs[m]
            clear = capsules.radius[a] + capsules.radius[b] + terms.margin
            gap = _near(ends[a], ends[b], clear + FAR, pa, pb)
            residuals.distance[t, m] = gap - clear
            push = multipliers.collision[t, m] - rho * residuals.distance[t, m]
            if push > 0.0 and gap < clear + FAR:
                augmented += 0.5 * push * push / rho
                if derivatives:
                    if gap < 1e-6:  # axes that meet have no normal: part the middles
                        for i in range(3):
                            u[i] = ends[a, 0, i] + ends[a, 1, i] - ends[b, 0, i] - ends[b, 1, i]
                        u /= np.sqrt((u * u).sum()) + 1e-9
                    else:
                        for i in range(3):
                            u[i] = (pa[i] - pb[i]) / gap
                    row[:] = 0.0
                    for i in range(3):
                        pa[i] -= p[0, i]
                        pb[i] -= p[0, i]
                    _point_row(tree, twist, capsules.body[a], pa, u, 1.0, row)
                    _point_row(tree, twist, capsules.body[b], pb, u, -1.0, row)
                    _add_row(row, rho, -push, g, H)

        w = terms.support_weight[t]
        if w > 0.0:
            for b in range(bodies):
                act(R[b], p[b], tree.center[b], s)
                subtree_mass[b] = tree.mass[b]
                for i in range(3):
                    subtree_center[b, i] = tree.mass[b] * (s[i] - p[0, i])
            for b in range(bodies - 1, 0, -1):
                subtree_mass[tree.parent[b]] += subtree_mass[b]
                subtree_center[tree.parent[b]] += subtree_center[b]
            for m in range(terms.support.shape[1]):
                n0, n1, limit = terms.support[t, m]
                outside = (
                    n0 * (p[0, 0] + subtree_center[0, 0] / total_mass)
                    + n1 * (p[0, 1] + subtree_center[0, 1] / total_mass)
                    - limit
                )
                if outside > 0.0:
                    objective += 0.5 * w * outside * outside
                    if derivatives:
                        row[0], row[1], row[2] = n0, n1, 0.0
                        for j in range(3, n):
                            b = max(j - 5, 0)
                            m0, m1, m2 = subtree_center[b] / total_mass
                            share = subtree_mass[b] / total_mass
                            # The subtree's motion: share · v + ω × (share · centre)
                            v0, v1, _, a0, a1, a2 = twist[j]
                            row[j] = n0 * (share * v0 + a1 * m2 - a2 * m1)
                            row[j] += n1 * (share * v1 + a2 * m0 - a0 * m2)
                        _add_row(row, w, w * outside, g, H)

        costs[t] = objective + augmented - already
        if derivatives:
            for i in range(n):
                for j in range(i):
                    H[j, i] = H[i, j]
    return objective


@njit(cache=True, inline="always")
def _near(a, b, reach, pa, pb):  # type: ignore[no-untyped-def]
    """Distance of two segments (2, 3), or ``reach`` where they are surely farther apart."""
    square = 0.0
    half_a = half_b = 0.0
    for i in range(3):
        square += (0.5 * (a[0, i] + a[1, i] - b[0, i] - b[1, i])) ** 2
        half_a += (a[1, i] - a[0, i]) ** 2
        half_b += (b[1, i] - b[0, i]) ** 2
    least = np.sqrt(square) - 0.5 * (np.sqrt(half_a) + np.sqrt(half_b))
    return reach if least > reach else closest_points(a[0], a[1], b[0], b[1], pa, pb)
