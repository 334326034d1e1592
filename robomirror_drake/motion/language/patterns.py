"""Regular expressions for words of English, with verbs in all their forms."""

from __future__ import annotations

import re

_VERB = re.compile(r"<(\w+)>")
_GAP = r" (?:[\w'-]+,? ){0,4}?"
_VOWELS = "aeiou"
_IRREGULAR: dict[str, str] = {
    "throw": "threw|thrown", "run": "ran", "kneel": "knelt", "bend": "bent", "stand": "stood",
    "leap": "leapt", "shake": "shook|shaken", "hold": "held", "catch": "caught", "take": "took",
    "strike": "struck", "swing": "swung", "spin": "spun", "sweep": "swept", "bring": "brought",
    "think": "thought", "drink": "drank", "lead": "led", "blow": "blew", "creep": "crept",
    "sneak": "snuck", "fall": "fell", "sit": "sat", "go": "goes|went|gone", "do": "does|did|done",
    "freeze": "froze", "fly": "flew", "sink": "sank", "get": "got", "put": "puts",
    "spring": "sprang", "come": "came", "say": "said", "make": "made", "drive": "drove",
}  # fmt: skip


def pattern(word: str) -> re.Pattern[str]:
    """The expression of a word list's entry.

    ``<walk>`` stands for the verb in all its forms, `` ~ `` for up to four words between.
    """
    expanded = _VERB.sub(lambda verb: verb_forms(verb[1]), word.replace(" ~ ", _GAP))
    return re.compile(rf"\b(?:{expanded})(?!\w|-\w)")


def verb_forms(verb: str) -> str:
    """An expression that matches the infinitive, third person, past and participles of a verb."""
    irregular = f"|{_IRREGULAR[verb]}" if verb in _IRREGULAR else ""
    if verb.endswith("e"):
        stem = verb[:-1]
        return rf"(?:{stem}(?:e|es|ed|ing){irregular})"
    if verb.endswith("y") and verb[-2] not in _VOWELS:
        return rf"(?:{verb[:-1]}(?:y|ies|ied|ying){irregular})"
    if verb.endswith(("s", "x", "z", "ch", "sh")):
        return rf"(?:{verb}(?:es|ed|ing)?{irregular})"
    last = verb[-1]
    doubled = last not in "aeiouwxy" and verb[-2] in _VOWELS and verb[-3:-2] not in tuple(_VOWELS)
    endings = f"s|ed|ing|{last}ed|{last}ing" if doubled else "s|ed|ing"
    return rf"(?:{verb}(?:{endings})?{irregular})"
