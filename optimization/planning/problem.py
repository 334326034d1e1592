"""The least-squares problem of a dynamic plan: what is tracked and what is bounded.

A plan is a cubic B-spline on the robot's whole configuration, at rest at both ends. Its
cost is a sum of squares over samples of the distance to a kinematic reference (keypoints,
trunk orientations, posture, accelerations); its constraints are rows lower ≤ y ≤ upper:
wrench cones, sole corners, joint velocities and torques, gaps between the links. Equalities
enter as an augmented Lagrangian, inequalities as relaxed barriers.

Source: J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch. 10 and 17.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization import centroidal, spline
from robomirror_drake.optimization.planning.collision import Gaps, gap_jacobians, gaps
from robomirror_drake.optimization.planning.contacts import Cones
from robomirror_drake.optimization.planning.frames import Frames
from robomirror_drake.optimization.planning.penalty import Rows
from robomirror_drake.optimization.planning.torque import Split, joint_torques
from robomirror_drake.robot import Robot

POSE = ("corners", "gaps")
"""Groups of constraint rows on x alone."""

EFFORT = ("wrench", "torque")
"""Groups of constraint rows on x, ẋ and ẍ."""

GROUPS = (*POSE, *EFFORT, "speed", "limits")
"""All groups of constraint rows."""


class Weights(NamedTuple):
    """Square roots of the cost's weights.

    Attributes:
        keypoint: [1/m].
        orientation: Pelvis and trunk [1/rad].
        posture: (30,) on x itself.
        acceleration: (30,) on ẍ beside the reference's.
        damping: (30,) on ẍ itself.
        ending: On the control points at the end.
    """

    keypoint: float
    orientation: float
    posture: Array
    acceleration: Array
    damping: Array
    ending: float


class Evaluation(NamedTuple):
    """The problem at one trajectory.

    Attributes:
        objective: Half the sum of squares, without what the constraints cost.
        values: Constraint rows y by group, (T, m).
        wrench: (T, 6) contact wrench about the world's origin.
        points: (T, P, 3) points of :class:`Frames` in world [m].
    """

    objective: float
    values: dict[str, Array]
    wrench: Array
    points: Array


class Linearization(NamedTuple):
    """The problem to first order about one trajectory.

    Attributes:
        at: The problem there.
        band, gradient: Gauss–Newton matrix and gradient (K, 30) of the objective.
        of_pose: (T, m, 30) derivatives of the rows of ``POSE`` by x.
        of_effort: (3, T, m, 30) derivatives of the rows of ``EFFORT`` by x, ẋ, ẍ.
    """

    at: Evaluation
    band: Array
    gradient: Array
    of_pose: Array
    of_effort: Array


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
            ``torque`` (T, 23) as shares of the limits, ``limits`` (K, 30) of the control points.
        cones: The wrench cones whose rows ``wrench`` are.
        split: How the feet share the wrench, for the torques.
        weights: See :class:`Weights`.
        fixed: How many leading control points stay as they are.
        ending: (3, 30) last control points to come near to, where the motion goes on with them.
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
    fixed: int = 0
    ending: Array | None = None

    def evaluate(self, control: Array) -> Evaluation:
        """The problem at control points (K, 30)."""
        return self._look(control, derivatives=False).at

    def linearize(self, control: Array) -> Linearization:
        """The problem and its first derivatives at control points (K, 30)."""
        look = self._look(control, derivatives=True)
        x, _, xdd = look.trajectory
        w, samples, frames = self.weights, look.samples, self.frames
        points, T = look.at.points, len(x)
        supports = frames.support[frames.owner]
        of_points = centroidal.point_jacobians(samples, supports, points)
        of_trunk = centroidal.rotation_jacobians(samples, frames.support[frames.trunk])
        of_gaps = gap_jacobians(frames.capsules, look.gaps, samples.motion, frames.support)
        J = np.concatenate(
            [
                w.keypoint * of_points[:, 8:].reshape(T, -1, 30),
                w.orientation * of_trunk.reshape(T, -1, 30),
                np.pad(2.0 * x[:, None, :4], ((0, 0), (0, 0), (0, 26))),
            ],
            axis=1,
        )
        astray, surge = look.astray
        gradient = np.einsum("tri,tr->ti", J, look.residual) + w.posture**2 * astray
        bend = w.acceleration**2 * surge + w.damping**2 * xdd
        total = spline.spread_gradient(self.basis, gradient, 0)
        total = total + spline.spread_gradient(self.basis, bend, 2)
        hessian = np.swapaxes(J, 1, 2) @ J
        hessian[:, range(30), range(30)] += w.posture**2
        band = spline.zero_band(self.basis.points, 30)
        spline.add_blocks(band, self.basis, hessian, rows=0, columns=0)
        if self.ending is not None:
            end = len(self.ending)
            total[-end:] += w.ending**2 * (control[-end:] - self.ending)
            band[-30 * end :, 0] += w.ending**2
        smooth = np.tile(w.acceleration**2 + w.damping**2, (T, 1))
        spline.add_diagonal(band, self.basis, smooth, 2)
        of_pose = np.concatenate(
            [
                of_points[:, :8].reshape(T, 24, 30),
                np.pad(of_gaps, ((0, 0), (0, 0), (7, 0))),
            ],
            axis=1,
        )
        # They are there, as they were asked for.
        assert samples.wrench_jacobians is not None
        assert look.of_torque is not None
        of_effort = np.concatenate(
            [
                self.cones.rows[None] @ samples.wrench_jacobians,
                look.of_torque / self.robot.effort_limits[:, None],
            ],
            axis=2,
        )
        return Linearization(look.at, band, np.asarray(total), of_pose, of_effort)

    def _look(self, control: Array, *, derivatives: bool) -> _Look:
        x, xd, xdd = (spline.evaluate(self.basis, control, order) for order in range(3))
        frames = self.frames
        samples = centroidal.sample(self.robot, frames.links, x, xd, xdd, derivatives=derivatives)
        points = frames.points(samples.links)
        feet = frames.support[frames.owner[0:8:4]]
        torque, of_torque = joint_torques(self.robot, samples, self.split, feet)
        apart = gaps(frames.capsules, samples.links)
        values = {
            "wrench": np.einsum("trw,tw->tr", self.cones.rows, samples.wrench),
            "corners": points[:, :8].reshape(len(x), 24),
            "speed": xd[:, 7:] / self.robot.velocity_limits,
            "gaps": apart.distance,
            "torque": torque / self.robot.effort_limits,
            "limits": control,
        }
        keypoints = (points[:, 8:] - self.target_points[:, 8:]).reshape(len(x), -1)
        turn = samples.links[:, frames.trunk, :3, :3] @ np.swapaxes(self.target_trunk, -1, -2)
        skew = 0.5 * (turn - np.swapaxes(turn, -1, -2))
        tilt = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
        w = self.weights
        gauge = np.sum(x[:, :4] ** 2, axis=1, keepdims=True) - 1.0
        residual = np.concatenate(
            [w.keypoint * keypoints, w.orientation * tilt.reshape(len(x), -1), gauge], axis=1
        )
        astray = x - self.target, xdd - self.target_acceleration
        parts = residual, w.posture * astray[0], w.acceleration * astray[1], w.damping * xdd
        objective = 0.5 * sum(float(np.sum(part**2)) for part in parts)
        if self.ending is not None:
            away = control[-len(self.ending) :] - self.ending
            objective += 0.5 * w.ending**2 * float(np.sum(away**2))
        at = Evaluation(objective, values, samples.wrench, points)
        return _Look(at, (x, xd, xdd), samples, apart, of_torque, residual, astray)


class _Look(NamedTuple):
    """What :meth:`Problem.evaluate` and :meth:`Problem.linearize` both need."""

    at: Evaluation
    trajectory: tuple[Array, Array, Array]
    samples: centroidal.Samples
    gaps: Gaps
    of_torque: Array | None
    residual: Array
    astray: tuple[Array, Array]


def at_rest(basis: spline.Basis, start: bool, end: bool) -> spline.Basis:
    """The basis of trajectories with ẋ = ẍ = 0 at the start, at the end, or both.

    Where the three control points at an end are one, value, velocity and acceleration at the
    outer knot are those of a constant; so at each such end there are two points fewer.
    """
    skipped = 2 * start
    count = basis.points - skipped - 2 * end
    index = np.clip(basis.first[:, None] + np.arange(spline.ORDER) - skipped, 0, count - 1)
    first = np.minimum(index[:, 0], count - spline.ORDER)
    weights = np.zeros_like(basis.weights)
    rows = np.arange(len(first))
    for point in range(spline.ORDER):
        for order in range(len(weights)):
            weights[order, rows, index[:, point] - first] += basis.weights[order, :, point]
    return spline.Basis(first, weights, count)
