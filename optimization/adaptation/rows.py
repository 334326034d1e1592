"""What an adapted motion must keep, sample by sample, with derivatives.

* ``position`` and ``speed`` of the joints within their limits; ``stretch``: a knee's limit on
  the straight side, as the distance that it leaves between hip and ankle, which is nearly linear
  in where pelvis and feet are, while the angle itself is not at all near a straight leg;
* ``torque``: a proxy within the motors' limits. With the weight above and the forces W λ_i at
  the middle f_i of each sole, W = m (g + c̈_z), motor j at p_j with axis a_j gives about

      τ_j = [a_j × (m_j g (c_j − p_j) − Σ_i λ_i W (f_i − p_j))]_z + I_j q̈_j,

  where m_j, c_j are mass and centre of what joint j carries, the sum is over the feet that it
  carries, and I_j is its inertia in the standing posture. The z component of a moment u is
  that of a vertical force, and turning about axis i above j changes it by [a_i × u]_z.
* ``ground``: no corner of a sole below the floor, or deeper than the command has it.

Feet that stand do so by construction (see :mod:`.motion`).

Source: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 2 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.adaptation.legs import KNEE, Legs
from robomirror_drake.optimization.adaptation.motion import Samples
from robomirror_drake.optimization.adaptation.options import AdaptOptions
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.kinematics import Indices, body_poses, positions
from robomirror_drake.robot import Robot

Slope = Callable[[Indices, Indices], Array]
"""From M samples and as many joints or corners to (M, X) derivatives by the variables."""


class Family(NamedTuple):
    """Rows of one kind: ``lower`` ≤ value ≤ ``upper``, in shares of a unit of their own.

    Attributes:
        name: ``position``, ``stretch``, ``speed``, ``torque`` or ``ground``.
        value: (R,) in shares of the unit.
        lower, upper: (R,) bounds.
        near: (M,) rows that are near a bound, and
        jacobian: (M, X) their derivatives by the variables; empty where none were asked for.
        columns: Rows of one sample: row r is of joint or corner r % columns.
    """

    name: str
    value: Array
    lower: Array
    upper: Array
    near: Indices
    jacobian: Array
    columns: int

    @property
    def violation(self) -> float:
        """The largest, or 0."""
        over = np.maximum(self.lower - self.value, self.value - self.upper)
        return float(max(0.0, over.max(initial=0.0)))


class Limits(NamedTuple):
    """What the rows are measured by.

    Attributes:
        legs: The robot's legs.
        below: (J + 1, J + 1) whether body c is body b, or carried by it.
        lower, upper, speed, torque, inertia: (J,) of the joints [rad, rad/s, N·m, kg·m²].
        length: (2,) largest distance from hip to ankle [m].
        floor: (2, 4) least height of each corner [m].
    """

    legs: Legs
    below: BoolArray
    lower: Array
    upper: Array
    speed: Array
    torque: Array
    inertia: Array
    length: Array
    floor: Array


_PRESSED = 5e-4  # a sole deeper in the floor than the command is not worth a change [m]

UNITS = {"position": 0.1, "stretch": 0.02, "ground": 0.02}
"""Of the rows [rad], [m]; speed and torque count by their limits."""

NEAR = {"position": 4.0, "stretch": 3.0, "speed": 0.5, "torque": 0.4, "ground": 2.0}
"""Distance from a bound, in units, from which on a row is not linearised: its value is still
looked at, so that a step that goes too far is not taken."""


def make_limits(robot: Robot, legs: Legs, command: Samples, options: AdaptOptions) -> Limits:
    """The limits of a robot, which a command may exceed already: then it may as far.

    Args:
        robot: The robot.
        legs: Its legs.
        command: Samples of the command.
        options: Shares of the limits.
    """
    lower, upper = (limit.copy() for limit in robot.position_limits)
    joints = command.q[:, 7:]
    knees = legs.chain[:, KNEE] - 1
    straight = np.maximum(lower[knees], options.knee_min)
    lower[knees] = -np.inf  # that is what the stretch is for
    bodies = len(legs.tree.parent)
    below = np.eye(bodies, dtype=np.bool_)
    for body in range(bodies - 1, 0, -1):
        below[legs.tree.parent[body]] |= below[body]
    standing = robot.to_pinocchio(robot.standing)
    data = robot.model.createData()
    inertia = np.diag(pin.crba(robot.model, data, standing)) + robot.model.armature
    return Limits(
        legs=legs,
        below=below,
        lower=np.minimum(lower, joints.min(axis=0)),
        upper=np.maximum(upper, joints.max(axis=0)),
        speed=options.speed_share * robot.velocity_limits,
        torque=options.torque_share * robot.effort_limits,
        inertia=inertia[6:],
        length=np.maximum(_lengths(legs, straight), _stretch(legs, command)[0].max(axis=0)),
        floor=np.minimum(0.0, _corners(legs, command)[..., 2].min(axis=0)) - _PRESSED,
    )


def families(limits: Limits, samples: Samples, near: float = 1.0) -> list[Family]:
    """All rows of a motion; with Jacobians where its samples have them.

    Args:
        limits: What to keep.
        samples: The motion.
        near: Share of :data:`NEAR` within which rows have derivatives; infinite for all.
    """
    joints, by_z = samples.q[:, 7:], samples.jacobian[:, 6:]
    dt = float(samples.time[1] - samples.time[0])
    corners = _corners(limits.legs, samples)
    length, by_knee = _stretch(limits.legs, samples)
    knees = limits.legs.chain[:, KNEE] - 1
    position, stretch, ground = (UNITS[name] for name in ("position", "stretch", "ground"))
    torque, slope = proxy(limits, samples)
    parts: list[tuple[str, Array, Array, Array, Array | float, Slope]] = [
        ("position", joints, limits.lower, limits.upper, position, lambda n, j: by_z[n, j]),
        (
            "stretch",
            length,
            np.full(2, -np.inf),
            limits.length,
            stretch,
            lambda n, leg: by_knee[n, leg, None] * by_z[n, knees[leg]],
        ),
        (
            "speed",
            np.diff(joints, axis=0) / dt,
            -limits.speed,
            limits.speed,
            limits.speed,
            lambda n, j: (by_z[n + 1, j] - by_z[n, j]) / dt,
        ),
        ("torque", torque, -limits.torque, limits.torque, limits.torque, slope),
        (
            "ground",
            corners[..., 2].reshape(-1, 8),
            limits.floor.ravel(),
            np.full(8, np.inf),
            ground,
            lambda n, k: _by_height(limits.legs, samples, corners, n, k),
        ),
    ]
    wide = samples.jacobian.shape[1] > 0
    return [_family(*part, near if wide else None, samples.jacobian.shape[2]) for part in parts]


def _family(
    name: str,
    value: Array,
    lower: Array,
    upper: Array,
    unit: Array | float,
    slope: Slope,
    near: float | None,
    variables: int,
) -> Family:
    """A family of values (N, C) with bounds and units (C,), and derivatives where it is near."""
    shape, scale = value.shape, np.broadcast_to(unit, value.shape[1:])
    value = value / scale
    low, high = (np.broadcast_to(bound / scale, shape) for bound in (lower, upper))
    picked = np.zeros(0, dtype=np.int64)
    jacobian = np.empty((0, variables))
    if near is not None:
        margin = near * NEAR[name]
        picked = np.flatnonzero(np.maximum(value - high, low - value) >= -margin)
        n, c = np.divmod(picked, shape[1])
        jacobian = slope(n, c) / scale[c, None]
    return Family(name, value.ravel(), low.ravel(), high.ravel(), picked, jacobian, shape[1])


def _stretch(legs: Legs, samples: Samples) -> tuple[Array, Array]:
    """(N, 2) distance of each leg's last hip joint from its first ankle joint [m], and its
    derivative by the knee's angle [m/rad]."""
    hip, knee, ankle = (samples.origin[:, legs.chain[:, i]] for i in (KNEE - 1, KNEE, KNEE + 1))
    bodies = legs.chain[:, KNEE]
    axis = np.einsum("nfij,fj->nfi", samples.rotation[:, bodies], legs.tree.axis[bodies])
    way = ankle - hip
    length = np.linalg.norm(way, axis=2)
    return length, np.sum(way * np.cross(axis, ankle - knee), axis=2) / length


def _lengths(legs: Legs, angle: Array) -> Array:
    """(2,) distance of hip from ankle at each knee's angle (2,) [m]."""
    x = np.zeros((1, len(legs.tree.parent) + 5))
    x[0, 5 + legs.chain[:, KNEE]] = angle
    _, p = body_poses(legs.tree, np.eye(3)[None], x)
    return np.asarray(
        np.linalg.norm(p[0, legs.chain[:, KNEE + 1]] - p[0, legs.chain[:, KNEE - 1]], axis=1)
    )


def _corners(legs: Legs, samples: Samples) -> Array:
    """(N, 2, 4, 3) sole corners in world [m]."""
    return positions(legs.corners, samples.rotation, samples.origin).reshape(-1, 2, 4, 3)


def _by_height(legs: Legs, samples: Samples, corners: Array, n: Indices, k: Indices) -> Array:
    """(M, X) rates of the heights of corners k (M,) at samples n, ż = ż_foot + [ω × r]_z."""
    foot = k // 4
    r = corners[n, foot, k % 4] - samples.origin[n, legs.chain[foot, -1]]
    twist = samples.twist[n, 1 + foot]
    return np.asarray(twist[:, 0] * r[:, 1, None] - twist[:, 1] * r[:, 0, None] + twist[:, 5])


def proxy(limits: Limits, samples: Samples) -> tuple[Array, Slope]:
    """(N, J) torques [N·m], see the module, and their derivatives at samples n of joints j."""
    legs, tree = limits.legs, limits.legs.tree
    R, p = samples.rotation, samples.origin
    dt = float(samples.time[1] - samples.time[0])
    axes = np.einsum("nbij,bj->nbi", R, tree.axis)[:, 1:]
    at = p[:, 1:]
    mass = limits.below @ tree.mass
    centers = p + np.einsum("nbij,bj->nbi", R, tree.center)
    moment = (limits.below * tree.mass) @ centers
    arm = moment - mass[:, None] * p  # m_j (c_j − p_j)
    weight = mass[0] * (GRAVITY + _second(moment[:, 0, 2] / mass[0], dt))
    middle = _corners(legs, samples).mean(axis=2)
    lever = np.zeros((2, *at.shape))  # of each foot's force, zero where no leg leads to it
    for foot, chain in enumerate(legs.chain):
        carries = limits.below[1:, chain[-1]]
        lever[foot][:, carries] = middle[:, foot, None] - at[:, carries]
    share = samples.load.T[..., None, None]
    push = GRAVITY * arm[:, 1:] - (share * lever).sum(axis=0) * weight[:, None, None]
    u = np.cross(axes, push)
    torque = u[..., 2] + limits.inertia * _second(samples.q[:, 7:], dt)
    J = samples.jacobian

    def slope(n: Indices, j: Indices) -> Array:
        own = u[n, j]
        # By the velocities: [a_i × u_j]_z where i carries j, and the same with i, j changed.
        above = axes[n, :, 0] * own[:, 1, None] - axes[n, :, 1] * own[:, 0, None]
        under = axes[n, j, 0, None] * u[n, :, 1] - axes[n, j, 1, None] * u[n, :, 0]
        carried = limits.below[1:, 1:]
        K = np.where(carried[:, j].T, above, np.where(carried[j], under, 0.0))
        spun = np.hstack([own[:, 1:2], -own[:, :1]])  # [e_x × u]_z, [e_y × u]_z
        rows = np.zeros((len(n), J.shape[1]))
        rows[:, :2], rows[:, 6:] = spun, K
        by_force = np.cross(axes[n, j], lever[:, n, j])[..., 2]  # (2, M)
        inner = np.clip(n, 1, max(len(J) - 2, 1))
        # The sums over one sample's velocities, sample by sample.
        made = np.empty((len(n), J.shape[2]))
        for row in np.unique(n):
            picked = n == row
            made[picked] = rows[picked] @ J[row]
        by_height = _by_height_of_center(samples, axes, arm, mass)
        lifted = by_height[inner + 1] - 2.0 * by_height[inner] + by_height[inner - 1]
        carried_share = np.sum(by_force * samples.load[n].T, axis=0)
        made -= (carried_share * mass[0] / dt**2)[:, None] * lifted
        made -= np.einsum("fm,mfx->mx", by_force * weight[n], samples.loading[n])
        bend = J[inner + 1, 6 + j] - 2.0 * J[inner, 6 + j] + J[inner - 1, 6 + j]
        return np.asarray(made + (limits.inertia[j] / dt**2)[:, None] * bend)

    return torque, slope


def _by_height_of_center(samples: Samples, axes: Array, arm: Array, mass: Array) -> Array:
    """(N, X) rates of the height of the centre of mass."""
    rows = np.zeros((len(axes), samples.jacobian.shape[1]))
    rows[:, 0], rows[:, 1], rows[:, 5] = arm[:, 0, 1] / mass[0], -arm[:, 0, 0] / mass[0], 1.0
    rows[:, 6:] = np.cross(axes, arm[:, 1:])[..., 2] / mass[0]
    return np.asarray((rows[:, None] @ samples.jacobian)[:, 0])


def _second(x: Array, dt: float) -> Array:
    """(N, …) second differences in time; at the ends those beside."""
    inner = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / dt**2
    return np.concatenate([inner[:1], inner, inner[-1:]])
