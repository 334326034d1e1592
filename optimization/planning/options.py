"""Options of dynamic planning."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.planning.contacts import ConeOptions
from robomirror_drake.robot import Robot


class PlanOptions(BaseModel):
    """How a dynamic plan is made."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    strength: float = Field(
        1.0, ge=0.0, le=1.0, description="share of the dynamic violation to remove; 0: no plan"
    )
    knot_spacing: float = Field(0.05, gt=0.0, le=0.5, description="of the spline's knots [s]")
    stride: int = Field(
        1, ge=1, le=3, description="frames from one sample to the next, but where contacts change"
    )
    friction: float = Field(0.35, gt=0.0, le=2.0, description="friction coefficient planned with")
    cop_margin: float = Field(
        0.06, ge=0.0, le=0.1, description="distance of the centre of pressure from the edge [m]"
    )
    max_normal_force: float = Field(2.5, gt=1.0, description="normal force [body weights]")
    clearance: float = Field(0.03, ge=0.0, le=0.2, description="of soles in mid-swing [m]")
    self_distance: float = Field(0.01, ge=0.0, le=0.1, description="between own links [m]")
    min_knee: float = Field(0.3, ge=0.0, le=1.0, description="least planned knee angle [rad]")
    torque_share: float = Field(0.75, gt=0.0, le=1.0, description="of the joints' torque limits")
    speed_share: float = Field(0.8, gt=0.0, le=1.0, description="of the joints' speed limits")
    lead: float = Field(
        0.8, ge=0.0, le=5.0, description="time added where a reference is cut in mid-motion [s]"
    )
    shortest_phase: float = Field(
        0.12, ge=0.0, le=0.5, description="shorter swings and supports are label flicker [s]"
    )
    time_scale: float = Field(
        1.0, ge=0.2, le=1.0, description="tempo to plan at; what flies keeps its own"
    )
    slowest: float = Field(
        1.0, ge=0.2, le=1.0, description="tempo down to which a motion that is too hard is slowed"
    )
    feasible: float = Field(
        0.05, gt=0.0, description="dynamic violation from which on it is too hard [body weights]"
    )
    farthest: float = Field(
        1.0, gt=0.0, description="distance to the reference from which on it is too hard [m]"
    )
    iterations: int = Field(40, ge=1, le=500, description="Gauss-Newton steps at most")
    window_iterations: int = Field(
        4, ge=1, le=500, description="Gauss-Newton steps at most for a window that goes on"
    )
    tolerance: float = Field(1e-3, gt=0.0, description="violation at which iterations may end")

    @model_validator(mode="after")
    def _no_contradiction(self) -> Self:
        if self.slowest < 1.0 and self.slowest > self.time_scale:
            raise ValueError(
                f"slowest {self.slowest} is faster than time_scale {self.time_scale}, the tempo "
                "to begin with: lower one or raise the other"
            )
        return self

    def cone(self, robot: Robot) -> ConeOptions:
        """Limits of the wrench that the ground can give."""
        return ConeOptions(
            friction=self.friction,
            margin=self.cop_margin,
            max_normal_force=self.max_normal_force,
            weight=robot.mass * centroidal.GRAVITY,
        )
