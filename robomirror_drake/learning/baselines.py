"""What a sceptic would try first: a few textbook figures, or boosted trees on summaries.

Both learn from the windows that the network learns from, are calibrated on the same ones,
and predict the same six scores.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from sklearn.ensemble import HistGradientBoostingClassifier, HistGradientBoostingRegressor
from sklearn.linear_model import LinearRegression, LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from robomirror_drake.learning.balance import balance
from robomirror_drake.learning.calibrate import platt
from robomirror_drake.learning.windows import Integers, Windows
from robomirror_drake.messages import Array
from robomirror_drake.ppn.features import REFERENCE_VECTORS, STATE_VECTORS, unflat
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.robot import Robot

LOGISTIC, TREES = "logistic regression", "boosted trees"
"""Names of the baselines."""

_CHUNK = 4096
_COM_VELOCITY = 5  # among the vectors of Frames

Features = Callable[[Integers], Array]


class Baseline(NamedTuple):
    """A baseline that has learned.

    Attributes:
        name: One of the names above.
        features: Of windows.
        fall: Its classifier.
        errors: A model of each error's logarithm.
        calibration: Slope and offset of its logit.
        limits: (2, 5) least and greatest logarithms that it has seen, which it does not leave.
    """

    name: str
    features: Features
    fall: Any
    errors: list[Any]
    calibration: tuple[float, float]
    limits: Array

    def predict(self, which: Integers) -> tuple[Array, Array]:
        """Logits (n,) of falls and logarithmic errors (n, 5) of windows."""
        found = self.features(which)
        slope, offset = self.calibration
        logit = slope * np.asarray(self.fall.decision_function(found)) + offset
        errors = np.stack([model.predict(found) for model in self.errors], 1)
        return logit, np.clip(errors, *self.limits)


def fit_baselines(
    data: Windows,
    learned: Integers,
    judged: Integers,
    robot: Robot,
    options: PPNOptions,
    seed: int = 0,
    report: Callable[[int, int], None] = lambda *_: None,
) -> list[Baseline]:
    """Both baselines.

    Args:
        data: A data set.
        learned: Windows to learn from.
        judged: Windows to calibrate with.
        robot: That the data set was made with.
        options: Of the network that they are compared with.
        seed: Of the trees.
        report: Told how many of their models have learned, and of how many.
    """
    scale = StandardScaler
    settings = {"random_state": seed, "max_iter": 200, "learning_rate": 0.1, "max_bins": 63}
    kinds: list[tuple[str, Features, Callable[[], Any], Callable[[], Any]]] = [
        (
            LOGISTIC,
            lambda which: _textbook(data, which, robot, options),
            lambda: make_pipeline(scale(), LogisticRegression(max_iter=1000)),
            lambda: make_pipeline(scale(), LinearRegression()),
        ),
        (
            TREES,
            lambda which: _summary(data, which, options),
            lambda: HistGradientBoostingClassifier(**settings),
            lambda: HistGradientBoostingRegressor(**settings),
        ),
    ]
    fall, errors = data.fall.numpy(), data.errors.numpy()
    limits = np.stack([errors[learned].min(0), errors[learned].max(0)])
    made: list[Baseline] = []
    total = len(kinds) * (1 + errors.shape[1])
    for name, features, classifier, regressor in kinds:
        found = features(learned)
        told = classifier().fit(found, fall[learned])
        report(len(made) * total // 2 + 1, total)
        tracking = []
        for number, error in enumerate(errors[learned].T, start=2):
            tracking.append(regressor().fit(found, error))
            report(len(made) * total // 2 + number, total)
        logit = np.asarray(told.decision_function(features(judged)))
        calibration = platt(logit, fall[judged])
        made.append(Baseline(name, features, told, tracking, calibration, limits))
    return made


def _textbook(data: Windows, which: Integers, robot: Robot, options: PPNOptions) -> Array:
    """(n, 4) tilt, both margins, and the mean speed of the reference's centre of mass."""
    rows = []
    for some in _chunks(which):
        now = unflat(data.states[data.now[some]], STATE_VECTORS)
        future = data.ahead[some, None] + np.arange(options.ahead)
        asked = unflat(data.references[future], REFERENCE_VECTORS)
        speed = asked.vectors[:, :, _COM_VELOCITY].norm(dim=-1).mean(1, keepdim=True)
        rows.append(np.concatenate([balance(robot, now), speed.double().numpy()], 1))
    return np.concatenate(rows)


def _summary(data: Windows, which: Integers, options: PPNOptions) -> Array:
    """The present state, the mean of the past ones, and mean, least and greatest of the reference.

    All features are those that the network sees.
    """
    rows = []
    both = options.model_copy(update={"use_state": True})
    for some in _chunks(which):
        state, asked = data.inputs(some, both)
        parts = [state[:, -1], state.mean(1), asked.mean(1), asked.amin(1), asked.amax(1)]
        rows.append(torch.cat(parts, 1).numpy())
    return np.concatenate(rows)


def _chunks(which: Integers) -> list[Integers]:
    return np.array_split(which, max(1, -(-len(which) // _CHUNK)))
