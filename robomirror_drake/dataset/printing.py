"""Progress and contents of a data set in words and tables."""

from __future__ import annotations

import time
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robomirror_drake.dataset.generate import Progress
from robomirror_drake.dataset.summary import PAPER_EPISODES, Cost, Summary, Tally


def progress_words(progress: Progress) -> str:
    """Rate, time to go and falls of a run."""
    executed = progress.episodes - progress.failed
    if not executed or not progress.elapsed_s:
        return ""
    rate = progress.simulated_s / progress.elapsed_s
    share = progress.fell / executed
    own = progress.done_here
    left = (progress.total - progress.done) * progress.elapsed_s / own if own else 0.0
    clock = time.strftime("%H:%M:%S", time.gmtime(left % 86_400))
    days = f"{int(left // 86_400)} d " if left >= 86_400 else ""
    return (
        f"{rate:.2f} simulated s/s, {rate / progress.workers:.2f} a worker, "
        f"{days}{clock} to go, {100 * share:.0f} % fell, {progress.failed} failed"
    )


def _ranked(counts: dict[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: -item[1])


def tally_words(tally: Tally) -> str:
    """Counts in one line."""
    return (
        f"{tally.episodes} episodes, {tally.seconds / 3600:.2f} h, {tally.fell} falls "
        f"({100 * tally.fall_share:.1f} %), {tally.failed} failed"
    )


def print_summary(summary: Summary, out: Console) -> None:
    """Prints balance, falls, failures, cost and what was skipped."""
    out.print(f"{summary.prompts} commands, {tally_words(summary.total)}", highlight=False)
    for name, tallies in summary.by.items():
        if not tallies:
            continue
        table = Table(name, "episodes", "share [%]", "hours", "fell [%]", "failed", "causes")
        for value, tally in sorted(tallies.items(), key=lambda item: -item[1].episodes):
            table.add_row(
                escape(value),
                str(tally.episodes),
                f"{100 * tally.episodes / summary.total.episodes:.1f}",
                f"{tally.seconds / 3600:.2f}",
                f"{100 * tally.fall_share:.1f}",
                str(tally.failed),
                ", ".join(f"{cause} {count}" for cause, count in _ranked(tally.causes)),
            )
        out.print(table)
    for failure, count in _ranked(summary.failures)[:10]:
        out.print(f"{count} failed: {failure}", markup=False, highlight=False)
    print_cost(summary.cost, out)
    for fault in summary.damaged:
        out.print(f"skipped: {fault}", style="red", markup=False, highlight=False, soft_wrap=True)


def print_cost(cost: Cost, out: Console) -> None:
    """Rates by stage, and the paper's data set on some numbers of cores."""
    if not cost.all_cpu_s:
        return
    table = Table("stage", "share of processor time [%]", "simulated s / s of a core")
    for stage, spent in cost.cpu_s.items():
        table.add_row(stage, f"{100 * spent / cost.all_cpu_s:.1f}", f"{cost.rate(stage):.2f}")
    table.add_row("all", "100", f"{cost.rate():.2f}")
    out.print(table)
    out.print(f"with waiting for a core: {cost.wall_rate():.2f} simulated s / s a worker")
    hours = ", ".join(f"{cost.paper_hours(n):,.0f} h on {n} cores" for n in (1, 16, 64, 256))
    out.print(f"{PAPER_EPISODES:,} executions at this rate: {hours}", highlight=False)


def plain(value: Any) -> Any:
    """The same with null where a number is not finite, as JSON has it."""
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and value != value else value
