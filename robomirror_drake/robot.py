"""One robot in Drake and in Pinocchio, and the only conversion between the two.

Drake orders a floating base as quaternion wxyz, position; its velocities are
angular first, both in the world. Pinocchio has position, quaternion xyzw;
velocities are linear first, both in the base's own frame. Joints stand in the
order of the robot's YAML in both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from pydrake.geometry import (
    AddContactMaterial,
    Capsule,
    CollisionFilterDeclaration,
    GeometrySet,
    HalfSpace,
    ProximityProperties,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from robomirror_drake.exceptions import RobotModelError
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.robot_spec import RobotSpec, load_spec
from robomirror_drake.urdf import cached_urdf

FEET = ("left", "right")
"""Order of the feet in every array."""

SOLE_SPHERE_RADIUS = 0.005
"""Radius of the contact spheres in the corners of a sole [m]."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot model.

    Attributes:
        spec: The robot's YAML.
        urdf: The reduced URDF that both libraries read.
        model: Pinocchio model with a free-flyer base and ``armature`` set.
    """

    spec: RobotSpec
    urdf: Path
    model: pin.Model

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The actuated joints, in order."""
        return tuple(self.spec.joints)

    @cached_property
    def knees(self) -> BoolArray:
        """(23,) which joints are knees."""
        return np.array(["KNEE" in name for name in self.joint_names])

    @cached_property
    def position_limits(self) -> tuple[Array, Array]:
        """(23,), (23,) lower and upper joint limits [rad]."""
        return self.model.lowerPositionLimit[7:].copy(), self.model.upperPositionLimit[7:].copy()

    @cached_property
    def velocity_limits(self) -> Array:
        """(23,) joint velocity limits [rad/s]."""
        return np.array([joint.velocity for joint in self.spec.joints.values()])

    @cached_property
    def effort_limits(self) -> Array:
        """(23,) joint torque limits [N·m]."""
        return np.array([joint.effort for joint in self.spec.joints.values()])

    @cached_property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @cached_property
    def sole_corners(self) -> Array:
        """(2, 4, 3) corners of the soles in the frames of their links [m]."""
        return np.array([self.spec.feet[foot].corners for foot in FEET])

    @cached_property
    def foot_frames(self) -> tuple[int, int]:
        """Pinocchio ids of the frames of the feet's links, (left, right)."""
        left, right = (self.frame_id(self.spec.feet[foot].link) for foot in FEET)
        return left, right

    def frame_id(self, link: str) -> int:
        """Pinocchio's id of the frame of a link.

        Raises:
            RobotModelError: The reduced model has no such link.
        """
        index = int(self.model.getFrameId(link, pin.FrameType.BODY))
        if index >= self.model.nframes:
            raise RobotModelError(f"robot {self.spec.name!r} has no link {link!r}")
        return index

    @cached_property
    def standing(self) -> Array:
        """(30,) the standing configuration on the floor z = 0, Drake order."""
        joints = np.array([self.spec.stand.get(name, 0.0) for name in self.joint_names])
        q = np.concatenate([np.zeros(6), [1.0], joints])
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        corners = [
            data.oMf[frame].act(corner)[2]
            for frame, foot in zip(self.foot_frames, self.sole_corners, strict=True)
            for corner in foot
        ]
        q[2] = -min(corners)
        return self.to_drake(q)

    def to_pinocchio(self, q: Array) -> Array:
        """(…, 30) positions from Drake's order to Pinocchio's."""
        return np.concatenate([q[..., 4:7], q[..., 1:4], q[..., :1], q[..., 7:]], axis=-1)

    def to_drake(self, q: Array) -> Array:
        """(…, 30) positions from Pinocchio's order to Drake's."""
        return np.concatenate([q[..., 6:7], q[..., 3:6], q[..., :3], q[..., 7:]], axis=-1)

    def v_to_pinocchio(self, q: Array, v: Array) -> Array:
        """(…, 29) velocities from Drake to Pinocchio; ``q`` (…, 30) is in Drake's order."""
        R = rotation_matrix(q[..., :4])
        return np.concatenate([_unrotate(R, v[..., 3:6]), _unrotate(R, v[..., :3]), v[..., 6:]], -1)

    def v_to_drake(self, q: Array, v: Array) -> Array:
        """(…, 29) velocities from Pinocchio to Drake; ``q`` (…, 30) is in Drake's order."""
        R = rotation_matrix(q[..., :4])
        return np.concatenate([_rotate(R, v[..., 3:6]), _rotate(R, v[..., :3]), v[..., 6:]], -1)

    def a_to_pinocchio(self, q: Array, v: Array, a: Array) -> Array:
        """(…, 29) time derivative of Pinocchio's v from that of Drake's; q, v in Drake's order.

        With v_B = Rᵀ v_W, v̇_B = Rᵀ v̇_W − ω_B × v_B.
        """
        moved = self.v_to_pinocchio(q, a)
        v_pin = self.v_to_pinocchio(q, v)
        moved[..., :3] -= np.cross(v_pin[..., 3:6], v_pin[..., :3])
        return moved

    def a_to_drake(self, q: Array, v: Array, a: Array) -> Array:
        """(…, 29) time derivative of Drake's v from that of Pinocchio's; q, v in Drake's order."""
        v_pin = self.v_to_pinocchio(q, v)
        linear = a[..., :3] + np.cross(v_pin[..., 3:6], v_pin[..., :3])
        return self.v_to_drake(q, np.concatenate([linear, a[..., 3:]], axis=-1))

    def add_to_plant(
        self, plant: MultibodyPlant, *, name: str | None = None, collision: bool = True
    ) -> ModelInstanceIndex:
        """Adds the robot to a plant that is not yet finalized.

        Args:
            plant: The plant; visuals and collision need it registered with a SceneGraph.
            name: Name of the model instance, ``spec.name`` by default.
            collision: Whether to add the contact geometry; without it the robot is a ghost.

        Raises:
            RobotModelError: Drake cannot read the model.
        """
        parser = Parser(plant)
        parser.SetAutoRenaming(True)
        try:
            (instance,) = parser.AddModels(self.urdf)
        except RuntimeError as error:
            raise RobotModelError(f"Drake cannot read {self.urdf}: {error}") from error
        if name is not None:
            plant.RenameModelInstance(instance, name)
        if collision:
            self._add_collision(plant, instance)
        return instance

    def _add_collision(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        contact = self.spec.contact
        friction = CoulombFriction(contact.friction, contact.friction)

        def properties() -> ProximityProperties:
            made = ProximityProperties()
            AddContactMaterial(
                dissipation=contact.dissipation,
                point_stiffness=contact.stiffness,
                friction=friction,
                properties=made,
            )
            return made

        def add(link: str, pose: RigidTransform, shape: Shape, name: str) -> None:
            body = plant.GetBodyByName(link, instance)
            plant.RegisterCollisionGeometry(body, pose, shape, name, properties())

        for foot, spec in self.spec.feet.items():
            for number, corner in enumerate(spec.corners):
                lifted = corner + np.array([0.0, 0.0, SOLE_SPHERE_RADIUS])
                center = RigidTransform(p=lifted)
                add(spec.link, center, Sphere(SOLE_SPHERE_RADIUS), f"{foot}_corner_{number}")
        for name, capsule in self.spec.collision.items():
            a, b = (np.array(end, dtype=np.float64) for end in capsule.ends)
            length = float(np.linalg.norm(b - a))
            if length == 0.0:
                add(capsule.link, RigidTransform(p=a), Sphere(capsule.radius), name)
            else:
                # Drake's capsule lies along its own z.
                X = RigidTransform(RotationMatrix.MakeFromOneVector(b - a, 2), (a + b) / 2)
                add(capsule.link, X, Capsule(capsule.radius, length), name)

    def filter_self_collision(
        self, plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex
    ) -> None:
        """Lets only the spec's ``self_collision`` pairs meet; call after ``Finalize()``."""
        inspector = scene_graph.model_inspector()
        geometries = {
            inspector.GetName(geometry).rpartition("::")[2]: geometry
            for body in plant.GetBodyIndices(instance)
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(body))
        }
        manager = scene_graph.collision_filter_manager()
        manager.Apply(
            CollisionFilterDeclaration().ExcludeWithin(GeometrySet(list(geometries.values())))
        )
        allowed = CollisionFilterDeclaration()
        for a, b in self.spec.collision_pairs:
            allowed.AllowBetween(GeometrySet(geometries[a]), GeometrySet(geometries[b]))
        manager.Apply(allowed)


@lru_cache(maxsize=8)
def load_robot(robot: str | Path = "jvrc1") -> Robot:
    """Loads a robot by the name of its YAML in ``assets/robots``, or by the YAML's path.

    Raises:
        ConfigError: The YAML is missing or wrong.
        RobotModelError: The description is missing, or the two libraries cannot agree on it.
    """
    spec = load_spec(robot)
    urdf = cached_urdf(spec)
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    if tuple(model.names)[2:] != tuple(spec.joints):
        raise RobotModelError(
            f"robot {spec.name!r}: list the joints in Pinocchio's order, {list(model.names)[2:]}"
        )
    model.armature = np.concatenate([np.zeros(6), [j.armature for j in spec.joints.values()]])
    return Robot(spec=spec, urdf=urdf, model=model)


def add_ground(plant: MultibodyPlant, friction: float) -> None:
    """A rigid floor at z = 0 with Coulomb friction, for contact only.

    Drake combines two surfaces' coefficients as 2 µ₁ µ₂ / (µ₁ + µ₂).
    """
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform(),
        HalfSpace(),
        "ground",
        CoulombFriction(friction, friction),
    )


def rotation_matrix(quaternion: Array) -> Array:
    """(…, 3, 3) rotation matrices of unit quaternions (…, 4), wxyz."""
    alone = quaternion.ndim == 1  # as in every tick of a controller: plain numbers are faster
    w, x, y, z = quaternion.tolist() if alone else np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    if alone:
        return np.array(rows)
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _rotate(R: Array, x: Array) -> Array:
    return np.asarray(R @ x if x.ndim == 1 else np.einsum("...ij,...j->...i", R, x))


def _unrotate(R: Array, x: Array) -> Array:
    return np.asarray(x @ R if x.ndim == 1 else np.einsum("...ji,...j->...i", R, x))
