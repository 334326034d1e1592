"""Candidates in six dimensions: safety first, then quality."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from robomirror_drake.adaptation.ranking import RankingOptions, rank
from robomirror_drake.goals import Satisfaction
from robomirror_drake.messages import DIMENSIONS, QualityPrediction, Ranking

GOOD = {"self_penetration": 0.0, "penetration": 0.0, "keypoint_error": 0.01, "stance_drift": 0.001}
ERRORS = ("A_q", "A_qd", "A_qdd", "A_p", "A_theta")


def predict(fall: list[float], **errors: list[float]) -> QualityPrediction:
    usual = {name: np.full(len(fall), 0.01) for name in ERRORS}
    return QualityPrediction(1.0, np.array(fall), **(usual | errors))  # type: ignore[arg-type]


def satisfied(score: float, done: bool = True) -> Satisfaction:
    missed = () if done else (SimpleNamespace(met=False, __str__=lambda _: "too low"),)
    return Satisfaction(missed, score, done)  # type: ignore[arg-type]


def options(**weights: float) -> RankingOptions:
    return RankingOptions.model_validate({"weights": weights} if weights else {})


fall_lists = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8)


@settings(max_examples=100, deadline=None)
@given(falls=fall_lists, t_safe=st.floats(0.0, 0.99), seed=st.integers(0, 9999))
def test_what_is_safe_comes_before_what_is_not_and_each_in_its_order(falls, t_safe, seed):
    rng = np.random.default_rng(seed)
    n = len(falls)
    errors = {name: rng.uniform(0.0, 1.0, n) for name in ERRORS}
    goals = [satisfied(float(s), bool(s > 0.5)) for s in rng.uniform(0.0, 1.0, n)]
    made = rank([GOOD] * n, predict(falls, **errors), goals, RankingOptions(t_safe=t_safe))
    safety = 1.0 - np.array(falls)
    np.testing.assert_array_equal(made.safe, safety > t_safe)
    assert ((made.scores >= 0.0) & (made.scores <= 1.0)).all()
    safe, unsafe = ([i for i in made.order if made.safe[i] == s] for s in (True, False))
    assert list(made.order) == safe + unsafe
    assert (np.diff(made.quality[safe]) <= 0.0).all()
    assert (np.diff(safety[unsafe]) <= 0.0).all()
    assert len(made.reasons) == n


def test_a_better_one_that_is_not_safe_loses_to_a_worse_one_that_is():
    better = predict([0.11, 0.02], A_q=[0.0, 0.2], A_p=[0.0, 0.2])
    goals = [satisfied(1.0), satisfied(0.7)]
    made = rank([GOOD, GOOD], better, goals)
    assert made.quality[0] > made.quality[1]
    assert list(made.order) == [1, 0]
    assert made.reasons[0] == "not safe enough: P(fall) 11.0%, allowed below 10.0%"
    assert made.reasons[1].startswith("safe (P(fall) 2.0%) and the best in quality")
    bold = rank([GOOD, GOOD], better, goals, RankingOptions(t_safe=0.8))
    assert list(bold.order) == [0, 1]
    assert "most of all in tracking" in bold.reasons[1]


def test_safety_exactly_at_the_threshold_is_not_enough():
    assert not rank([GOOD], predict([0.25]), options=RankingOptions(t_safe=0.75)).safe[0]
    assert rank([GOOD], predict([0.24]), options=RankingOptions(t_safe=0.75)).safe[0]


def test_where_none_is_safe_the_safest_is_taken_and_it_is_said():
    made = rank([GOOD] * 3, predict([0.9, 0.4, 0.6], A_q=[0.0, 0.9, 0.0]))
    assert list(made.order) == [1, 2, 0]
    assert made.reasons[1].startswith("the safest, though none is safe enough: P(fall) 40.0%")


@pytest.mark.parametrize(
    ("dimension", "residuals", "errors", "goals"),
    [
        ("collision", [GOOD | {"self_penetration": 0.02}, GOOD], {}, None),
        ("collision", [GOOD | {"penetration": 0.01}, GOOD], {}, None),
        ("feasibility", [GOOD | {"keypoint_error": 0.08}, GOOD], {}, None),
        ("feasibility", [GOOD | {"stance_drift": 0.01}, GOOD], {}, None),
        ("feasibility", [GOOD | {"limit_violation": 0.1}, GOOD], {}, None),
        ("tracking", [GOOD, GOOD], {"A_q": [0.1, 0.01]}, None),
        ("tracking", [GOOD, GOOD], {"A_p": [0.1, 0.01]}, None),
        ("tracking", [GOOD, GOOD], {"A_theta": [0.1, 0.01]}, None),
        ("smoothness", [GOOD, GOOD], {"A_qd": [0.5, 0.01]}, None),
        ("smoothness", [GOOD, GOOD], {"A_qdd": [5.0, 0.01]}, None),
        ("goal", [GOOD, GOOD], {}, [satisfied(0.7), satisfied(0.9)]),
        ("goal", [GOOD, GOOD], {}, [satisfied(0.9, done=False), satisfied(0.9)]),
    ],
)
def test_each_figure_lowers_its_own_dimension_only(dimension, residuals, errors, goals):
    made = rank(residuals, predict([0.0, 0.0], **errors), goals)
    lower = made.scores[0] < made.scores[1]
    assert [DIMENSIONS[i] for i in np.flatnonzero(lower)] == [dimension]
    assert made.best == 1
    assert f"most of all in {dimension}" in made.reasons[0]


def test_a_half_is_where_a_score_is_one_half():
    halves = RankingOptions().halves
    errors = {name: [0.0] for name in ERRORS}
    clean = dict.fromkeys(GOOD, 0.0)
    perfect = rank([clean], predict([0.0], **errors)).scores[0]
    np.testing.assert_array_equal(perfect, np.ones(6))
    made = rank([clean], predict([0.3], **(errors | {"A_q": [halves.A_q]}))).scores[0]
    np.testing.assert_allclose(made, [1.0, 1.0, 0.7, 0.5, 1.0, 1.0])


@settings(max_examples=50, deadline=None)
@given(weights=st.lists(st.floats(0.01, 5.0), min_size=6, max_size=6))
def test_quality_is_the_weighted_mean_and_only_ratios_of_weights_matter(weights):
    named = dict(zip(DIMENSIONS, weights, strict=True))
    double = {name: 2.0 * w for name, w in named.items()}
    goals = [satisfied(0.8), satisfied(1.0)]
    foreseen = predict([0.02, 0.05], A_q=[0.02, 0.05])
    made, twice = (rank([GOOD, GOOD], foreseen, goals, options(**w)) for w in (named, double))
    np.testing.assert_allclose(made.quality, made.scores @ weights / sum(weights))
    np.testing.assert_allclose(made.quality, twice.quality)
    np.testing.assert_array_equal(made.order, twice.order)


def test_a_weight_of_nought_takes_a_dimension_out():
    goals = [satisfied(0.6), satisfied(1.0)]
    foreseen = predict([0.0, 0.0], A_q=[0.0, 0.05])
    none = dict.fromkeys(DIMENSIONS, 0.0)
    assert rank([GOOD, GOOD], foreseen, goals, options(**(none | {"goal": 1.0}))).best == 1
    assert rank([GOOD, GOOD], foreseen, goals, options(**(none | {"tracking": 1.0}))).best == 0


def test_what_is_equal_keeps_its_order_and_the_task_that_is_missed_is_named():
    goals = [satisfied(1.0), satisfied(1.0), satisfied(0.9, done=False)]
    made = rank([GOOD] * 3, predict([0.0, 0.0, 0.0]), goals)
    assert list(made.order) == [0, 1, 2]
    assert "as good as the best" in made.reasons[1]
    assert "task not done" in made.reasons[2]


def test_bad_input_is_refused_by_name():
    with pytest.raises(ValueError, match="no candidate"):
        rank([], predict([]))
    with pytest.raises(ValueError, match="2 candidates, but 1 predictions"):
        rank([GOOD, GOOD], predict([0.1]))
    with pytest.raises(ValueError, match="1 candidates, but 2 satisfactions"):
        rank([GOOD], predict([0.1]), [satisfied(1.0), satisfied(1.0)])
    with pytest.raises(ValueError, match="self_penetration"):
        rank([{}], predict([0.1]))
    with pytest.raises(ValueError, match=r"fall_probability is 1\.2"):
        predict([0.1, 1.2])
    with pytest.raises(ValueError, match="A_q has shape"):
        predict([0.1, 0.2], A_q=[0.1])
    with pytest.raises(ValueError, match="horizon"):
        QualityPrediction(0.0, *([0.0],) * 6)
    with pytest.raises(ValueError, match="each of 0 to 1 once"):
        Ranking(np.array([0, 0]), np.ones((2, 6)), np.ones(2), np.ones(2, bool), ("a", "b"))
    with pytest.raises(ValidationError, match="positive weight"):
        options(**dict.fromkeys(DIMENSIONS, 0.0))
    with pytest.raises(ValidationError):
        RankingOptions(t_safe=1.0)
