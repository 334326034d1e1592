"""From a command to predicates: what has to be measurable in a motion that does it.

Every figure is wanted in proportion to the command's own motion, the nominal one: a gentler
version is still the same task, standing still never is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robomirror_drake.goals.probes import Channel, Probe, along, beats, channel, extreme
from robomirror_drake.goals.quantities import QUANTITIES, Quantity, quantities_of
from robomirror_drake.goals.trace import Trace, make_trace
from robomirror_drake.goals.turns import Turns, make_turns
from robomirror_drake.messages import Array
from robomirror_drake.motion.composer.keyed import keyed_actions
from robomirror_drake.motion.library import library
from robomirror_drake.motion.text import Clause
from robomirror_drake.robot import Robot

ASTRAY = math.radians(35.0)
"""How far the way may lead aside of the direction that is wanted [rad]."""
SHORT = 0.2
"""Way from which on its direction is looked at, and up to which it is none [m]."""
FAINT = 0.01
"""Figure up to which nothing can be told from noise [m], [rad], [s]."""
FEWER = 0.6
"""Share of the usual repetitions that do where the words name no number."""

_COUNTED: dict[Channel, tuple[Channel, ...]] = {
    "left_hand": ("left_hand", "right_hand", "hands_in_turn"),
    "hands": ("left_hand", "right_hand", "hands_in_turn"),
    "left_foot": ("left_foot", "right_foot", "lifts"),
    "left_lift": ("lifts", "left_lift", "right_lift"),
    "feet": ("left_foot", "right_foot"),
    "place": ("apart", "lifts"),
    "heading": ("apart", "lifts"),
    "trunk": ("trunk",),
    "height": ("height",),
    "flight": ("flight", "height"),
}
"""Where the beats of an action are looked for, by what it is recognised by."""


@dataclass(frozen=True, eq=False)
class Predicate:
    """One figure of a motion, and what it has to be.

    Attributes:
        name: A quantity of ``assets/goals.yaml``, ``direction`` or ``count``.
        clause: Which clause of the command asks for it, from 0.
        wanted: What it is in the command's own motion.
        least, most: What still does, both included.
        unit: Of these three.
        sentence: The predicate in words.
        mirrored: Whether the other side may do it, as the words leave that open.
        probe: How it is read off a trace.
    """

    name: str
    clause: int
    wanted: float
    least: float
    most: float
    unit: str
    sentence: str
    mirrored: bool
    probe: Probe

    def score(self, value: float) -> float:
        """How near a figure is to what is wanted, from 0 to 1; more than wanted may do as well."""
        if self.wanted <= self.least:  # only a limit
            return min(1.0, self.most / value) if value > 0.0 else 1.0
        if value <= self.wanted:
            return max(0.0, value / self.wanted)
        return 1.0 if math.isinf(self.most) else self.wanted / value

    def met(self, value: float) -> bool:
        """Whether a figure does."""
        return self.least <= value <= self.most


@dataclass(frozen=True, eq=False)
class Goals:
    """What a command means.

    Attributes:
        clauses: The command, parsed.
        predicates: All of them, in the order of the clauses.
        turns: When each clause has its turn in the command's own motion.
    """

    clauses: tuple[Clause, ...]
    predicates: tuple[Predicate, ...]
    turns: Turns


def make_goals(robot: Robot, clauses: tuple[Clause, ...], nominal: Array) -> Goals:
    """The predicates of a command.

    Args:
        robot: The robot.
        clauses: What :func:`robomirror_drake.motion.text.parse` makes of the command.
        nominal: (T, 30) the command's own motion on the robot at 60 Hz, Drake order: the
            reference of the first candidate, or the plan made from it.

    Raises:
        ValueError: There is no clause, or ``nominal`` is no motion of the robot.
    """
    if not clauses:
        raise ValueError("a command without a clause has no goals")
    trace = make_trace(robot, nominal)
    turns = make_turns(clauses, trace)
    predicates = [
        predicate
        for number, (clause, (start, stop)) in enumerate(zip(clauses, turns.bounds, strict=True))
        for predicate in _of_clause(clause, number, trace.window(int(start), int(stop)))
    ]
    return Goals(clauses, tuple(predicates), turns)


def _of_clause(clause: Clause, number: int, nominal: Trace) -> list[Predicate]:
    """The predicates of one clause, whose turn in the command's own motion is ``nominal``."""
    names = quantities_of()[clause.action]
    every = [_predicate(clause, number, name, QUANTITIES[name], nominal) for name in names]
    # A jump that hardly leaves the floor is not asked to; something is asked for in any case.
    clear = [p for p in every if p.wanted > FAINT or QUANTITIES[p.name].limit is not None]
    made = clear or every
    if any(p.name == "travel" and p.wanted > SHORT for p in made):
        made.append(_direction(clause, number, nominal))
    if "place" not in names and _stays(clause, nominal):
        made.append(_predicate(clause, number, "place", QUANTITIES["place"], nominal))
    counted = _count(clause, number, nominal)
    return made if counted is None else [*made, counted]


def _predicate(
    clause: Clause, number: int, name: str, quantity: Quantity, nominal: Trace
) -> Predicate:
    sizes = [np.linalg.norm(extreme(channel(nominal, c))) for c in quantity.channels]
    acting = int(np.argmax(sizes))
    chosen = quantity.channels[acting - 1 if quantity.other else acting]
    probe = along(quantity.kind, chosen, nominal)
    unit, limit = quantity.unit, quantity.limit
    if limit is not None:
        wanted, least, most = 0.0, 0.0, limit
        wish = f"at most {most:.2f} {unit}"
    else:
        wanted = probe.read(nominal)
        least, most = quantity.share * wanted, quantity.most * wanted
        to = f" to {most:.2f}" if math.isfinite(most) else " or more"
        wish = f"{least:.2f}{to} {unit} (as meant: {wanted:.2f})"
    sentence = f"{clause.action}: {quantity.words} {wish}"
    return Predicate(name, number, wanted, least, most, unit, sentence, _open(clause), probe)


def _direction(clause: Clause, number: int, nominal: Trace) -> Predicate:
    probe = along("aside", "place", nominal)
    sentence = f"{clause.action}: goes there within {math.degrees(ASTRAY):.0f}° of the direction"
    return Predicate("direction", number, 0.0, 0.0, ASTRAY, "rad", sentence, _open(clause), probe)


def _count(clause: Clause, number: int, nominal: Trace) -> Predicate | None:
    """How often, where the words say it or the action repeats by itself, and it shows."""
    keyed = keyed_actions().get(clause.action)
    usual = keyed.repeats if keyed is not None and keyed.beat else 0
    times = clause.count or (usual if usual > 1 and not library()[clause.action].clip else 0)
    if times < 1:
        return None
    shown, probe = _beats(clause, times, nominal)
    if probe is None:
        return None
    said = clause.count is not None
    least = float(shown if said else math.ceil(FEWER * shown))
    most = float(shown) if said else math.inf
    words = f"{times} times" if said else f"{least:.0f} times at least, usually {times}"
    also = "" if shown == times else f", which shows {shown} times"
    sentence = f"{clause.action}: does it {words}{also}"
    return Predicate("count", number, float(shown), least, most, "", sentence, _open(clause), probe)


def _beats(clause: Clause, times: int, nominal: Trace) -> tuple[int, Probe | None]:
    """How often something of a clause shows that is done so many times, and how that is read."""
    read = (QUANTITIES[name].channels[0] for name in quantities_of()[clause.action])
    places = tuple(dict.fromkeys(place for c in read for place in _COUNTED.get(c, ())))
    if clause.group != "locomotion":
        return times, beats(nominal, places, times)
    # Who walks may set the feet together with the last step; sideways, with every other one.
    for place in places:
        for shown in (s for s in (times, times - 1, times + 1, times // 2) if s > 0):
            probe = beats(nominal, (place,), shown)
            if probe is not None:
                return shown, probe
    return times, None


def _stays(clause: Clause, nominal: Trace) -> bool:
    """Whether what is meant stays where it is; a recording's other take may not."""
    if clause.group == "locomotion" or clause.accompanies or library()[clause.action].clip:
        return False
    return bool(np.linalg.norm(nominal.place, axis=1).max() < SHORT)


def _open(clause: Clause) -> bool:
    """Whether the words leave open which side does it."""
    return clause.side not in ("left", "right")
