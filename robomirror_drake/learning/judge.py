"""The figures of one predictor on windows whose commands it has not seen."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from robomirror_drake.dataset.windows import ERRORS
from robomirror_drake.learning import metrics
from robomirror_drake.learning.metrics import Draws, Integers
from robomirror_drake.learning.windows import Windows
from robomirror_drake.messages import Array, BoolArray

EARLY: Final = 0.3
"""Windows that begin less than this before a fall tell little: the robot is falling [s]."""

UNITS: Final = dict(zip(ERRORS, ("rad", "rad/s", "rad/s²", "m", "rad"), strict=True))
"""Of the errors."""


class Truth(NamedTuple):
    """What happened in W windows.

    Attributes:
        fall: (W,) whether the robot fell within the horizon.
        time_to_fall: (W,) [s], +inf where the execution has no fall.
        errors: (W, 5) logarithms of the errors.
        episode: (W,) which execution.
        command: (W,) which command.
        family: (W,) for which family of actions the command is held out, or "".
    """

    fall: BoolArray
    time_to_fall: Array
    errors: Array
    episode: Integers
    command: Integers
    family: npt.NDArray[np.str_]

    @classmethod
    def of(cls, data: Windows, which: Integers) -> Truth:
        """Of some windows of a data set."""
        rows = data.episodes
        episode = data.episode[which]
        return cls(
            data.fall[which].numpy(),
            data.time_to_fall[which].double().numpy(),
            data.errors[which].double().numpy(),
            episode,
            np.array([row["prompt_index"] for row in rows], np.int64)[episode],
            np.array([row.get("family") or "" for row in rows], np.str_)[episode],
        )

    def part(self, which: BoolArray) -> Truth:
        """Some of the windows."""
        fall, time_to_fall, errors, episode, command, family = self
        return Truth(
            fall[which], time_to_fall[which], errors[which],
            episode[which], command[which], family[which],
        )  # fmt: skip

    def counts(self) -> dict[str, int]:
        """How much it is."""
        fell = self.episode[np.isfinite(self.time_to_fall)]
        return {
            "commands": len(np.unique(self.command)),
            "executions": len(np.unique(self.episode)),
            "executions_with_fall": len(np.unique(fell)),
            "windows": len(self.fall),
            "windows_with_fall": int(self.fall.sum()),
        }


class Told(NamedTuple):
    """What was predicted for W windows.

    Attributes:
        logit: (W,) of the probability of a fall, as frequent as falls are where it was
            calibrated.
        errors: (W, 5) logarithms of the errors.
        threshold: Of the logit, where falls are as frequent as not.
    """

    logit: Array
    errors: Array
    threshold: float

    @property
    def alarm(self) -> BoolArray:
        """(W,) whether a fall is predicted."""
        return np.asarray(self.logit > self.threshold)

    @property
    def probability(self) -> Array:
        """(W,) of a fall."""
        return np.asarray(expit(self.logit))


def fall_figures(truth: Truth, told: Told, draws: Draws) -> dict[str, Any]:
    """How well falls are told; shares are from 0 to 1, times in seconds."""
    alarm, fall = told.alarm, truth.fall
    early = ~fall | (truth.time_to_fall >= EARLY - 1e-6)
    hit, false = metrics.rates(alarm, fall)
    return {
        "fall_accuracy": metrics.balanced(alarm, fall),
        "fall_accuracy_interval": metrics.interval(draws.balanced(alarm, fall)),
        "fall_accuracy_early": metrics.balanced(alarm[early], fall[early]),
        "true_positive_rate": hit,
        "false_positive_rate": false,
        "auroc": metrics.auroc(told.logit, fall),
        "calibration_error": metrics.calibration_error(told.probability, fall),
        "upright_executions_with_alarm": _alarmed(truth, alarm),
        "lead_time": _lead(truth, alarm),
    }


def _alarmed(truth: Truth, alarm: BoolArray) -> float:
    """Share of the executions without a fall in which there ever is an alarm."""
    upright = np.isinf(truth.time_to_fall)
    everywhere, somewhere = (np.unique(truth.episode[x]) for x in (upright, upright & alarm))
    return len(somewhere) / len(everywhere) if len(everywhere) else float("nan")


def _lead(truth: Truth, alarm: BoolArray) -> dict[str, float | int]:
    """Of the first alarm that stays, over all falls; a fall without one counts as 0 s."""
    leads = metrics.lead_times(alarm, truth.time_to_fall, truth.episode)
    low, median, high = np.percentile(leads, [10, 50, 90]) if len(leads) else [float("nan")] * 3
    return {
        "falls": len(leads),
        "p10_s": float(low),
        "median_s": float(median),
        "p90_s": float(high),
        "missed": float(np.mean(leads == 0.0)) if len(leads) else float("nan"),
    }


def error_figures(truth: Truth, told: Told) -> dict[str, dict[str, Any]]:
    """How well each error is told: MSE in its unit, and the share of its variance.

    ``mse_balanced`` is where half of the windows have a fall, as in a balanced test set;
    ``r2_log`` is of logarithms, ``r2_upright`` of windows without a fall.
    """
    found = {}
    for number, (name, unit) in enumerate(UNITS.items()):
        logs = truth.errors[:, number], told.errors[:, number]
        true, said = (np.exp(x) for x in logs)
        square, fall = np.square(true - said), truth.fall
        found[name] = {
            "unit": unit,
            "mse": float(square.mean()),
            "mse_balanced": 0.5 * float(square[fall].mean() + square[~fall].mean())
            if 0 < fall.sum() < len(fall)
            else float("nan"),
            "r2": metrics.r_squared(true, said),
            "r2_log": metrics.r_squared(*logs),
            "r2_upright": metrics.r_squared(true[~fall], said[~fall]),
        }
    return found


def family_figures(truth: Truth, told: Told) -> dict[str, dict[str, Any]]:
    """How well falls are told in each held-out family."""
    found = {}
    for name in sorted(set(truth.family.tolist()) - {""}):
        own = truth.family == name
        alarm, fall = told.alarm[own], truth.fall[own]
        hit, false = metrics.rates(alarm, fall)
        found[name] = {
            "fall_accuracy": metrics.balanced(alarm, fall),
            "true_positive_rate": hit,
            "false_positive_rate": false,
            **truth.part(own).counts(),
        }
    return found
