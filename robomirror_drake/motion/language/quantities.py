"""Quantities in a clause of English: side, count, speed, size, angle, distance.

Each function reads one quantity from lower-case text and returns None where it says nothing.
"""

from __future__ import annotations

import re

import numpy as np

from robomirror_drake.exceptions import InputError

_WORDS = (
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven",
    "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen",
    "twenty",
)  # fmt: skip
_NUMBERS: dict[str, float] = {
    **{word: float(i) for i, word in enumerate(_WORDS)},
    "thirty": 30.0, "forty-five": 45.0, "forty": 40.0, "fifty": 50.0, "sixty": 60.0,
    "ninety": 90.0, "a hundred": 100.0, "a few": 3.0, "several": 3.0, "a couple of": 2.0,
    "half an": 0.5, "half a": 0.5, "one and a half": 1.5, "a": 1.0, "an": 1.0,
}  # fmt: skip
_NUMBER = (
    r"(?<![\w.])(-?\d+(?:[.,]\d+)?|"
    + "|".join(sorted(map(re.escape, _NUMBERS), key=len, reverse=True))
    + r")(?![\w.]*\d)"
)

# A side that things are at, or go by, is not the side that acts.
_PASSING = re.compile(
    r"\bfrom (?:the |his |her )?(?:left|right) to (?:the |his |her )?(?:left|right)\b"
    r"|\b(?:left to right|right to left)\b"
    r"|\b(?:on|at) (?:his|her|their|its) (?:left|right)\b(?! (?!side)\w)"
)
_SPEED = re.compile(
    rf"{_NUMBER}\s*(m/s|meters? (?:per|a) second|metres? (?:per|a) second|km/h|kmh)"
)
_ANGLE = re.compile(rf"{_NUMBER}\s*[- ]?(?:degrees?\b|deg\b|°)")
_DISTANCE = re.compile(rf"{_NUMBER}\s*[- ]?(meters?|metres?|m|centimeters?|centimetres?|cm|feet)\b")
_DURATION = re.compile(
    rf"{_NUMBER}[- ]+(?:seconds?|secs?|minutes?|mins?|hours?|days?)\b|\b\d+(?:[.,]\d+)? ?s\b"
)
_VAGUE = re.compile(
    r"\b(?:for )?(?:a few|several|a couple of|some|a) (?:seconds?|minutes?|moments?)\b"
)
_LARGE = re.compile(r"\b(?:hundreds|thousands?|millions?|billions?|dozens)\b")
_TURN_WORDS: tuple[tuple[str, float], ...] = (
    (r"three[- ]quarter", 270.0),
    (r"quarter|right angle", 90.0),
    (r"half[- ](?:a )?turn|around|about[- ]face|turn about|(?:other|opposite) (?:way|direction)"
     r"|backward", 180.0),
    (r"full|complete|whole|circle|once round", 360.0),
)  # fmt: skip
_COUNT = re.compile(
    rf"{_NUMBER}[ -](?!(?:of|hands?|arms?|legs?|foot|feet|fists?|knees?|side|moment|m[ae]n|persons?"
    r"|people|while|little|half|quarter)\b(?! ?-?step))(?:\w+[ -]){0,2}?"
    r"(?:times?|steps?|strides?|paces|reps|repetitions|rounds|\w+s)\b"
)
_ARTICLE = re.compile(r"\b(?:a|an)\b(?! (?:few|couple|hundred|half))")
_A_STEP = re.compile(
    r"\b(?:a|an|one) (?:(?!box|side|waltz|salsa|dance|cross|grapevine|basic|mambo)\w+[ -]){0,2}?"
    r"(?:step|time|stride)\b"
)
_SINGLE = re.compile(
    r"\bone (?:(?:more|big|small|single|quick|high|low|deep|left|right) )*"
    r"(?:step|stride|jump|clap|bow|kick|punch|jab|squat|hop|lunge|leap|nod|wave|spin|turn|stomp|round)\b"
)
_TIMES = re.compile(r"\b(once|twice|thrice)\b")

_AGED = r"like an? (?:old|elderly|tired) \w+|(?:old|elderly) (?:man|woman|person|lady)"
_ANGRY = r"angry|angrily|aggressive\w*|violent\w*|wild(?:ly)?|enthusiastic\w*"
_HAPPY = r"happ(?:y|ily)|cheerful\w*|excited\w*|joyful\w*"
_TEMPO: tuple[tuple[str, float], ...] = (
    (r"(?:very|extremely|really|so) slow\w*|in slow motion|at a snail's pace", 0.55),
    (rf"{_AGED}|exhausted\w*|wear(?:y|ily)|tired\w*|sad(?:ly)?|depressed\w*|sluggish\w*", 0.65),
    (r"slow\w*|cautious\w*|careful\w*|leisurely|calm\w*|gentl[ey]|unhurried\w*|graceful\w*"
     r"|casual\w*|relaxed|lazy|lazily|hesitant\w*|timid\w*|shy(?:ly)?|solemn\w*", 0.75),
    (r"(?:very|extremely|really|so) (?:quick|fast|rapid)\w*|frantic\w*|furious\w*"
     r"|explosive\w*", 1.6),
    (rf"{_ANGRY}|quick\w*|fast|faster|rapid\w*|swift\w*|brisk\w*|hurr(?:y|ied|ies|ying)\w*"
     r"|sudden\w*|speed\w*|energetic\w*|vigorous\w*", 1.35),
    (rf"{_HAPPY}|nervous\w*|determined\w*", 1.15),
)  # fmt: skip
_AMPLITUDE: tuple[tuple[str, float], ...] = (
    (r"little while|little bit later|so far", 1.0),
    (r"(?:very|extremely|really) (?:high|big|large|wide|long|deep|far|hard)\w*|huge|giant"
     r"|enormous|as (?:high|far|deep) as|exaggerated|furious\w*|explosive\w*", 1.5),
    (rf"{_ANGRY}|high\w*|big|bigger|large|wide\w*|long|deep\w*|far|great|tall|hard|powerful\w*"
     r"|strong\w*|forceful\w*|dramatic\w*", 1.3),
    (rf"{_HAPPY}|energetic\w*|vigorous\w*|confident\w*", 1.15),
    (rf"{_AGED}|low|small|short|little|slight\w*|tiny|shallow\w*|light(?:ly)?|a bit|shy(?:ly)?"
     r"|timid\w*|sad(?:ly)?|subtl[ey]|tired\w*", 0.7),
    (r"careful\w*|cautious\w*|gentl[ey]|nervous\w*|hesitant\w*", 0.85),
)  # fmt: skip
"""Words and the factors that they stand for; of an adverb of style, both its tempo and its size."""

MAX_COUNT, MAX_DISTANCE, MAX_SPEED, MAX_ANGLE = 50, 20.0, 4.0, 1080.0


def _value(word: str) -> float:
    return _NUMBERS[word] if word in _NUMBERS else float(word.replace(",", "."))


def _within(value: float, low: float, high: float, unit: str, text: str) -> float:
    if not low <= value <= high:
        raise InputError(
            f"{value:g} {unit} in {text!r} is out of range; give {low:g} to {high:g} {unit}"
        )
    return value


def refuse_unreadable(text: str) -> None:
    """Raises InputError for what would otherwise be dropped in silence."""
    text = _VAGUE.sub(" ", _SPEED.sub(" ", text))
    if found := _DURATION.search(text):
        raise InputError(f"{found[0]!r}: durations are not understood; give a count or a distance")
    if found := _LARGE.search(text):
        raise InputError(f"{found[0]!r}: counts go up to {MAX_COUNT}")


def side_of(text: str) -> str | None:
    """``left``, ``right`` or ``both``."""
    if re.search(r"\b(?:(?:both|two) (?:of )?(?:\w+ )?(?:hands|arms|fists|legs|sides)"
                 r"|left and (?:the )?right \w+|right and (?:the )?left \w+)", text):  # fmt: skip
        return "both"
    text = _PASSING.sub(" ", text)
    found = re.search(r"\b(left|right|counter-?clockwise|anti-?clockwise|clockwise)\b", text)
    if found is None:
        return None
    return {"left": "left", "right": "right", "clockwise": "right"}.get(found[1], "left")


def speed_of(text: str) -> float | None:
    """Speed [m/s] where a number is given."""
    found = _SPEED.search(text)
    if found is None:
        return None
    factor = 1.0 / 3.6 if found[2].startswith("km") else 1.0
    return _within(_value(found[1]) * factor, 0.05, MAX_SPEED, "m/s", text)


def angle_of(text: str) -> float | None:
    """Angle [rad], positive."""
    found = _ANGLE.search(text)
    if found is not None:
        return float(np.deg2rad(_within(_value(found[1]), 1.0, MAX_ANGLE, "degrees", text)))
    for pattern, degrees in _TURN_WORDS:
        if re.search(rf"\b(?:{pattern})\b", text):
            return float(np.deg2rad(degrees))
    return None


def distance_of(text: str) -> float | None:
    """Distance [m], positive."""
    found = _DISTANCE.search(_SPEED.sub(" ", text))
    if found is None or (found[2] == "feet" and re.search(rf"\b(?:with|on) {found[0]}", text)):
        return None
    unit = {"c": 0.01, "f": 0.3048}.get(found[2][0], 1.0)
    return _within(_value(found[1]) * unit, 0.05, MAX_DISTANCE, "m", text)


def count_of(text: str) -> int | None:
    """Number of repetitions or steps."""
    times = _TIMES.search(text)
    if times is not None:
        return {"once": 1, "twice": 2, "thrice": 3}[times[1]]
    for unit in (_SPEED, _ANGLE, _DISTANCE):
        text = unit.sub(" ", text)
    text = _VAGUE.sub(" ", text)
    found = _COUNT.search(_ARTICLE.sub(" ", text).replace("one ", " "))
    if found is None:
        return 1 if _SINGLE.search(text) or _A_STEP.search(text) else None
    count = _within(_value(found[1]), 1, MAX_COUNT, "repetitions", text)
    if count != int(count):
        raise InputError(f"{found[0]!r}: give a whole number of repetitions")
    return int(count)


def tempo_of(text: str) -> float:
    """Factor on the usual tempo; 1 where nothing is said."""
    return _factor(_TEMPO, text)


def amplitude_of(text: str) -> float:
    """Factor on the usual size; 1 where nothing is said."""
    return _factor(_AMPLITUDE, text)


def _factor(table: tuple[tuple[str, float], ...], text: str) -> float:
    return next((f for pattern, f in table if re.search(rf"\b(?:{pattern})\b", text)), 1.0)


def without_quantities(text: str) -> str:
    """The text less its numbers with units, counts and tempo, for the comparison of meanings."""
    for pattern in (_SPEED, _ANGLE, _DISTANCE, _TIMES):
        text = pattern.sub(" ", text)
    text = re.sub(rf"{_NUMBER}[ -](?:times|reps|repetitions)\b", " ", text)
    text = re.sub(r"\b(?:very )?(?:slowly|quickly|rapidly|cautiously|carefully)\b", " ", text)
    return re.sub(r"\s+", " ", text).strip(" ,")
