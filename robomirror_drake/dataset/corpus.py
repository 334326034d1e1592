"""A corpus of commands: balanced, understood, and split by what is meant."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files

import numpy as np
import yaml

from robomirror_drake.dataset.grammar import (
    Meaning,
    Phrases,
    Proposal,
    grammar,
    key,
    matches,
    phrases,
    propose,
    understood,
)
from robomirror_drake.dataset.prompts import Prompt, Split
from robomirror_drake.motion.library import library

TRIES = 40
"""Proposals for one command before another action has its turn."""

SHARES: tuple[tuple[Split, float], ...] = (("train", 0.8), ("validation", 0.1), ("test", 0.1))
"""Of what is not held out."""


@dataclass
class Corpus:
    """Commands, and how they came about.

    Attributes:
        prompts: The commands, in random order.
        refused: Proposals that were not understood as what they mean, by first action.
        proposed: Proposals in all.
        lost: Commands written by hand that are not understood as their actions.
    """

    prompts: tuple[Prompt, ...] = ()
    refused: Counter[str] = field(default_factory=Counter)
    proposed: int = 0
    lost: list[str] = field(default_factory=list)


def make_corpus(
    count: int,
    seed: int = 0,
    report: Callable[[int], None] | None = None,
    actions: tuple[str, ...] = (),
) -> Corpus:
    """Proposes commands until there are enough that are understood as what they mean.

    Groups have equal shares of them, and within a group so have its actions. Commands that
    mean the same are in the same split, whatever their words.

    Args:
        count: How many.
        seed: Of all choices.
        report: Called with how many there are.
        actions: Of the grammar's commands; empty for all of the library.
    """
    corpus, found = Corpus(), dict[str, Prompt]()
    for prompt in _hand_written(corpus):
        found[prompt.text] = prompt
    rng, known = np.random.default_rng(seed), phrases(actions)
    groups: dict[str, list[str]] = {}
    for name in known:
        groups.setdefault(library()[name].group, []).append(name)
    turn = 0
    while len(found) < count:
        among = list(groups.values())[turn % len(groups)]
        _add(corpus, found, among[turn // len(groups) % len(among)], known, rng)
        turn += 1
        if report is not None:
            report(len(found))
    prompts = list(found.values())
    corpus.prompts = tuple(prompts[i] for i in rng.permutation(len(prompts)))
    return corpus


def _add(
    corpus: Corpus, found: dict[str, Prompt], action: str, known: Phrases, rng: np.random.Generator
) -> None:
    """One more command that begins with an action, if one is found."""
    for _ in range(TRIES):
        made = propose(action, known, rng)
        if made.text in found:
            continue
        corpus.proposed += 1
        if matches(understood(made.text), made.meaning):
            found[made.text] = _prompt(made, "grammar")
            return
        corpus.refused[action] += 1


def _prompt(made: Proposal, origin: str) -> Prompt:
    actions = tuple(clause.action for clause in made.meaning)
    family = next((name for name in map(grammar().family, actions) if name), "")
    return Prompt(
        text=made.text,
        split="held_out" if family else _split(made.meaning),
        group=library()[actions[0]].group,
        family=family,
        actions=actions,
        origin=origin,
    )


def _split(meaning: tuple[Meaning, ...]) -> Split:
    """By a hash of what is meant, so that it does not depend on the other commands."""
    digest = hashlib.sha256(key(meaning).encode()).digest()
    place, upper = int.from_bytes(digest[:4], "little") / 2**32, 0.0
    for split, share in SHARES:
        upper += share
        if place < upper:
            return split
    return SHARES[-1][0]


def _hand_written(corpus: Corpus) -> list[Prompt]:
    """Those that are understood as their actions."""
    file = files("robomirror_drake.assets").joinpath("prompts/hand_written.yaml")
    prompts = []
    for text, actions in yaml.safe_load(file.read_text(encoding="utf-8")):
        meaning = understood(text)
        if meaning is None or [clause.action for clause in meaning] != actions.split():
            corpus.lost.append(text)
        else:
            prompts.append(_prompt(Proposal(text, meaning), "hand"))
    return prompts
