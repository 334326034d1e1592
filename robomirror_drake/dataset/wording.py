"""The few forms of English words that commands are put together from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

_SUBJECT = re.compile(r"^(?:a person|someone|the man|she|he|a figure) (?=\w)")
_PROGRESSIVE = re.compile(r"^is (\w+ing)\b")
_ADVERB = re.compile(r"^(?:very )?\w{3,}ly ")


def finite_phrases(sentences: Iterable[str]) -> Iterator[str]:
    """What follows the subject of each sentence, once: "walks forward"; "(…)" is left out."""
    seen = set()
    for sentence in sentences:
        phrase = re.sub(r" *\(.*?\)", "", _SUBJECT.sub("", sentence)).strip()
        if re.match(r"\w+s\b", phrase) and phrase not in seen:
            seen.add(phrase)
            yield phrase


def gerund_phrase(phrase: str) -> str:
    """A phrase to stand after "while": "slowly waves" gives "slowly waving"."""
    if progressive := _PROGRESSIVE.match(phrase):
        return phrase[progressive.start(1) :]
    adverb = _ADVERB.match(phrase)
    front = adverb[0] if adverb else ""
    verb, *rest = phrase[len(front) :].split(" ")
    return front + " ".join([gerund(verb), *rest])


def gerund(verb: str) -> str:
    """The -ing form of a verb in the third person: "claps" gives "clapping"."""
    stem = _stem(verb)
    if stem.endswith("ie"):
        return f"{stem[:-2]}ying"
    if stem.endswith("e") and not stem.endswith(("ee", "oe", "ye")):
        return f"{stem[:-1]}ing"
    # A short vowel between consonants, in a word of one syllable, doubles the last one.
    if re.fullmatch(r"[^aeiou]*[aeiou][^aeiouwxy]", stem):
        return f"{stem}{stem[-1]}ing"
    return f"{stem}ing"


def _stem(verb: str) -> str:
    """The infinitive of a verb in the third person."""
    if verb.endswith("ies") and len(verb) > 4:
        return f"{verb[:-3]}y"
    if verb.endswith(("sses", "shes", "ches", "xes", "zzes", "oes")):
        return verb[:-2]
    return verb.removesuffix("s")
