"""What a user can set about the optimisation of a reference."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Variable = Literal["tempo", "amplitude", "stride", "base", "lean", "upper", "feet"]
"""What may change: ``tempo`` the duration; ``amplitude`` the excursions from a smooth posture;
``stride`` the way over the floor; and offsets in time of the pelvis' position (``base``), of
its roll and pitch (``lean``), of waist and arms (``upper``), of feet in the air (``feet``)."""


Beginning = Literal["command", "slower", "smaller", "both"]
"""Where to start from: the command as it is, or with less tempo, amplitude and stride."""


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class AdaptScales(_Options):
    """Deviations that cost ½ each, as a root mean square over the motion's time."""

    tempo: float = Field(0.25, gt=0.0, description="time added per time of the command")
    amplitude: float = Field(0.5, gt=0.0, description="beside what the change itself costs")
    stride: float = Field(0.5, gt=0.0, description="beside what the change itself costs")
    base: float = Field(0.05, gt=0.0, description="of the pelvis [m]")
    lean: float = Field(0.1, gt=0.0, description="of the pelvis [rad]")
    upper: float = Field(0.2, gt=0.0, description="of a joint of waist and arms [rad]")
    feet: float = Field(0.06, gt=0.0, description="of a foot [m]; its turn counts as 0.3 m/rad")
    smooth: float = Field(
        0.1, ge=0.0, description="time for which an offset's acceleration counts as deviation [s]"
    )


class AdaptBounds(_Options):
    """The most that the motion may deviate from the command."""

    slowest: float = Field(0.5, gt=0.1, le=1.0, description="tempo")
    fastest: float = Field(1.1, ge=1.0, le=2.0, description="tempo")
    amplitude: float = Field(0.35, ge=0.0, le=1.0, description="least share of it")
    stride: float = Field(0.35, ge=0.0, le=1.0, description="least share of it")
    base: float = Field(0.10, gt=0.0, description="offset of the pelvis [m]")
    lean: float = Field(0.25, gt=0.0, description="offset of its roll and pitch [rad]")
    upper: float = Field(0.6, gt=0.0, description="offset of a joint of waist and arms [rad]")
    feet: float = Field(0.10, gt=0.0, description="offset of a foot in the air [m]")


class AdaptOptions(_Options):
    """How a reference is changed until it is judged safe."""

    variables: tuple[Variable, ...] = Field(
        ("tempo", "amplitude", "stride", "base", "lean", "upper", "feet"),
        min_length=1,
        description="what may change",
    )
    safe: float = Field(0.9, gt=0.0, lt=1.0, description="T_safe: P(fall) is to be 1 - T_safe")
    margin: float = Field(
        1.5,
        ge=0.0,
        description="kept below that, in the fall logit: an optimiser finds where the judge errs",
    )
    scales: AdaptScales = AdaptScales()
    bounds: AdaptBounds = AdaptBounds()
    knot_spacing: float = Field(0.2, ge=0.1, le=1.0, description="of the offsets' knots [s]")
    most_knots: int = Field(
        10, ge=3, description="spaces between knots at most: longer motions have wider ones"
    )
    smoothing: float = Field(2.0, gt=0.0, description="over which posture is smoothed [s]")
    path_smoothing: float = Field(0.4, gt=0.0, description="likewise the way over the floor [s]")
    knee_min: float = Field(0.2, ge=0.0, description="least knee angle [rad]")
    speed_share: float = Field(1.0, gt=0.0, le=1.0, description="of the joints' speed limits")
    torque_share: float = Field(1.0, gt=0.0, description="of the joints' torque limits")
    horizon: float | None = Field(
        None, gt=0.0, description="of the motion to look at; None: all of it [s]"
    )
    starts: tuple[Beginning, ...] = Field(
        ("command", "both"), min_length=1, description="where to start from, for each reference"
    )
    iterations: int = Field(12, ge=1, le=500, description="judged steps at most")
    tolerance: float = Field(0.01, gt=0.0, description="share of the cost that a step must save")
    hurry: bool = Field(
        False,
        description="stop as soon as one motion is safe by half the margin, be it the least change"
        " or not",
    )
    penalty: float = Field(30.0, gt=0.0, description="of a violated constraint, at first")
    radius: float = Field(1.0, gt=0.0, description="first trust region, in the scales above")
    qp_solver: Literal["daqp", "osqp", "piqp", "proxqp", "quadprog"] = Field(
        "daqp", description="solves the steps"
    )

    @model_validator(mode="after")
    def _no_twice(self) -> Self:
        if len(set(self.variables)) < len(self.variables):
            raise ValueError(f"variables {list(self.variables)} names one twice: leave one out")
        return self
