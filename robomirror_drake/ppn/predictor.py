"""A trained network at work: references and states in, predictions and gradients out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import Array, BoolArray, QualityPrediction, RobotReference
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import (
    PAD,
    RECORDED,
    Frames,
    reference_frames,
    rows_at,
    seen,
    state_frames,
)
from robomirror_drake.ppn.model import PPN, Scores
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.weights import check_robot, weights_file
from robomirror_drake.robot import Robot

EVERY = 0.5
"""From one window of a whole motion to the next [s]."""

_SHARPNESS = 4.0  # of the smooth maximum over windows


class Judged(NamedTuple):
    """Predictions for n whole motions, and how they change with them.

    Attributes:
        logit: (n,) of the probability of a fall: the smooth maximum over windows, calibrated
            on whole motions where these begin from rest.
        errors: (n, 5) A_q, A_qd, A_qdd, A_p, A_theta as means over windows, in their units.
        gradient: (n, N, 30) derivative of ``logit`` by the samples of the motions.
    """

    logit: Array
    errors: Array
    gradient: Array


class History(NamedTuple):
    """What the robot did until now, at the network's rate; the last state is the present one.

    Attributes:
        q: (S, 30) positions, Drake order.
        v: (S, 29) velocities, Drake order.
    """

    q: Array
    v: Array

    @classmethod
    def at_rest(cls, q: Array, count: int) -> Self:
        """Of a robot that has stood in a configuration (30,) for ``count`` states."""
        return cls(np.tile(q, (count, 1)), np.zeros((count, len(q) - 1)))


class Predictor:
    """A network and the robot it knows. There is no state: the same arguments, the same bytes."""

    def __init__(self, network: PPN, robot: Robot, header: dict[str, Any] | None = None) -> None:
        """A predictor in the precision of the network's weights."""
        self.network = network.eval().requires_grad_(False)
        self.header = header or {}
        self._type = network.cls.dtype
        self._body = Body.of(robot).to(self._type)

    @property
    def options(self) -> PPNOptions:
        """What the network looks at."""
        return self.network.options

    @property
    def joints(self) -> int:
        """How many the robot has."""
        return len(self._body.parents)

    def predict(
        self, references: Sequence[RobotReference], start: float, history: History
    ) -> QualityPrediction:
        """What becomes of each reference from a time on.

        Args:
            references: Kinematic references at 60 Hz; their ends are held.
            start: Time in each of them that is now [s].
            history: Of the robot, in the world of the references.

        Raises:
            ValueError: The history has another length than the network looks back.
        """
        self._check(history)
        options = self.options
        time = start + np.arange(-PAD, options.ahead + PAD) / options.rate
        q, contact = sampled(references, time)
        with torch.no_grad():
            asked = self._reference(self._tensor(q), self._tensor(contact[:, PAD:-PAD]))
            past = self._state(history).flat()[None]
            scores = self._scores(past, asked.flat())
        return quality(options.horizon, scores)

    def judge(
        self,
        q: Array,
        contact: Array | BoolArray,
        history: History | None = None,
        every: float = EVERY,
    ) -> Judged:
        """Risk and errors of whole motions, and the gradient of the risk.

        Windows begin every half second. The first one begins with the robot as it is; for the
        others it is taken to be where the motion has it.

        Args:
            q: (n, N, 30) motions at the network's rate, Drake order.
            contact: (n, N, 2, 4) which sole corners are meant to bear load.
            history: Of the robot, in the world of the motions; None where it stands as each
                of them begins.
            every: From one window to the next [s].
        """
        if history is not None:
            self._check(history)
        samples = self._tensor(q).requires_grad_()
        with torch.enable_grad():
            scores = self._windows(samples, self._tensor(contact), history, every)
            logit, errors = self._over_windows(scores, len(q), history)
            (gradient,) = torch.autograd.grad(logit.sum(), samples)
        return Judged(*(x.detach().double().numpy() for x in (logit, errors, gradient)))

    def foresee(
        self,
        q: Array,
        contact: Array | BoolArray,
        history: History | None = None,
        ahead: float = math.inf,
        every: float = EVERY,
    ) -> QualityPrediction:
        """As :meth:`judge`, of windows that begin before a time ``ahead`` [s], with no gradient.

        Args:
            q: (n, N, 30) motions at the network's rate, Drake order.
            contact: (n, N, 2, 4) which sole corners are meant to bear load.
            history: Of the robot, in the world of the motions; None where it stands as each
                of them begins.
            ahead: Time before which windows begin [s]; infinite for the whole of the motions.
            every: From one window to the next [s].
        """
        if history is not None:
            self._check(history)
        with torch.no_grad():
            scores = self._windows(self._tensor(q), self._tensor(contact), history, every, ahead)
            logit, errors = self._over_windows(scores, len(q), history)
        fall = torch.sigmoid(logit.double())
        horizon = min(ahead, (q.shape[1] - 1) / self.options.rate) + self.options.horizon
        return QualityPrediction(horizon, fall.numpy(), *errors.numpy().T)

    def check_features(self, source: object) -> None:
        """Raises ConfigError where the network was made for other features than there are here."""
        one = np.zeros((1, self.joints + 7))
        one[0, 0] = 1.0
        asked = self._reference(
            self._tensor(np.tile(one, (1 + 2 * PAD, 1))), self._tensor(np.ones((1, 2, 4)))
        )
        for name, frames in (("state", asked.as_state(self._asked)), ("reference", asked)):
            there, here = getattr(self.network, f"{name}_scale").shape[1], frames.flat().shape[1]
            if there != here:
                raise ConfigError(f"{source}: {there} features of a {name}, but here are {here}")

    def _windows(
        self,
        q: Tensor,
        contact: Tensor,
        history: History | None,
        every: float,
        ahead: float = math.inf,
    ) -> Scores:
        """Scores of all windows, motion by motion; each has as many."""
        options, number, samples = self.options, len(q), q.shape[1]
        back, future_samples = options.back - 1, options.ahead
        until = max(math.ceil(min(samples - 1, ahead * options.rate)), 1)
        first = torch.arange(0, until, max(1, round(every * options.rate)))
        # No further than the last window looks: features are most of what a prediction costs.
        looked = int(first[-1]) + future_samples + PAD
        held = torch.arange(-back - PAD, looked).clamp(0, samples - 1)
        asked = self._reference(q[:, held], contact[:, held[PAD:-PAD]])
        past, future = asked.as_state(self._asked).flat(), asked.flat()
        states = past[:, first[:, None] + torch.arange(options.back)]
        if history is not None:
            states = torch.cat(
                [self._state(history).flat().expand(number, 1, -1, -1), states[:, 1:]], 1
            )
        references = future[:, back + first[:, None] + torch.arange(future_samples)]
        return self._scores(states.flatten(0, 1), references.flatten(0, 1))

    def _over_windows(
        self, scores: Scores, number: int, history: History | None
    ) -> tuple[Tensor, Tensor]:
        """Of ``number`` motions: (n,) smooth maximum of the logit, (n, 5) mean errors.

        What is known of whole motions is known of those that begin from rest.
        """
        fall = scores.fall.reshape(number, -1)
        errors = scores.errors.double().exp().reshape(number, -1, scores.errors.shape[-1]).mean(1)
        logit = torch.logsumexp(_SHARPNESS * fall, 1) / _SHARPNESS
        if history is None:
            slope, offset = self.network.motion_calibration
            logit = slope * logit + offset
        return logit, errors

    @property
    def _asked(self) -> int:
        """Scalars of a reference that a state does not have: contacts, torques."""
        return 4 + sum(len(leg) for leg in self._body.legs)

    def _reference(self, q: Tensor, contact: Tensor) -> Frames:
        return reference_frames(self._body, q, contact, 1.0 / self.options.rate)

    def _state(self, history: History) -> Frames:
        return state_frames(self._body, self._tensor(history.q), self._tensor(history.v))

    def _scores(self, past: Tensor, future: Tensor) -> Scores:
        scores: Scores = self.network(
            *seen(past.expand(len(future), -1, -1), future, self.options.use_state)
        )
        return scores

    def _tensor(self, values: Array | BoolArray) -> Tensor:
        return torch.from_numpy(np.array(values, dtype=np.float64)).to(self._type)

    def _check(self, history: History) -> None:
        if len(history.q) != self.options.back or len(history.v) != self.options.back:
            raise ValueError(
                f"a history of {len(history.q)} states; the network looks at "
                f"{self.options.back}, {1.0 / self.options.rate:g} s apart"
            )


def whole(count: int, rate: float) -> Array:
    """Times (T,) [s] that show ``count`` rows at 60 Hz to their end, at a rate [Hz]."""
    step = round(RECORDED / rate)
    return np.arange(0, count + step - 1, step) / RECORDED


def sampled(references: Sequence[RobotReference], time: Array) -> tuple[Array, BoolArray]:
    """Positions (n, T, 30) and contacts (n, T, 2, 4) of references at times (T,) [s].

    Their ends are held.
    """
    rows = [rows_at(time, len(reference.time)) for reference in references]
    return (
        np.stack([one.q[at] for one, at in zip(references, rows, strict=True)]),
        np.stack([one.contact[at] for one, at in zip(references, rows, strict=True)]),
    )


def quality(horizon: float, scores: Scores) -> QualityPrediction:
    """Scores as a message."""
    errors = scores.errors.double().exp().numpy()
    return QualityPrediction(horizon, torch.sigmoid(scores.fall.double()).numpy(), *errors.T)


def load_predictor(weights: str | Path, robot: Robot) -> Predictor:
    """A predictor from weights.

    Args:
        weights: Name of a file in ``assets/ppn`` without suffix, or a path.
        robot: That it is for.

    Raises:
        ConfigError: There are no such weights, or they are of another robot or other features;
            the message names the difference.
    """
    path = weights_file(weights)
    tensors, header = checkpoint.load(path, checkpoint.PREDICTOR)
    check_robot(path, header, robot)
    options = PPNOptions.model_validate(header["options"]["network"])
    if RECORDED % options.rate:
        raise ConfigError(f"{path}: looks at {options.rate:g} frames a second, no part of 60")
    state, reference = (
        tensors[f"network.{name}_scale"].shape[1] for name in ("state", "reference")
    )
    network = PPN(options, state, reference)
    checkpoint.restore("network", network, tensors)
    predictor = Predictor(network, robot, header)
    predictor.check_features(path)
    return predictor
