"""What a user can set about retargeting."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RetargetWeights(_Options):
    """Weights of the objective, ½ ∫ Σ w ‖residual‖² dt."""

    keypoint: float = Field(1.0, gt=0.0, description="keypoint position [1/m²]")
    direction: float = Field(0.02, ge=0.0, description="direction of pelvis, chest and feet")
    support: float = Field(3.0, ge=0.0, description="CoM outside the support, at rest [1/m²]")
    posture: float = Field(3e-4, gt=0.0, description="joint angle from standing [1/rad²]")
    acceleration: float = Field(1e-8, ge=0.0, description="coordinates' acceleration [s⁴/rad²]")
    jerk: float = Field(4.5e-8, gt=0.0, description="coordinates' jerk [s⁶/rad²]")


class RetargetGate(_Options):
    """The most that a reference may miss its problem by, else it is refused."""

    keypoint_error: float = Field(0.10, gt=0.0, description="mean over keypoints and time [m]")
    stance_drift: float = Field(0.015, gt=0.0, description="of a standing sole corner [m]")
    penetration: float = Field(0.015, gt=0.0, description="of a sole into the floor [m]")
    self_penetration: float = Field(0.03, gt=0.0, description="of two capsules [m]")
    limit_violation: float = Field(1e-9, gt=0.0, description="joint position [rad], speed [rad/s]")


class RetargetOptions(_Options):
    """How a human motion is turned into a robot's reference."""

    knot_spacing: float = Field(1 / 15, gt=0.02, le=0.5, description="distance of the knots [s]")
    knee_min: float = Field(
        0.2, ge=0.0, description="least knee angle; a straight leg is singular [rad]"
    )
    joint_acceleration: float = Field(250.0, gt=0.0, description="limit of all joints [rad/s²]")
    collision_margin: float = Field(0.01, ge=0.0, description="kept between capsules [m]")
    support_margin: float = Field(0.02, ge=0.0, description="CoM inside the support polygon [m]")
    slow_speed: float = Field(0.25, gt=0.0, description="pelvis speed that is no longer slow [m/s]")
    weights: RetargetWeights = RetargetWeights()
    gate: RetargetGate = RetargetGate()
    iterations: int = Field(30, ge=1, le=500, description="most Gauss–Newton iterations")
    tolerance: float = Field(
        2.5e-3, gt=0.0, description="stance, floor and collision when solved [m]"
    )
    flatness: float = Field(
        0.1, gt=0.0, lt=1.0, description="share of the cost that a step must save for another"
    )
