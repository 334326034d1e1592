"""What the robot takes instead of what it was told, and who is asked whether that is safe."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import expit

from robomirror_drake.adaptation.command import adapt_command, foresee
from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import QualityPrediction, RobotReference
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.ppn.predictor import Judged
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
OPTIONS = AdaptationOptions.model_validate(
    {"method": "optimisation", "optimiser": {"knot_spacing": 0.4, "margin": 0.5}}
)
UNKNOWN = "brillig slithy toves"  # has no goals


class Foreseer:
    """Dislikes quick joints; once it was climbed, others see the risk ``apart`` from it."""

    options = SimpleNamespace(rate=20.0)

    def __init__(self, apart: float) -> None:
        self.apart, self.climbed = apart, False

    def judge(self, q, contact, every):
        self.climbed = True
        assert contact.shape == (*q.shape[:2], 2, 4)
        assert every == OPTIONS.every
        gradient = np.zeros_like(q)
        for shift, sign in ((0, 1.0), (1, -2.0), (2, 1.0)):
            slope = 6e-3 * sign * bends(q) / 23 / 0.05**2
            gradient[:, shift : q.shape[1] - 2 + shift, 7:] += slope
        return Judged(logit_of(q), np.zeros((len(q), 5)), gradient)

    def foresee(self, q, contact, every):
        assert (len(contact), every) == (len(q), OPTIONS.every)
        fall = expit(logit_of(q) + self.apart * self.climbed)
        return QualityPrediction(1.0, fall, *np.full((5, len(q)), 0.01))


def bends(q: np.ndarray) -> np.ndarray:
    return np.diff(q[..., 7:], 2, axis=1) / 0.05**2


def logit_of(q: np.ndarray) -> np.ndarray:
    return 3e-3 * (bends(q) ** 2).sum((1, 2)) / 23 - 4.0


@lru_cache
def walk() -> RobotReference:
    return retarget(ROBOT, load_clip("walk"))


def test_what_was_climbed_is_taken_where_all_say_that_it_is_safe():
    predictor = Foreseer(apart=-1.0)
    made = adapt_command(ROBOT, UNKNOWN, [walk()], predictor, OPTIONS)
    assert made.how == "optimised"
    assert made.risk_before > 0.1 >= made.risk
    (told,) = foresee(predictor, [made.reference], OPTIONS.every).fall_probability
    assert made.risk == made.changed.risk == made.changed.explanation.risk_after == told


def test_what_fools_who_was_climbed_alone_is_not_taken():
    made = adapt_command(ROBOT, UNKNOWN, [walk()], Foreseer(apart=3.0), OPTIONS)
    assert (made.how, made.changed) == ("unsafe", None)
    assert made.reference is walk()


def test_where_nothing_is_safe_the_safest_is_taken():
    made = adapt_command(ROBOT, UNKNOWN, [walk()], Foreseer(apart=0.3), OPTIONS)
    assert made.how == "unsafe"
    assert made.changed is not None
    assert 0.1 < made.risk < made.risk_before
    assert made.reason.startswith("nothing safe was found; the safest: Done with")


def test_no_candidate_is_refused():
    with pytest.raises(InputError, match="slithy"):
        adapt_command(ROBOT, UNKNOWN, [], Foreseer(0.0), OPTIONS)
