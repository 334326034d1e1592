"""Every action of the library executed once, to see what the robot can do."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import InputError, RoboMirrorError
from robomirror_drake.motion.library import library
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS
from robomirror_drake.run import run


@dataclass(frozen=True)
class Row:
    """One execution; times in s, errors as in :class:`~robomirror_drake.messages.Outcome`."""

    action: str
    group: str
    command: str
    seed: int
    fell: bool | None = None
    fall_time_s: float | None = None
    fall_cause: str | None = None
    A_q: float | None = None
    A_p: float | None = None
    distance_to_raw: float | None = None
    torque_saturation: float | None = None
    error: str | None = None


def survey_rows(
    scenario: Scenario,
    names: tuple[str, ...] = (),
    jobs: int = 2,
    report: Callable[[int, int], None] | None = None,
) -> list[Row]:
    """Executes actions, each with a hold at its end, in processes of their own.

    Args:
        scenario: The settings; one candidate is made for each action, the nominal one.
        names: Actions, or ``clip:NAME``; empty for all actions and all clips on the feet.
        jobs: Processes.
        report: Called with how many are done, and how many there are.

    Raises:
        InputError: A name is not known.
    """
    commands = _commands(names)
    if jobs < 1:
        raise InputError(f"{jobs} processes asked for; give 1 or more")
    done: dict[str, Row] = {}
    # Spawned, not forked: Drake and numba have threads by now.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(commands)), mp_context=context) as pool:
        futures = [
            pool.submit(_row, name, group, scenario.model_copy(update=update))
            for name, (group, command) in commands.items()
            for update in ({"command": command, "candidates": 1},)
        ]
        for future in as_completed(futures):
            row = future.result()
            done[row.action] = row
            if report is not None:
                report(len(done), len(commands))
    return [done[name] for name in commands]


def _commands(names: tuple[str, ...]) -> dict[str, tuple[str, str]]:
    """Group and command of each name, in the library's order."""
    known: dict[str, tuple[str, str]] = {
        name: (a.group, a.paraphrases[0]) for name, a in library().items()
    }
    clips = {f"clip:{name}": ("mocap", f"clip:{name}") for name in FEET_ONLY_CLIPS}
    known = known | clips
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"no actions {', '.join(unknown)}; known: {', '.join(known)}")
    return {name: value for name, value in known.items() if not names or name in names}


def _row(name: str, group: str, scenario: Scenario) -> Row:
    try:
        result = run(scenario)
    except RoboMirrorError as error:
        return Row(name, group, scenario.command, scenario.seed, error=str(error))
    outcome = result.outcome
    return Row(
        action=name,
        group=group,
        command=scenario.command,
        seed=scenario.seed,
        fell=outcome.fell,
        fall_time_s=outcome.fall_time_s,
        fall_cause=outcome.fall_cause,
        A_q=outcome.A_q,
        A_p=outcome.A_p,
        distance_to_raw=result.reference.residuals.get("distance_to_raw"),
        torque_saturation=outcome.torque_saturation,
    )


def print_survey(rows: list[Row], console: Console) -> None:
    """Prints a table of the rows and how many of each group stayed upright."""
    table = Table("action", "group", "outcome", "joints [rad]", "root [cm]", "from raw [cm]")
    for row in rows:
        if row.error is not None:
            outcome = f"[yellow]{escape(row.error)}"
        elif row.fell:
            outcome = f"[red]fell at {row.fall_time_s:.2f} s ({row.fall_cause})"
        else:
            outcome = "[green]upright"
        table.add_row(
            row.action,
            row.group,
            outcome,
            _number(row.A_q, 1.0),
            _number(row.A_p, 100.0),
            _number(row.distance_to_raw, 100.0),
        )
    console.print(table)
    for group in dict.fromkeys(row.group for row in rows):
        of_group = [row for row in rows if row.group == group]
        upright = sum(row.fell is False for row in of_group)
        console.print(f"{group}: {upright} of {len(of_group)} upright")


def _number(value: float | None, factor: float) -> str:
    return "" if value is None else f"{factor * value:.3g}"
