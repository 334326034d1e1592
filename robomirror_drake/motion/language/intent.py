"""Whether a command is understood as it was meant: written sentences and what they mean.

What a sentence means is written as clauses: ``a > b`` where b follows a, ``a + b`` where it goes
along with it, ``x|y`` where either reading is right. After an action may stand a side, ``xN`` for
a count, ``@N`` for degrees, ``Nm`` for metres, ``slow``, ``fast``, ``big``, ``small``. Side and
count have to be exactly as said (``both`` is the same as nothing); angle, distance, tempo and size
are compared where they are written.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from robomirror_drake.exceptions import InputError
from robomirror_drake.motion.text import Clause, parse

PACKAGED = "packaged"
"""Stands for the sentences that come with the package."""

_SIGNS = r"\s*([>+])\s*"


def load_sentences(source: str = PACKAGED) -> list[tuple[str, str]]:
    """Sentences and what each means.

    Args:
        source: A YAML file with a list of pairs ``[sentence, clauses]``, or ``packaged`` for 400
            that were held apart while the words and the classifier were chosen.

    Raises:
        InputError: There is no such file, or something else is in it.
    """
    packaged = resources.files("robomirror_drake.assets") / "sentences" / "held_apart.yaml"
    file = packaged if source == PACKAGED else Path(source)
    try:
        rows = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{source}: no file of sentences: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{source}: not YAML: {error}") from error
    if not isinstance(rows, list) or not rows:
        raise InputError(f"{source}: no list of sentences, such as [a person bows, bow]")
    for number, row in enumerate(rows, start=1):
        if not (isinstance(row, list) and len(row) == 2 and all(isinstance(x, str) for x in row)):
            raise InputError(f"{source}: entry {number} is {row!r:.60}, not [sentence, clauses]")
    return [(text, meaning) for text, meaning in rows]


def readings(meaning: str) -> list[list[tuple[bool, str]]]:
    """Every reading of what is meant, as (whether it goes along, clause)."""
    options = [part.split("|") for part in re.split(_SIGNS, meaning)]
    whole = [" ".join(combination) for combination in itertools.product(*options)]
    if "|" in meaning:
        whole += meaning.split("|")
    found = []
    for reading in whole:
        parts = re.split(_SIGNS, reading)
        signs = [False, *(sign == "+" for sign in parts[1::2])]
        found.append(list(zip(signs, parts[0::2], strict=True)))
    return found


def means(clause: Clause, accompanies: bool, wanted: str) -> bool:
    """Whether a clause is what is written in ``wanted``."""
    action, *details = wanted.split()
    side = next((d for d in details if d in ("left", "right")), None)
    count = next((int(d[1:]) for d in details if re.fullmatch(r"x\d+", d)), None)
    same = (
        clause.action == action
        and clause.accompanies == accompanies
        and {"both": None}.get(clause.side or "", clause.side) == side
        and clause.count == count
    )
    for detail in details:
        if detail.startswith("@"):
            same &= _close(clause.angle, np.deg2rad(float(detail[1:])))
        elif re.fullmatch(r"[\d.]+m", detail):
            same &= _close(clause.distance, float(detail[:-1]))
        elif detail in ("slow", "fast"):
            same &= (clause.tempo < 1.0) if detail == "slow" else (clause.tempo > 1.0)
        elif detail in ("small", "big"):
            same &= (clause.amplitude < 1.0) if detail == "small" else (clause.amplitude > 1.0)
    return same


def _close(value: float | None, wanted: float) -> bool:
    return value is not None and bool(np.isclose(value, wanted, rtol=1e-6))


def understood(text: str, meaning: str) -> bool:
    """Whether all clauses of a sentence, in their order, are read as they are meant."""
    try:
        clauses = parse(text)
    except InputError:
        return False
    return any(
        len(reading) == len(clauses)
        and all(means(clause, *want) for clause, want in zip(clauses, reading, strict=True))
        for reading in readings(meaning)
    )


def kinds(meaning: str) -> list[str]:
    """What kinds of sentence one is, by what it means in its first reading."""
    first = meaning.split("|")[0]
    found = ["simultaneous"] if "+" in meaning else []
    found += ["sequence"] if ">" in meaning else []
    found = found or ["single"]
    found += ["with side"] if re.search(r"\b(left|right)\b", first) else []
    found += ["with count"] if re.search(r"\bx\d", first) else []
    quantity = re.search(r"@\d|\b[\d.]+m\b|\b(slow|fast|big|small)\b", first)
    return found + (["with quantity or manner"] if quantity else [])


def accuracy(sentences: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """How many sentences are understood, of which kind, and which ones are not.

    Returns:
        ``sentences``, ``right``, ``refused`` (of those that are not right), ``accuracy``, ``kinds``
        (kind -> ``sentences``, ``right``), and ``wrong``, each with ``text``, ``meant``, ``read``.
    """
    wrong = []
    by_kind: dict[str, dict[str, int]] = {}
    for text, meaning in sentences:
        right = understood(text, meaning)
        for kind in kinds(meaning):
            row = by_kind.setdefault(kind, {"sentences": 0, "right": 0})
            row["sentences"] += 1
            row["right"] += right
        if not right:
            wrong.append({"text": text, "meant": meaning, "read": written(text)})
    right_ones = len(sentences) - len(wrong)
    return {
        "sentences": len(sentences),
        "right": right_ones,
        "refused": sum(row["read"] == "refused" for row in wrong),
        "accuracy": right_ones / len(sentences),
        "kinds": dict(sorted(by_kind.items())),
        "wrong": wrong,
    }


def written(text: str) -> str:
    """How a sentence is read, written as its meaning is; ``refused`` where it is."""
    try:
        clauses = parse(text)
    except InputError:
        return "refused"
    parts: list[str] = []
    for clause in clauses:
        sign = [] if not parts else ["+" if clause.accompanies else ">"]
        side = [clause.side] if clause.side else []
        count = [] if clause.count is None else [f"x{clause.count}"]
        angle = [] if clause.angle is None else [f"@{np.rad2deg(clause.angle):.0f}"]
        distance = [] if clause.distance is None else [f"{clause.distance:g}m"]
        parts += [*sign, clause.action, *side, *count, *angle, *distance]
    return " ".join(parts)
