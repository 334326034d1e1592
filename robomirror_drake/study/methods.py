"""What each method makes of a command, and what becomes of that in physics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robomirror_drake.adaptation.command import foresee
from robomirror_drake.dataset.options import stream
from robomirror_drake.messages import RobotReference
from robomirror_drake.study.bench import Bench, Tried, digest
from robomirror_drake.study.deviation import deviation
from robomirror_drake.study.options import CLOSED, Variant, adaptation_of, adapter_of
from robomirror_drake.study.records import Row, pool_earlier


def outcome(bench: Bench, variant: Variant) -> Row:
    """The columns that tell what a variant made of the bench's command.

    Raises:
        RetargetingError: The robot cannot follow the command's own motion.
    """
    pool = bench.pool(variant.pool or 1)
    row: Row = {"generate_s": pool.generate_s, "retarget_s": pool.retarget_s}
    if variant.method == "random":
        row |= _random(bench, variant)
    elif variant.method == "oracle":
        row |= _oracle(bench, variant)
    elif variant.method == "none":
        tried = bench.attempt(bench.own, variant.level)
        row |= {"how": "kept", "candidate": 0} | _of_one(bench, bench.own, tried)
    elif variant.method in CLOSED:
        row |= _closed(bench, variant)
    else:
        row |= _adapted(bench, variant)
    spent = (row.get(name, 0.0) for name in ("generate_s", "retarget_s", "adapt_s"))
    return row | {"time_s": sum(spent)}


def survivor(bench: Bench, variant: Variant) -> bool | None:
    """Whether a candidate of a variant's pool survives; None where that is not known.

    Where the study asks for enough to know, the likeliest are simulated until one does.
    """
    if earlier := pool_earlier(bench.job, variant):
        return bool(earlier["survivor"])
    references = bench.pool(variant.pool or 1).references
    known = [bench.known(reference, variant.level) for reference in references]
    if any(tried is not None and not tried.fell for tried in known):
        return True
    if None not in known:
        return False
    if bench.job.options.simulated == "chosen":
        return None
    for reference in _likeliest(bench, references):
        if not bench.attempt(reference, variant.level).fell:
            return True
    return False


def simulated(bench: Bench, variant: Variant) -> int:
    """How many of a variant's pool have been simulated."""
    if earlier := pool_earlier(bench.job, variant):
        return int(earlier["simulated"])
    references = bench.pool(variant.pool or 1).references
    return sum(bench.known(reference, variant.level) is not None for reference in references)


def _adapted(bench: Bench, variant: Variant) -> Row:
    reference, row = _chosen(bench, variant)
    return row | _of_one(bench, reference, bench.attempt(reference, variant.level))


def _chosen(bench: Bench, variant: Variant) -> tuple[RobotReference, Row]:
    """What adaptation takes before the motion begins."""
    options = adaptation_of(variant, bench.job.scenario.adaptation)
    taken, spent = bench.adapt(options, variant.pool or 1)
    return taken.reference, {
        "how": taken.how,
        "candidate": bench.pool(variant.pool or 1).numbers[taken.candidate],
        "reason": taken.reason,
        "risk_before": taken.risk_before,
        "risk": taken.risk,
        "adapt_s": spent,
    }


def _closed(bench: Bench, variant: Variant) -> Row:
    """What is taken beforehand, changed on the way where danger is foreseen."""
    reference, row = bench.own, {"how": "kept", "candidate": 0}
    if variant.method == "closed_loop":
        reference, row = _chosen(bench, variant)
    adapter = adapter_of(variant, bench.job.options.adapter)
    tried, done = bench.run_closed(reference, variant.level, adapter)
    followed = [one for one in done.handovers if one.done]
    stopped = any(one.stopped for one in followed)
    row |= _of_one(bench, done.commanded if followed else reference, tried)
    row |= {
        "changed": bool(followed) or row["changed"],
        "handovers": len(followed),
        "stopped": stopped,
        "look_s": float(np.median(done.seconds)) if len(done.seconds) else None,
    }
    if stopped:  # it did not do what it was told
        row |= {"saved": 0.0, "done": 0.0}
    if followed:
        row |= {"how": "stopped" if stopped else "changed", "reason": followed[-1].reason}
        if tried.fall_time_s is not None:
            row["since_s"] = max(0.0, tried.fall_time_s - followed[-1].start)
    alone = bench.known(reference, variant.level)
    if done.handovers and alone is not None and alone.fall_time_s is not None:
        row["lead_s"] = alone.fall_time_s - done.handovers[0].time
    return row


def _random(bench: Bench, variant: Variant) -> Row:
    """The mean over the other candidates, or over some that are drawn."""
    others = bench.pool(variant.pool or 1).references[1:]
    options = bench.job.options
    if options.simulated != "whole" and len(others) > options.draws:
        rng = stream(options, bench.job.prompt.text, 1, variant.pool or 1)
        others = tuple(others[i] for i in rng.permutation(len(others))[: options.draws])
    rows = [_of_one(bench, one, bench.attempt(one, variant.level)) for one in others]
    if not rows:
        return {"how": "selected", "saved": 0.0, "done": 0.0}
    known = [row["done"] for row in rows if row["done"] is not None]
    saved = [row["deviation"] for row in rows if row["saved"]]
    return {
        "how": "selected",
        "changed": True,
        "saved": float(np.mean([row["saved"] for row in rows])),
        "done": float(np.mean(known)) if known else None,
        "deviation": float(np.mean(saved)) if saved else None,
    }


def _oracle(bench: Bench, variant: Variant) -> Row:
    """What survives of the pool: what does the task first, then the nearest to the command."""
    pool = bench.pool(variant.pool or 1)
    if bench.job.options.simulated == "whole":
        for reference in pool.references:
            bench.attempt(reference, variant.level)
    survivor(bench, variant)
    rows = []
    for number, reference in zip(pool.numbers, pool.references, strict=True):
        if (tried := bench.known(reference, variant.level)) is not None:
            rows.append({"candidate": number} | _of_one(bench, reference, tried))
    best = min(rows, key=lambda row: (not row["saved"], not row["done"], row["deviation"]))
    return best | {"how": "selected"}


def _likeliest(bench: Bench, references: Sequence[RobotReference]) -> list[RobotReference]:
    """The same by what is foreseen of them, the safest first."""
    foreseen = foresee(bench.predictor, references, bench.job.scenario.adaptation.every)
    order = np.argsort(foreseen.fall_probability, kind="stable")
    return [references[int(i)] for i in order]


def _of_one(bench: Bench, reference: RobotReference, tried: Tried) -> Row:
    return {
        "changed": digest(reference) != digest(bench.own),
        "saved": float(not tried.fell),
        "done": 0.0 if tried.fell else None if tried.done is None else float(tried.done),
        "missed": tried.missed,
        "fall_time_s": tried.fall_time_s,
        "why_fell": tried.why_fell,
        "deviation": deviation(bench.robot, reference, bench.own),
        "tempo": bench.own.duration / reference.duration,
        "failure": tried.failure,
    }
