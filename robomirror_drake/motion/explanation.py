"""What the motion library knows, and how it understands a command, for people and programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from robomirror_drake.motion.library import library
from robomirror_drake.motion.mocap import list_clips
from robomirror_drake.motion.text import parse


def listing() -> dict[str, Any]:
    """Every action and clip."""
    keys = {"name", "group", "description", "side"}
    return {
        "actions": [action.model_dump(include=keys) for action in library().values()],
        "clips": list(list_clips()),
    }


def of(text: str) -> dict[str, Any]:
    """How a command is understood: ``text``, and ``clauses`` in the order in which they are done.

    A clause tells what :class:`~robomirror_drake.motion.text.Clause` does, with the action's
    description and with ``relation``, ``follows`` or ``accompanies``; angles in rad, lengths in m.

    Raises:
        InputError: It cannot be used.
        UnknownCommandError: A clause names no known action; the nearest ones are in it.
    """
    clauses = [
        asdict(clause)
        | {
            "relation": "accompanies" if clause.accompanies else "follows",
            "description": library()[clause.action].description,
        }
        for clause in parse(text)
    ]
    return {"text": text, "clauses": clauses}


def print_listing(console: Console) -> None:
    """Prints a table of the actions, and the names of the clips."""
    table = Table("action", "group", "a person …", "for example")
    for action in library().values():
        table.add_row(action.name, action.group, action.description, action.paraphrases[1])
    console.print(table)
    console.print(f"clips, as clip:NAME: {', '.join(list_clips())}")


def print_clauses(figures: dict[str, Any], console: Console) -> None:
    """Prints a table of what :func:`of` tells."""
    table = Table("", "words", "action", "group", "side", "count", "tempo", "size", "angle [°]",
                  "distance [m]", "speed [m/s]", "sure")  # fmt: skip
    for clause in figures["clauses"]:
        angle = clause["angle"]
        cells = [
            "along with it" if clause["accompanies"] else "then" if table.row_count else "",
            clause["text"], clause["action"], clause["group"], clause["side"], clause["count"],
            clause["tempo"], clause["amplitude"], None if angle is None else np.rad2deg(angle),
            clause["distance"], clause["speed"], clause["score"],
        ]  # fmt: skip
        table.add_row(*(_cell(cell) for cell in cells))
    console.print(table)


def _cell(value: object) -> str:
    if value is None:
        return "·"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
