"""Sentences for a corpus: commands in many words, of which the composer is sure what they mean."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from robomirror_drake.exceptions import InputError
from robomirror_drake.motion.library import Action, library
from robomirror_drake.motion.text import Clause, parse

_SUBJECT = re.compile(r"^(?:a person|someone|somebody|the man|the woman|a man|a woman|she|he"
                      r"|a figure|the person|a runner)\s+")  # fmt: skip
_PLAIN_SHARE = 0.35  # of clauses that say nothing but the action
_TRIES = 12  # to say a command in other words
_FAST_SLOW = ("slowly", "quickly", "very slowly", "carefully", "swiftly", "in a hurry")
_SIZES = ("a little", "widely", "slightly")
_COUNTS = ("twice", "three times", "four times", "two times")


@dataclass(frozen=True)
class Command:
    """A command: its clauses as understood, and some ways to say it.

    Attributes:
        clauses: What the composer understands; the first caption's own words are in it.
        captions: One sentence or more, each understood alike.
    """

    clauses: tuple[Clause, ...]
    captions: tuple[str, ...]

    @property
    def meaning(self) -> tuple[Clause, ...]:
        """What is asked for: equal where two commands ask for the same."""
        return _key(self.clauses)


def draw_command(rng: np.random.Generator, captions: int) -> Command | None:
    """A command drawn at random, in up to so many wordings; None where the draw makes no sense.

    A single action (with or without side, number, manner), two or three in a row, or one with a
    gesture of the arms along with it. A sentence counts only if the composer understands the
    action that it was made for.
    """
    actions = list(library().values())
    shape = rng.choice(["one", "two", "three", "while"], p=[0.62, 0.22, 0.04, 0.12])
    number = {"one": 1, "two": 2, "three": 3, "while": 2}[str(shape)]
    chosen = [actions[i] for i in rng.choice(len(actions), number, replace=False)]
    if shape == "while":
        gestures = [a for a in actions if a.arms and a is not chosen[0]]
        chosen[1] = gestures[rng.integers(len(gestures))]
    manners = [_manner(action, rng) for action in chosen]
    said: list[str] = []
    meaning: tuple[Clause, ...] | None = None
    for _ in range(_TRIES):
        sentence = _sentence(chosen, manners, " while " if shape == "while" else None, rng)
        clauses = _understood(sentence, chosen)
        if clauses is None or sentence in said:
            continue
        if meaning is None:
            meaning = clauses
        if _key(clauses) == _key(meaning):
            said.append(sentence)
        if len(said) == captions:
            break
    return Command(meaning, tuple(said)) if meaning else None


def _key(clauses: tuple[Clause, ...]) -> tuple[Clause, ...]:
    """What is meant, whatever the words and however sure."""
    return tuple(replace(clause, text="", score=1.0) for clause in clauses)


def _understood(sentence: str, chosen: list[Action]) -> tuple[Clause, ...] | None:
    try:
        clauses = parse(sentence)
    except InputError:
        return None
    return clauses if [c.action for c in clauses] == [a.name for a in chosen] else None


def _sentence(
    actions: list[Action], manners: list[str], along: str | None, rng: np.random.Generator
) -> str:
    parts = []
    for i, (action, manner) in enumerate(zip(actions, manners, strict=True)):
        words = action.paraphrases
        if len(actions) > 1:  # "jumping up and down" stands well alone only
            words = tuple(w for w in words if _SUBJECT.match(w)) or words
        phrase = str(words[rng.integers(len(words))])
        if i:
            phrase = _SUBJECT.sub("she " if along else "", phrase)
        parts.append(f"{phrase} {manner}".strip())
    joint = along or str(rng.choice([" and then ", ", then ", " then "]))
    return joint.join(parts)


def _manner(action: Action, rng: np.random.Generator) -> str:
    """Side, number and manner as words; mostly few of them."""
    if rng.random() < _PLAIN_SHARE:
        return ""
    words = []
    if action.sided and rng.random() < 0.6:
        side = rng.choice(["left", "right"])
        limb = "hand" if action.arms or "punch" in action.name else "leg"
        words.append(
            f"to the {side}" if action.group == "locomotion" else f"with the {side} {limb}"
        )
    if rng.random() < 0.35:
        words.append(str(rng.choice(_COUNTS)))
    if rng.random() < 0.4:
        words.append(str(rng.choice(_FAST_SLOW if rng.random() < 0.75 else _SIZES)))
    return " ".join(words)
