"""What the controller needs to know about a configuration: dynamics, and the motion of its tasks.

Everything here is in Pinocchio's order of coordinates (base linear then angular,
in the base's own frame), its results in world axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.centroidal import frame_support
from robomirror_drake.optimization.control.collision import CollisionModel
from robomirror_drake.optimization.control.pinocchio_kernels import (
    dynamics_in_world,
    motion_in_world,
)
from robomirror_drake.optimization.control.pinocchio_memory import Memory, memory_of
from robomirror_drake.robot import FEET, Robot

PELVIS, TRUNK, LEFT_SOLE, RIGHT_SOLE = range(4)
"""Rows of the task frames in :class:`TaskMotion` and :class:`DynamicsTerms`."""


@dataclass(frozen=True)
class ControlModel:
    """A robot's model with one more frame in the centre of each sole.

    Attributes:
        model: Pinocchio model.
        frames: Frame ids: pelvis, trunk, left sole, right sole.
        arms: (4, 3) their origins in the axes of the joints that carry them [m].
        support: (4, 29) which velocities move them.
        corners: (2, 4, 3) sole corners in the frames of the soles [m].
        damping: (29,) viscous friction, zero for the base [N·m·s/rad].
        effort: (23,) torque limits [N·m].
        lower, upper: (23,) joint limits [rad].
        knees: (23,) which joints are knees.
        limbs: (23,) which limb each joint belongs to: ``leg``, ``waist`` or ``arm``.
        mass: Total mass [kg].
        collision: What to keep apart.
    """

    model: pin.Model
    frames: tuple[int, int, int, int]
    arms: Array
    support: BoolArray
    corners: Array
    damping: Array
    effort: Array
    lower: Array
    upper: Array
    knees: BoolArray
    limbs: tuple[str, ...]
    mass: float
    collision: CollisionModel


def control_model(robot: Robot) -> ControlModel:
    """The control model of a robot; the robot's own Pinocchio model stays as it is."""
    model = pin.Model(robot.model)
    soles = []
    for foot, link in zip(FEET, robot.foot_frames, strict=True):
        parent = model.frames[link]
        center = pin.SE3(np.eye(3), robot.spec.feet[foot].center)
        frame = pin.Frame(
            f"{foot}_sole", parent.parentJoint, link, parent.placement * center, pin.OP_FRAME
        )
        soles.append(int(model.addFrame(frame)))
    centers = np.array([robot.spec.feet[foot].center for foot in FEET])
    damping = [joint.damping for joint in robot.spec.joints.values()]
    lower, upper = robot.position_limits
    trunk = robot.frame_id(robot.spec.keypoints["neck"].link)
    frames = (robot.frame_id(robot.spec.base_link), trunk, soles[0], soles[1])
    return ControlModel(
        model=model,
        frames=frames,
        arms=np.array([model.frames[frame].placement.translation for frame in frames]),
        support=frame_support(model, list(frames)),
        corners=robot.sole_corners - centers[:, None],
        damping=np.concatenate([np.zeros(6), damping]),
        effort=robot.effort_limits,
        lower=lower,
        upper=upper,
        knees=robot.knees,
        limbs=_limbs(model, soles, trunk),
        mass=robot.mass,
        collision=CollisionModel.of(robot),
    )


def _limbs(model: pin.Model, soles: list[int], trunk: int) -> tuple[str, ...]:
    """A joint is of a leg if it carries a sole, of the waist if the trunk, else of an arm."""
    legs = {joint for sole in soles for joint in model.supports[model.frames[sole].parentJoint]}
    waist = set(model.supports[model.frames[trunk].parentJoint])
    return tuple(
        "leg" if joint in legs else "waist" if joint in waist else "arm"
        for joint in range(2, model.njoints)
    )


class TaskMotion(NamedTuple):
    """Where everything that is controlled is, and how it moves, for some (q, v, a).

    For a = 0 the accelerations are the bias J̇ v of the tasks.

    Attributes:
        com: (3, 3) position, velocity, acceleration of the centre of mass [m, m/s, m/s²].
        angular: (2, 3) angular momentum about the centre of mass and its rate.
        R: (4, 3, 3) rotation of the task frames.
        p: (4, 3) their origins [m].
        v: (4, 6) their velocities, linear then angular.
        a: (4, 6) their classical accelerations, linear then angular.
    """

    com: Array
    angular: Array
    R: Array
    p: Array
    v: Array
    a: Array


class DynamicsTerms(NamedTuple):
    """``M q̈ + h = [0; τ] + Jᵀ f`` and the tasks, at one state.

    Attributes:
        M: (29, 29) mass matrix with armature.
        h: (29,) Coriolis, centrifugal, gravity and joint friction.
        momentum: (6, 29) centroidal momentum matrix, linear then angular.
        J: (4, 6, 29) Jacobians of the task frames, linear then angular.
        motion: The tasks' motion for zero acceleration.
        joints: (23,) joint positions.
        rates: (23,) joint velocities.
    """

    M: Array
    h: Array
    momentum: Array
    J: Array
    motion: TaskMotion
    joints: Array
    rates: Array


def memory(robot: ControlModel) -> Memory:
    """Memory to work in, for :func:`task_motion` and :func:`dynamics_terms`."""
    return memory_of(robot.model, robot.frames, robot.collision.links)


def task_motion(robot: ControlModel, memory: Memory, q: Array, v: Array, a: Array) -> TaskMotion:
    """Motion of the task frames, the centre of mass and the angular momentum.

    Args:
        robot: The model.
        memory: To work in.
        q, v, a: (30,), (29,), (29,) in Pinocchio's order.
    """
    pin.computeCentroidalMomentumTimeVariation(robot.model, memory.data, q, v, a)
    pin.updateFramePlacements(robot.model, memory.data)
    return TaskMotion(*motion_in_world(memory.motion, robot.arms, robot.mass))


def dynamics_terms(robot: ControlModel, memory: Memory, q: Array, v: Array) -> DynamicsTerms:
    """All terms at a state.

    Args:
        robot: The model.
        memory: To work in.
        q, v: (30,), (29,) in Pinocchio's order.
    """
    data = memory.data
    # In world axes this is where the Jacobians and the momentum matrix come from as well.
    pin.crba(robot.model, data, q, pin.Convention.WORLD)
    pin.nonLinearEffects(robot.model, data, q, v)
    motion = task_motion(robot, memory, q, v, np.zeros(robot.model.nv))
    M, h, momentum, J = dynamics_in_world(
        memory.dynamics, motion.p, robot.support, robot.damping, v
    )
    return DynamicsTerms(M, h, momentum, J, motion, q[7:], v[6:])
