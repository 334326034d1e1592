"""A command is cut into fragments, one for each action, with how each relates to the one before."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

Relation = Literal["follows", "accompanies", "manner"]
"""After the fragment before, along with it, or how it is done: a gesture that may go along."""
Evidence = Callable[[str], bool]
"""Whether words of an action stand in a text."""

# After these a new fragment begins, whatever follows.
_SEQUENCE = re.compile(
    r"\s*(?:[;:!\n]+|\.(?!\d)|,?\s*\b(?:and )?(?:then|after that|after which|afterwards?"
    r"|next(?=,| (?:he|she|they|it)\b)|finally|subsequently|followed by|thereafter|at last|later"
    r"|before(?= \w+ing\b| (?:he|she|they|it)\b)|eventually)\b,?)\s*"
)
# After these one begins where the words of an action follow.
_JOIN = re.compile(r"\s*(,\s*and\b|,\s*but\b|,|\band\b|\bto\b(?= \w+))\s*")
_WHILE = re.compile(
    r"\s*,?\s*\b(?:while(?: also)?|simultaneously|at the same time(?: as)?|and at the same time"
    r"|as (?=(?:he|she|they|it|the \w+|a \w+) \w+))\b,?\s*"
)
_MANNER = re.compile(
    r",? (?:with|using|keeping|holding) (?=(?:both |the |his |her |their |its |two |one )*"
    r"(?:arms?|hands?)\b)"
)
_PEOPLE = (
    r"(?:person|man|woman|human|figure|boy|girl|robot|character|individual|guy|lady|actor|athlete"
    r"|subject|kid|child|people|player|dancer|soldier|fighter|boxer|gentleman|visitor)"
)
_DETERMINER = r"(?:the|a|an|some|one|this|that|his|her|another)"
_PRONOUN = r"(?:someone|somebody|he|she|they|it|you|i)"
_ADJECTIVES = r"(?:(?!the |a |an |his |her |their )[\w-]+ ){0,2}?"
_SOMEONE = rf"(?:{_DETERMINER} {_ADJECTIVES}{_PEOPLE}|{_PRONOUN}|{_PEOPLE})"
_BEING = (
    r"(?: (?:is|are|was|were|starts?|starting|begins?|beginning|continues?|wants?|keeps?|proceeds?"
    r"|tries|appears|seems|decides?|can be seen|now|then|also|slowly|quickly|suddenly))*(?: to)?"
)
SUBJECT = re.compile(rf"^(?:{_SOMEONE}|[\w-]+ {_PEOPLE}){_BEING} ")
"""Who does it, and that it is done."""

# What comes first in the words but not in time, or goes along.
_FRONTED = tuple(
    (re.compile(pattern), order)
    for pattern, order in (
        (rf"^with (?P<a>[^,]+?),? (?P<b>{_SOMEONE} .+)$", "{b} with {a}"),
        (r"^with (?P<a>[^,]+), (?P<b>.+)$", "{b} with {a}"),
        (rf"^(?:while|as) (?:{_SOMEONE} )?(?P<a>[^,]+?),? (?P<b>{_SOMEONE} .+)$", "{b} while {a}"),
        (r"^(?:while|as) (?P<a>[^,]+), ?(?P<b>.+)$", "{b} while {a}"),
        (rf"^after (?P<a>[^,]+?),? (?P<b>{_SOMEONE} .+)$", "{a} then {b}"),
        (r"^after (?P<a>[^,]+), ?(?P<b>.+)$", "{a} then {b}"),
        (rf"^before (?P<a>[^,]+?),? (?P<b>{_SOMEONE} .+)$", "{b} then {a}"),
        (r"^before (?P<a>[^,]+), ?(?P<b>.+)$", "{b} then {a}"),
        (r"^(?P<b>.+?),?\s+after (?P<a>\w+ing\b.*)$", "{a} then {b}"),
    )
)
_AS_POSSIBLE = re.compile(r"\bas (\w+) as (?:possible|(?:he|she|they|it|you) (?:can|could))\b")
# "And" does not join two actions in these.
_FIXED = re.compile(
    r"\b(?:back and forth|up and down|down and up|to and fro|there and back|round and round"
    r"|again and again|over and over|hands and knees|forwards? and backwards?|hand and foot"
    r"|in and out|bob(?:s|bing)? and weav\w+|arms and legs|one and a half)\b"
)
_FIRST = re.compile(r"^(?:first|firstly|at first|to begin with|suddenly|starting)\b,? ")
_LIMB = (
    r"(?:it|them|(?:the |his |her |their |both )+(?:arms?|hands?|foot|feet|legs?|knees?|head|body"
    r"|fists?|left \w+|right \w+))"
)
_PLACE = (
    r"to (?:the |their |his |her |a |its )?(?:\w+ )?(?:position|start|place|stance|standing"
    r"|original|neutral|normal|sides?|ground|floor)(?: \w+)?"
)
# The way back to the neutral stance, which every action takes by itself.
_RECOVERY = re.compile(
    r"^(?:(?:he|she|they|it|slowly|quickly|then|again|finally|suddenly) )*(?:"
    rf"(?:stand|get|ris|com|return|straighten|go|stood)\w*"
    rf"(?: (?:back|up|again|upright|down|straight|{_PLACE}))*"
    r"|(?:stop|halt|land|finish|end)\w*(?: (?:and|there|still|again|moving|walking))*"
    rf"|(?:lower|drop|bring|put|let|mov|set|pull|swing|plac)\w* {_LIMB}"
    rf"(?: (?:back|down|again|slowly|quickly|fall|{_PLACE}))*"
    r"|(?:lower|drop)\w* (?:back )?down(?: again)?"
    r"|(?:up|down)(?: again)?|back(?: up| down| again)|wak\w* up"
    r"|(?:keep|hold|stay)\w* (?:it|them|there|(?:that|the|this) (?:pose|position))"
    r"(?: (?:there|up|for|a|while|moment))*"
    r"|retracts? (?:it|them)|steps? (?:back )?(?:down|off)|(?:regain|recover)\w*(?: \w+)? balance"
    r"|(?:gestures|motions|signals|says) (?:the|a) \w+"
    r")(?: (?:again|slowly|quickly|after\w*))*$"
)
_LANDING = re.compile(r"^(?:then )?land(?:s|ed|ing)?\b")
# Words of a fragment that has no action of its own: the one before, otherwise.
ELLIPSIS = re.compile(
    r"^(?:(?:and|then|again|also|once|twice|thrice|one|two|three|four|five|six|more|times?|steps?"
    r"|to|towards?|on|with|by|using|from|in|the|his|her|their|its|a|other|opposite|way|direction"
    r"|left|right|both|side|sides|hand|hands|arm|arms|leg|legs|foot|feet|forwards?|backwards?|back"
    r"|sideways|up|down|slowly|quickly|it|does|do|repeats?|same|thing|alternately|another|only"
    r"|of|that|this|first|last|knee|fist|elbow|small|big|times|goes|switches|meters?|metres?"
    r"|clockwise|counter-?clockwise|anti-?clockwise|\d+)\b,? ?)+$"
)
_NOT_A_VERB = frozenset(
    {
        *("arms", "hands", "legs", "feet", "knees", "hips", "shoulders", "elbows", "fists"),
        *("fingers", "palms", "toes", "heels", "sides", "times", "rounds"),
        *("reps", "repetitions", "metres", "meters", "degrees", "seconds", "always"),
        *("sometimes", "perhaps", "this", "something", "anything", "nothing", "everything"),
        *("morning", "evening", "king", "upwards", "downwards", "forwards", "backwards"),
        *("sideways", "towards", "afterwards", "besides", "across", "chest", "standing"),
        *("crossed", "raised", "extended", "outstretched", "bent", "folded", "spread", "left"),
        *("others", "guests", "friends", "motions", "movements", "gestures", "his"),
    }
)
_LEAD = re.compile(
    r"^(?:(?:and|then|also|he|she|they|it|who|is|are|again|\w+ly"
    r"|(?:the|a) (?:man|woman|person|figure)"
    r"|with (?:the |his |her |their )?(?:left|right) (?:hand|arm|foot|leg)),? )+"
)


@dataclass(frozen=True)
class Fragment:
    """The words of one action.

    Attributes:
        text: The words.
        relation: How it relates to the fragment before.
        close: Whether it is part of the same statement: joined by a comma or 'and', not 'then'.
    """

    text: str
    relation: Relation = "follows"
    close: bool = False


def fragments(command: str, evident: Evidence, travels: Evidence) -> list[Fragment]:
    """Cut a command, lower case and checked, into fragments in the order in which they are done.

    Args:
        command: The command.
        evident: Tells where the words of an action stand.
        travels: Tells whether those words are of going somewhere.
    """
    command = _AS_POSSIBLE.sub(r"very \1", _FIRST.sub("", command))
    command = _FIXED.sub(lambda found: found[0].replace(" and ", "_and_"), command)
    command = re.sub(r"\bin turn\b", "alternately", command)
    for fronted, order in _FRONTED:
        if found := fronted.match(command):
            command = order.format(**found.groupdict())
            break
    parts: list[Fragment] = []
    for sentence in _SEQUENCE.split(command):
        for i, piece in enumerate(_pieces(_FIRST.sub("", sentence), evident, travels)):
            if not piece.strip() or _RECOVERY.match(piece.strip()):
                continue
            for k, text in enumerate(_WHILE.split(piece)):
                if text.strip():
                    relation: Relation = "accompanies" if k else "follows"
                    words = text.strip().replace("_and_", " and ")
                    fragment = Fragment(words, relation, close=i + k > 0)
                    parts += _with_manner(fragment, evident)
    return parts


def _with_manner(fragment: Fragment, evident: Evidence) -> list[Fragment]:
    """Split off what the arms do, where the rest is an action without it."""
    found = _MANNER.search(fragment.text)
    if found is None:
        return [fragment]
    head, tail = fragment.text[: found.start()], fragment.text[found.end() :]
    if not (evident(head) and evident(tail)):
        return [fragment]
    return [replace(fragment, text=head), Fragment(tail, "manner")]


def _pieces(part: str, evident: Evidence, travels: Evidence) -> list[str]:
    """Split at commas, 'and' and 'to' where the words of an action stand on both sides."""
    words = _JOIN.split(part)
    pieces = [words[0]] if words[0].strip() else []
    for joint, text in zip(words[1::2], words[2::2], strict=True):
        if not text.strip():
            continue
        if not pieces:
            pieces.append(text)
        elif _LANDING.match(text):
            pieces[-1] = f"{pieces[-1]} and {text}"  # how far it goes may stand here
        elif joint == "to" and not (travels(pieces[-1]) and _infinitive(text, evident)):
            pieces[-1] = f"{pieces[-1]} to {text}"
        elif joint != "to" and _RECOVERY.match(text):
            continue
        elif joint == "to" or _begins(text, evident) or _other_side(pieces[-1], text):
            pieces.append(text)
        else:
            pieces[-1] = f"{pieces[-1]}{'' if joint == ',' else ' '}{joint} {text}"
    return pieces


def _infinitive(text: str, evident: Evidence) -> bool:
    """Whether a purpose begins here: "steps ahead to kick"."""
    first = text.split(" ")[0]
    return evident(first) and not first.endswith(("s", "ing"))


def _other_side(before: str, text: str) -> bool:
    """Whether the same is to be done with the other side: "with the left leg and the right leg"."""
    if not ELLIPSIS.match(text):
        return False
    if before.endswith((" left", " right")) and re.search(r"(?:left|right) \w+$", text):
        return False  # "the left and right arm"
    said, more = (set(re.findall(r"\b(?:left|right)\b", t)) for t in (before, text))
    counted = re.search(r"\b(?:once|twice|times)\b", text)
    return bool(said and more - said) or bool(counted)


def _begins(text: str, evident: Evidence) -> bool:
    """Whether a fragment begins here rather than the one before going on."""
    bare = _LEAD.sub("", text)
    first = bare.split(" ")[0]
    if first in _NOT_A_VERB:
        return False
    if evident(bare) and not _only_later(bare, evident):
        return True
    ends_like_verb = first.endswith(("s", "ing", "ed")) and not first.endswith("ss")
    return len(first) > 3 and ends_like_verb


def _only_later(text: str, evident: Evidence) -> bool:
    """Whether the words of an action come only after a preposition or another noun phrase."""
    first = re.split(r"\b(?:of|for|from|by|like|as if|in order)\b", text, maxsplit=1)[0]
    return not evident(first)
