"""A command in English becomes clauses: which action, with which parameters, in which order."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from robomirror_drake.exceptions import InputError, UnknownCommandError
from robomirror_drake.motion.composer.cue import Cue, other
from robomirror_drake.motion.language import quantities
from robomirror_drake.motion.language.fragments import ELLIPSIS, Fragment, fragments
from robomirror_drake.motion.language.recognise import evident, ranking, recognise, travels
from robomirror_drake.motion.library import library

MAX_CHARACTERS = 400
MAX_CLAUSES = 12

# What shall not be done; "does not move" is standing.
_NEGATION = re.compile(
    r"\b(?:(?:do|does|must|should|will|shall|is|are) not|don't|doesn't|mustn't|shouldn't|won't"
    r"|isn't|never)\b(?! (?:move|stir|budge|know|do anything))"
)
_TURNED_WALK = {"back": "walk_backward", "forw": "walk", "side": "side_step",
                "left": "side_step", "righ": "side_step"}  # fmt: skip
# To do these to one side and then the other is what they are.
_TWO_SIDED = frozenset(
    {
        *("look_around", "shake_head", "sway", "zigzag", "twist", "swing_arms", "dance"),
        *("stretch", "wipe", "disco", "salsa", "waltz", "stagger"),
    }
)
# Arms that are said to be held somehow belong to these anyway.
_ARMS_BELONG = frozenset(
    {
        *("squat", "deep_squat", "stand_on_one_leg", "jump", "lunge", "leap", "jumping_jack"),
        *("side_lunge", "dodge", "hop"),
    }
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
        score: How sure the choice of the action is, from 0 to 1.
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
    quantities.refuse_unreadable(command)
    clauses: list[Clause] = []
    for fragment in fragments(command, evident, travels):
        clauses = _extended(clauses, fragment)
    clauses = _without_idle_start(clauses)
    if len(clauses) > MAX_CLAUSES:
        raise InputError(f"{len(clauses)} actions in one command; give {MAX_CLAUSES} at most")
    if not clauses:
        raise UnknownCommandError(command, list(ranking(command))[:3])
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


def _extended(clauses: list[Clause], fragment: Fragment) -> list[Clause]:
    """The clauses with what a fragment says."""
    if clauses and fragment.relation == "follows" and ELLIPSIS.match(fragment.text):
        return _again(clauses, fragment.text)
    clause = _clause(fragment.text)
    if clauses and fragment.close and _same(clauses[-1], clause):
        return [*clauses[:-1], replace(clauses[-1], side=clauses[-1].side or clause.side)]
    if clauses and fragment.close and (clauses[-1].action, clause.action) in _PREPARES:
        return [*clauses[:-1], replace(clause, side=clause.side or _acting(clauses[-1]))]
    if clause.action == "walk_backward" and _turned(clauses) and _BACK.search(clause.text):
        clause = replace(clause, action="walk")
    meanwhile = fragment.close and _goes_on(clauses, clause)
    if (fragment.relation == "follows" and not meanwhile) or not clauses:
        return [*clauses, clause]
    if fragment.relation == "manner" and not _free_arms(clauses[-1].action):
        return clauses
    return _together(clauses, clause)


def _acting(clause: Clause) -> str | None:
    """The side that acts: of standing on one leg, the other."""
    if clause.action == "stand_on_one_leg" and clause.side in ("left", "right"):
        return other(clause.side)
    return clause.side


def _free_arms(action: str) -> bool:
    """Whether what the arms do beside an action is worth a clause of its own."""
    held = library()[action].arms_held(Cue(side="both"))
    return not held and action not in _ARMS_BELONG


def _goes_on(clauses: list[Clause], clause: Clause) -> bool:
    """Whether a participle tells what the arms do on the way: "walks ahead, waving"."""
    participle = re.match(r"(?:\w+ly )?\w+ing\b", clause.text) is not None
    going = bool(clauses) and clauses[-1].group == "locomotion"
    return participle and going and library()[clause.action].arms


def _same(last: Clause, clause: Clause) -> bool:
    """Whether a clause says the last one over again in other words: "leans back to dodge"."""
    return (
        clause.action == last.action
        and (clause.side == last.side or None in (clause.side, last.side))
        and clause.count is None
        and not _MORE.search(clause.text)
        and last.action not in ("walk", "turn")
    )


def _turned(clauses: list[Clause]) -> bool:
    return any(clause.action in ("turn", "spin") for clause in clauses)


def _again(clauses: list[Clause], text: str) -> list[Clause]:
    """The last action once more, as a fragment without an action of its own says."""
    last = clauses[-1]
    said = _clause_of(text, last.action, last.score)
    if re.search(r"\bother\b", text):
        if last.side not in ("left", "right"):
            return clauses  # "one foot and then the other"
        said = replace(said, side=other(last.side))
    if last.action in _TWO_SIDED:
        return [*clauses[:-1], replace(last, side=None)]
    action = last.action
    if action in ("walk", "walk_backward", "side_step"):
        turned = next((v for k, v in _TURNED_WALK.items() if re.search(rf"\b{k}", text)), action)
        action = turned
    return [*clauses, replace(said, action=action, group=library()[action].group)]


def _together(clauses: list[Clause], clause: Clause) -> list[Clause]:
    """A clause that goes along with the one before: what carries the body comes first."""
    *before, carrier = clauses
    if carrier.action == "stand":
        return [*before, replace(clause, accompanies=carrier.accompanies)]
    if clause.action == "stand":
        return clauses
    both_go = {"locomotion"} == {clause.group, carrier.group}
    if clause.action == carrier.action or (both_go and clause.action in _PLAIN_GOING):
        return clauses
    if both_go and carrier.action in _PLAIN_GOING:
        return [*before, clause]
    arms, others = library()[clause.action].arms, library()[carrier.action].arms
    if arms and not library()[carrier.action].clip:
        return [*clauses, replace(clause, accompanies=True)]
    if others and not carrier.accompanies and not library()[clause.action].clip:
        return [*before, clause, replace(carrier, accompanies=True)]
    raise InputError(
        f"{carrier.action} and {clause.action} cannot be done at the same time;"
        " say 'then' between them, or let only a gesture of the arms go along"
    )


_PLAIN_GOING = frozenset({"walk", "side_step"})
# What comes first here is on the way to what follows it: "bends down and picks something up".
_PREPARES = frozenset(
    {
        *(("bow", "pick_up"), ("squat", "pick_up"), ("raise_arms", "pick_up")),
        *(("bow", "touch_toes"), ("guide", "shake_hands"), ("stand_on_one_leg", "front_kick")),
        *(("stand_on_one_leg", "side_kick"), ("stand_on_one_leg", "round_kick")),
        *(("step_over", "step_over"), ("shake_head", "duck")),
    }
)
_MORE = re.compile(r"\b(?:again|another|more|second|once|also)\b")
_BACK = re.compile(r"\bback\b")
_STILL = re.compile(r"still|wait|paus|moment|while|second|idle|motionless|not |freez|nothing|rest")


def _without_idle_start(clauses: list[Clause]) -> list[Clause]:
    """Without "a person is standing" where more follows: that is how every motion begins."""
    kept = [c for c in clauses if c.action != "stand" or _STILL.search(c.text)]
    return kept or clauses


def _clause(text: str) -> Clause:
    action, score = recognise(text)
    return _clause_of(text, action, score)


def _clause_of(text: str, action: str, score: float) -> Clause:
    return Clause(
        text=text,
        action=action,
        group=library()[action].group,
        side=_side(text, action),
        count=quantities.count_of(text),
        speed=quantities.speed_of(text),
        tempo=quantities.tempo_of(text),
        amplitude=quantities.amplitude_of(text),
        angle=quantities.angle_of(text),
        distance=quantities.distance_of(text),
        score=score,
    )


def _side(text: str, action: str) -> str | None:
    both = {"left", "right"} <= set(re.findall(r"\bleft\b|\bright\b", text))
    if action in _TWO_SIDED and both:
        return None
    bearing = re.search(r"\bon(?:to)? (?:\w+ )?(left|right)\b", text)
    if action in ("stand_on_one_leg", "kneel") and bearing:
        return bearing[1]
    side = quantities.side_of(text)
    lifted = re.search(r"\b(?:lift|rais|hold)\w* (?:\w+ ){0,2}(?:leg|foot)", text)
    if action == "stand_on_one_leg" and side in ("left", "right") and lifted:
        return other(side)  # the other one stands
    return side
