"""The actions that the generator knows: how each moves, and the words for it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.motion.composer import dance, flight, gait, paths
from robomirror_drake.motion.composer.cue import Cue, hands
from robomirror_drake.motion.composer.keyed import keyed_actions
from robomirror_drake.motion.composer.keyed_play import play_keyed
from robomirror_drake.motion.composer.score import Score
from robomirror_drake.motion.language.patterns import pattern

Group = Literal["locomotion", "dynamic", "expressive"]
Side = Literal["left", "right", "both"]
ActionFunction = Callable[[Score, Cue], None]

_WRITTEN: dict[str, ActionFunction] = {
    function.__name__: function
    for function in (
        gait.walk, gait.walk_backward, gait.side_step, gait.turn, gait.march, gait.jog_in_place,
        gait.jog, gait.sneak, gait.stride, gait.step_over, gait.climb_step, gait.limp,
        gait.stagger, gait.cross_step,
        paths.circle, paths.figure_eight, paths.zigzag, paths.pace,
        flight.run, flight.skip, flight.jump, flight.hop, flight.leap, flight.jumping_jack,
        dance.waltz, dance.salsa,
    )
}  # fmt: skip


_SUBJECTS = ("a person", "someone", "the man", "a person", "she", "a figure", "a person", "he")


class Action(BaseModel):
    """One action of the library."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    group: Group
    description: str = Field(description="What it is, after 'a person'.")
    side: Side = Field(description="Which side does it when the words leave it open.")
    clip: tuple[str, ...] = Field((), description="Recordings to play; '' is the written one.")
    words: tuple[str, ...] = Field(min_length=1, description="Regular expressions of its words.")
    phrases: tuple[str, ...] = Field(min_length=15, description="What may follow 'a person'.")

    @property
    def paraphrases(self) -> tuple[str, ...]:
        """Sentences that mean it, of several people."""
        return tuple(
            f"{_SUBJECTS[i % len(_SUBJECTS)]} {phrase}" for i, phrase in enumerate(self.phrases)
        )

    @property
    def sided(self) -> bool:
        """Whether it is done with one side rather than with both."""
        return self.side != "both"

    @property
    def arms(self) -> bool:
        """Whether only arms, chest and head move, so that it can go along with another."""
        keyed = keyed_actions().get(self.name)
        return keyed is not None and not self.clip and keyed.goes_along

    def arms_held(self, cue: Cue) -> set[str]:
        """The arms that it holds, of an action that can go along with another."""
        held = keyed_actions()[self.name].arms if self.arms else "none"
        return {"none": set[str](), "one": set(hands(cue)), "both": {"left", "right"}}[held]

    def perform(self, score: Score, cue: Cue) -> None:
        """Write the action into a score."""
        if self.name in _WRITTEN:
            _WRITTEN[self.name](score, cue)
        else:
            play_keyed(score, cue, keyed_actions()[self.name])

    def match(self, text: str) -> str:
        """The longest stretch of ``text`` that one of its words matches; empty if none does."""
        found = (m[0] for p in _patterns(self.words) for m in p.finditer(text))
        return max(found, key=len, default="")


@cache
def _patterns(words: tuple[str, ...]) -> tuple[re.Pattern[str], ...]:
    return tuple(pattern(word) for word in words)


@cache
def library() -> dict[str, Action]:
    """Every known action by name, in the order of ``assets/actions.yaml``."""
    text = files("robomirror_drake.assets").joinpath("actions.yaml").read_text(encoding="utf-8")
    actions = {name: Action(name=name, **entry) for name, entry in yaml.safe_load(text).items()}
    moving = _WRITTEN.keys() | keyed_actions().keys()
    lost = [n for n, a in actions.items() if n not in moving and not (a.clip and all(a.clip))]
    if lost:
        raise ValueError(f"actions.yaml: nothing says how to move for {', '.join(lost)}")
    return actions
