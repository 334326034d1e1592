"""How good predictions are: of falls, of probabilities, of errors; pure functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

from robomirror_drake.messages import Array, BoolArray

BINS = 10
"""Of probabilities, equally wide, where they are compared with what happened."""

Integers = npt.NDArray[np.int64]


def balanced(said: BoolArray, fall: BoolArray) -> float:
    """Accuracy where half of the windows had a fall: the mean of both rates; NaN without one."""
    hit, alarm = rates(said, fall)
    return 0.5 * (hit + 1.0 - alarm)


def rates(said: BoolArray, fall: BoolArray) -> tuple[float, float]:
    """Share of the windows with a fall, and of those without, for which a fall was said."""
    return _mean(said[fall]), _mean(said[~fall])


def _mean(values: BoolArray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


class Draws:
    """Bootstrap over clusters: windows of one command are not independent of each other.

    All models are judged with the same draws, so that differences can be told as well
    (Efron and Tibshirani 1993, chapter 13: percentile intervals).
    """

    def __init__(self, cluster: Integers, draws: int, seed: int) -> None:
        """Draws of clusters with replacement.

        Args:
            cluster: (W,) which one each window is of.
            draws: How many.
            seed: Of them.
        """
        _, self._cluster = np.unique(cluster, return_inverse=True)
        count = int(self._cluster.max(initial=-1)) + 1
        rng = np.random.default_rng(seed)
        share = np.full(count, 1.0 / max(count, 1))
        self._weight = (
            rng.multinomial(count, share, size=draws) if count else np.zeros((draws, 0), np.int64)
        )

    def balanced(self, said: BoolArray, fall: BoolArray) -> Array:
        """(draws,) :func:`balanced`; NaN where a draw lacks one kind of window."""
        with np.errstate(invalid="ignore"):
            hit = self._sum(said & fall) / self._sum(fall)
            passed = self._sum(~said & ~fall) / self._sum(~fall)
        return np.asarray(0.5 * (hit + passed))

    def auroc(self, logit: Array, fall: BoolArray) -> Array:
        """(draws,) :func:`auroc`; NaN where a draw lacks one kind."""
        count = self._weight.shape[1]
        falls, others = (np.eye(count)[self._cluster[kind]] for kind in (fall, ~fall))
        above = np.sign(logit[fall][:, None] - logit[~fall][None, :])
        pairs = falls.T @ (0.5 * (above + 1.0)) @ others  # by the cluster of either
        won = np.einsum("di,ij,dj->d", self._weight, pairs, self._weight, optimize=True)
        with np.errstate(invalid="ignore"):
            return np.asarray(won / (self._sum(fall) * self._sum(~fall)))

    def _sum(self, which: BoolArray) -> Array:
        count = np.bincount(self._cluster, which, self._weight.shape[1])
        return np.asarray(self._weight @ count, dtype=np.float64)


def interval(values: Array) -> list[float]:
    """The middle 95 % of draws."""
    known = values[np.isfinite(values)]
    if not len(known):
        return [float("nan")] * 2
    return [float(x) for x in np.percentile(known, [2.5, 97.5])]


def auroc(logit: Array, fall: BoolArray) -> float:
    """Probability that a window with a fall has a higher score than one without (ties half)."""
    falls = int(fall.sum())
    others = len(fall) - falls
    if not (falls and others):
        return float("nan")
    rank = rankdata(logit)[fall].sum() - falls * (falls + 1) / 2.0
    return float(rank / (falls * others))


def roc(logit: Array, fall: BoolArray) -> tuple[Array, Array]:
    """Rates of false and true alarms for all thresholds, from none to all."""
    order = np.argsort(-logit, kind="stable")
    last = np.append(np.diff(logit[order]) != 0.0, True)  # of windows that are scored alike
    hits, alarms = (np.cumsum(kind[order])[last] for kind in (fall, ~fall))
    start = np.zeros(1)
    return (
        np.concatenate([start, alarms / max(alarms[-1], 1)]),
        np.concatenate([start, hits / max(hits[-1], 1)]),
    )


class Reliability(NamedTuple):
    """Windows by the probability that was predicted for them; bins without any are left out.

    Attributes:
        said: (B,) mean probability.
        happened: (B,) share of falls.
        windows: (B,) how many.
    """

    said: Array
    happened: Array
    windows: Integers


def reliability(probability: Array, fall: BoolArray, bins: int = BINS) -> Reliability:
    """Compares probabilities (W,) with what happened (W,)."""
    place = np.minimum((probability * bins).astype(np.int64), bins - 1)
    count = np.bincount(place, minlength=bins)
    some = count > 0
    said, happened = (
        np.bincount(place, values, bins)[some] / count[some] for values in (probability, fall)
    )
    return Reliability(said, happened, count[some])


def calibration_error(probability: Array, fall: BoolArray, bins: int = BINS) -> float:
    """Expected calibration error: mean distance of what was said from what happened."""
    found = reliability(probability, fall, bins)
    return float(np.average(np.abs(found.said - found.happened), weights=found.windows))


def r_squared(truth: Array, predicted: Array) -> float:
    """Share of the variance that is explained; NaN where there is none."""
    spread = np.square(truth - truth.mean()).sum() if len(truth) else 0.0
    if spread == 0.0:
        return float("nan")
    return float(1.0 - np.square(truth - predicted).sum() / spread)


def lead_times(said: BoolArray, time_to_fall: Array, episode: Integers) -> Array:
    """How long before each fall the first alarm stands that then stays [s]; 0 where none does.

    Args:
        said: (W,) whether there is an alarm.
        time_to_fall: (W,) [s], +inf in executions without a fall.
        episode: (W,) which execution.

    Returns:
        One for each execution with a fall that has a window.
    """
    leads = []
    for number in np.unique(episode[np.isfinite(time_to_fall)]):
        own = np.flatnonzero(episode == number)
        backwards = own[np.argsort(time_to_fall[own])]  # from the fall
        silent = np.append(~said[backwards], True)
        stays = int(np.argmax(silent))
        leads.append(float(time_to_fall[backwards[stays - 1]]) if stays else 0.0)
    return np.array(leads)
