"""What a data set holds, what its making took, and what more of it would take."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

from robomirror_drake.dataset.shards import read_shards
from robomirror_drake.exceptions import ResultError

Number = TypeVar("Number", int, float)

PAPER_EPISODES: Final = 255_000
"""Executions of the paper's data set."""


@dataclass
class Tally:
    """Counts of some episodes.

    Attributes:
        episodes: How many.
        failed: How many could not be executed.
        fell: How many ended in a fall.
        seconds: Time simulated.
        causes: Falls by cause, or by condition where the cause was not looked for.
    """

    episodes: int = 0
    failed: int = 0
    fell: int = 0
    seconds: float = 0.0
    causes: dict[str, int] = field(default_factory=dict)

    def add(self, row: dict[str, Any]) -> None:
        """Counts an episode."""
        self.episodes += 1
        self.failed += row["failed_stage"] is not None
        self.seconds += row["duration_s"] or 0.0
        if row["fell"]:
            self.fell += 1
            _increase(self.causes, row["cause"] or row["fall_cause"], 1)

    @property
    def fall_share(self) -> float:
        """Share of falls among what was executed; NaN where nothing was."""
        executed = self.episodes - self.failed
        return self.fell / executed if executed else float("nan")


@dataclass
class Cost:
    """What the making took.

    Attributes:
        prompts: Commands that it is known of.
        cpu_s: Processor time by stage [s].
        wall_s: Time of workers in all [s].
        simulated_s: Time simulated [s].
        episodes: Executions.
    """

    prompts: int = 0
    cpu_s: dict[str, float] = field(default_factory=dict)
    wall_s: float = 0.0
    simulated_s: float = 0.0
    episodes: int = 0

    def add(self, timing: dict[str, Any]) -> None:
        """Counts a command."""
        self.prompts += 1
        for stage, spent in timing["cpu_s"].items():
            _increase(self.cpu_s, stage, spent)
        self.wall_s += timing["wall_s"]
        self.simulated_s += timing["simulated_s"]
        self.episodes += timing["episodes"]

    @property
    def all_cpu_s(self) -> float:
        """Processor time of all stages [s]."""
        return sum(self.cpu_s.values())

    def rate(self, stage: str | None = None) -> float:
        """Simulated seconds per second of one core, of one stage or of all together."""
        spent = self.all_cpu_s if stage is None else self.cpu_s[stage]
        return self.simulated_s / spent if spent else float("nan")

    def wall_rate(self) -> float:
        """Simulated seconds per second of one worker, waiting for a core included."""
        return self.simulated_s / self.wall_s if self.wall_s else float("nan")

    def paper_hours(self, cores: int = 1) -> float:
        """Hours that the paper's number of executions would take on so many cores."""
        if not self.episodes:
            return float("nan")
        return PAPER_EPISODES * self.all_cpu_s / self.episodes / 3600.0 / cores


@dataclass
class Summary:
    """What is known of a data set; ``by`` has tallies by what, and by its value."""

    total: Tally
    prompts: int
    by: dict[str, dict[str, Tally]]
    failures: dict[str, int]
    cost: Cost
    damaged: list[str]


def summarise(folder: Path) -> Summary:
    """Reads all episodes of a data set; damaged shards are named and skipped.

    Raises:
        ResultError: The folder holds no data set.
    """
    if not (folder / "dataset.json").is_file():
        raise ResultError(f"{folder} is no data set: there is no dataset.json in it")
    summary = Summary(
        total=Tally(),
        prompts=0,
        by={name: {} for name in ("group", "split", "family", "kind", "action")},
        failures={},
        cost=_cost(folder / "timing.jsonl"),
        damaged=[],
    )
    wanted = [
        "prompt_index", "group", "split", "family", "kind", "actions", "failed_stage", "failure",
        "duration_s", "fell", "fall_cause", "cause",
    ]  # fmt: skip
    for _, episodes in read_shards(folder, summary.damaged):
        rows = episodes.select(wanted).to_pylist()
        summary.prompts += len({row["prompt_index"] for row in rows})
        for row in rows:
            _add(summary, row)
    return summary


def _add(summary: Summary, row: dict[str, Any]) -> None:
    summary.total.add(row)
    for name in ("group", "split", "kind"):
        summary.by[name].setdefault(row[name] or "unknown", Tally()).add(row)
    if row["family"]:
        summary.by["family"].setdefault(row["family"], Tally()).add(row)
    for action in set(row["actions"]):
        summary.by["action"].setdefault(action, Tally()).add(row)
    if row["failed_stage"] is not None:
        _increase(summary.failures, f"{row['failed_stage']}: {row['failure']:.80}", 1)


def _increase(counts: dict[str, Number], key: str, by: Number) -> None:
    counts[key] = counts.get(key, 0) + by


def _cost(log: Path) -> Cost:
    """The last entry of each command; a line that a kill has cut short counts for nothing."""
    entries = {}
    if log.is_file():
        for line in log.read_text(encoding="utf-8").splitlines():
            try:
                entry = json.loads(line)
                entries[entry["prompt_index"]] = entry
            except (ValueError, KeyError, TypeError):
                continue
    cost = Cost()
    for entry in entries.values():
        cost.add(entry)
    return cost
