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

Feet that stand do so by construction (see :mod:`adapt_motion`).

Source: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 2 and 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.adapt_legs import KNEE, Legs
from robomirror_drake.optimization.adapt_motion import Samples
from robomirror_drake.optimization.adapt_options import AdaptOptions
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.kinematics import body_poses
from robomirror_drake.robot import Robot


class Family(NamedTuple):
    """Rows of one kind: ``lower`` ≤ value ≤ ``upper``, in shares of a unit of their own.

    Attributes:
        name: ``position``, ``stretch``, ``speed``, ``torque`` or ``ground``.
        value: (R,) in shares of the unit.
        lower, upper: (R,) bounds.
        jacobian: (R, X) by the variables; empty where it was not asked for.
        columns: Rows of one sample: row r is of joint or corner r % columns.
    """

    name: str
    value: Array
    lower: Array
    upper: Array
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


def make_limits(robot: Robot, legs: Legs, command: Samples, options: AdaptOptions) -> Limits:
    """The limits of a robot, which a command may exceed already: then it may as far.

    Args:
        robot: The robot.
        legs: Its legs.
        command: Samples of the command.
        options: Shares of the limits.
    """
    lower, upper = robot.position_limits
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


def families(limits: Limits, samples: Samples) -> list[Family]:
    """All rows of a motion; with Jacobians where its samples have them."""
    wide = samples.jacobian.shape[1] > 0
    joints, by_z = samples.q[:, 7:], samples.jacobian[:, 6:]
    dt = float(samples.time[1] - samples.time[0])
    torque, by_torque = proxy(limits, samples)
    corners = _corners(limits.legs, samples)
    length, by_knee = _stretch(limits.legs, samples)
    knees = limits.legs.chain[:, KNEE] - 1
    by_length = by_knee[..., None] * by_z[:, knees] if wide else by_z
    position, stretch = UNITS["position"], UNITS["stretch"]
    return [
        _family("position", joints, limits.lower, limits.upper, by_z, position),
        _family("stretch", length, np.full(2, -np.inf), limits.length, by_length, stretch),
        _family(
            "speed",
            np.diff(joints, axis=0) / dt,
            -limits.speed,
            limits.speed,
            np.diff(by_z, axis=0) / dt if wide else by_z[1:],
            limits.speed,
        ),
        _family("torque", torque, -limits.torque, limits.torque, by_torque, limits.torque),
        _family(
            "ground",
            corners[..., 2].reshape(-1, 8),
            limits.floor.ravel(),
            np.full(8, np.inf),
            _by_height(limits.legs, samples, corners) if wide else by_z,
            UNITS["ground"],
        ),
    ]


def _family(
    name: str, value: Array, lower: Array, upper: Array, jacobian: Array, unit: Array | float
) -> Family:
    """A family of values (N, C) with bounds and units (C,)."""
    shape, rows = value.shape, value.size
    scale = np.broadcast_to(unit, shape[1:])
    empty = jacobian.shape[1] == 0
    return Family(
        name,
        (value / scale).ravel(),
        np.broadcast_to(lower / scale, shape).ravel(),
        np.broadcast_to(upper / scale, shape).ravel(),
        np.empty((0, jacobian.shape[2]))
        if empty
        else (jacobian / scale[:, None]).reshape(rows, -1),
        shape[1],
    )


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
    feet = legs.chain[:, -1]
    turned = np.einsum("nfij,fcj->nfci", samples.rotation[:, feet], legs.corners)
    return np.asarray(turned + samples.origin[:, feet, None])


def _by_height(legs: Legs, samples: Samples, corners: Array) -> Array:
    """(N, 8, X) rates of the corners' heights, ż = ż_foot + [ω × r]_z."""
    r = corners - samples.origin[:, legs.chain[:, -1], None]
    w, rise = samples.twist[:, 1:, None, :2], samples.twist[:, 1:, None, 5]
    made = w[..., 0, :] * r[..., 1, None] - w[..., 1, :] * r[..., 0, None] + rise
    return made.reshape(len(r), 8, -1)


def proxy(limits: Limits, samples: Samples) -> tuple[Array, Array]:
    """(N, J) torques [N·m], see the module, and (N, J, X) their derivatives."""
    legs, tree = limits.legs, limits.legs.tree
    R, p = samples.rotation, samples.origin
    dt = float(samples.time[1] - samples.time[0])
    axes = np.einsum("nbij,bj->nbi", R, tree.axis)[:, 1:]
    at = p[:, 1:]
    mass = limits.below @ tree.mass
    moment = np.einsum(
        "cb,nbi->nci", limits.below * tree.mass, p + np.einsum("nbij,bj->nbi", R, tree.center)
    )
    arm = moment - mass[:, None] * p  # m_j (c_j − p_j)
    height = moment[:, 0, 2] / mass[0]
    weight = mass[0] * (GRAVITY + _second(height, dt))
    push = GRAVITY * arm[:, 1:]
    middle = _corners(legs, samples).mean(axis=2)
    lever = np.zeros((2, *at.shape))  # of each foot's force, zero where no leg leads to it
    for foot, chain in enumerate(legs.chain):
        carries = limits.below[1:, chain[-1]]
        lever[foot][:, carries] = middle[:, foot, None] - at[:, carries]
    share = samples.load.T[..., None, None]
    push = push - (share * lever).sum(axis=0) * weight[:, None, None]
    u = np.cross(axes, push)
    bend = _second(samples.q[:, 7:], dt)
    torque = u[..., 2] + limits.inertia * bend
    J = samples.jacobian
    if J.shape[1] == 0:
        return torque, J
    # By the velocities: K[j, i] = [a_i × u_j]_z where i carries j, and the same with i, j changed.
    K = axes[:, None, :, 0] * u[:, :, None, 1] - axes[:, None, :, 1] * u[:, :, None, 0]
    carried = limits.below[1:, 1:].T  # [j, i]: i carries j
    K = np.where(carried, K, np.where(carried.T, K.swapaxes(1, 2), 0.0))
    spin = np.stack([u[..., 1], -u[..., 0]], axis=2)  # [e_x × u]_z, [e_y × u]_z
    by_force = np.cross(axes, lever)[..., 2]  # (2, N, J)
    rise = np.cross(axes, arm[:, 1:])[..., 2] / mass[0]
    lean = arm[:, 0] / mass[0]
    by_height = (
        J[:, 5]
        + lean[:, 1, None] * J[:, 0]
        - lean[:, 0, None] * J[:, 1]
        + (rise[:, None] @ J[:, 6:])[:, 0]
    )
    by_weight = mass[0] * _second(by_height, dt)
    made = K @ J[:, 6:] + spin @ J[:, :2]
    made -= (by_force * samples.load.T[..., None]).sum(axis=0)[..., None] * by_weight[:, None]
    for foot in range(2):
        made -= (by_force[foot] * weight[:, None])[..., None] * samples.loading[:, foot, None]
    made += limits.inertia[:, None] * _second(J[:, 6:], dt)
    return torque, made


def _second(x: Array, dt: float) -> Array:
    """(N, …) second differences in time; at the ends those beside."""
    inner = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / dt**2
    return np.concatenate([inner[:1], inner, inner[-1:]])
