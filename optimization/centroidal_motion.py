"""A motion as centre of mass, contact wrench and soles see it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from robomirror_drake.messages import Array
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.robot import Robot


class CentroidalMotion(NamedTuple):
    """How a robot moves, or is told to.

    Attributes:
        com: (T, 3) centre of mass [m].
        com_velocity: (T, 3) [m/s].
        force: (T, 3) sum of the contact forces that the motion needs [N].
        moment: (T, 3) their moment about the world's origin [N·m].
        corners: (T, 2, 4, 3) of the soles, in world [m].
        corner_velocity: (T, 2, 4, 3) [m/s].
    """

    com: Array
    com_velocity: Array
    force: Array
    moment: Array
    corners: Array
    corner_velocity: Array

    @property
    def wrench(self) -> Array:
        """(T, 6) contact wrench about the world's origin, [moment N·m, force N]."""
        return np.concatenate([self.moment, self.force], axis=1)


def centroidal_motion(robot: Robot, q: Array, v: Array, a: Array | None = None) -> CentroidalMotion:
    """The motion of positions (T, 30), velocities (T, 29), accelerations (T, 29), Drake order.

    Without accelerations, force and moment have no meaning.
    """
    a = np.zeros_like(v) if a is None else a
    q_pin, v_pin = robot.to_pinocchio(q), robot.v_to_pinocchio(q, v)
    a_pin = robot.a_to_pinocchio(q, v, a)
    model, data, count = robot.model, robot.model.createData(), len(q)
    com, momentum, rate = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 6))
    R, p, twist = np.empty((count, 2, 3, 3)), np.empty((count, 2, 3)), np.empty((count, 2, 6))
    # The loop does nothing but call Pinocchio and copy what it returns.
    for t in range(count):
        pin.computeCentroidalMomentumTimeVariation(model, data, q_pin[t], v_pin[t], a_pin[t])
        com[t], momentum[t], rate[t] = data.com[0], data.hg.linear, data.dhg.vector
        for foot, frame in enumerate(robot.foot_frames):
            placement = pin.updateFramePlacement(model, data, frame)
            R[t, foot], p[t, foot] = placement.rotation, placement.translation
            twist[t, foot] = pin.getFrameVelocity(
                model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            ).vector
    arm = robot.sole_corners @ np.swapaxes(R, -1, -2)
    force = rate[:, :3] + np.array([0.0, 0.0, robot.mass * GRAVITY])
    return CentroidalMotion(
        com=com,
        com_velocity=momentum / robot.mass,
        force=force,
        moment=np.cross(com, force) + rate[:, 3:],
        corners=p[:, :, None] + arm,
        corner_velocity=twist[:, :, None, :3] + np.cross(twist[:, :, None, 3:], arm),
    )
