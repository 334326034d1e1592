"""Which action the words of one clause mean: its words and its meaning weighed together."""

from __future__ import annotations

import re
from functools import lru_cache

from robomirror_drake.exceptions import UnknownCommandError
from robomirror_drake.motion.language import encoder, quantities
from robomirror_drake.motion.language.classifier import UNKNOWN, meaning
from robomirror_drake.motion.language.fragments import SUBJECT
from robomirror_drake.motion.language.unknown import foreign
from robomirror_drake.motion.library import library

THRESHOLD = 0.45
"""Least score of an action for a clause to be understood."""
WORD_BONUS = 0.35
"""What words of the action add to its probability."""
LENGTH_BONUS = 0.03
"""What each letter of the words adds, up to :data:`LONGEST`."""
LONGEST = 30
VETO = 0.75
"""Probability of no action from which short words count for nothing."""
FIRM = 12
"""Letters from which words count whatever the meaning seems to be."""
# Directions and the like belong to many actions: they begin no clause by themselves.
_WEAK = re.compile(
    r"^(?:forwards?|backwards?|rearwards?|sideways?|lateral(?:ly)?|steps?|stairs?|idle|"
    r"diagonal(?:ly)?|circles?|upstairs|(?:front|back) ?side|wings?|chicken|hello|hands? up|"
    r"hooks?|one knee|unsteadily|thoughtful(?:ly)?|kiss(?:es)?|baton|golf|tennis|defensive(?:ly)?|"
    r"loops?|yoga|steps? (?:to the )?(?:left|right)|arms? (?:\w+ )?up|bat|swords?|"
    r"in an? (?:\w+ )?circles?|(?:on|onto) (?:one|a|his|her|their|the)(?: left| right)? knees?)$"
)


_PURPOSE = re.compile(
    r" (?:to|in order to|and) (?P<what>(?!the\b|his\b|her\b|their\b|its\b|a\b|\w+ side)\w+\b.*)$"
)
# What is done for the sake of something else: "raises a hand to wave".
_MEANS = frozenset({"raise_arms", "bow", "side_bend", "stretch", "open_arms", "squat"})


@lru_cache(maxsize=4096)
def matches(text: str) -> dict[str, str]:
    """The longest stretch of a text that words of each action match, of those that do."""
    found = {name: action.match(text) for name, action in library().items()}
    return {name: stretch for name, stretch in found.items() if stretch}


def evident(text: str) -> bool:
    """Whether words of an action stand in a text that can begin a clause."""
    return any(not _WEAK.match(stretch) for stretch in matches(text).values())


def travels(text: str) -> bool:
    """Whether the longest words of an action in a text are of locomotion."""
    found = matches(text)
    longest = max(found, key=lambda name: len(found[name]), default=None)
    return longest is not None and library()[longest].group == "locomotion"


@lru_cache(maxsize=4096)
def ranking(text: str) -> dict[str, float]:
    """How well each action fits a clause, best first: probability of meaning plus its words."""
    bare = SUBJECT.sub("", f"{text} ").strip()
    bare = quantities.without_quantities(bare) or bare
    probability = meaning(f"a person {bare}")
    alien = foreign(text)
    doubt = probability[UNKNOWN]
    total = {}
    for name in library():
        stretch = matches(text).get(name, "")
        found = 0 if alien and _WEAK.match(stretch) else len(stretch)
        counts = found and (found > len(alien) if alien else doubt <= VETO or found >= FIRM)
        bonus = WORD_BONUS + LENGTH_BONUS * min(found, LONGEST) if counts else 0.0
        total[name] = (0.0 if alien and not counts else probability[name]) + bonus
    return dict(sorted(total.items(), key=lambda item: -item[1]))


def recognise(text: str) -> tuple[str, float]:
    """The action that a clause means, and how sure that is, from 0 to 1.

    Raises:
        UnknownCommandError: No action is likely enough; it names the nearest.
    """
    fits = ranking(text)
    best = next(iter(fits))
    purpose = _PURPOSE.search(text)
    if purpose and best in _MEANS and evident(purpose["what"]):
        return recognise(purpose["what"])
    if fits[best] < THRESHOLD:
        raise UnknownCommandError(text, list(fits)[:3])
    return best, min(fits[best], 1.0)


def forget() -> None:
    """Forgets every clause read so far, so that the time of reading can be measured anew."""
    for cached in (matches, ranking, meaning):
        cached.cache_clear()
    encoder.forget()
