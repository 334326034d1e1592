"""Actions told by key poses: gestures, strikes, kicks, bends, in ``assets/gestures.yaml``.

Between keys every channel moves in minimum-jerk time (T. Flash, N. Hogan, J. Neuroscience 5(7),
1985); channels may overlap, so that a strike unrolls from hip to hand.
"""

from __future__ import annotations

from functools import cache, cached_property
from importlib.resources import files
from typing import Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.motion.composer.arm import arm_angles
from robomirror_drake.motion.composer.score import NEUTRAL

ARM_ANGLES = ("flexion", "abduction", "rotation", "elbow")

BodyChannel = Literal[
    "pelvis_z", "pelvis_yaw", "pelvis_pitch", "pelvis_roll", "chest_yaw", "chest_pitch",
    "chest_roll", "head_yaw", "head_pitch", "head_roll", "load",
]  # fmt: skip
SIDED: frozenset[str] = frozenset(
    {"pelvis_yaw", "pelvis_roll", "chest_yaw", "chest_roll", "head_yaw", "head_roll", "load"}
)
"""Channels that change sign from one side to the other."""
_PELVIS_ANGLES = ("pelvis_yaw", "pelvis_pitch", "pelvis_roll")


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ArmPose(_Model):
    """An arm: by the place of its wrist, or by angles; what is not said is neutral."""

    hand: tuple[float, float, float] | None = Field(
        None, description="Wrist from the shoulder, chest's frame: ahead, outward, up [m]."
    )
    swivel: float = Field(20.0, description="Elbow: 0 below the wrist's line, 90 outward [deg].")
    flexion: float = Field(0.0, description="[deg]")
    abduction: float = Field(float(np.rad2deg(NEUTRAL["left_abduction"])), description="[deg]")
    rotation: float = Field(0.0, description="Outward [deg].")
    elbow: float = Field(float(np.rad2deg(NEUTRAL["left_elbow"])), description="[deg]")

    @cached_property
    def angles(self) -> dict[str, float]:
        """Over neutral [rad], by name."""
        if self.hand is not None:
            values = arm_angles(self.hand, np.deg2rad(self.swivel))
        else:
            values = tuple(np.deg2rad([getattr(self, name) for name in ARM_ANGLES]))
        return {
            name: float(value) - NEUTRAL.get(f"left_{name}", 0.0)
            for name, value in zip(ARM_ANGLES, values, strict=True)
        }


class FootPose(_Model):
    """The foot of the acting side from where it stood."""

    x: float = Field(0.0, description="Ahead, along the foot [m].")
    y: float = Field(0.0, description="Outward [m].")
    z: float = Field(0.0, ge=0.0, description="Up [m].")
    heel: float = Field(0.0, description="Heel over toe [deg].")
    yaw: float = Field(0.0, description="Outward [deg].")


class Key(_Model):
    """What is reached between two times; the rest stays as it is."""

    at: tuple[float, float] = Field(description="Begin and end [s].")
    arm: ArmPose | None = Field(None, description="The acting arm.")
    other: ArmPose | None = Field(None, description="The other arm.")
    both: ArmPose | None = Field(None, description="Either arm.")
    foot: FootPose | None = Field(None, description="The acting foot.")
    body: dict[BodyChannel, float] = Field(
        default_factory=dict,
        description="Angles [deg], pelvis_z [m], load: share of the weight moved to the acting"
        " foot, -0.5 to 0.5. Signs are those of the left side.",
    )


class Stance(_Model):
    """A step before the action, taken back after it."""

    foot: Literal["acting", "other"] = "other"
    x: float = Field(0.0, description="Ahead [m].")
    y: float = Field(0.0, description="Outward [m].")
    yaw: float = Field(0.0, description="Outward [deg].")


class Keyed(_Model):
    """An action: a way there, a beat that repeats, a pause, and the way back to neutral."""

    keys: tuple[Key, ...] = Field((), description="The way there.")
    beat: tuple[Key, ...] = Field((), description="What is repeated; counts count it.")
    repeats: int = Field(1, ge=1, description="Beats where the words say nothing.")
    alternate: bool = Field(False, description="Each beat is done with the other side.")
    hold: float = Field(0.0, ge=0.0, description="Pause before the way back [s].")
    fall: float = Field(1.0, gt=0.0, description="Time of the way back [s].")
    scaled: bool = Field(False, description="The way there grows with amplitude, not only the beat")
    most: float = Field(1.6, ge=1.0, description="Largest amplitude.")
    mirrored: bool = Field(False, description="The side that is named rests, the other acts.")
    stance: Stance | None = None

    @property
    def arms(self) -> Literal["none", "one", "both"]:
        """Which arms it holds when one side is named."""
        keys = (*self.keys, *self.beat)
        if any(key.both or key.other for key in keys) or (self.alternate and self._acts):
            return "both"
        return "one" if self._acts else "none"

    @property
    def _acts(self) -> bool:
        return any(key.arm for key in (*self.keys, *self.beat))

    @property
    def goes_along(self) -> bool:
        """Whether legs and weight can stay out of it, so that another action can carry it."""
        keys = (*self.keys, *self.beat)
        moves = any(key.arm or key.other or key.both or key.body for key in keys)
        return moves and not self.stance and not any(_needs_legs(key) for key in keys)


def _needs_legs(key: Key) -> bool:
    lean = max((abs(a) for name, a in key.body.items() if name in _PELVIS_ANGLES), default=0.0)
    sunk = abs(key.body.get("pelvis_z", 0.0))
    return bool(key.foot) or "load" in key.body or sunk > 0.1 or lean > 6.0


@cache
def keyed_actions() -> dict[str, Keyed]:
    """The actions of ``assets/gestures.yaml`` by name."""
    text = files("robomirror_drake.assets").joinpath("gestures.yaml").read_text(encoding="utf-8")
    return {name: Keyed(**entry) for name, entry in yaml.safe_load(text).items()}
