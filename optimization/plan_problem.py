"""The least-squares problem of a dynamic plan: what is tracked and what is bounded.

A plan is a cubic B-spline on the robot's whole configuration, at rest at both ends. Its
cost is a sum of squares over samples of the distance to a kinematic reference (keypoints,
trunk orientations, posture, accelerations); its constraints are rows lower ≤ y ≤ upper:
wrench cones, sole corners, joint velocities and torques, gaps between the links. Equalities
enter as an augmented Lagrangian, inequalities as relaxed barriers, so that every step is a
Newton step on a banded matrix.

Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch. 10 and 17.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization import centroidal, spline
from robomirror_drake.optimization.plan_collision import gap_jacobians, gaps
from robomirror_drake.optimization.plan_contacts import Cones
from robomirror_drake.optimization.plan_frames import Frames
from robomirror_drake.optimization.plan_penalty import Penalty, Rows, bound_terms
from robomirror_drake.optimization.plan_torque import Split, joint_torques
from robomirror_drake.robot import Robot

GROUPS = ("wrench", "corners", "speed", "gaps", "torque")
"""Groups of constraint rows."""


class Weights(NamedTuple):
    """Square roots of the cost's weights.

    Attributes:
        keypoint: [1/m].
        orientation: Pelvis and trunk [1/rad].
        posture: (30,) on x itself.
        acceleration: (30,) on ẍ beside the reference's.
        damping: (30,) on ẍ itself.
    """

    keypoint: float
    orientation: float
    posture: Array
    acceleration: Array
    damping: Array


class Evaluation(NamedTuple):
    """The problem at one trajectory.

    Attributes:
        cost: Half the sum of squares, multipliers included.
        values: Constraint rows y by group, (T, m).
        wrench: (T, 6) contact wrench about the world's origin.
        points: (T, P, 3) points of :class:`Frames` in world [m].
        band, gradient: Gauss–Newton matrix and gradient; None without derivatives.
    """

    cost: float
    values: dict[str, Array]
    wrench: Array
    points: Array
    band: Array | None
    gradient: Array | None


@dataclass(frozen=True)
class Problem:
    """A dynamic plan as a least-squares problem with bounded rows.

    Attributes:
        robot: The robot.
        frames: The points looked at.
        basis: Spline basis at the samples.
        target: (T, 30) kinematic reference at the samples, and
        target_acceleration: (T, 30) its second derivative.
        target_points: (T, P, 3) points of the kinematic reference [m].
        target_trunk: (T, 2, 3, 3) orientations of the trunk links.
        rows: Bounds of each group: ``wrench`` (T, 16), ``corners`` (T, 24) [m], ``speed``
            (T, 23) as shares of the limits, ``gaps`` (T, M) between the robot's own links [m],
            ``torque`` (T, 23) as shares of the limits.
        cones: The wrench cones whose rows ``wrench`` are.
        split: How the feet share the wrench, for the torques.
        weights: See :class:`Weights`.
    """

    robot: Robot
    frames: Frames
    basis: spline.Basis
    target: Array
    target_acceleration: Array
    target_points: Array
    target_trunk: Array
    rows: dict[str, Rows]
    cones: Cones
    split: Split
    weights: Weights

    def evaluate(
        self,
        control: Array,
        penalty: dict[str, Penalty],
        multipliers: dict[str, Array],
        *,
        derivatives: bool,
    ) -> Evaluation:
        """Cost and, if asked for, Gauss–Newton matrix and gradient at control points (K, 30).

        Args:
            control: (K, 30) control points.
            penalty: Of each group.
            multipliers: λ of each group's equalities, (T, m).
            derivatives: Whether to build the matrix and the gradient.
        """
        x, xd, xdd = (spline.evaluate(self.basis, control, order) for order in range(3))
        samples = centroidal.sample(
            self.robot.model, self.frames.links, x, xd, xdd, derivatives=derivatives
        )
        points = self.frames.points(samples.links)
        torque, of_torque = joint_torques(
            self.robot,
            samples,
            self.split,
            self.frames.support[self.frames.owner[0:8:4]],
        )
        apart = gaps(self.frames.capsules, samples.links)
        y = {
            "wrench": np.einsum("trw,tw->tr", self.cones.rows, samples.wrench),
            "corners": points[:, :8].reshape(len(x), 24),
            "speed": xd[:, 7:] / self.robot.velocity_limits,
            "gaps": apart.distance,
            "torque": torque / self.robot.effort_limits,
        }
        terms = {
            name: bound_terms(y[name], self.rows[name], penalty[name], multipliers[name])
            for name in GROUPS
        }
        keypoints = (points[:, 8:] - self.target_points[:, 8:]).reshape(len(x), -1)
        turn = samples.links[:, self.frames.trunk, :3, :3] @ np.swapaxes(self.target_trunk, -1, -2)
        skew = 0.5 * (turn - np.swapaxes(turn, -1, -2))
        tilt = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
        tilt = tilt.reshape(len(x), -1)
        w = self.weights
        astray, surge = x - self.target, xdd - self.target_acceleration
        gauge = np.sum(x[:, :4] ** 2, axis=1) - 1.0
        cost = 0.5 * float(
            w.keypoint**2 * np.sum(keypoints**2)
            + w.orientation**2 * np.sum(tilt**2)
            + np.sum((w.posture * astray) ** 2)
            + np.sum((w.acceleration * surge) ** 2)
            + np.sum((w.damping * xdd) ** 2)
            + np.sum(gauge**2)
        )
        cost += sum(term.cost for term in terms.values())
        if samples.jacobians is None or of_torque is None:
            return Evaluation(cost, y, samples.wrench, points, None, None)

        # Residuals and Jacobians of what depends on x alone …
        of_points = centroidal.point_jacobians(
            samples, self.frames.support[self.frames.owner], points
        )
        of_trunk = centroidal.rotation_jacobians(samples, self.frames.support)[:, self.frames.trunk]
        of_gaps = gap_jacobians(self.frames.capsules, apart, samples.motion, self.frames.support)
        stiff = np.sqrt(terms["corners"].curvature)
        tight = np.sqrt(terms["gaps"].curvature)
        J = np.concatenate(
            [
                stiff[..., None] * of_points[:, :8].reshape(len(x), 24, 30),
                w.keypoint * of_points[:, 8:].reshape(len(x), -1, 30),
                w.orientation * of_trunk.reshape(len(x), -1, 30),
                np.pad(tight[..., None] * of_gaps, ((0, 0), (0, 0), (7, 0))),
                np.pad(2.0 * x[:, None, :4], ((0, 0), (0, 0), (0, 26))),
            ],
            axis=1,
        )
        push = terms["corners"].slope / np.where(stiff > 0.0, stiff, 1.0)
        r = np.concatenate(
            [
                push,
                w.keypoint * keypoints,
                w.orientation * tilt,
                terms["gaps"].slope / tight,
                gauge[:, None],
            ],
            axis=1,
        )
        # … and of wrench and torques, which depend on x, ẋ and ẍ.
        wrench = np.concatenate(
            [
                self.cones.rows[None] @ samples.jacobians,
                of_torque / self.robot.effort_limits[:, None],
            ],
            axis=2,
        )
        slope, curvature = (
            np.concatenate([getattr(terms[name], kind) for name in ("wrench", "torque")], axis=1)
            for kind in ("slope", "curvature")
        )
        stiff_wrench = wrench * curvature[None, :, :, None]
        transposed = np.swapaxes(stiff_wrench, -1, -2)
        hessian = {(i, j): transposed[i] @ wrench[j] for i in range(3) for j in range(i + 1)}
        hessian[0, 0] += np.swapaxes(J, 1, 2) @ J
        gradient = np.einsum("atri,tr->ati", wrench, slope)
        gradient[0] += np.einsum("tri,tr->ti", J, r) + w.posture**2 * astray
        gradient[2] += w.acceleration**2 * surge + w.damping**2 * xdd
        gradient[1, :, 7:] += terms["speed"].slope / self.robot.velocity_limits
        speed = np.zeros_like(x)
        speed[:, 7:] = terms["speed"].curvature / self.robot.velocity_limits**2
        ones = np.ones_like(x)
        band = spline.zero_band(self.basis.points, 30)
        spline.add_diagonal(band, self.basis, w.posture**2 * ones, 0)
        spline.add_diagonal(band, self.basis, speed, 1)
        spline.add_diagonal(band, self.basis, (w.acceleration**2 + w.damping**2) * ones, 2)
        for (i, j), block in hessian.items():
            spline.add_blocks(band, self.basis, block, rows=i, columns=j)
        total = sum(spline.spread_gradient(self.basis, gradient[i], i) for i in range(3))
        return Evaluation(cost, y, samples.wrench, points, band, np.asarray(total))


def rest_at_both_ends(basis: spline.Basis) -> spline.Basis:
    """The basis of trajectories with ẋ = ẍ = 0 at both ends.

    The first three and the last three control points are one each, which makes value,
    velocity and acceleration at the outer knots those of a constant; the two that are left
    for three neighbours each are the first and the last of the K − 4 points of this basis.
    """
    count = basis.points - 4
    index = np.clip(basis.first[:, None] + np.arange(spline.ORDER) - 2, 0, count - 1)
    first = np.minimum(index[:, 0], count - spline.ORDER)
    weights = np.zeros_like(basis.weights)
    rows = np.arange(len(first))
    for point in range(spline.ORDER):
        for order in range(len(weights)):
            weights[order, rows, index[:, point] - first] += basis.weights[order, :, point]
    return spline.Basis(first, weights, count)
