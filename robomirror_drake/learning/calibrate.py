"""From a score to a probability, and from a probability to a decision."""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import minimize
from scipy.special import expit, log_expit
from torch import Tensor

from robomirror_drake.learning.metrics import balanced
from robomirror_drake.messages import Array, BoolArray

_SLOPES = (0.05, 5.0)


def calibrate(calibration: Tensor, logit: Array, fall: BoolArray) -> None:
    """Makes logits those of true probabilities, by slope and offset (Platt 1999).

    Args:
        calibration: (2,) slope and offset that were in use; what is found is composed with them.
            Nothing is changed where either kind is missing.
        logit: (n,) of windows or motions as they come, none of them learned from.
        fall: (n,) whether the robot fell in them.
    """
    if not 0 < fall.sum() < len(fall):
        return
    slope, offset = platt(logit, fall)
    before = calibration.double().tolist()
    with torch.no_grad():
        calibration.copy_(torch.tensor([slope * before[0], slope * before[1] + offset]))


def platt(logit: Array, fall: BoolArray) -> tuple[float, float]:
    """Slope and offset of the logits with the highest likelihood; targets are smoothed."""
    count = np.array([(~fall).sum(), fall.sum()])
    target = np.where(fall, (count[1] + 1.0) / (count[1] + 2.0), 1.0 / (count[0] + 2.0))

    def cost(x: Array) -> tuple[float, Array]:
        z = x[0] * logit + x[1]
        loss = -(target * log_expit(z) + (1.0 - target) * log_expit(-z)).mean()
        slack = expit(z) - target
        return float(loss), np.array([(slack * logit).mean(), slack.mean()])

    found = minimize(cost, np.array([1.0, 0.0]), jac=True, bounds=[_SLOPES, (None, None)])
    return float(found.x[0]), float(found.x[1])


def balanced_threshold(prevalence: float) -> float:
    """Logit from which on a fall is the more likely where falls are as frequent as not.

    Args:
        prevalence: Share of falls where the logit was calibrated.
    """
    return float(np.log(prevalence / (1.0 - prevalence)))


def balanced_accuracy(logit: Tensor, fall: Tensor, threshold: float = 0.0) -> float:
    """Accuracy where half of the windows have a fall: the mean of both rates.

    It is what the accuracy on a sample with as many falls as not comes to on average.
    """
    return balanced((logit > threshold).numpy(), fall.numpy())
