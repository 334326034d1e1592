"""The retargeting problem solved offline with exact constraints, to judge the online solver by.

CasADi's own symbolic kinematics, exact Hessians and IPOPT's interior point take the
place of everything that is fast in :mod:`.solver`: same objective, same
constraints, none of the code. Seconds for a window of half a second.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.kinematics import Points, Tree, body_poses, distances
from robomirror_drake.optimization.retargeting.problem import Problem

NEAR = 0.06
"""Pairs nearer than this where the solve starts are constrained, all are checked [m]."""


class ReferenceSolution(NamedTuple):
    """``control`` (K, 29) control points and the ``objective`` there."""

    control: Array
    objective: float


def solve_reference(
    problem: Problem, standing: BoolArray, start: Array, tolerance: float, iterations: int = 300
) -> ReferenceSolution:
    """Solves with IPOPT.

    Args:
        problem: The problem.
        standing: (S, 8) which sole corners stand.
        start: (K, 29) control points to begin with.
        tolerance: How far a standing corner may be from its anchor in each direction, a
            corner below the floor, or a pair below its margin [m].
        iterations: The most that IPOPT may take.

    Raises:
        RetargetingError: IPOPT found no solution.
    """
    terms, frames = problem.terms, len(problem.basis.first)
    size, n = start.shape
    c = ca.MX.sym("c", n, size)
    x = ca.mtimes(c, ca.DM(_matrix(problem.basis)).T)
    frame = _frame(problem, _near_pairs(problem, start))
    data = ca.DM(
        np.hstack(
            [
                terms.reference.transpose(0, 2, 1).reshape(frames, -1),
                terms.target.reshape(frames, -1),
                terms.weight,
                terms.goal.reshape(frames, -1),
                terms.direction_weight,
                terms.support.reshape(frames, -1),
                terms.support_weight[:, None],
            ]
        )
    )
    cost, corners, gaps = frame.map(frames)(x, data.T)
    flat = ca.vec(c)
    quadratic = ca.DM(_dense(problem.quadratic))
    objective = ca.sum2(cost) + 0.5 * ca.bilin(quadratic, flat, flat)
    objective -= ca.dot(ca.DM(problem.linear.ravel()), flat)

    anchor = terms.anchor.reshape(frames, -1)
    free = ~np.repeat(standing, 3, axis=1)
    low, high = anchor - tolerance, anchor + tolerance
    low[free], high[free] = -np.inf, np.inf
    low[:, 2::3] = np.maximum(low[:, 2::3], -tolerance)
    joints, h, limits = c[6:, :], problem.spacing, problem.limits
    speed, bend = limits.speed * h, limits.acceleration * h**2
    rows = [
        (ca.vec(corners), low.ravel(), high.ravel()),
        (ca.vec(gaps), np.full(gaps.numel(), -tolerance), np.full(gaps.numel(), np.inf)),
        (ca.vec(ca.diff(joints, 1, 1)), -np.tile(speed, size - 1), np.tile(speed, size - 1)),
        (ca.vec(ca.diff(joints, 2, 1)), -np.tile(bend, size - 2), np.tile(bend, size - 2)),
    ]
    bound = np.full((size, n), np.inf)
    lower, upper = -bound.copy(), bound.copy()
    lower[:, 6:], upper[:, 6:] = limits.lower, limits.upper
    solver = ca.nlpsol(
        "reference",
        "ipopt",
        {"x": flat, "f": objective, "g": ca.vertcat(*(row[0] for row in rows))},
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": iterations}},
    )
    found = solver(
        x0=start.ravel(),
        lbx=lower.ravel(),
        ubx=upper.ravel(),
        lbg=np.concatenate([row[1] for row in rows]),
        ubg=np.concatenate([row[2] for row in rows]),
    )
    if not solver.stats()["success"]:
        taken = {"iterations": float(solver.stats()["iter_count"])}
        raise RetargetingError("reference solve", taken, ["iterations"])
    return ReferenceSolution(np.array(found["x"]).reshape(size, n), float(found["f"]))


def _matrix(basis: spline.Basis) -> Array:
    """(S, K) values of the basis."""
    matrix = np.zeros((len(basis.first), basis.points))
    for r in range(spline.ORDER):
        matrix[np.arange(len(basis.first)), basis.first + r] = basis.weights[0, :, r]
    return matrix


def _dense(quadratic: Array) -> Array:
    """(K n, K n) of a Hessian (4, K, n) that does not couple coordinates."""
    _, size, n = quadratic.shape
    full = np.zeros((size, n, size, n))
    k, i = np.meshgrid(np.arange(size), np.arange(n), indexing="ij")
    full[k, i, k, i] = quadratic[0]
    for r in range(1, spline.ORDER):
        full[k[:-r], i[:-r], k[r:], i[r:]] = full[k[r:], i[r:], k[:-r], i[:-r]] = quadratic[r, :-r]
    return full.reshape(size * n, size * n)


def _near_pairs(problem: Problem, control: Array) -> list[int]:
    terms = problem.terms
    R, p = body_poses(terms.tree, terms.reference, spline.evaluate(problem.basis, control))
    return [int(m) for m in np.flatnonzero(distances(terms.capsules, R, p).min(axis=0) < NEAR)]


def _frame(problem: Problem, pairs: list[int]) -> ca.Function:
    """One frame: (x, data) to its objective, its corners (24) and the gaps of pairs."""
    terms = problem.terms
    tree, n = terms.tree, problem.linear.shape[1]
    x = ca.SX.sym("x", n)
    reference = ca.SX.sym("reference", 3, 3)
    target = ca.SX.sym("target", 3, len(terms.points.body))
    weight = ca.SX.sym("weight", len(terms.points.body))
    goal = ca.SX.sym("goal", 3, len(terms.directions.body))
    direction_weight = ca.SX.sym("direction_weight", len(terms.directions.body))
    support = ca.SX.sym("support", 3, terms.support.shape[1])
    support_weight = ca.SX.sym("support_weight")
    given = (reference, target, weight, goal, direction_weight, support, support_weight)

    R, p = _poses(tree, reference, x)
    miss = _points(terms.points, R, p) - target
    cost = 0.5 * ca.dot(weight, ca.sum1(miss**2).T)
    origin = [ca.SX.zeros(3)] * len(p)
    turned = _points(terms.directions, R, origin) - goal
    cost += 0.5 * ca.dot(direction_weight, ca.sum1(turned**2).T)
    centers = _points(Points(np.arange(len(p)), tree.center), R, p)
    com = ca.mtimes(centers, tree.mass / tree.mass.sum())
    outside = ca.fmax(0.0, ca.mtimes(support[:2, :].T, com[:2]) - support[2, :].T)
    cost += 0.5 * support_weight * ca.sumsqr(outside)

    gaps = [_gap(problem, R, p, m) for m in pairs]
    corners = ca.vec(_points(terms.corners, R, p))
    data = ca.vertcat(*(ca.vec(part) for part in given))
    return ca.Function("frame", [x, data], [cost, corners, ca.vertcat(ca.SX(0, 1), *gaps)])


def _poses(tree: Tree, reference: ca.SX, x: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    phi = x[3:6]
    angle = ca.sqrt(ca.sumsqr(phi) + 1e-16)
    R, p = [ca.mtimes(reference, _rotation(phi / angle, angle))], [x[:3]]
    for b in range(1, len(tree.parent)):
        up = tree.parent[b]
        turn = ca.mtimes(ca.DM(tree.rotation[b]), _rotation(ca.DM(tree.axis[b]), x[5 + b]))
        R.append(ca.mtimes(R[up], turn))
        p.append(p[up] + ca.mtimes(R[up], ca.DM(tree.offset[b])))
    return R, p


def _rotation(axis: ca.SX | ca.DM, angle: ca.SX) -> ca.SX:
    """Rodrigues' formula."""
    K = ca.skew(axis)
    R: ca.SX = ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * ca.mtimes(K, K)
    return R


def _points(points: Points, R: list[ca.SX], p: list[ca.SX]) -> ca.SX:
    """(3, P) points in world."""
    pairs = zip(points.body, points.local, strict=True)
    columns: ca.SX = ca.horzcat(*(p[b] + ca.mtimes(R[b], ca.DM(local)) for b, local in pairs))
    return columns


def _gap(problem: Problem, R: list[ca.SX], p: list[ca.SX], pair: int) -> ca.SX:
    """Distance of a pair of capsules above the margin."""
    capsules = problem.terms.capsules
    ends = []
    for k in capsules.pairs[pair]:
        b = capsules.body[k]
        ends.append([p[b] + ca.mtimes(R[b], ca.DM(end)) for end in capsules.ends[k]])
    (a0, a1), (b0, b1) = ends
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    a, b, c = ca.sumsqr(u) + 1e-9, ca.dot(u, v), ca.dot(u, w)
    e, f = ca.sumsqr(v) + 1e-9, ca.dot(v, w)
    s = ca.fmin(1.0, ca.fmax(0.0, (b * f - c * e) / (a * e - b * b + 1e-12)))
    t = ca.fmin(1.0, ca.fmax(0.0, (b * s + f) / e))
    s = ca.fmin(1.0, ca.fmax(0.0, (b * t - c) / a))
    i, j = capsules.pairs[pair]
    clear = capsules.radius[i] + capsules.radius[j] + problem.terms.margin
    gap: ca.SX = ca.sqrt(ca.sumsqr(w + s * u - t * v) + 1e-12) - clear
    return gap
