"""Makes a data set: hands out the commands that are not done yet, and keeps what comes back."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robomirror_drake.config import Scenario
from robomirror_drake.dataset.folder import describe, locked
from robomirror_drake.dataset.options import DatasetOptions
from robomirror_drake.dataset.pool import Pool, here
from robomirror_drake.dataset.prompts import Prompt
from robomirror_drake.dataset.records import Job
from robomirror_drake.dataset.shards import (
    Shard,
    Store,
    check,
    merge,
    read_episodes,
    remove,
    write_shard,
)
from robomirror_drake.dataset.unit import Made, failed, make
from robomirror_drake.results import installed_versions

Work = Callable[[Job], Made]
"""What is done for a command; :func:`make`, but for tests of what is around it."""


@dataclass
class Progress:
    """How far a run has come.

    Attributes:
        total: Commands asked for.
        done: Commands that are done, by earlier runs too.
        done_here: Commands that this run did.
        episodes, fell, failed: Executions of this run, how many fell, and how many failed.
        simulated_s: Time simulated in this run [s].
        elapsed_s: Since its beginning [s].
        workers: Processes.
        damaged: What was wrong with files that are made anew.
    """

    total: int
    done: int = 0
    done_here: int = 0
    episodes: int = 0
    fell: int = 0
    failed: int = 0
    simulated_s: float = 0.0
    elapsed_s: float = 0.0
    workers: int = 1
    damaged: tuple[str, ...] = ()


def generate_dataset(
    prompts: Sequence[Prompt],
    options: DatasetOptions,
    scenario: Scenario,
    folder: Path,
    *,
    workers: int | None = None,
    address: str | None = None,
    limit: int | None = None,
    report: Callable[[Progress], None] | None = None,
    work: Work = make,
) -> Progress:
    """Executes commands and writes what happens; goes on where an earlier run ended.

    Args:
        prompts: The commands.
        options: Of the data set.
        scenario: All other settings; its command, seed and candidates are not used.
        folder: Where to write, see :mod:`robomirror_drake.dataset.shards`.
        workers: Processes, as many as there are cores where None; 0 works in this one,
            without Ray.
        address: Of a Ray cluster whose machines have this package; else this one works.
        limit: Only the first so many commands.
        report: Called after each command.
        work: What is done for each.

    Raises:
        InputError: The folder holds another data set, or another run is writing to it.
        ResultError: The folder cannot be written to.
    """
    wanted = len(prompts) if limit is None else min(limit, len(prompts))
    store, began = Store(folder), time.monotonic()
    with locked(folder):
        _describe(folder, prompts, options, scenario)
        progress = Progress(total=wanted)
        done = _recover(store, progress)
        progress.done = len(done & set(range(wanted)))
        jobs = [
            Job(number, prompts[number], options, scenario)
            for number in range(wanted)
            if number not in done
        ]
        with _results(jobs, work, workers, address, progress) as results:
            for job, made in results:
                _keep(store, job, made)
                done.add(job.number)
                _count(progress, made, time.monotonic() - began)
                _merge_group(store, job.number // options.group, options.group, wanted, done)
                if report is not None:
                    report(progress)
        for group in {int(part.episodes.stem) // options.group for part in store.parts()}:
            _merge_group(store, group, options.group, wanted, done)
    return progress


@contextmanager
def _results(
    jobs: list[Job], work: Work, workers: int | None, address: str | None, progress: Progress
) -> Iterator[Iterable[tuple[Job, Made]]]:
    if not jobs or workers == 0:
        yield here(jobs, work)
        return
    with Pool(workers, address) as pool:
        progress.workers = pool.workers
        yield pool.map(jobs, work, failed)


def _describe(
    folder: Path, prompts: Sequence[Prompt], options: DatasetOptions, scenario: Scenario
) -> None:
    """Writes what the data set is, or makes sure that it is the same as what is there.

    Raises:
        InputError: It is another one; the message names the first difference.
    """
    texts = "\n".join(prompt.model_dump_json() for prompt in prompts)
    unused = {"command", "seed", "candidates", "adaptation"}
    settings = scenario.model_dump(mode="json", exclude=unused)
    told: dict[str, Any] = {
        "format": 1,
        "options": options.model_dump(mode="json"),
        "scenario": settings,
        "prompts": {"count": len(prompts), "sha256": hashlib.sha256(texts.encode()).hexdigest()},
        "versions": installed_versions(),
    }
    describe(folder, "dataset.json", told, "data set")


def _recover(store: Store, progress: Progress) -> set[int]:
    """Clears away what a kill has left, and returns the commands that are done."""
    for partial in store.folder.rglob(".*.partial"):
        partial.unlink()
    done: set[int] = set()
    damaged = []
    for shard in store.groups():
        if fault := check(shard):
            damaged.append(fault)
            _put_aside(shard, store.folder / "damaged")
        else:
            done |= set(read_episodes(shard)["prompt_index"].to_pylist())
    for shard in store.parts():
        number = int(shard.episodes.stem)
        fault = None if number in done else check(shard)
        if fault is not None:
            damaged.append(fault)
        if fault is not None or number in done:
            remove([shard])
        else:
            done.add(number)
    progress.damaged = tuple(damaged)
    return done


def _put_aside(shard: Shard, folder: Path) -> None:
    """Moves files out of the way that are made anew."""
    for file in shard:
        if file.exists():
            (folder / file.parent.name).mkdir(parents=True, exist_ok=True)
            file.rename(folder / file.parent.name / file.name)


def _keep(store: Store, job: Job, made: Made) -> None:
    """Writes a command's files, and what it took before that."""
    with (store.folder / "timing.jsonl").open("a", encoding="utf-8") as log:
        log.write(json.dumps(made.timing) + "\n")
    write_shard(store.part(job.number), made.episodes, made.frames)


def _merge_group(store: Store, group: int, size: int, wanted: int, done: set[int]) -> None:
    """Merges a group's parts as soon as all of its commands that are asked for are done."""
    numbers = range(group * size, min((group + 1) * size, wanted))
    if not done.issuperset(numbers):
        return
    inside = {number: store.part(number) for number in numbers}
    there = [number for number, part in inside.items() if part.episodes.exists()]
    if there:
        merge([inside[number] for number in there], store.group(there[0], there[-1]))


def _count(progress: Progress, made: Made, elapsed: float) -> None:
    progress.done += 1
    progress.done_here += 1
    progress.episodes += made.timing["episodes"]
    progress.fell += made.timing["fell"]
    progress.failed += made.timing["failed"]
    progress.simulated_s += made.timing["simulated_s"]
    progress.elapsed_s = elapsed
