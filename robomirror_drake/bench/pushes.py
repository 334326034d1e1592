"""How hard a walking robot can be pushed: directions, sizes and instants of a push."""

from __future__ import annotations

import itertools
import math
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from robomirror_drake.config import Scenario
from robomirror_drake.disturbance import Push
from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Execution, RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.generate import generate
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.outcome import find_fall
from robomirror_drake.robot import load_robot
from robomirror_drake.rollout import rollout

COMMAND: Final = "a person walks forward at 0.4 meters per second"
SPEEDS: Final = (0.3, 0.5)
"""Impulse over mass: how much faster the centre of mass is after the push [m/s]."""

DIRECTIONS: Final = {
    "forward": (1.0, 0.0),
    "left": (0.0, 1.0),
    "backward": (-1.0, 0.0),
    "right": (0.0, -1.0),
}
Case = tuple[RobotReference, Scenario, float, str, float, float]
"""The walk, the settings, then a push as in :class:`Row`: speed, direction, phase, time."""

PHASES: Final = (0.0, 1 / 3, 2 / 3)
"""Of a step, from one lift-off to the next of the other foot."""


@dataclass(frozen=True)
class Row:
    """One push and how it ended.

    Attributes:
        speed: Impulse over mass [m/s].
        direction: As the robot sees it.
        phase: Of the step, 0 to 1.
        time_s: When the push began [s].
        fell: Whether the robot fell.
        fall_time_s: When [s].
    """

    speed: float
    direction: str
    phase: float
    time_s: float
    fell: bool
    fall_time_s: float | None


def step_in_the_middle(reference: RobotReference) -> tuple[float, float]:
    """Lift-offs of two feet, one after the other, half way through a walk [s].

    Raises:
        InputError: There are fewer than two steps in the second half.
    """
    on = np.asarray(reference.contact.any(axis=-1))
    leaves = np.flatnonzero((on[:-1] & ~on[1:]).any(axis=1))
    late = reference.time[leaves[reference.time[leaves] > 0.4 * reference.duration]]
    if len(late) < 2:
        raise InputError(f"{reference.text!r} has too few steps to push in; give a longer walk")
    return float(late[0]), float(late[1])


def run(
    scenario: Scenario,
    command: str = COMMAND,
    speeds: tuple[float, ...] = SPEEDS,
    jobs: int = 2,
    report: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Executes a walk once for every push.

    Args:
        scenario: The settings; other disturbances that are in it stay.
        command: The walk.
        speeds: Sizes of the pushes [m/s].
        jobs: Processes.
        report: Called with how many are done, and how many there are.

    Returns:
        ``command``, ``seed``, ``survived``, ``pushes`` and ``rows``, see :class:`Row`.

    Raises:
        InputError: The walk is too short, or there is no process.
    """
    if jobs < 1:
        raise InputError(f"{jobs} processes asked for; give 1 or more")
    robot = load_robot()
    (motion,) = generate(command, 1, scenario.seed)
    raw = retarget(robot, motion, foot_contacts(motion), scenario.retargeter)
    walk = plan_dynamics(robot, raw, scenario.planner)
    first, second = step_in_the_middle(walk)
    cases = [
        (walk, scenario, speed, direction, phase, first + phase * (second - first))
        for speed, direction, phase in itertools.product(speeds, DIRECTIONS, PHASES)
    ]
    rows = []
    # Spawned, not forked: Drake and numba have threads by now.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(cases)), mp_context=context) as pool:
        for row in pool.map(_row, cases):
            rows.append(row)
            if report is not None:
                report(len(rows), len(cases))
    return {
        "command": command,
        "seed": scenario.seed,
        "survived": sum(not row.fell for row in rows),
        "pushes": len(rows),
        "rows": [asdict(row) for row in rows],
    }


def execute(case: Case) -> Execution:
    """The execution of a walk in which there is one push."""
    walk, scenario, speed, direction, _, time = case
    w, x, y, z = walk.q[np.searchsorted(walk.time, time), :4]
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    ahead, left = DIRECTIONS[direction]
    push = Push(
        time=time,
        speed=(
            speed * (math.cos(yaw) * ahead - math.sin(yaw) * left),
            speed * (math.sin(yaw) * ahead + math.cos(yaw) * left),
            0.0,
        ),
    )
    options = scenario.simulation
    pushes = (*options.disturbance.pushes, push)
    disturbance = options.disturbance.model_copy(update={"pushes": pushes})
    pushed = options.model_copy(update={"disturbance": disturbance})
    with threadpool_limits(1):
        return rollout(load_robot(), walk, pushed, scenario.seed)


def _row(case: Case) -> Row:
    fall = find_fall(execute(case))
    return Row(*case[2:], fell=fall is not None, fall_time_s=None if fall is None else fall.time)


def print_table(figures: dict[str, Any], console: Console) -> None:
    """Prints what :func:`run` has measured: one line a size and direction."""
    table = Table(
        "push [m/s]",
        "direction",
        *(f"at {phase:.2f} of a step" for phase in PHASES),
        title=f"{figures['command']}, seed {figures['seed']}",
    )
    rows = {(row["speed"], row["direction"], row["phase"]): row for row in figures["rows"]}
    for speed, direction in dict.fromkeys((speed, direction) for speed, direction, _ in rows):
        told = (rows[speed, direction, phase] for phase in PHASES)
        table.add_row(
            f"{speed:g}",
            direction,
            *(
                f"[red]fell after {row['fall_time_s'] - row['time_s']:.1f} s"
                if row["fell"]
                else "[green]upright"
                for row in told
            ),
        )
    console.print(table)
    console.print(f"{figures['survived']} of {figures['pushes']} survived")
