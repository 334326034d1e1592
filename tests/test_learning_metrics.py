"""Figures of predictions beside scikit-learn's, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull
from scipy.special import expit
from sklearn.calibration import calibration_curve
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import balanced_accuracy_score, r2_score, roc_auc_score, roc_curve

from robomirror_drake.learning import metrics
from robomirror_drake.learning.balance import balance
from robomirror_drake.learning.calibrate import balanced_accuracy, balanced_threshold, platt
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.centroidal_motion import centroidal_motion
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import state_frames
from robomirror_drake.robot import load_robot


@pytest.fixture(scope="module")
def scored() -> tuple[np.ndarray, np.ndarray]:
    """Logits, some of them alike, and falls that they foretell somewhat."""
    rng = np.random.default_rng(0)
    fall = rng.random(2000) < 0.1
    return np.round(rng.normal(size=2000) + 2.0 * fall - 3.0, 2), fall


def test_rates_and_curves_are_scikit_learns(scored):
    logit, fall = scored
    said = logit > -2.0
    assert metrics.balanced(said, fall) == pytest.approx(balanced_accuracy_score(fall, said))
    assert metrics.auroc(logit, fall) == pytest.approx(roc_auc_score(fall, logit))
    false, hit = metrics.roc(logit, fall)
    expected = roc_curve(fall, logit, drop_intermediate=False)
    np.testing.assert_allclose(false, expected[0])
    np.testing.assert_allclose(hit, expected[1])
    truth = np.random.default_rng(1).normal(size=50)
    assert metrics.r_squared(truth, 0.7 * truth) == pytest.approx(r2_score(truth, 0.7 * truth))


def test_calibration_is_scikit_learns(scored):
    logit, fall = scored
    probability = expit(logit)
    found = metrics.reliability(probability, fall)
    happened, said = calibration_curve(fall, probability, n_bins=metrics.BINS)
    np.testing.assert_allclose(found.happened, happened)
    np.testing.assert_allclose(found.said, said)
    error = np.average(np.abs(happened - said), weights=found.windows)
    assert metrics.calibration_error(probability, fall) == pytest.approx(error)
    assert metrics.calibration_error(np.where(fall, 1.0, 0.0), fall) == 0.0


def test_what_cannot_be_told_is_not_a_number():
    none = np.zeros(3, np.bool_)
    assert np.isnan(metrics.balanced(none, none))
    assert np.isnan(metrics.auroc(np.arange(3.0), none))
    assert np.isnan(metrics.r_squared(np.ones(3), np.ones(3)))
    assert np.isnan(metrics.interval(np.full(4, np.nan))).all()


def test_draws_of_commands_are_those_of_their_windows(scored):
    logit, fall = scored
    said = logit > -2.0
    command = np.random.default_rng(2).integers(100, 140, size=len(fall))
    draws = metrics.Draws(command, 400, seed=3)
    drawn = draws.balanced(said, fall)
    np.testing.assert_array_equal(drawn, metrics.Draws(command, 400, seed=3).balanced(said, fall))
    rng = np.random.default_rng(4)
    names = np.unique(command)
    slow = []
    for _ in range(400):
        own = np.concatenate([np.flatnonzero(command == c) for c in rng.choice(names, len(names))])
        slow.append(metrics.balanced(said[own], fall[own]))
    assert drawn.mean() == pytest.approx(np.mean(slow), abs=5e-3)
    assert drawn.std() == pytest.approx(np.std(slow), rel=0.2)
    low, high = metrics.interval(drawn)
    assert low < metrics.balanced(said, fall) < high


def test_windows_of_one_command_count_as_one_command():
    """A hundred copies of a window are no more evidence than one."""
    said = np.array([True, True, False, False, True, False])
    fall = np.array([True, False, False, True, True, False])
    command = np.arange(6)
    once = metrics.Draws(command, 500, seed=0).balanced(said, fall)
    often = metrics.Draws(np.repeat(command, 100), 500, seed=0)
    np.testing.assert_allclose(often.balanced(np.repeat(said, 100), np.repeat(fall, 100)), once)


def test_lead_is_of_the_first_alarm_that_stays():
    to_fall = np.array([0.5, 0.4, 0.3, 0.2, 0.1] * 3 + [np.inf] * 2)
    said = np.array([1, 0, 1, 1, 1] + [1, 1, 1, 1, 0] + [1] * 5 + [1, 1], np.bool_)
    episode = np.repeat([4, 2, 9, 3], [5, 5, 5, 2])
    leads = metrics.lead_times(said, to_fall, episode)
    np.testing.assert_allclose(leads, [0.0, 0.3, 0.5])  # of episodes 2, 4, 9
    mixed = np.random.default_rng(0).permutation(len(said))
    np.testing.assert_allclose(
        metrics.lead_times(said[mixed], to_fall[mixed], episode[mixed]), leads
    )


def test_logits_are_calibrated_to_true_probabilities():
    rng = np.random.default_rng(0)
    logit = rng.normal(size=20_000) * 3.0
    fall = rng.random(len(logit)) < expit(0.5 * logit - 2.0)
    slope, offset = platt(logit, fall)
    assert (slope, offset) == pytest.approx((0.5, -2.0), abs=0.06)
    model = LogisticRegression(C=1e6).fit(logit[:, None], fall)
    assert slope == pytest.approx(model.coef_[0, 0], rel=5e-3)
    assert offset == pytest.approx(model.intercept_[0], rel=5e-3)
    assert metrics.calibration_error(expit(slope * logit + offset), fall) < 0.01


def test_the_balanced_threshold_is_the_best_one():
    """Where both densities are known, the logit of equal likelihoods is the prior's."""
    rng = np.random.default_rng(1)
    prevalence, count = 0.05, 400_000
    fall = rng.random(count) < prevalence
    x = rng.normal(size=count) + 2.0 * fall  # log-likelihood ratio 2 x - 2
    threshold = balanced_threshold(prevalence)
    logit = 2.0 * x - 2.0 + threshold
    scores = [metrics.balanced(logit > threshold + shift, fall) for shift in (-1.0, 0.0, 1.0)]
    assert scores[1] == max(scores)
    told = balanced_accuracy(torch.from_numpy(logit), torch.from_numpy(fall), threshold)
    assert told == pytest.approx(scores[1])


def test_margins_are_distances_to_the_support():
    robot = load_robot()
    rng = np.random.default_rng(0)
    q = np.tile(robot.standing, (40, 1))
    q[:, 4:6] += rng.normal(size=(40, 2))
    q[:20, 7:] += 0.02 * rng.normal(size=(20, 23))
    angle = 0.12 * rng.random(40)
    q[:, 0], q[:, 1] = np.cos(angle / 2.0), np.sin(angle / 2.0)
    v = 0.3 * rng.normal(size=(40, 29))
    frames = state_frames(Body.of(robot), torch.tensor(q), torch.tensor(v))
    tilt, com, capture = balance(robot, frames).T
    np.testing.assert_allclose(tilt, angle, atol=1e-6)
    motion = centroidal_motion(robot, q, v)
    inside = 0
    for t in range(len(q)):
        corners = motion.corners[t].reshape(-1, 3)
        low = corners[:, 2].min()
        hull = ConvexHull(corners[corners[:, 2] < low + 0.03, :2])
        c, rate = motion.com[t], motion.com_velocity[t]
        ahead = c[:2] + rate[:2] * np.sqrt((c[2] - low) / GRAVITY)
        edges = hull.points[np.array([hull.vertices, np.roll(hull.vertices, -1)])]
        for found, point in ((com[t], c[:2]), (capture[t], ahead)):
            reach = -(hull.equations[:, :2] @ point + hull.equations[:, 2]).max()
            inside += bool(reach > 0.0)
            if reach < 0.0:
                start, way = edges[0], edges[1] - edges[0]
                share = ((point - start) * way).sum(1) / (way**2).sum(1)
                nearest = start + np.clip(share, 0.0, 1.0)[:, None] * way
                reach = -np.linalg.norm(nearest - point, axis=1).min()
            assert found == pytest.approx(reach, abs=1e-6)
    assert 10 < inside < 70
