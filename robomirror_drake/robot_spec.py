"""The YAML that describes a robot, as validated dataclasses.

See ``assets/robots/jvrc1.yaml`` for a commented example; every key there is a
field here. Unknown keys and bad values raise :class:`ConfigError`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from robomirror_drake.messages import Array
from robomirror_drake.yaml_file import load_yaml

Point = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class DescriptionSpec(_Spec):
    """Where the robot's own files are: a URDF inside an installed Python package."""

    package: str
    urdf: str


class JointSpec(_Spec):
    """What the description does not say about a joint, or says only nominally."""

    effort: Positive = Field(description="torque limit [N·m]")
    velocity: Positive = Field(description="velocity limit [rad/s]")
    armature: NonNegative = Field(description="rotor inertia at the joint [kg·m²]")
    damping: NonNegative = Field(description="viscous friction [N·m·s/rad]")


class JointGains(_Spec):
    """Low-level joint servo: τ = stiffness (q_des − q) − damping q̇."""

    stiffness: Positive = Field(description="[N·m/rad]")
    damping: NonNegative = Field(description="[N·m·s/rad]")


class FootSpec(_Spec):
    """The flat rectangle of a sole in the frame of its link [m]."""

    link: str
    x: tuple[float, float] = Field(description="heel, toe")
    y: tuple[float, float] = Field(description="right edge, left edge")
    z: float = Field(description="height of the sole")

    @property
    def corners(self) -> Array:
        """(4, 3) front left, front right, rear right, rear left."""
        (x0, x1), (y0, y1), z = self.x, self.y, self.z
        return np.array([[x1, y1, z], [x1, y0, z], [x0, y0, z], [x0, y1, z]])

    @property
    def center(self) -> Array:
        """(3,) centre of the sole."""
        return np.asarray(self.corners.mean(axis=0))


class ContactSpec(_Spec):
    """Compliant contact of the soles with the floor."""

    stiffness: Positive = Field(description="[N/m] per corner")
    dissipation: NonNegative = Field(description="Hunt & Crossley [s/m]")
    friction: Positive = Field(description="static and dynamic coefficient")


class CapsuleSpec(_Spec):
    """A capsule fixed to a link; a sphere where both ends are the same."""

    link: str
    ends: tuple[Point, Point] = Field(description="[m] in the link's frame")
    radius: Positive = Field(description="[m]")


class KeypointSpec(_Spec):
    """The point of a link that answers to a joint of the human skeleton."""

    link: str
    point: Point = Field(description="[m] in the link's frame")


class RobotSpec(_Spec):
    """Everything about a robot that its description does not carry."""

    name: str
    description: DescriptionSpec
    base_link: str
    joints: dict[str, JointSpec]
    joint_gains: JointGains
    stand: dict[str, float] = Field(description="standing joint angles [rad], 0 where absent")
    feet: dict[str, FootSpec] = Field(description="``left`` and ``right``")
    contact: ContactSpec
    collision: dict[str, CapsuleSpec]
    self_collision: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    keypoints: dict[str, KeypointSpec]

    @model_validator(mode="after")
    def _names_exist(self) -> RobotSpec:
        if set(self.feet) != {"left", "right"}:
            raise ValueError(f"feet must be left and right, not {sorted(self.feet)}")
        if unknown := set(self.stand) - set(self.joints):
            raise ValueError(f"stand names unknown joints: {sorted(unknown)}")
        named = {name for pair in self.self_collision for side in pair for name in side}
        if unknown := named - set(self.collision):
            raise ValueError(f"self_collision names unknown capsules: {sorted(unknown)}")
        return self

    @property
    def collision_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the capsules that retargeting keeps apart, two by two."""
        pairs = {
            (min(a, b), max(a, b)): None
            for first, second in self.self_collision
            for a in first
            for b in second
            if a != b
        }
        return tuple(pairs)


def load_spec(robot: str | Path = "jvrc1") -> RobotSpec:
    """Reads a robot's YAML.

    Args:
        robot: Name of a file in ``assets/robots`` without suffix, or a path.

    Raises:
        ConfigError: There is no such file, it is not YAML, or a key or value is wrong.
    """
    return load_yaml(RobotSpec, "robots", robot)
