"""The units of work: how a command's own motion ends, and what each variant makes of it.

Whatever fails is recorded with its reason, and the study goes on.
"""

from __future__ import annotations

from contextlib import suppress

from robomirror_drake.adaptation.command import adapt_command
from robomirror_drake.study.bench import Bench
from robomirror_drake.study.causes import cause
from robomirror_drake.study.methods import outcome, simulated, survivor
from robomirror_drake.study.options import FORESEEING, Variant, variants
from robomirror_drake.study.records import Job, Row, about, of_earlier, of_variant

_WARM: set[tuple[str, ...]] = set()  # weights that this process has adapted with


def screen(job: Job) -> Row:
    """How the command's own motion ends, at the study's first level of disturbance."""
    row = about(job)
    try:
        bench = Bench(job)
        row["duration_s"] = bench.own.duration
        if bench.own.duration > job.options.longest:
            return row | {"state": "long"}
        tried = bench.attempt(bench.own, job.options.grid.levels[0].name)
    except Exception as error:
        return row | screening_failed(job, error)
    state = "failed" if tried.failure else "fell" if tried.fell else "stood"
    return (
        row
        | {name: value for name, value in vars(tried).items() if name != "fell"}
        | {"state": state}
    )


def screening_failed(job: Job, error: BaseException) -> Row:
    """What is recorded of a command that cannot be screened."""
    return about(job) | {"state": "failed", "failure": _words(error)}


def compare(job: Job) -> list[Row]:
    """A row for each variant that is of interest for the command, which has been screened."""
    wanted = _wanted(job)
    try:
        bench = Bench(job)
        _warm_up(bench)
        if job.screened is not None:
            bench.remember(bench.own, job.options.grid.levels[0].name, job.screened)
    except Exception as error:
        return [_failed(job, variant, error) for variant in wanted]
    rows = [of_earlier(job, variant) or _row(bench, variant) for variant in wanted]
    if _falls(job):
        for variant, row in zip(wanted, rows, strict=True):
            _explain(bench, variant, row)
    return rows


def comparison_failed(job: Job, error: BaseException) -> list[Row]:
    """What is recorded of a command whose worker died of it."""
    return [_failed(job, variant, error) for variant in _wanted(job)]


def _falls(job: Job) -> bool:
    return job.screened is None or job.screened["state"] == "fell"


def _wanted(job: Job) -> list[Variant]:
    """All variants; of a command that goes well by itself only those that might break it."""
    first = job.options.grid.levels[0].name
    return [
        one
        for one in variants(job.options, job.scenario.adaptation)
        if _falls(job) or (one.method in FORESEEING and one.level == first)
    ]


def _row(bench: Bench, variant: Variant) -> Row:
    try:
        return _base(bench.job, variant) | outcome(bench, variant)
    except Exception as error:
        return _failed(bench.job, variant, error)


def _explain(bench: Bench, variant: Variant, row: Row) -> None:
    """Adds why the command was not saved, for which more may have to be simulated."""
    if row.get("cause"):
        return
    try:
        if variant.pool is not None:
            row["survivor"] = survivor(bench, variant)
            row["simulated"] = simulated(bench, variant)
        if row["saved"] < 1.0:
            row["cause"] = cause(row)
    except Exception as error:
        row |= {"cause": "unknown", "failure": _words(error)}


def _base(job: Job, variant: Variant) -> Row:
    return about(job) | {"set": "failing" if _falls(job) else "succeeding"} | of_variant(variant)


def _failed(job: Job, variant: Variant, error: BaseException) -> Row:
    said = {"saved": 0.0, "done": 0.0, "cause": "failed", "failure": _words(error)}
    return _base(job, variant) | said


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


def _warm_up(bench: Bench) -> None:
    """Adapts once unseen in each process, so that no figure has the time of loading in it."""
    given = bench.job.scenario.adaptation
    if given.predictor in _WARM:
        return
    options = given.model_copy(
        update={
            "method": "optimisation",
            "ranking": given.ranking.model_copy(update={"t_safe": 0.999}),
        }
    )
    with suppress(Exception):  # it is not this that is measured
        adapt_command(bench.robot, bench.job.prompt.text, [bench.own], bench.predictor, options)
    _WARM.add(given.predictor)
