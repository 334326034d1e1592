"""r(z): from variables to the samples of a motion, with exact derivatives.

Sample k shows the path at τ(t_k; σ), changed by amplitude, stride and offsets; the legs follow
by inverse kinematics. Derivatives are those of the twists of pelvis and feet and of the upper
joints, taken through ω = J_l(φ) φ̇ + exp(φ) ω_ref for a rotation exp(φ) R_ref, and through the
legs' Jacobians (see :mod:`.legs`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import rotations
from robomirror_drake.optimization.adaptation.legs import Legs, solve_legs
from robomirror_drake.optimization.adaptation.path import LINKS, MotionPath, PathPoint
from robomirror_drake.optimization.adaptation.variables import TWISTS, Layout, stacked
from robomirror_drake.optimization.centroidal import cross_matrix
from robomirror_drake.optimization.floating_base import product
from robomirror_drake.optimization.kinematics import body_poses


class Samples(NamedTuple):
    """A motion at N times.

    Attributes:
        time: (N,) [s].
        q: (N, 30) positions, Drake's order.
        contact: (N, 2, 4) schedule.
        miss: How far a foot is from where it should be [m, rad]; not zero where the legs do
            not reach.
        rotation, origin: (N, B, 3, 3), (N, B, 3) poses of all bodies in world [m].
        load: (N, 2) share of the weight on each foot.
        jacobian: (N, 29, X) velocities, Drake's order, by the variables' rates; so too
        twist: (N, 3, 6, X) [angular, linear] of pelvis and feet in world, and
        loading: (N, 2, X) the loads' rates. All empty where derivatives were not asked for.
    """

    time: Array
    q: Array
    contact: BoolArray
    miss: float
    rotation: Array
    origin: Array
    load: Array
    jacobian: Array
    twist: Array
    loading: Array


def sample(
    legs: Legs, path: MotionPath, layout: Layout, z: Array, time: Array, derivatives: bool = True
) -> Samples:
    """The motion of variables z (X,) at times (N,) [s].

    Args:
        legs: The robot's legs.
        path: The command.
        layout: Its variables.
        z: (X,) their values.
        time: (N,) times from its start [s]; after its end it stands still.
        derivatives: Whether to work out the Jacobians.
    """
    sigma, alpha, beta = layout.changes(z)
    tau, _, by_sigma = path.tau(time, sigma)
    at = path.at(tau)
    weights = layout.basis(tau)[:2]
    offset, rate = (_offsets(layout, z, w, path.upper) for w in weights)
    # δ of a foot is there only while it swings.
    shown = np.concatenate([np.ones((len(tau), 1)), at.swing[0]], axis=1)[..., None]
    change = np.concatenate([np.zeros((len(tau), 1)), at.swing[1]], axis=1)[..., None]
    turned, moved, bent = offset
    phi = alpha * at.turn[0] + turned
    position = at.position[0] + alpha * at.excursion[0] + beta * at.way[0] + shown * moved
    turn = rotations.exp(phi)
    R = turn @ at.rotation
    upper = at.upper[0] + alpha * at.bend[0] + bent
    start = at.joints.copy()
    start[:, legs.upper] = upper
    joints, miss = solve_legs(
        legs,
        (np.ascontiguousarray(R[:, 0]), np.ascontiguousarray(position[:, 0])),
        (np.ascontiguousarray(R[:, 1:]), np.ascontiguousarray(position[:, 1:])),
        start,
    )
    quaternion = product(rotations.exp_quaternion(phi[:, 0]), at.base)
    q = np.hstack([quaternion, position[:, 0], joints])
    poses = body_poses(
        legs.tree, np.ascontiguousarray(R[:, 0]), np.hstack([position[:, 0], 0 * phi[:, 0], joints])
    )
    # In contact where both samples beside are: a foot that begins to lift in between does not.
    last = len(path.time) - 1
    before = np.searchsorted(path.time, tau + 1e-9, side="right") - 1
    after = np.searchsorted(path.time, tau - 1e-9)
    contact = path.contact[np.clip(before, 0, last)] & path.contact[np.clip(after, 0, last)]
    empty = np.empty((len(tau), 0, layout.size))
    made = Samples(time, q, contact, float(miss.max()), *poses, at.load[0], empty, empty, empty)
    if not derivatives:
        return made
    J_l = rotations.left_jacobian(phi)
    linear = at.position[1] + alpha * at.excursion[1] + beta * at.way[1]
    linear = linear + shown * rate[1] + change * moved
    spin = (J_l @ (alpha * at.turn[1] + rate[0])[..., None] + turn @ at.spin[..., None])[..., 0]
    slope = stacked(spin, linear, at.upper[1] + alpha * at.bend[1] + rate[2])
    Y = _coordinates(layout, at, J_l, weights[0], slope * by_sigma[:, None])
    loading = np.zeros((len(tau), 2, layout.size))
    if "tempo" in layout.blocks:
        column = layout.blocks["tempo"].start
        loading[:, :, column] = at.load[1] * by_sigma[:, None] * layout.scale[column]
    return made._replace(
        jacobian=_to_joints(legs, position, *poses, Y),
        twist=Y[:, :TWISTS].reshape(-1, LINKS, 6, layout.size),
        loading=loading,
    )


def quaternion_gradient(q: Array, gradient: Array) -> Array:
    """(N, 29) derivatives by velocities from (N, 30) partial derivatives by q (N, 30).

    A quaternion's rate is ½ (0, ω) r with ω in world.
    """
    w, v = q[:, :1], q[:, 1:4]
    by_w, by_v = gradient[:, :1], gradient[:, 1:4]
    spin = 0.5 * (w * by_v - by_w * v + np.cross(v, by_v))
    return np.hstack([spin, gradient[:, 4:]])


def _offsets(layout: Layout, z: Array, weights: Array, upper: int) -> tuple[Array, Array, Array]:
    """(N, 3, 3) turns and (N, 3, 3) shifts of the links, (N, U) of the upper joints."""
    y = np.zeros((len(weights), TWISTS + upper))
    for name, columns in layout.columns.items():
        block = layout.blocks[name]
        free = (z[block] * layout.scale[block]).reshape(weights.shape[1], -1)
        y[:, columns] = weights @ free
    links = y[:, :TWISTS].reshape(-1, LINKS, 2, 3)
    return links[:, :, 0], links[:, :, 1], y[:, TWISTS:]


def _coordinates(
    layout: Layout, at: PathPoint, J_l: Array, weights: Array, by_sigma: Array
) -> Array:
    """(N, Y, X) rates of the coordinates, turns as angular velocities."""
    Y = np.zeros((*by_sigma.shape, layout.size))
    for name, block in layout.blocks.items():
        column = block.start
        if name == "tempo":
            Y[:, :, column] = by_sigma
        elif name == "amplitude":
            spin = (J_l @ at.turn[0][..., None])[..., 0]
            Y[:, :, column] = stacked(spin, at.excursion[0], at.bend[0])
        elif name == "stride":
            Y[:, :, column] = stacked(0.0 * at.way[0], at.way[0], 0.0 * at.bend[0])
        else:
            columns = layout.columns[name]
            for i, y in enumerate(columns):
                own = slice(block.start + i, block.stop, len(columns))
                if name == "lean":
                    Y[:, :3, own] = J_l[:, 0, :, i, None] * weights[:, None]
                elif name == "feet":
                    Y[:, y, own] = weights * at.swing[0][:, i // 3, None]
                else:
                    Y[:, y, own] = weights
    Y *= layout.scale
    return Y


def _to_joints(legs: Legs, position: Array, R: Array, p: Array, Y: Array) -> Array:
    """(N, 29, X) velocities in Drake's order from the coordinates' rates (N, Y, X)."""
    J = np.zeros((len(Y), R.shape[1] + 5, Y.shape[2]))
    J[:, :6] = Y[:, :6]
    J[:, 6 + legs.upper] = Y[:, TWISTS:]
    for leg, chain in enumerate(legs.chain):
        axes = np.einsum("nbij,bj->nbi", R[:, chain], legs.tree.axis[chain])
        foot = position[:, 1 + leg]
        arms = np.cross(axes, foot[:, None] - p[:, chain])
        own = np.concatenate([axes, arms], axis=2).swapaxes(1, 2)
        relative = Y[:, 6 + 6 * leg : 12 + 6 * leg] - Y[:, :6]
        relative[:, 3:] += cross_matrix(foot - position[:, 0]) @ Y[:, :3]  # − ω × r = r × ω
        J[:, 5 + chain] = np.linalg.solve(own, relative)
    return J
