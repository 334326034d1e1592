"""Joint torques of a planned motion, with derivatives.

With the wrench F_i of each foot about the world's origin and S_j the world twist of joint j,

    τ_j = [M q̈ + h]_j + d_j q̇_j − Σ_i S_j · F_i,        F_i = G_i w + g_i,

over the feet that the joint carries, where w is the wrench that the whole motion needs. How
the feet share it is fixed but for the linear map G_i, so that torques are functions of the
motion alone. As a joint k below j moves its axis by S_k × S_j,

    ∂(S_j · F)/∂q_k = (S_k × S_j) · F = S_k · (S_j ×* F).

Source: R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, ch. 2 and 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.planning.contacts import ConeOptions
from robomirror_drake.optimization.planning.forces import share_wrench
from robomirror_drake.robot import Robot

_ARM = 0.1  # a moment of 0.1 m times a force counts as much as the force


class Split(NamedTuple):
    """How the feet share a wrench w about the world's origin, [moment, force]: G w + g.

    Attributes:
        gain: (T, 2, 6, 6) G of each foot; they sum up to one, or zero in flight.
        offset: (T, 2, 6) g, which sum up to nothing.
    """

    gain: Array
    offset: Array


def split_of(wrench: Array, standing: Array, loaded: BoolArray, cone: ConeOptions) -> Split:
    """The smooth split at a wrench; what is added to the wrench goes by the present loads.

    Args:
        wrench: (T, 6) wrench about the world's origin.
        standing: (T, 2, 4, 3) sole corners at their anchors [m].
        loaded: (T, 2, 4) corners that bear load.
        cone: Limits of one foot.

    Raises:
        PlanningError: See :func:`share_wrench`.
    """
    share = share_wrench(wrench, standing, loaded, cone)
    centers = standing.mean(axis=2)
    share[..., :3] += np.cross(centers, share[..., 3:])
    on = np.asarray(loaded.any(axis=2))
    load = np.where(on, np.maximum(share[..., 5], 1.0), 0.0)
    # Least norm of the added wrenches about the soles' centres, each against its load.
    lever = np.tile(np.eye(6), (len(wrench), 2, 1, 1))
    lever[..., :3, 3:] = centroidal.cross_matrix(centers)
    weight = np.diag(np.repeat([_ARM**2, 1.0], 3))
    mobility = lever @ weight @ np.swapaxes(lever, -1, -2) * load[..., None, None]
    total = mobility.sum(axis=1)
    total[~on.any(axis=1)] = np.eye(6)
    gain = mobility @ np.linalg.inv(total)[:, None]
    return Split(gain, share - np.einsum("tfij,tj->tfi", gain, wrench))


def joint_torques(
    robot: Robot, samples: centroidal.Samples, split: Split, carries: BoolArray
) -> tuple[Array, Array | None]:
    """Torques (T, 23) [N·m] and, where the samples have them, derivatives (3, T, 23, 30).

    Args:
        robot: The robot.
        samples: The motion; the derivatives are with respect to x, ẋ, ẍ.
        split: How the feet share the wrench.
        carries: (2, 29) which velocities move each foot.
    """
    damping = np.array([joint.damping for joint in robot.spec.joints.values()])
    at, legs = samples.at, np.flatnonzero(carries[:, 6:].any(axis=0))
    feet = np.einsum("tfij,tj->tfi", split.gain, samples.wrench) + split.offset
    feet = np.roll(feet, 3, axis=-1)
    turning = np.swapaxes(samples.motion[:, :, 6:], -1, -2)[:, None, legs]
    carried = carries[:, 6 + legs, None] * turning
    torque = samples.torque + damping * at.v[:, 6:]
    torque[:, legs] -= np.einsum("tfji,tfi->tj", carried, feet)
    if samples.torque_jacobians is None or samples.wrench_jacobians is None:
        return torque, None
    linear, angular = carried[..., :3], carried[..., 3:]
    force, moment = feet[:, :, None, :3], feet[:, :, None, 3:]
    turned = np.concatenate(
        [np.cross(angular, force), np.cross(angular, moment) + np.cross(linear, force)], axis=-1
    )
    jacobians = samples.torque_jacobians.copy()
    # What moves the foot and comes after the joint itself turns the joint's axis, or the base.
    by_q = np.zeros((len(torque), len(legs), 29))
    for foot in range(2):
        by_q -= carries[foot] * (turned[:, foot] @ samples.motion)
    by_q *= np.arange(29) < (6 + legs)[:, None]
    jacobians[0, :, legs] += np.moveaxis(
        np.concatenate([by_q[:, :, :6] @ at.dq, by_q[:, :, 6:]], axis=2), 1, 0
    )
    jacobians[1, :, :, 7:] += np.diag(damping)
    gain = np.roll(split.gain, 3, axis=-2)
    through = np.einsum("tfji,tfik->tjk", carried, gain)
    jacobians[:, :, legs] -= through @ samples.wrench_jacobians
    return torque, jacobians
