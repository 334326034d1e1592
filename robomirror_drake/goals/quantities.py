"""The quantities that actions are recognised by, and which action by which."""

from __future__ import annotations

import math
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import yaml

from robomirror_drake.goals.probes import Channel, Kind
from robomirror_drake.motion.library import library


class Quantity(NamedTuple):
    """One quantity.

    Attributes:
        kind: How it is read off a motion.
        channels: Off what; of two, the acting side's is the one that moves more in the
            command's own motion.
        unit: Its unit.
        words: What it is, after "the robot" and before "at least so much".
        share: Of what it is in the command's own motion, the least that still means the same.
        most: Likewise the most.
        other: Whether it is the side that does not act.
        limit: The most, whatever the command's own motion does; then there is no least.
    """

    kind: Kind
    channels: tuple[Channel, ...]
    unit: str
    words: str
    share: float = 0.6
    most: float = math.inf
    other: bool = False
    limit: float | None = None


_HANDS: tuple[Channel, ...] = ("left_hand", "right_hand")
_FEET: tuple[Channel, ...] = ("left_foot", "right_foot")
_LIFTS: tuple[Channel, ...] = ("left_lift", "right_lift")

QUANTITIES: dict[str, Quantity] = {
    "travel": Quantity("net", ("place",), "m", "gets ahead that way", most=1.7),
    "away": Quantity("reach", ("place",), "m", "gets away that way", most=1.8),
    "way": Quantity("total", ("place",), "m", "covers a way of", most=1.8),
    "turn": Quantity("net", ("heading",), "rad", "turns that way", most=1.5),
    "turning": Quantity("total", ("heading",), "rad", "turns to and fro"),
    "low": Quantity("reach", ("height",), "m", "lowers the pelvis"),
    "bounce": Quantity("span", ("height",), "m", "moves the pelvis up and down", 0.4),
    "lean": Quantity("near", ("trunk",), "rad", "bends or turns the trunk that way"),
    "hand": Quantity("near", _HANDS, "m", "moves the hand that way"),
    "other_hand": Quantity("near", _HANDS, "m", "moves the other hand that way", other=True),
    # A guard is half of a strike already.
    "strike": Quantity("near", _HANDS, "m", "strikes that far with the hand", 0.75),
    "hands": Quantity("near", ("hands",), "m", "moves the hands that way"),
    "arms": Quantity("total", ("hands",), "m", "moves the hands along a way of", 0.4),
    "foot": Quantity("near", _FEET, "m", "moves the foot that way"),
    "other_foot": Quantity("near", _FEET, "m", "moves the other foot that way", other=True),
    "feet": Quantity("near", ("feet",), "m", "moves the feet that way"),
    "lift": Quantity("reach", _LIFTS, "m", "lifts the foot", 0.35),
    "other_lift": Quantity("reach", _LIFTS, "m", "lifts the other foot", 0.35, other=True),
    "aloft": Quantity("time", _LIFTS, "s", "keeps a foot off the floor for"),
    "flight": Quantity("reach", ("flight",), "m", "takes both soles off the floor", 0.4),
    "place": Quantity("still", ("place",), "m", "goes away from its place", limit=0.4),
    "quiet": Quantity("total", ("hands",), "m", "moves the hands along a way of", limit=0.8),
}


@cache
def quantities_of() -> dict[str, tuple[str, ...]]:
    """By which quantities each action of the library is recognised, from ``assets/goals.yaml``.

    Raises:
        ValueError: The file misses an action, or names an action or a quantity that is none.
    """
    text = files("robomirror_drake.assets").joinpath("goals.yaml").read_text(encoding="utf-8")
    told = {name: tuple(of) for name, of in yaml.safe_load(text).items()}
    if lost := library().keys() ^ told.keys():
        raise ValueError(f"goals.yaml and actions.yaml differ in {', '.join(sorted(lost))}")
    if unknown := {name for of in told.values() for name in of} - QUANTITIES.keys():
        raise ValueError(f"goals.yaml: {', '.join(sorted(unknown))}: no such quantity")
    return told
