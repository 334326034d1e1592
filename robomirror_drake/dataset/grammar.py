"""Commands proposed at random, each with what it means."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict

from robomirror_drake.dataset.wording import finite_phrases, gerund_phrase
from robomirror_drake.exceptions import InputError
from robomirror_drake.motion.library import library
from robomirror_drake.motion.text import parse

T = TypeVar("T")
Direction = Literal["less", "more"]
Value = int | float | str | None

MANY = (0.3, 0.42, 0.22, 0.06)
"""How often a clause has 0, 1, 2, 3 modifiers."""

SHAPES = {"single": 0.5, "sequence": 0.27, "long": 0.08, "together": 0.15}
"""How often a command is one action, two or three in a row, or one that goes along."""


class Grammar(BaseModel):
    """The contents of ``assets/prompts/grammar.yaml``, which says what they are."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    subjects: tuple[str, ...]
    joins: tuple[str, ...]
    last: tuple[str, ...]
    front: tuple[str, ...]
    modifiers: dict[str, dict[str, Value]]
    fields: dict[str, str]
    extents: tuple[str, ...]
    slots: dict[str, tuple[str, ...]]
    held_out: dict[str, tuple[str, ...]]

    def family(self, action: str) -> str:
        """The held-out family of an action; empty for one that is learned."""
        return next((name for name, members in self.held_out.items() if action in members), "")


@dataclass(frozen=True)
class Meaning:
    """What a clause asks for; see :class:`~robomirror_drake.motion.text.Clause`.

    Tempo and amplitude are ``less`` or ``more`` than usual, None where they are left open.
    """

    action: str
    side: str | None = None
    count: int | None = None
    speed: float | None = None
    tempo: Direction | None = None
    amplitude: Direction | None = None
    angle: float | None = None
    distance: float | None = None
    accompanies: bool = False


class Proposal(NamedTuple):
    """A command and what it means."""

    text: str
    meaning: tuple[Meaning, ...]


class Worded(NamedTuple):
    """A clause without its subject: "slowly walks forward", and what it means."""

    words: str
    meaning: Meaning


Phrases = Mapping[str, tuple[Worded, ...]]
"""Wordings without modifiers that are understood as their action, by action."""


@cache
def grammar() -> Grammar:
    """The grammar of the package."""
    file = files("robomirror_drake.assets").joinpath("prompts/grammar.yaml")
    return Grammar.model_validate(yaml.safe_load(file.read_text(encoding="utf-8")))


def understood(text: str) -> tuple[Meaning, ...] | None:
    """What a command is understood as, None where it is not."""
    try:
        clauses = parse(text)
    except InputError:
        return None
    return tuple(
        Meaning(
            c.action, c.side, c.count, c.speed, _direction(c.tempo), _direction(c.amplitude),
            c.angle, c.distance, c.accompanies,
        )
        for c in clauses
    )  # fmt: skip


def matches(heard: tuple[Meaning, ...] | None, meant: tuple[Meaning, ...]) -> bool:
    """Whether a command is understood as what is meant; what is left open may be anything."""
    if heard is None or len(heard) != len(meant):
        return False
    return all(
        key((replace(a, tempo=b.tempo and a.tempo, amplitude=b.amplitude and a.amplitude),))
        == key((b,))
        for a, b in zip(heard, meant, strict=True)
    )


def key(meaning: tuple[Meaning, ...]) -> str:
    """The same text for the same meaning; numbers up to rounding."""
    rounded = [
        [round(value, 3) if isinstance(value, float) else value for value in astuple(clause)]
        for clause in meaning
    ]
    return json.dumps(rounded)


def _direction(factor: float) -> Direction | None:
    return None if abs(factor - 1.0) < 0.01 else "less" if factor < 1.0 else "more"


@cache
def phrases(actions: tuple[str, ...] = ()) -> Phrases:
    """All wordings of actions that are understood as what they word.

    Args:
        actions: Which; empty for all of the library.
    """
    found: dict[str, list[Worded]] = {}
    for name in actions or library():
        action = library()[name]
        for words in finite_phrases((action.description, *action.paraphrases)):
            meant = understood(f"a person {words}")
            if meant is not None and len(meant) == 1 and meant[0].action == name:
                found.setdefault(name, []).append(Worded(words, meant[0]))
    return {name: tuple(worded) for name, worded in found.items()}


def propose(action: str, known: Phrases, rng: np.random.Generator) -> Proposal:
    """A command whose first action is this one.

    Args:
        action: Its name.
        known: Wordings to choose from.
        rng: Of all choices.
    """
    said = grammar()
    shape = str(rng.choice(list(SHAPES), p=list(SHAPES.values())))
    others = [name for name in known if not said.family(name) and name != action]
    subject = _one(said.subjects, rng)
    first = _clause(action, known, rng)
    gestures = [name for name in others if library()[name].arms]
    if shape == "together" and gestures and not library()[action].arms:
        gesture = _clause(_one(gestures, rng), known, rng)
        along = replace(gesture.meaning, accompanies=True)
        words = f"{subject} {first.words} while {gerund_phrase(gesture.words)}"
        return Proposal(words, (first.meaning, along))
    count = {"sequence": 2, "long": 3}.get(shape, 1)
    clauses = [first, *(_clause(_one(others, rng), known, rng) for _ in range(count - 1))]
    text = f"{subject} {first.words}"
    for number, clause in enumerate(clauses[1:], start=2):
        joins = said.last if number == count == 3 else said.joins
        text += _one(joins, rng) + clause.words
    return Proposal(text, tuple(clause.meaning for clause in clauses))


def _clause(action: str, known: Phrases, rng: np.random.Generator) -> Worded:
    """One of an action's wordings with modifiers for what it leaves open."""
    said = grammar()
    chosen = _one(known[action], rng)
    words, meaning = chosen
    slots = said.slots.get(action, said.slots[library()[action].group])
    for kind in rng.permutation(list(slots))[: rng.choice(len(MANY), p=MANY)]:
        field = said.fields[kind]
        # A mood has a tempo of its own.
        manner = field in ("mood", "tempo") and re.search(r"ly\b|\blike\b", words)
        if manner or not _open(meaning, field, said.extents):
            continue
        modifier = _one(tuple(said.modifiers[kind]), rng)
        meaning = _with(meaning, field, said.modifiers[kind][modifier])
        plain = words == chosen.words and not words.startswith("is ")
        adverb = kind in said.front and modifier.endswith("ly")
        before = adverb and plain and rng.random() < 0.6
        words = f"{modifier} {words}" if before else f"{words} {modifier}"
    return Worded(words, meaning)


def _with(meaning: Meaning, field: str, value: Value) -> Meaning:
    if field == "mood":
        return meaning
    said: dict[str, Any] = {field: value}
    if field == "angle":
        said[field] = float(np.deg2rad(float(value or 0.0)))
    return replace(meaning, **said)


def _open(meaning: Meaning, field: str, extents: tuple[str, ...]) -> bool:
    """Whether a clause says nothing yet about a quantity."""
    fields = extents if field in extents else ("tempo",) if field == "mood" else (field,)
    return all(getattr(meaning, name) is None for name in fields)


def _one(values: Sequence[T], rng: np.random.Generator) -> T:
    return values[int(rng.integers(len(values)))]
