"""Several predictors as one."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.special import expit, logit

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import RobotReference
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.robot import load_robot

ROBOT = load_robot()


@pytest.fixture(scope="module")
def members(make_predictor) -> list[Predictor]:
    return [
        make_predictor(0, torch.float64),
        make_predictor(1, torch.float64, horizon=1.0, history=0.4),
    ]


@pytest.fixture(scope="module")
def motions() -> tuple[np.ndarray, np.ndarray]:
    """Two motions (2, N, 30) at 20 Hz that sway, with their contacts."""
    time = np.arange(40) / 20.0
    q = np.tile(ROBOT.standing, (2, len(time), 1))
    q[:, :, 7:] += 0.1 * np.sin(np.multiply.outer([2.0, 3.0], time))[..., None]
    return q, np.ones((2, len(time), 2, 4))


def test_it_foresees_the_mean_of_logits_and_errors(members, motions):
    told = [member.foresee(*motions) for member in members]
    made = Ensemble(members).foresee(*motions)
    assert abs(told[0].fall_probability - told[1].fall_probability).max() > 1e-3
    mean = np.mean([logit(one.fall_probability) for one in told], axis=0)
    np.testing.assert_allclose(made.fall_probability, expit(mean), atol=1e-12)
    for name in ("A_q", "A_qd", "A_qdd", "A_p", "A_theta"):
        mean = np.mean([getattr(one, name) for one in told], axis=0)
        np.testing.assert_allclose(getattr(made, name), mean)


def test_one_alone_is_what_it_is(members, motions):
    made, alone = Ensemble(members[:1]).judge(*motions), members[0].judge(*motions)
    for mine, its in zip(made, alone, strict=True):
        np.testing.assert_array_equal(mine, its)


def test_its_gradient_is_that_of_its_logit(members, motions):
    q, contact = motions
    ensemble = Ensemble(members)
    told = ensemble.judge(q, contact)
    np.testing.assert_allclose(
        expit(told.logit), ensemble.foresee(q, contact).fall_probability, atol=1e-9
    )
    rng = np.random.default_rng(0)
    for _ in range(3):
        way = rng.standard_normal(q.shape)
        way[..., :4] = 0.0
        ahead, behind = (ensemble.judge(q + s * 1e-6 * way, contact).logit for s in (1.0, -1.0))
        slope = (told.gradient * way).sum(axis=(1, 2))
        np.testing.assert_allclose((ahead - behind) / 2e-6, slope, rtol=1e-5, atol=1e-8)


def test_each_sees_as_much_of_the_past_as_it_looks_at(members, motions):
    q, contact = motions
    time = np.arange(120) / 60.0
    rows = np.minimum(np.arange(120) // 3, 39)
    still = np.zeros((120, 29))
    reference = RobotReference(time, q[0, rows], still, still, contact[0, rows].astype(bool))
    ensemble = Ensemble(members)
    back = ensemble.options.back
    assert back == members[1].options.back > members[0].options.back
    history = History(q[0, :back], still[:back])
    short = History(history.q[-members[0].options.back :], still[: members[0].options.back])
    told = [
        members[0].predict([reference], 0.5, short),
        members[1].predict([reference], 0.5, history),
    ]
    made = ensemble.predict([reference], 0.5, history)
    mean = np.mean([logit(one.fall_probability) for one in told], axis=0)
    np.testing.assert_allclose(made.fall_probability, expit(mean), atol=1e-12)


def test_other_rates_are_refused(members, make_predictor):
    with pytest.raises(ConfigError, match="10 and 20 Hz"):
        Ensemble([members[0], make_predictor(2, rate=10.0, stack=1)])


def test_weights_are_named_alone_or_in_a_list():
    one, two = (
        AdaptationOptions.model_validate({"predictor": given}).predictor
        for given in ("ppn_1s", ["ppn_1s", "ppn_3s"])
    )
    assert (one, two) == (("ppn_1s",), ("ppn_1s", "ppn_3s"))
    with pytest.raises(ValueError, match="predictor"):
        AdaptationOptions.model_validate({"predictor": []})
