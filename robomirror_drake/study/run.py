"""Runs a study: screens commands until there are enough, then compares the variants on them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from robomirror_drake.config import Scenario
from robomirror_drake.dataset.folder import describe, description, difference, locked
from robomirror_drake.dataset.pool import Pool, here
from robomirror_drake.dataset.prompts import Prompt, read_prompts, write_prompts
from robomirror_drake.exceptions import InputError, ResultError
from robomirror_drake.ppn.ensemble import load_ensemble
from robomirror_drake.ppn.predictor import load_predictor
from robomirror_drake.results import installed_versions
from robomirror_drake.robot import load_robot
from robomirror_drake.study.choose import Choice, choose, order_of
from robomirror_drake.study.options import CLOSED, FORESEEING, StudyOptions
from robomirror_drake.study.records import RESULTS, SCREENED, Job, Row
from robomirror_drake.study.store import Part, write_file
from robomirror_drake.study.unit import (
    compare,
    comparison_failed,
    screen,
    screening_failed,
)

Map = Callable[
    [Iterable[Job], Callable[[Job], Any], Callable[[Job, BaseException], Any]],
    Iterator[tuple[Job, Any]],
]
Report = Callable[[str, int, int], None]
"""Called with what is done, how many commands are done, and how many there are to do."""


class Study(NamedTuple):
    """What a study has found.

    Attributes:
        options: Of the study.
        scenario: All other settings.
        screened: A row for each command whose own motion was executed, in their order.
        results: A row for each command and variant, command by command.
        damaged: What was wrong with files that were made anew.
    """

    options: StudyOptions
    scenario: Scenario
    screened: list[Row]
    results: list[Row]
    damaged: tuple[str, ...]


class Work(NamedTuple):
    """What is done for a command; the real thing, but for tests of what is around it."""

    screen: Callable[[Job], Row] = screen
    compare: Callable[[Job], list[Row]] = compare


def commands_of(options: StudyOptions) -> tuple[Prompt, ...]:
    """The commands that a study chooses from.

    Raises:
        InputError: There is no such file, or none of the splits has a command.
    """
    prompts = read_prompts(options.prompts)
    wanted = tuple(one for one in prompts if not options.splits or one.split in options.splits)
    if not wanted:
        raise InputError(f"{options.prompts} has no command in {' or '.join(options.splits)}")
    return wanted


def run_study(
    options: StudyOptions,
    scenario: Scenario,
    prompts: Sequence[Prompt],
    folder: Path,
    *,
    workers: int | None = None,
    address: str | None = None,
    limit: int | None = None,
    report: Report | None = None,
    screened_in: Path | None = None,
    work: Work = Work(),  # noqa: B008 (a constant)
    weights: str | None = None,
) -> Study:
    """Compares the variants of a study; goes on where an earlier run ended.

    Args:
        options: Of the study.
        scenario: All other settings.
        prompts: The commands to choose from.
        folder: Where to write, see :mod:`robomirror_drake.study.store`.
        workers: Processes, as many as there are cores where None; 0 works in this one.
        address: Of a Ray cluster whose machines have this package; else this one works.
        limit: Commands of each kind, failing and succeeding, at most.
        report: Called after each command.
        screened_in: Folder of a study in the same physics, from the same commands: how their own
            motions end is taken from there, and what became of its pools.
        work: What is done for each.
        weights: Fingerprint of the predictor's; found out where None.

    Raises:
        ConfigError: The scenario's predictor cannot be used.
        InputError: The folder holds another study, or another run is writing to it.
        ResultError: The folder cannot be written to.
    """
    told = {
        "format": 1,
        "options": options.model_dump(mode="json"),
        "scenario": scenario.model_dump(mode="json", exclude={"command", "seed", "candidates"}),
        "commands": _fingerprint(one.model_dump_json() for one in prompts),
        "weights": weights or fingerprint(options, scenario),
        "screening": _screening(options, scenario),
        "versions": installed_versions(),
    }
    tell = report or (lambda _words, _done, _total: None)
    damaged: list[str] = []
    with locked(folder), _mapping(workers, address) as mapped:
        describe(folder, "study.json", told, "study")
        earlier: dict[int, list[Row]] = {}
        if screened_in is not None:
            earlier = _take_over(screened_in, folder, told, damaged)
        jobs = [Job(n, prompt, options, scenario) for n, prompt in enumerate(prompts)]
        chosen, screened = _screen(jobs, folder, damaged, mapped, tell, work, limit)
        results = _compare(
            [
                jobs[n]._replace(screened=screened[n], earlier=tuple(earlier.get(n, ())))
                for n in chosen
            ],
            folder, damaged, mapped, tell, work,
        )  # fmt: skip
        ordered = [screened[n] for n in sorted(screened)]
        write_file(folder / "screened.parquet", ordered, SCREENED)
        write_file(folder / "results.parquet", results, RESULTS)
        write_prompts(folder / "commands.csv", [prompts[n] for n in chosen])
    return Study(options, scenario, ordered, results, tuple(damaged))


def _screen(
    jobs: Sequence[Job],
    folder: Path,
    damaged: list[str],
    mapped: Map,
    tell: Report,
    work: Work,
    limit: int | None,
) -> tuple[list[int], dict[int, Row]]:
    """The commands to compare on, and how the own motions of all that were looked at end."""
    options = jobs[0].options
    part = Part(folder / "screened", SCREENED)
    found = {number: rows[0] for number, rows in part.read(damaged).items()}
    order = order_of([job.prompt for job in jobs], options.seed)
    failing, succeeding = (
        wanted if limit is None else min(wanted, limit)
        for wanted in (options.failing, options.succeeding)
    )

    def chosen() -> Choice:
        states = {n: row["state"] for n, row in found.items()}
        made = choose(order, states, failing, succeeding, options.patience)
        have = len(made.failing) + len(made.succeeding)
        tell("looking for commands that fall", have, failing + succeeding)
        return made

    while (choice := chosen()).more:
        for job, row in mapped((jobs[n] for n in choice.more), work.screen, screening_failed):
            (found[job.number],) = part.write(job.number, [row])
            chosen()
    return [*choice.failing, *choice.succeeding], found


def _screening(options: StudyOptions, scenario: Scenario) -> dict[str, Any]:
    """All that decides how the own motion of a command ends."""
    simulated = {"generator", "retargeter", "planner", "simulation", "robot"}
    return {
        "seed": options.seed,
        "longest": options.longest,
        "level": options.grid.levels[0].disturbance.model_dump(mode="json"),
        "scenario": scenario.model_dump(mode="json", include=simulated),
    }


def _take_over(
    other: Path, folder: Path, told: Mapping[str, Any], damaged: list[str]
) -> dict[int, list[Row]]:
    """Copies how own motions ended in another study.

    Returns:
        By command, its rows of methods that do not look at what is foreseen; none where the pools
        were not simulated as far, or were disturbed in another way.

    Raises:
        InputError: There is no study, or of other physics or commands.
    """
    try:
        there = description(other, "study.json")
    except ResultError as error:
        raise InputError(f"{other} holds no study: {error}") from error
    pair = ({key: one.get(key) for key in ("commands", "screening")} for one in (there, told))
    if found := difference(*(json.loads(json.dumps(part)) for part in pair)):
        raise InputError(f"own motions end otherwise in the study of {other}: {found}")
    part = Part(folder / "screened", SCREENED)
    own = part.read(damaged)
    for number, rows in Part(other / "screened", SCREENED).read(damaged, mend=False).items():
        if number not in own:
            part.write(number, rows)
    simulated = [_simulated(one["options"]) for one in (there, told)]
    if simulated[0] is None or simulated[0] != simulated[1]:
        return {}
    results = Part(other / "results", RESULTS).read(damaged, mend=False)
    return {
        number: [row for row in rows if row["method"] not in FORESEEING and not row["failure"]]
        for number, rows in results.items()
    }


def _simulated(options: Mapping[str, Any]) -> str | None:
    """What decides what is known of how pools end; None where that is only what was chosen."""
    known = [options["simulated"], options["draws"], options["grid"]["levels"]]
    return None if options["simulated"] == "chosen" else json.dumps(known)


def _compare(
    jobs: Sequence[Job],
    folder: Path,
    damaged: list[str],
    mapped: Map,
    tell: Report,
    work: Work,
) -> list[Row]:
    """The rows of these commands, in their order."""
    part = Part(folder / "results", RESULTS)
    found: dict[int, list[Row]] = part.read(damaged)
    missing = [job for job in jobs if job.number not in found]
    tell("adapting", len(jobs) - len(missing), len(jobs))
    for done, (job, rows) in enumerate(mapped(missing, work.compare, comparison_failed), 1):
        found[job.number] = part.write(job.number, rows)
        tell("adapting", len(jobs) - len(missing) + done, len(jobs))
    return [row for job in jobs for row in found[job.number]]


@contextmanager
def _mapping(workers: int | None, address: str | None) -> Iterator[Map]:
    """What does units of work, here or on Ray; that is started only where there is work."""
    if workers == 0:
        yield lambda jobs, work, _failed: here(jobs, work)
        return
    with ExitStack() as stack:
        pool: list[Pool] = []

        def mapped(
            jobs: Iterable[Job],
            work: Callable[[Job], Any],
            failed: Callable[[Job, BaseException], Any],
        ) -> Iterator[tuple[Job, Any]]:
            waiting = list(jobs)
            if waiting and not pool:
                pool.append(stack.enter_context(Pool(workers, address)))
            return pool[0].map(waiting, work, failed) if waiting else iter(())

        yield mapped


def fingerprint(options: StudyOptions, scenario: Scenario) -> str:
    """Of the weights that foresee falls.

    Raises:
        ConfigError: There are no such weights, or they are of another robot.
    """
    robot = load_robot(scenario.robot)
    used = [*load_ensemble(scenario.adaptation.predictor, robot).members]
    if set(options.grid.methods) & set(CLOSED):
        used.append(load_predictor(options.adapter.predictor, robot))
    networks = [one.network.state_dict() for one in used]
    return _fingerprint(one[name].numpy().tobytes() for one in networks for name in sorted(one))


def _fingerprint(parts: Iterable[str | bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else part.encode())
    return digest.hexdigest()
