"""Several predictors as one: what one of them takes for safe, others have not seen that way.

A choice among motions, and an optimiser all the more, looks for where a network errs. Networks
that look at other spans of time, or learned from other states, err elsewhere. An optimiser finds
where all of them err that it climbs: so there are some that it does not, who see nothing but the
largest torques, and are heard on what is to be chosen and on what came of it.

Source: B. Lakshminarayanan, A. Pritzel, C. Blundell, "Simple and scalable predictive uncertainty
estimation using deep ensembles", NeurIPS 2017.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit, logit

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import Array, BoolArray, QualityPrediction, RobotReference
from robomirror_drake.ppn.model import SCORES
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import EVERY, History, Judged, Predictor, load_predictor
from robomirror_drake.ppn.torques import TorquePredictor, load_torques
from robomirror_drake.ppn.weights import weights_file
from robomirror_drake.robot import Robot

_SURE = 1e-12  # probability beyond which nobody is


class Ensemble:
    """Predictors at the same rate, whose logits, errors and gradients are averaged.

    Those that see torques alone have half of the say in :meth:`foresee`, and none elsewhere.
    """

    def __init__(self, members: Sequence[Predictor | TorquePredictor]) -> None:
        """Of one predictor at least that sees more than torques.

        Raises:
            ConfigError: There is none, or they look at motions at different rates.
        """
        self._networks = tuple(one for one in members if not isinstance(one, TorquePredictor))
        self._torques = tuple(one for one in members if isinstance(one, TorquePredictor))
        if not self._networks:
            raise ConfigError("no predictor of errors and windows: name one beside the torques'")
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
        return max((member.options for member in self._networks), key=lambda own: own.back)

    @property
    def headers(self) -> tuple[Mapping[str, Any], ...]:
        """Of their weights."""
        return tuple(member.header for member in self.members)

    def predict(
        self, references: Sequence[RobotReference], start: float, history: History
    ) -> QualityPrediction:
        """See :meth:`.Predictor.predict`; the history is as long as the longest needs it."""
        back = [member.options.back for member in self._networks]
        return _mean(
            [
                member.predict(references, start, History(history.q[-count:], history.v[-count:]))
                for member, count in zip(self._networks, back, strict=True)
            ]
        )

    def foresee(
        self, q: Array, contact: Array | BoolArray, every: float = EVERY
    ) -> QualityPrediction:
        """See :meth:`.Predictor.foresee`; of motions that begin from rest."""
        told = _mean([one.foresee(q, contact, every=every) for one in self._networks])
        if not self._torques:
            return told
        apart = np.mean([_logit(one.foresee(q, contact)) for one in self._torques], axis=0)
        both = 0.5 * (_logit(told.fall_probability) + apart)
        return replace(told, fall_probability=np.asarray(expit(both)))

    def judge(self, q: Array, contact: Array | BoolArray, every: float = EVERY) -> Judged:
        """See :meth:`.Predictor.judge`; of motions that begin from rest.

        It is what can be climbed: torques have no say in it.
        """
        told = [member.judge(q, contact, every=every) for member in self._networks]
        return Judged(*(np.mean(part, axis=0) for part in zip(*told, strict=True)))


def load_ensemble(weights: Sequence[str | Path], robot: Robot) -> Ensemble:
    """The ensemble of some weights; see :func:`.load_predictor` for what it raises."""
    paths = [weights_file(one) for one in weights]
    return Ensemble(
        [
            load_torques(path, robot)
            if checkpoint.is_of(path, checkpoint.TORQUES)
            else load_predictor(path, robot)
            for path in paths
        ]
    )


def _logit(probability: Array) -> Array:
    return np.asarray(logit(np.clip(probability, _SURE, 1.0 - _SURE)))


def _mean(told: Sequence[QualityPrediction]) -> QualityPrediction:
    """Of predictions for the same motions: the mean of logits, and of errors."""
    errors = (np.mean([getattr(one, name) for one in told], axis=0) for name in SCORES[1:])
    return QualityPrediction(
        max(one.horizon for one in told),
        np.asarray(expit(np.mean([_logit(one.fall_probability) for one in told], axis=0))),
        *errors,
    )
