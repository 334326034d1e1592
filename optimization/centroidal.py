"""Contact wrench, inverse dynamics and link poses along a trajectory, with derivatives.

A trajectory is given by x (T, 30) and its two time derivatives, where x is a
configuration in Drake's order whose quaternion need not have unit length: that
makes R⁴ × R²⁶ a chart without singularities on which splines can be laid. The
angular velocity and acceleration in the base's own frame are

    ω = 2 vec(r̄ ṙ) / |r|²,      ω̇ = 2 vec(r̄ r̈) / |r|² − 2 (r·ṙ) / |r|² ω.

The wrench that the ground has to supply is what inverse dynamics asks of the base's six
joints that have no motor. About the origin of the world it is, by Newton and Euler,

    f = ḣ_lin − m g,      n = c × f + L̇,

c being the centre of mass, ḣ_lin and L̇ the rates of linear and angular momentum about it
(D. Orin, A. Goswami, S.-H. Lee, "Centroidal dynamics of a humanoid robot", Autonomous
Robots, 2013). Pinocchio gives the derivatives in the tangent space of its free flyer; the
chain rule to x, ẋ, ẍ is here.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from robomirror_drake.messages import Array
from robomirror_drake.optimization.kinematics import Tree, configuration_poses, make_tree
from robomirror_drake.robot import Robot, rotation_matrix

GRAVITY = 9.81


class Samples(NamedTuple):
    """Dynamics and kinematics along a trajectory.

    Attributes:
        wrench: (T, 6) contact wrench, [moment about the world's origin N·m, force N].
        torque: (T, 23) joint torques that the motion needs where no foot is loaded [N·m].
        wrench_jacobians: (3, T, 6, 30) derivatives with respect to x, ẋ, ẍ, and
        torque_jacobians: (3, T, 23, 30) likewise; None if not asked for.
        links: (T, L, 4, 4) poses of the frames asked for, in world.
        motion: (T, 6, 29) Jacobian of Pinocchio, world, linear first, about the origin.
        at: The trajectory in Pinocchio's coordinates.
    """

    wrench: Array
    torque: Array
    wrench_jacobians: Array | None
    torque_jacobians: Array | None
    links: Array
    motion: Array
    at: Tangent


class Tangent(NamedTuple):
    """Pinocchio's q, v, a of a trajectory and what the chain rule needs.

    Attributes:
        q, v, a: (T, 30), (T, 29), (T, 29) in Pinocchio's order.
        dq: (T, 6, 7) δ in the tangent of q per dx of the base.
        dv: (2, T, 6, 7) dv of the base per dx, dẋ of the base.
        da: (3, T, 6, 7) da of the base per dx, dẋ, dẍ of the base.
    """

    q: Array
    v: Array
    a: Array
    dq: Array
    dv: Array
    da: Array


def _conjugate_product(r: Array) -> Array:
    """(…, 3, 4) matrix of s ↦ vec(r̄ s) for quaternions r (…, 4), wxyz."""
    w, x, y, z = np.moveaxis(r, -1, 0)
    rows = [[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def cross_matrix(a: Array) -> Array:
    """(…, 3, 3) matrix of b ↦ a × b."""
    x, y, z = np.moveaxis(a, -1, 0)
    o = np.zeros_like(x)
    rows = [[o, -z, y], [z, o, -x], [-y, x, o]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _apply(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))


def unit_quaternions(x: Array) -> Array:
    """(…, n) x with the quaternion that it begins with normalised: Drake's order."""
    q = x.copy()
    q[..., :4] /= np.linalg.norm(q[..., :4], axis=-1, keepdims=True)
    return q


def drake_velocities(x: Array, xd: Array, xdd: Array) -> tuple[Array, Array]:
    """(T, 29), (T, 29) velocity and acceleration in Drake's order."""
    r, rd, rdd = x[:, :4], xd[:, :4], xdd[:, :4]
    n2 = np.sum(r * r, axis=1, keepdims=True)
    R = rotation_matrix(unit_quaternions(x)[:, :4])
    E = 2.0 * _conjugate_product(r) / n2[..., None]
    w = _apply(E, rd)
    wd = _apply(E, rdd) - 2.0 * np.sum(r * rd, axis=1, keepdims=True) / n2 * w
    v = np.concatenate([_apply(R, w), xd[:, 4:]], axis=1)
    return v, np.concatenate([_apply(R, wd), xdd[:, 4:]], axis=1)


def tangent(x: Array, xd: Array, xdd: Array) -> Tangent:
    """Pinocchio's q, v, a and the derivatives of its base part; see :class:`Tangent`."""
    r, rd, rdd = x[:, :4], xd[:, :4], xdd[:, :4]
    n2 = np.sum(r * r, axis=1)[:, None, None]
    R_T = np.swapaxes(rotation_matrix(unit_quaternions(x)[:, :4]), -1, -2)
    E = 2.0 * _conjugate_product(r) / n2
    w = _apply(E, rd)
    rate = 2.0 * np.sum(r * rd, axis=1)[:, None] / n2[:, 0]
    alpha0 = _apply(E, rdd)
    wd = alpha0 - rate * w
    lin = _apply(R_T, xd[:, 4:7])
    lin_acc = _apply(R_T, xdd[:, 4:7])

    def outer(a: Array, b: Array) -> Array:
        return a[:, :, None] * b[:, None, :]

    # d vec(r̄ s) = −vec(s̄ dr), and every quotient by |r|² adds its own term.
    w_r = -2.0 * _conjugate_product(rd) / n2 - outer(w, 2.0 * r) / n2
    wd_r = (
        -2.0 * _conjugate_product(rdd) / n2
        - outer(alpha0, 2.0 * r) / n2
        - outer(w, 2.0 * rd - 2.0 * rate * r) / n2
        - rate[..., None] * w_r
    )
    wd_rd = -outer(w, 2.0 * r) / n2 - rate[..., None] * E
    T = len(x)
    dq = np.zeros((T, 6, 7))
    dq[:, :3, 4:], dq[:, 3:, :4] = R_T, E
    dv = np.zeros((2, T, 6, 7))
    dv[0, :, :3, :4] = cross_matrix(lin) @ E
    dv[0, :, 3:, :4] = w_r
    dv[1] = dq
    # a_lin = Rᵀ p̈ − ω × v_lin
    da = np.zeros((3, T, 6, 7))
    spin, speed = cross_matrix(w), cross_matrix(lin)
    da[0, :, :3] = -spin @ dv[0, :, :3] + speed @ dv[0, :, 3:]
    da[0, :, :3, :4] += cross_matrix(lin_acc) @ E
    da[0, :, 3:, :4] = wd_r
    da[1, :, :3] = -spin @ dv[1, :, :3] + speed @ dv[1, :, 3:]
    da[1, :, 3:, :4] = wd_rd
    da[2] = dq
    unit = unit_quaternions(x)
    q = np.concatenate([unit[:, 4:7], unit[:, 1:4], unit[:, :1], unit[:, 7:]], axis=1)
    v = np.concatenate([lin, w, xd[:, 7:]], axis=1)
    a = np.concatenate([lin_acc - np.cross(w, lin), wd, xdd[:, 7:]], axis=1)
    return Tangent(q=q, v=v, a=a, dq=dq, dv=dv, da=da)


def chart_jacobians(by_q: Array, by_v: Array, by_a: Array, at: Tangent) -> Array:
    """(3, T, m, 30) derivatives by x, ẋ, ẍ from those (T, m, 29) by Pinocchio's q, v, a."""
    by_x, by_xd, by_xdd = _chain(by_q, at.dq), _chain(by_v, at.dv[1]), _chain(by_a, at.da[2])
    by_x[:, :, :7] += by_v[:, :, :6] @ at.dv[0] + by_a[:, :, :6] @ at.da[0]
    by_xd[:, :, :7] += by_a[:, :, :6] @ at.da[1]
    return np.stack([by_x, by_xd, by_xdd])


def _chain(J: Array, base: Array) -> Array:
    """(T, m, 30): J (T, m, 29) with its base columns multiplied by ``base`` (T, 6, 7)."""
    return np.concatenate([J[:, :, :6] @ base, J[:, :, 6:]], axis=2)


@lru_cache(maxsize=8)
def _tree(robot: Robot) -> Tree:
    return make_tree(robot)


def sample(
    robot: Robot, frames: list[int], x: Array, xd: Array, xdd: Array, *, derivatives: bool
) -> Samples:
    """Evaluates dynamics and link poses on a trajectory x, ẋ, ẍ, each (T, 30).

    Args:
        robot: The robot.
        frames: (L,) Pinocchio ids of the frames whose poses are wanted.
        x, xd, xdd: The trajectory.
        derivatives: Whether to evaluate the Jacobians too.
    """
    model, at = robot.model, tangent(x, xd, xdd)
    data = model.createData()
    R, p = _placed(robot, x)
    links = _carried(model, frames, R, p)
    motion = _motion(_tree(robot).axis, R, p)
    T, nv = len(x), model.nv
    tau = np.empty((T, nv))
    # The loops do nothing but call Pinocchio and copy what it returns.
    if not derivatives:
        for t in range(T):
            tau[t] = pin.rnea(model, data, at.q[t], at.v[t], at.a[t])
        wrench = _to_world(tau[..., None], R[:, 0], p[:, 0])[..., 0]
        return Samples(wrench, tau[:, 6:], None, None, links, motion, at)
    by_q, by_v, by_a = (np.empty((T, nv, nv)) for _ in range(3))
    for t in range(T):
        pin.computeRNEADerivatives(model, data, at.q[t], at.v[t], at.a[t])
        tau[t], by_q[t], by_v[t], by_a[t] = data.tau, data.dtau_dq, data.dtau_dv, data.M
    wrench = _to_world(tau[..., None], R[:, 0], p[:, 0])[..., 0]
    by_q, by_v, by_a = (
        np.concatenate([_to_world(d, R[:, 0], p[:, 0]), d[:, 6:]], axis=1)
        for d in (by_q, by_v, by_a)
    )
    # A base that moves and turns carries the wrench with it.
    load, lever = cross_matrix(wrench[:, 3:]), cross_matrix(p[:, 0])
    moment = cross_matrix(wrench[:, :3] - np.cross(p[:, 0], wrench[:, 3:]))
    by_q[:, 3:6, 3:6] -= load @ R[:, 0]
    by_q[:, :3, 3:6] -= (moment + lever @ load) @ R[:, 0]
    by_q[:, :3, :3] -= load @ R[:, 0]
    jacobians = chart_jacobians(by_q, by_v, by_a, at)
    return Samples(wrench, tau[:, 6:], jacobians[:, :, :6], jacobians[:, :, 6:], links, motion, at)


def _to_world(tau: Array, R: Array, p: Array) -> Array:
    """(T, 6, n) wrenches about the world's origin from the base's rows of (T, 29, n)."""
    force = R @ tau[:, :3]
    return np.concatenate([R @ tau[:, 3:6] + cross_matrix(p) @ force, force], axis=1)


def link_poses(robot: Robot, frames: list[int], x: Array) -> Array:
    """(T, L, 4, 4) poses in world of frames, by Pinocchio's ids, at configurations x (T, 30)."""
    return _carried(robot.model, frames, *_placed(robot, x))


def _placed(robot: Robot, x: Array) -> tuple[Array, Array]:
    """(T, B, 3, 3), (T, B, 3) poses of the bodies."""
    return configuration_poses(_tree(robot), unit_quaternions(x))


def _carried(model: Any, frames: list[int], R: Array, p: Array) -> Array:
    """(T, L, 4, 4) poses of frames from those of the bodies."""
    body = [model.frames[frame].parentJoint - 1 for frame in frames]
    placed = np.reshape([model.frames[frame].placement.homogeneous for frame in frames], (-1, 4, 4))
    links = np.zeros((len(R), len(frames), 4, 4))
    links[..., :3, :3] = R[:, body] @ placed[:, :3, :3]
    links[..., :3, 3] = p[:, body] + (R[:, body] @ placed[:, :3, 3:])[..., 0]
    links[..., 3, 3] = 1.0
    return links


def _motion(axis: Array, R: Array, p: Array) -> Array:
    """(T, 6, 29) Jacobian in world, linear first, about the origin."""
    turning = np.concatenate(
        [R[:, 0], np.moveaxis((R[:, 1:] @ axis[1:, :, None])[..., 0], 1, 2)], 2
    )
    origin = np.concatenate([np.repeat(p[:, :1], 3, axis=1), p[:, 1:]], axis=1)
    linear = np.cross(origin, np.swapaxes(turning, 1, 2)).swapaxes(1, 2)
    sliding = np.concatenate([R[:, 0], np.zeros_like(R[:, 0])], axis=1)
    return np.concatenate([sliding, np.concatenate([linear, turning], axis=1)], axis=2)


def frame_support(model: Any, frames: list[int]) -> npt.NDArray[np.bool_]:
    """(L, 29) which velocities move each frame."""
    mask = np.zeros((len(frames), model.nv), dtype=np.bool_)
    for row, frame in zip(mask, frames, strict=True):
        for joint in model.supports[model.frames[frame].parentJoint]:
            start = model.joints[joint].idx_v
            row[start : start + model.joints[joint].nv] = joint > 0
    return mask


def point_jacobians(samples: Samples, support: npt.NDArray[np.bool_], points: Array) -> Array:
    """(T, P, 3, 30) derivative of points (T, P, 3) in world with respect to x.

    ``support`` (P, 29) says which velocities move each point.
    """
    linear, angular = samples.motion[:, :3], samples.motion[:, 3:]
    J = linear[:, None] - cross_matrix(points) @ angular[:, None]
    J *= support[None, :, None, :]
    base = J[..., :6] @ samples.at.dq[:, None]
    return np.concatenate([base, J[..., 6:]], axis=-1)


def rotation_jacobians(samples: Samples, support: npt.NDArray[np.bool_]) -> Array:
    """(T, L, 3, 30) derivative of link orientations, as rotation vectors in world.

    ``support`` (L, 29) says which velocities move each link.
    """
    J = samples.motion[:, None, 3:] * support[None, :, None, :]
    base = J[..., :6] @ samples.at.dq[:, None]
    return np.asarray(np.concatenate([base, J[..., 6:]], axis=-1))
