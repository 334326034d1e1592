"""A command in English becomes clauses: which action, with which parameters, in which order."""

from __future__ import annotations

import re
from dataclasses import dataclass

from robomirror_drake.exceptions import InputError, UnknownCommandError
from robomirror_drake.motion.language import quantities
from robomirror_drake.motion.language.encoder import likeness
from robomirror_drake.motion.library import library

MAX_CHARACTERS = 400
MAX_CLAUSES = 12
THRESHOLD = 0.60
"""Least score of an action for a clause to be understood."""
WORD_BONUS = 0.30
"""What a word of the action adds to the likeness, and a little more for a longer match."""

# After these a new clause begins, whatever follows.
_SEQUENCE = re.compile(
    r"\s*(?:[;!\n]+|\.(?!\d)|,?\s*\b(?:and )?(?:then|after that|afterwards?|next|finally"
    r"|subsequently|followed by|before|thereafter)\b,?)\s*"
)
# After these one begins where the words of an action follow.
_JOIN = re.compile(r"\s*(?:,\s*and\b|,|\band\b)\s*")
_WHILE = re.compile(r"\s*,?\s*\b(?:while|simultaneously|at the same time(?: as)?)\b,?\s*")
_WHILE_FIRST = re.compile(r"^while (?P<second>[^,]+), ?(?P<first>.+)$")
# What shall not be done; "does not move" is standing.
_NEGATION = re.compile(
    r"\b(?:(?:do|does|must|should|will|shall) not|don't|doesn't|mustn't|shouldn't|won't|never)\b"
    r"(?! (?:move|stir|budge))"
)
_AFTER = re.compile(r"^(?P<second>.+?),?\s+after (?P<first>\w+ing\b.*)$")
# The way back to the neutral stance, which every action takes by itself.
_RECOVERY = re.compile(
    r"^(?:(?:he|she|they|it) )?(?:(?:stand|get|ris|com|go|return|straighten)\w*)"
    r"(?: (?:back|up|again|upright|down|to (?:the )?\w+(?: position)?)\b)*(?: again)?$"
)
_SUBJECT = re.compile(
    r"^(?:(?:the|a|an|some|one|this|that) )?(?:\w+ )?(?:person|man|woman|human|figure|someone"
    r"|somebody|he|she|they|boy|girl|robot|character|individual|guy|lady|actor|athlete)"
    r"(?: (?:is|are|was|starts|begins|continues|wants|keeps))?(?: to)? "
)


@dataclass(frozen=True)
class Clause:
    """One action of a command.

    Attributes:
        text: The words.
        action: Name of the action in the library.
        group: ``locomotion``, ``dynamic`` or ``expressive``.
        side: ``left``, ``right`` or ``both``; None where the words leave it open.
        count: Repetitions or steps; None where nothing is said.
        speed: Speed [m/s] where a number is given, else None.
        tempo: Factor on the usual tempo.
        amplitude: Factor on the usual size.
        angle: Angle [rad], positive; None where nothing is said.
        distance: Distance [m], positive; None where nothing is said.
        accompanies: Whether it goes along with the clause before it instead of following it.
        score: How sure the choice of the action is; at least :data:`THRESHOLD`.
    """

    text: str
    action: str
    group: str
    side: str | None = None
    count: int | None = None
    speed: float | None = None
    tempo: float = 1.0
    amplitude: float = 1.0
    angle: float | None = None
    distance: float | None = None
    accompanies: bool = False
    score: float = 1.0


def parse(text: str) -> tuple[Clause, ...]:
    """The clauses of a command, in the order in which they are done.

    Raises:
        InputError: The text is empty, too long, not in English letters, says what shall not
            be done, asks for a quantity out of range, for a duration, or for two actions at
            once that need the same limbs.
        UnknownCommandError: A clause names no known action.
    """
    command = _checked(text)
    if denied := _NEGATION.search(command):
        raise InputError(f"{denied[0]!r} is not understood; say only what shall be done")
    if together := _WHILE_FIRST.match(command):
        command = f"{together['first']} while {together['second']}"
    quantities.refuse_unreadable(command)
    inverted = _AFTER.match(command)
    if inverted:
        command = f"{inverted['first']} then {inverted['second']}"
    clauses: list[Clause] = []
    for part in _SEQUENCE.split(command):
        for piece in _pieces(part):
            clauses.extend(_simultaneous(piece))
    if len(clauses) > MAX_CLAUSES:
        raise InputError(f"{len(clauses)} actions in one command; give {MAX_CLAUSES} at most")
    if not clauses:
        raise InputError(f"{text!r} names no action")
    return tuple(clauses)


def _checked(text: str) -> str:
    """Lower case, plain spaces; or an InputError."""
    if not isinstance(text, str):
        raise InputError(f"a command is a text, not {type(text).__name__}")
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"the command has {len(text)} characters; give {MAX_CHARACTERS} at most")
    plain = re.sub(r"[ \t\r\f\v]+", " ", text.lower().replace("’", "'")).strip(" .,;!?\n")
    if not plain:
        raise InputError("the command is empty; say for instance 'a person walks forward'")
    letters = [c for c in plain if c.isalpha()]
    if sum(c.isascii() for c in letters) < 0.8 * max(len(letters), 1) or not letters:
        raise InputError(f"{text[:60]!r} is not English; commands are understood in English only")
    return plain


def _pieces(part: str) -> list[str]:
    """Split at commas and 'and' where an action's words stand on both sides."""
    pieces: list[str] = []
    for fragment in _JOIN.split(part):
        if not fragment or (pieces and _RECOVERY.match(fragment)):
            continue
        if pieces and not (_has_evidence(fragment) and _has_evidence(pieces[-1])):
            pieces[-1] = f"{pieces[-1]} and {fragment}"
        else:
            pieces.append(fragment)
    return pieces


def _has_evidence(fragment: str) -> bool:
    return any(action.evidence(fragment) for action in library().values())


def _simultaneous(piece: str) -> list[Clause]:
    """The clauses of a piece: first what carries the body, then the gestures that go along."""
    parts = [_clause(part) for part in _WHILE.split(piece) if part.strip()]
    if len(parts) < 2:
        return parts
    carriers = [clause for clause in parts if not library()[clause.action].arms]
    gestures = [clause for clause in parts if library()[clause.action].arms]
    if not carriers:
        carriers, gestures = gestures[:1], gestures[1:]
    recorded = any(library()[c.action].clip for c in carriers)
    if len(carriers) > 1 or recorded:
        raise InputError(
            f"{piece!r}: {' and '.join(c.action for c in parts)} cannot be done at the same time;"
            " say 'then' between them, or let only a gesture of the arms go along"
        )
    return carriers + [_accompanying(clause) for clause in gestures]


def _accompanying(clause: Clause) -> Clause:
    return Clause(**{**vars(clause), "accompanies": True})


def _clause(text: str) -> Clause:
    text = text.strip()
    name, score = _recognise(text)
    action = library()[name]
    return Clause(
        text=text,
        action=name,
        group=action.group,
        side=quantities.side_of(text),
        count=quantities.count_of(text),
        speed=quantities.speed_of(text),
        tempo=quantities.tempo_of(text),
        amplitude=quantities.amplitude_of(text),
        angle=quantities.angle_of(text),
        distance=quantities.distance_of(text),
        score=score,
    )


def scores(text: str) -> dict[str, float]:
    """How well each action fits a clause, best first: likeness of meaning plus its words."""
    stripped = quantities.without_quantities(text)
    stripped = _SUBJECT.sub("", f"{stripped} ").strip()
    alike = likeness(f"a person {stripped}")
    total = {}
    for name, action in library().items():
        matched = action.evidence(text)
        bonus = WORD_BONUS + 0.012 * min(matched, 20) if matched else 0.0
        total[name] = alike[name] + bonus
    return dict(sorted(total.items(), key=lambda item: -item[1]))


def _recognise(text: str) -> tuple[str, float]:
    ranking = scores(text)
    best = next(iter(ranking))
    if ranking[best] < THRESHOLD:
        raise UnknownCommandError(text, list(ranking)[:3])
    return best, ranking[best]
