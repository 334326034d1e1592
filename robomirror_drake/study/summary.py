"""What a study says: for each variant how many commands it saved, at which price, and why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from scipy.stats import binomtest

from robomirror_drake.learning.metrics import interval
from robomirror_drake.messages import Array
from robomirror_drake.study.options import Variant
from robomirror_drake.study.records import CAUSES, Row, variant_of
from robomirror_drake.study.run import Study

DRAWS: Final = 5000
"""Of the bootstrap over commands, where no exact interval is known."""

Figures = dict[str, Any]


def summarise(study: Study) -> Figures:
    """All figures of a study; what cannot be told is None.

    ``methods`` has one entry for each variant, with its method and what it depends on:
    ``saved`` is the share of the commands whose own motion falls that did not fall,
    ``task_done`` the share of these that did the task, each with a 95 % interval;
    ``deviation`` [m] and ``time_s`` are medians; ``causes`` counts the commands that were not
    saved; ``succeeding`` tells what became of commands whose own motion goes well.
    """
    states = Counter(row["state"] for row in study.screened)
    commands = {
        which: {row["command"]: row["group"] for row in study.results if row["set"] == which}
        for which in ("failing", "succeeding")
    }
    of: dict[Variant, list[Row]] = {}
    for row in study.results:
        of.setdefault(variant_of(row), []).append(row)
    methods = [of_variant(variant, rows) for variant, rows in of.items()]
    return {
        "scenario": study.options.scenario,
        "seed": study.options.seed,
        "simulated": study.options.simulated,
        "commands": {
            "screened": len(study.screened),
            "states": dict(sorted(states.items())),
            **{
                which: {"commands": len(own), "groups": dict(sorted(Counter(own.values()).items()))}
                for which, own in commands.items()
            },
        },
        "methods": methods,
        "best": _best(of, methods),
    }


def of_variant(variant: Variant, rows: Sequence[Row]) -> Figures:
    """The figures of one variant from its rows."""
    failing = [row for row in rows if row["set"] == "failing"]
    fine = [row for row in rows if row["set"] == "succeeding"]
    lost = [row for row in failing if row["survivor"] is False]
    saved = [row for row in failing if row["saved"]]
    return {
        **asdict(variant),
        "commands": len(failing),
        **_shares(failing),
        "deviation": _median(row["deviation"] for row in saved),
        "tempo": _median(row["tempo"] for row in saved),
        "time_s": _median(row["time_s"] for row in failing),
        "time_90_s": _percentile([row["time_s"] for row in failing], 90),
        "stages_s": {
            stage: _median(row[f"{stage}_s"] for row in failing)
            for stage in ("generate", "retarget", "adapt")
        },
        "lead_s": _median(row["lead_s"] for row in failing),
        "look_s": _median(row["look_s"] for row in failing),
        "causes": causes(failing),
        "how": dict(sorted(Counter(row["how"] for row in failing if row["how"]).items())),
        "groups": _parts(failing, "group"),
        "splits": _parts(failing, "split"),
        "without_survivor": {"commands": len(lost), **_shares(lost)} if lost else None,
        "succeeding": _succeeding(fine) if fine else None,
    }


def causes(rows: Sequence[Row]) -> dict[str, float]:
    """Commands not saved, by cause; of ``random`` shares of commands."""
    found = {
        cause: float(sum(1.0 - row["saved"] for row in rows if row["cause"] == cause))
        for cause in CAUSES
    }
    return {cause: round(count, 6) for cause, count in found.items() if count}


def share_interval(values: Array, of: Array | None = None) -> list[float] | None:
    """A 95 % interval of Σ values / Σ of, which are one each for a command.

    Wilson's score interval where a command either counts or not; else percentiles of a
    bootstrap over commands. None where there is nothing to divide by.
    """
    of = np.ones(len(values)) if of is None else of
    total = float(of.sum())
    if not total:
        return None
    both = np.append(values, of)
    if np.all((both == 0.0) | (both == 1.0)):
        found = binomtest(round(float(values.sum())), round(total)).proportion_ci(method="wilson")
        return [float(found.low), float(found.high)]
    return _bootstrap(values, of)


def _bootstrap(values: Array, of: Array) -> list[float]:
    """Percentiles of Σ values / Σ of over draws of commands, the same for the same data."""
    count = len(values)
    weight = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), size=DRAWS)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (weight @ values) / (weight @ of)
    return interval(ratio)


def _parts(rows: Sequence[Row], column: str) -> Figures:
    """Shares of the rows apart by what is in a column."""
    return {
        part: {"commands": len(own), **_shares(own)}
        for part in sorted({row[column] for row in rows})
        if (own := [row for row in rows if row[column] == part])
    }


def _shares(rows: Sequence[Row]) -> Figures:
    saved = np.array([row["saved"] for row in rows], dtype=np.float64)
    told = [row for row in rows if row["done"] is not None]
    done = np.array([row["done"] for row in told], dtype=np.float64)
    upright = np.array([row["saved"] for row in told], dtype=np.float64)
    return {
        "saved": float(saved.mean()) if len(saved) else None,
        "saved_interval": share_interval(saved),
        "task_done": float(done.sum() / upright.sum()) if upright.sum() else None,
        "task_done_interval": share_interval(done, upright),
    }


def _succeeding(rows: Sequence[Row]) -> Figures:
    changed = np.array([bool(row["changed"]) for row in rows], dtype=np.float64)
    broken = np.array([1.0 - row["saved"] for row in rows], dtype=np.float64)
    told = [row for row in rows if row["done"] is not None]
    done = np.array([row["done"] for row in told], dtype=np.float64)
    return {
        "commands": len(rows),
        "changed": float(changed.mean()),
        "changed_interval": share_interval(changed),
        "broken": float(broken.mean()),
        "broken_interval": share_interval(broken),
        "task_done": float(done.mean()) if len(done) else None,
        "task_done_interval": share_interval(done),
    }


def _best(
    of: Mapping[Variant, Sequence[Row]], methods: Sequence[Mapping[str, Any]]
) -> Figures | None:
    """The method that saves most, and how many times as many as a random candidate."""
    open_ = [
        m for m in methods if m["method"] not in ("none", "random", "oracle") and m["commands"]
    ]
    if not open_:
        return None
    best = max(open_, key=lambda method: method["saved"])
    variant = variant_of(best)
    found = {"variant": asdict(variant), "saved": best["saved"]}
    chance = next(
        (
            m
            for m in methods
            if m["method"] == "random"
            and m["level"] == best["level"]
            and best["pool"] in (None, m["pool"])
        ),
        None,
    )
    if chance is None:
        return found | {"times_random": None, "times_random_interval": None}
    pairs = [_saved(of[one]) for one in (variant, variant_of(chance))]
    common = sorted(pairs[0].keys() & pairs[1].keys())
    mine, theirs = (np.array([pair[n] for n in common], dtype=np.float64) for pair in pairs)
    if not theirs.sum():
        return found | {"times_random": None, "times_random_interval": None}
    return found | {
        "times_random": float(mine.sum() / theirs.sum()),
        "times_random_interval": _bootstrap(mine, theirs),
    }


def _saved(rows: Sequence[Row]) -> dict[int, float]:
    return {row["command"]: row["saved"] for row in rows if row["set"] == "failing"}


def _median(values: Any) -> float | None:
    return _percentile(list(values), 50)


def _percentile(values: Sequence[float | None], share: float) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.percentile(known, share)) if known else None
