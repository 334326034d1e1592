"""The retargeting problem over the control points of one window, ready to be solved.

minimise over c   Σ_t dt · frame objective(x_t)                        (:mod:`.kernel`)
                  + ½ ∫ w_p ‖q − q_stand‖² + w_a ‖ẍ‖² + w_j ‖x⃛‖² dt
subject to        standing corners at their anchors, no corner below the floor,
                  no two capsules in each other, joints within their limits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from robomirror_drake.messages import Array
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.contact_schedule import picked_samples
from robomirror_drake.optimization.floating_base import continuous, reference_rotation
from robomirror_drake.optimization.kinematics import Points
from robomirror_drake.optimization.retargeting.footholds import support_planes
from robomirror_drake.optimization.retargeting.kernel import Terms
from robomirror_drake.optimization.retargeting.limits import Limits
from robomirror_drake.optimization.retargeting.metrics import RobotTables
from robomirror_drake.optimization.retargeting.options import RetargetOptions, RetargetWeights
from robomirror_drake.optimization.retargeting.targets import RATE, Targets

STRIDE = 2
"""Every how many samples a problem looks, beside those where a contact begins or ends.

Of arms that swing past each other this may see neither before nor after that they pass through
each other; a motion that fails by it is solved again at every sample.
"""


ROUNDING = 1e-9
"""How far inside its limits a joint stays, so that rounding does not carry it out [rad]."""


class Problem(NamedTuple):
    """One window's problem.

    Attributes:
        picked: (S,) indices of the samples at which the problem looks, its frames.
        step: Time from one to the next, where no contact begins or ends [s].
        terms: What the frames are asked to do, weights times the time step.
        basis: Basis at the frames.
        quadratic: (4, K, 29) Hessian of posture and smoothness, which do not couple
            coordinates: entry (r, k) stands between control points k and k + r.
        linear: (K, 29) its gradient at zero, negated.
        limits: Bounds of the joints.
        reference: (K, 4) control quaternions of the base's reference orientation.
        spacing: Distance of the knots [s].
        start: (K, 29) where to begin without a better guess.
    """

    picked: npt.NDArray[np.int64]
    step: float
    terms: Terms
    basis: spline.Basis
    quadratic: Array
    linear: Array
    limits: Limits
    reference: Array
    spacing: float
    start: Array


def make_problem(
    tables: RobotTables,
    standing: Array,
    targets: Targets,
    options: RetargetOptions,
    reference: Array | None,
    stride: int,
) -> Problem:
    """Poses the problem.

    Args:
        tables: The robot.
        standing: (J,) the posture to which joints tend [rad].
        targets: What to follow.
        options: Weights, limits and margins.
        reference: (k, 4) leading control quaternions to be kept, of a previous window; or None.
        stride: Every how many samples it looks.
    """
    spacing, weights = options.knot_spacing, options.weights
    whole = spline.basis(targets.time, spacing)
    quaternions = _reference_quaternions(whole, targets, reference)
    picked = picked_samples(targets.contact, stride)
    basis = spline.basis(targets.time[picked], spacing, whole.points)
    dt = np.gradient(targets.time[picked])[:, None]
    slow = weights.support * _slowness(targets, tables, options.slow_speed)[picked]
    counts = targets.contact[picked] & (slow > 0.0)[:, None, None]  # hulls of others take time
    feet = np.full(2, 0.3)  # the toes see most of a foot's direction already
    direction = weights.direction * np.concatenate([np.ones(4), feet])
    chest = tables.keypoints.body[tables.body.keypoints.index("neck")]
    ankles = [
        tables.keypoints.body[tables.body.keypoints.index(f"{s}_foot")] for s in ("left", "right")
    ]
    up, left = np.eye(3)[2], np.eye(3)[1]
    frames = len(picked)
    terms = Terms(
        tree=tables.tree,
        reference=reference_rotation(basis, quaternions),
        points=tables.keypoints,
        target=np.ascontiguousarray(targets.keypoints[picked]),
        weight=np.tile(weights.keypoint * dt, (1, len(tables.keypoints.body))),
        directions=Points(
            np.array([0, 0, chest, chest, *ankles]), np.array([up, left, up, left, left, left])
        ),
        goal=np.ascontiguousarray(targets.directions[picked]),
        direction_weight=dt * direction,
        corners=tables.corners,
        anchor=targets.anchor[picked].reshape(frames, 8, 3),
        standing=targets.contact[picked].reshape(frames, 8),
        support=support_planes(targets.anchor[picked], counts, options.support_margin),
        support_weight=slow * dt[:, 0],
        capsules=tables.capsules,
        margin=options.collision_margin,
    )
    lower = np.where(tables.knees, np.maximum(tables.lower, options.knee_min), tables.lower)
    posture = np.concatenate([np.zeros(6), np.clip(standing, lower, tables.upper)])
    quadratic, linear = _quadratic(targets, whole, spacing, weights, posture)
    start = np.tile(posture, (whole.points, 1))
    start[:, :3] = spline.fit(
        whole, targets.keypoints[:, tables.body.keypoints.index("pelvis")], 1e-5
    )
    acceleration = np.full(len(lower), options.joint_acceleration)
    limits = Limits(lower + ROUNDING, tables.upper - ROUNDING, tables.speed, acceleration)
    return Problem(
        picked, stride / RATE, terms, basis, quadratic, linear, limits, quaternions, spacing, start
    )


def _quadratic(
    targets: Targets, whole: spline.Basis, spacing: float, weights: RetargetWeights, posture: Array
) -> tuple[Array, Array]:
    """Hessian and linear term of posture and smoothness over all the knots."""
    points, n = whole.points, len(posture)
    steps = 3 * (points - spline.ORDER + 1)
    dt = spacing / 3
    basis = spline.basis(np.arange(0.5, steps) * dt, spacing, points)
    pull = np.concatenate([np.full(6, 1e-6), np.full(n - 6, weights.posture)])
    quickness = _quickness(targets, whole, basis, round(QUICK_TIME / dt))

    def gram(weight: Array, derivative: int) -> Array:
        band = spline.zero_band(points, 1)
        spline.add_diagonal(band, basis, (weight * dt)[:, None], derivative)
        return band.T[:, :, None]

    still = gram(np.ones(steps), 0)
    smooth = gram(np.full(steps, weights.acceleration), 2) + gram(weights.jerk / quickness**2.5, 3)
    pulled = spline.spread_gradient(basis, np.full((steps, 1), dt)) * pull * posture
    return still * pull + smooth, pulled


QUICK, QUICK_TIME, SLOWEST = 100.0, 0.1, 0.3
"""Jerk of a quick motion's keypoints [m/s³], over what time it is averaged [s], and the least
quickness that is told from standing."""


def _quickness(targets: Targets, whole: spline.Basis, basis: spline.Basis, window: int) -> Array:
    """(S,) how jerky the human is around each sample, 1 where quick.

    Smoothness is asked for in proportion: what blurs a punch leaves a walk ragged.
    """
    keypoints = targets.keypoints.reshape(len(targets.time), -1)
    jerk = spline.evaluate(basis, spline.fit(whole, keypoints), 3)
    square = gaussian_filter1d(3.0 * np.mean(jerk**2, axis=1), window, mode="nearest")
    return np.asarray(np.maximum(np.sqrt(square) / QUICK, SLOWEST))


def multiply_diagonal(quadratic: Array, control: Array) -> Array:
    """(K, n) product of a Hessian (4, K, n) that does not couple coordinates with ``control``."""
    return np.asarray(_multiply_diagonal(quadratic, control))


def add_diagonal_band(band: Array, quadratic: Array) -> None:
    """Adds such a Hessian to a banded one (K n, 4 n)."""
    _, points, n = quadratic.shape
    band.reshape(points, n, spline.ORDER, n)[..., 0] += quadratic.transpose(1, 2, 0)


@njit(cache=True)
def _multiply_diagonal(quadratic, control):  # type: ignore[no-untyped-def]
    product = quadratic[0] * control
    for r in range(1, len(quadratic)):
        for k in range(len(control) - r):
            for i in range(control.shape[1]):
                product[k, i] += quadratic[r, k, i] * control[k + r, i]
                product[k + r, i] += quadratic[r, k, i] * control[k, i]
    return product


def _reference_quaternions(basis: spline.Basis, targets: Targets, kept: Array | None) -> Array:
    """(K, 4) smooth control quaternions of the pelvis' orientation; the leading ones as given."""
    q = Rotation.from_matrix(targets.pelvis).as_quat(scalar_first=True)
    control = spline.fit(basis, continuous(q), 1e-4)
    if kept is not None:
        count = min(len(kept), len(control))
        sign = 1.0 if np.sum(kept[:count] * control[:count]) >= 0 else -1.0
        control[:count] = sign * kept[:count]
    return control


def _slowness(targets: Targets, tables: RobotTables, speed: float) -> Array:
    """(T,) 1 where the pelvis is at rest, 0 from ``speed`` [m/s] on."""
    pelvis = targets.keypoints[:, tables.body.keypoints.index("pelvis")]
    velocity = np.gradient(gaussian_filter1d(pelvis, 0.05 * RATE, axis=0), targets.time, axis=0)
    return np.asarray(np.maximum(0.0, 1.0 - np.linalg.norm(velocity, axis=1) / speed))
