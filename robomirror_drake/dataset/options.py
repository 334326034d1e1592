"""Settings of a data set, and what they draw for each of its episodes.

Disturbances come on top of those that the scenario has for all executions. They range from
what the robot hardly notices to what brings it down, so that both are learned.
"""

from __future__ import annotations

import hashlib
import math
from typing import Literal, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.disturbance import DisturbanceOptions, NonNegative, Push, Range, StartErrors

Kind = Literal["nominal", "pushed", "start", "dynamics"]
"""What of an execution is disturbed."""

PUSH_DURATION = 0.1
"""[s]"""


def _dynamics() -> DisturbanceOptions:
    return DisturbanceOptions.model_validate(
        {
            "friction": [0.15, 1.0],
            "mass": [-0.2, 0.3],
            "center_of_mass": 0.03,
            "sensors": {"joint_position": 0.004, "joint_velocity": 0.1, "orientation": 0.02},
            "actuators": {"latency": [0.0, 0.02], "strength": [0.4, 1.0]},
        }
    )


def _start() -> DisturbanceOptions:
    errors = StartErrors(
        joint_position=0.03, joint_velocity=0.5, linear_velocity=0.4, angular_velocity=0.8
    )
    return DisturbanceOptions(start=errors)


class DatasetOptions(BaseModel):
    """What is executed, and how it is disturbed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(0, ge=0, le=2**32 - 1, description="of everything that is drawn")
    per_prompt: int = Field(10, ge=1, le=256, description="motions of each command")
    executions: int = Field(
        3, ge=1, le=100, description="of each motion: nominal, pushed, disturbed, pushed …"
    )
    group: int = Field(64, ge=1, le=10_000, description="commands in one file")
    longest: float = Field(
        60.0, gt=0.0, description="an execution is cut off there [s]; its plan is whole"
    )
    vigour: Range[NonNegative] = Field(
        (1.0, 1.0), description="of the generator, drawn for each command; see there"
    )
    slowest: float = Field(0.6, gt=0.1, le=1.0, description="of the generator, see there")
    push_speed: Range[NonNegative] = Field(
        (0.1, 1.2), description="impulse of a push / mass of the robot [m/s]"
    )
    start: DisturbanceOptions = Field(_start(), description="of executions that start off")
    dynamics: DisturbanceOptions = Field(_dynamics(), description="where the robot is another")


class Seeded(Protocol):
    """Options with a seed."""

    @property
    def seed(self) -> int:
        """Of everything that is drawn."""


def stream(options: Seeded, text: str, *which: int) -> np.random.Generator:
    """Random numbers for a command, or for a candidate and an execution of it.

    They depend on the seed, the command's text and these numbers, and on nothing else: not
    on where the command stands, nor on what else is executed or by whom.
    """
    key = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
    return np.random.default_rng([options.seed, key, *which])


def seed_of(rng: np.random.Generator) -> int:
    """A seed for what takes one number."""
    return int(rng.integers(2**31))


def draw_disturbance(
    options: DatasetOptions,
    turn: int,
    duration: float,
    rng: np.random.Generator,
    always: DisturbanceOptions | None = None,
) -> tuple[Kind, DisturbanceOptions]:
    """How an execution of a motion is disturbed.

    Args:
        options: Of the data set.
        turn: 0 is nominal, odd ones are pushed, the others disturbed in their start or in their
            dynamics.
        duration: Of the motion [s]; a push begins within it.
        rng: Of the execution.
        always: What all executions are disturbed by; nothing where None. Of it, a disturbed
            start or dynamics replace what they name, and a push is one more.
    """
    always = always or DisturbanceOptions()
    if turn == 0:
        return "nominal", always
    if turn % 2 == 1:
        direction, speed = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(*options.push_speed)
        push = Push(
            time=rng.uniform(0.0, duration),
            duration=PUSH_DURATION,
            speed=(speed * math.cos(direction), speed * math.sin(direction), 0.0),
        )
        return "pushed", always.model_copy(update={"pushes": (*always.pushes, push)})
    kind: Kind = "start" if rng.random() < 0.5 else "dynamics"
    own = options.start if kind == "start" else options.dynamics
    return kind, replaced(always, own)


def replaced(always: DisturbanceOptions, own: DisturbanceOptions) -> DisturbanceOptions:
    """What is always disturbed, with what ``own`` names in its place."""
    return always.model_copy(update={n: getattr(own, n) for n in own.model_fields_set})
