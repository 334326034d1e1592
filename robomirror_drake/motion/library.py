"""The actions that the generator knows: how each moves, and the words for it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.motion.composer import dynamic, expressive, gait
from robomirror_drake.motion.composer.cue import Cue
from robomirror_drake.motion.composer.score import Score

Group = Literal["locomotion", "dynamic", "expressive"]
Side = Literal["left", "right", "both"]
ActionFunction = Callable[[Score, Cue], None]

_PARAMETRIC: dict[str, ActionFunction] = {
    function.__name__: function
    for function in (
        gait.walk_forward, gait.walk_backward, gait.walk_sideways, gait.turn, gait.march,
        dynamic.jump, dynamic.front_kick, dynamic.punch, dynamic.lunge, dynamic.squat,
        dynamic.deep_squat, dynamic.stand_on_one_leg,
        expressive.wave, expressive.bow, expressive.raise_arms, expressive.clap,
        expressive.point, expressive.sway, expressive.stand,
    )
}  # fmt: skip


class Action(BaseModel):
    """One action of the library."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    group: Group
    description: str = Field(description="What it is, after 'a person'.")
    side: Side = Field(description="Which side does it when the words leave it open.")
    arms: bool = Field(False, description="Only the arms move, so it can go along with another.")
    both_arms: bool = Field(False, description="Holds both arms, whichever side it is done with.")
    clip: tuple[str, ...] = Field((), description="Recorded motions it is played from.")
    words: tuple[str, ...] = Field(min_length=1, description="Regular expressions of its words.")
    paraphrases: tuple[str, ...] = Field(min_length=8, description="Sentences that mean it.")

    @property
    def sided(self) -> bool:
        """Whether it is done with one side rather than with both."""
        return self.side != "both"

    def perform(self, score: Score, cue: Cue) -> None:
        """Write the action into a score."""
        _PARAMETRIC[self.name](score, cue)

    def evidence(self, text: str) -> int:
        """Length of the longest stretch of ``text`` that one of its words matches."""
        return max((len(m[0]) for p in _patterns(self.words) for m in p.finditer(text)), default=0)


@cache
def _patterns(words: tuple[str, ...]) -> tuple[re.Pattern[str], ...]:
    return tuple(re.compile(rf"\b(?:{word})(?!\w)") for word in words)


@cache
def library() -> dict[str, Action]:
    """Every known action by name, in the order of ``assets/actions.yaml``."""
    text = files("robomirror_drake.assets").joinpath("actions.yaml").read_text(encoding="utf-8")
    actions = {name: Action(name=name, **entry) for name, entry in yaml.safe_load(text).items()}
    lost = [name for name, action in actions.items() if not (name in _PARAMETRIC or action.clip)]
    if lost:
        raise ValueError(f"actions.yaml: no function and no clip for {', '.join(lost)}")
    return actions
