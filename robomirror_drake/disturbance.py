"""What the controller does not know: pushes, a wrong model, noise, slow actuators.

These options say within which bounds things are disturbed, and all is zero by default.
:mod:`robomirror_drake.disturbance_draw` draws from them.
"""

from __future__ import annotations

from typing import Annotated, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

T = TypeVar("T", bound=float)
Finite = Annotated[float, Field(allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


def _both_ends(value: object) -> object:
    return (value, value) if isinstance(value, int | float) else value


def _ordered(value: tuple[T, T]) -> tuple[T, T]:
    if value[0] > value[1]:
        raise ValueError("the lower end of a range comes first")
    return value


Range = Annotated[tuple[T, T], BeforeValidator(_both_ends), AfterValidator(_ordered)]
"""Two ends, between which the seed draws; or one number, which is both."""

Friction = Annotated[float, Field(gt=0.0, le=3.0)]
MassError = Annotated[float, Field(ge=-0.5, le=1.0)]
Strength = Annotated[float, Field(gt=0.0, le=2.0)]
Delay = Annotated[float, Field(ge=0.0, le=0.1)]
Lag = Annotated[float, Field(ge=0.0, le=0.5)]


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Push(_Options):
    """A constant force for a while; give one of ``force``, ``impulse`` and ``speed``."""

    time: float = Field(ge=0.0, allow_inf_nan=False, description="when it begins [s]")
    duration: float = Field(0.1, gt=0.0, le=10.0, description="[s]")
    force: Vector | None = Field(None, description="in world [N]")
    impulse: Vector | None = Field(None, description="force x duration, in world [N·s]")
    speed: Vector | None = Field(None, description="impulse / mass of the robot, in world [m/s]")
    body: str = Field("", description="link that is pushed; empty for the base")
    point: Vector = Field((0.0, 0.0, 0.0), description="of attack, in the link's frame [m]")

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        given = [name for name in ("force", "impulse", "speed") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of force, impulse and speed, not {given or 'none'}")
        return self


class RandomPushes(_Options):
    """Horizontal pushes on the base in directions and at times of the seed's choice."""

    interval: float = Field(2.0, gt=0.0, description="there is one push in each of these [s]")
    duration: float = Field(0.1, gt=0.0, description="of each [s]")
    speed: Range[NonNegative] = Field((0.0, 0.0), description="impulse / mass of the robot [m/s]")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.duration > self.interval:
            raise ValueError(f"{self.duration} s long, but one every {self.interval} s")
        return self


class SensorNoise(_Options):
    """Standard deviations of white noise on what the controller sees, drawn at its ticks."""

    joint_position: NonNegative = Field(0.0, description="[rad]")
    joint_velocity: NonNegative = Field(0.0, description="[rad/s]")
    orientation: NonNegative = Field(0.0, description="of the base, about each axis [rad]")
    angular_velocity: NonNegative = Field(0.0, description="of the base, each axis [rad/s]")


class StartErrors(_Options):
    """Standard deviations of how the robot's first state differs from the reference's."""

    joint_position: NonNegative = Field(0.0, description="[rad]")
    joint_velocity: NonNegative = Field(0.0, description="[rad/s]")
    linear_velocity: NonNegative = Field(0.0, description="of the base, along x and y [m/s]")
    angular_velocity: NonNegative = Field(0.0, description="of the base, each axis [rad/s]")


class ActuatorErrors(_Options):
    """What lies between a command and the joints."""

    latency: Range[Delay] = Field((0.0, 0.0), description="rounded to steps of the plant [s]")
    lag: Range[Lag] = Field((0.0, 0.0), description="time constant of first order [s]")
    strength: Range[Strength] = Field((1.0, 1.0), description="share of the torque limits")


class DisturbanceOptions(_Options):
    """What is disturbed and how much; a range is drawn from by the seed of the run."""

    pushes: tuple[Push, ...] = Field((), description="at given times")
    random_pushes: RandomPushes = Field(RandomPushes(), description="none at speed 0")
    friction: Range[Friction] | None = Field(
        None, description="between soles and ground, instead of theirs"
    )
    mass: Range[MassError] = Field((0.0, 0.0), description="relative error, the same of all links")
    center_of_mass: float = Field(
        0.0, ge=0.0, le=0.1, description="largest shift of a link's, along each axis [m]"
    )
    start: StartErrors = StartErrors()
    sensors: SensorNoise = SensorNoise()
    actuators: ActuatorErrors = ActuatorErrors()
