"""Several predictors as one: what one of them takes for safe, others have not seen that way.

A choice among motions, and an optimiser all the more, looks for where a network errs. Networks
that look at other spans of time, or learned from other states, err elsewhere.

Source: B. Lakshminarayanan, A. Pritzel, C. Blundell, "Simple and scalable predictive uncertainty
estimation using deep ensembles", NeurIPS 2017.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit, logit

from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import Array, BoolArray, QualityPrediction, RobotReference
from robomirror_drake.ppn.model import SCORES
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import EVERY, History, Judged, Predictor, load_predictor
from robomirror_drake.robot import Robot

_SURE = 1e-12  # probability beyond which nobody is


class Ensemble:
    """Predictors at the same rate, whose logits, errors and gradients are averaged."""

    def __init__(self, members: Sequence[Predictor]) -> None:
        """Of one predictor at least.

        Raises:
            ConfigError: They look at motions at different rates.
        """
        rates = sorted({member.options.rate for member in members})
        if len(rates) > 1:
            told = " and ".join(f"{rate:g}" for rate in rates)
            raise ConfigError(
                f"predictors that look at {told} Hz cannot be averaged; choose others"
            )
        self.members = tuple(members)

    @property
    def options(self) -> PPNOptions:
        """Of the one that looks back farthest."""
        return max((member.options for member in self.members), key=lambda own: own.back)

    @property
    def headers(self) -> tuple[Mapping[str, Any], ...]:
        """Of their weights."""
        return tuple(member.header for member in self.members)

    def predict(
        self, references: Sequence[RobotReference], start: float, history: History
    ) -> QualityPrediction:
        """See :meth:`.Predictor.predict`; the history is as long as the longest needs it."""
        back = [member.options.back for member in self.members]
        return _mean(
            [
                member.predict(references, start, History(history.q[-count:], history.v[-count:]))
                for member, count in zip(self.members, back, strict=True)
            ]
        )

    def foresee(
        self, q: Array, contact: Array | BoolArray, every: float = EVERY
    ) -> QualityPrediction:
        """See :meth:`.Predictor.foresee`; of motions that begin from rest."""
        return _mean([one.foresee(q, contact, every=every) for one in self.members])

    def judge(self, q: Array, contact: Array | BoolArray, every: float = EVERY) -> Judged:
        """See :meth:`.Predictor.judge`; of motions that begin from rest."""
        told = [member.judge(q, contact, every=every) for member in self.members]
        return Judged(*(np.mean(part, axis=0) for part in zip(*told, strict=True)))


def load_ensemble(weights: Sequence[str | Path], robot: Robot) -> Ensemble:
    """The ensemble of some weights; see :func:`.load_predictor` for what it raises."""
    return Ensemble([load_predictor(one, robot) for one in weights])


def _mean(told: Sequence[QualityPrediction]) -> QualityPrediction:
    """Of predictions for the same motions: the mean of logits, and of errors."""
    sure = [np.clip(one.fall_probability, _SURE, 1.0 - _SURE) for one in told]
    errors = (np.mean([getattr(one, name) for one in told], axis=0) for name in SCORES[1:])
    return QualityPrediction(
        max(one.horizon for one in told),
        np.asarray(expit(np.mean(logit(sure), axis=0))),
        *errors,
    )
