"""Contact wrench and link kinematics along a trajectory, with derivatives.

A trajectory is given by x (T, 30) and its two time derivatives, where x is a
configuration in Drake's order whose quaternion need not have unit length: that
makes R⁴ × R²⁶ a chart without singularities on which splines can be laid. The
angular velocity and acceleration in the base's own frame are

    ω = 2 vec(r̄ ṙ) / |r|²,      ω̇ = 2 vec(r̄ r̈) / |r|² − 2 (r·ṙ) / |r|² ω.

The wrench that the ground has to supply follows from Newton and Euler,

    f = ḣ_lin − m g,      n = c × f + L̇,

with n about the origin of the world, c the centre of mass, ḣ_lin and L̇ the
rates of linear and angular momentum about it (D. Orin, A. Goswami, S.-H. Lee,
"Centroidal dynamics of a humanoid robot", Autonomous Robots, 2013). Pinocchio
gives the derivatives in the tangent space of its free flyer; the chain rule to
x, ẋ, ẍ is here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from robomirror_drake.messages import Array
from robomirror_drake.robot import rotation_matrix

GRAVITY = 9.81


class WrenchSamples(NamedTuple):
    """Contact wrench along a trajectory, [moment about the world's origin N·m, force N].

    Attributes:
        wrench: (T, 6).
        jacobians: (3, T, 6, 30) derivatives with respect to x, ẋ, ẍ; None if not asked for.
        links: (T, L, 4, 4) poses of the frames asked for, in world.
        motion: (T, 6, 29) Jacobian of Pinocchio, world, linear first, about the origin.
        at: The trajectory in Pinocchio's coordinates.
    """

    wrench: Array
    jacobians: Array | None
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
    """(T, 30) x with its quaternion normalised: a configuration in Drake's order."""
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


def sample(
    model: Any, frames: list[int], x: Array, xd: Array, xdd: Array, *, derivatives: bool
) -> WrenchSamples:
    """Evaluates wrench and link poses on a trajectory x, ẋ, ẍ, each (T, 30)."""
    data = model.createData()
    at = tangent(x, xd, xdd)
    T, nv = len(x), model.nv
    hdot, com = np.empty((T, 6)), np.empty((T, 3))
    links = np.empty((T, len(frames), 4, 4))
    motion = np.empty((T, 6, nv))
    dq, dv, da = (np.empty((T, 6, nv)) for _ in range(3))
    # The loop does nothing but call Pinocchio and copy what it returns.
    for t in range(T):
        if derivatives:
            _, dq[t], dv[t], da[t] = pin.computeCentroidalDynamicsDerivatives(
                model, data, at.q[t], at.v[t], at.a[t]
            )
            motion[t] = data.J
        else:
            pin.computeCentroidalMomentumTimeVariation(model, data, at.q[t], at.v[t], at.a[t])
        hdot[t], com[t] = data.dhg.np, data.com[0]
        pin.updateFramePlacements(model, data)
        for i, frame in enumerate(frames):
            links[t, i] = data.oMf[frame].homogeneous
    mass = float(sum(inertia.mass for inertia in model.inertias))
    force = hdot[:, :3] + np.array([0.0, 0.0, mass * GRAVITY])
    wrench = np.concatenate([np.cross(com, force) + hdot[:, 3:], force], axis=1)
    if not derivatives:
        return WrenchSamples(wrench, None, links, motion, at)
    # dn = c × df − f × dc + dL̇, and m dc is the linear part of dḣ/da.
    lever, load = cross_matrix(com), cross_matrix(force)

    def to_wrench(d: Array) -> Array:
        return np.concatenate([lever @ d[:, :3] + d[:, 3:], d[:, :3]], axis=1)

    by_q, by_v, by_a = to_wrench(dq), to_wrench(dv), to_wrench(da)
    by_q[:, :3] -= load @ da[:, :3] / mass
    return WrenchSamples(wrench, chart_jacobians(by_q, by_v, by_a, at), links, motion, at)


def frame_support(model: Any, frames: list[int]) -> npt.NDArray[np.bool_]:
    """(L, 29) which velocities move each frame."""
    mask = np.zeros((len(frames), model.nv), dtype=np.bool_)
    for row, frame in zip(mask, frames, strict=True):
        for joint in model.supports[model.frames[frame].parentJoint]:
            start = model.joints[joint].idx_v
            row[start : start + model.joints[joint].nv] = joint > 0
    return mask


def point_jacobians(samples: WrenchSamples, support: npt.NDArray[np.bool_], points: Array) -> Array:
    """(T, P, 3, 30) derivative of points (T, P, 3) in world with respect to x.

    ``support`` (P, 29) says which velocities move each point.
    """
    linear, angular = samples.motion[:, :3], samples.motion[:, 3:]
    J = linear[:, None] - cross_matrix(points) @ angular[:, None]
    J *= support[None, :, None, :]
    base = J[..., :6] @ samples.at.dq[:, None]
    return np.concatenate([base, J[..., 6:]], axis=-1)


def rotation_jacobians(samples: WrenchSamples, support: npt.NDArray[np.bool_]) -> Array:
    """(T, L, 3, 30) derivative of link orientations, as rotation vectors in world."""
    J = samples.motion[:, None, 3:] * support[None, :, None, :]
    base = J[..., :6] @ samples.at.dq[:, None]
    return np.asarray(np.concatenate([base, J[..., 6:]], axis=-1))
