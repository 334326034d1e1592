"""Whole motions before they begin: which are read, how they are judged, what choosing is worth."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.special import expit

from robomirror_drake.learning.calibrate import calibrate
from robomirror_drake.learning.metrics import Draws, auroc
from robomirror_drake.learning.motion_baseline import torque_logits
from robomirror_drake.learning.motions import Motion, foreseen, motion_figures, read_motions
from robomirror_drake.ppn.model import PPN
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.robot import load_robot

ROBOT = load_robot()


def motion(command, fell):
    return Motion(np.tile(ROBOT.standing, (61, 1)), np.ones((61, 2, 4)), command, fell)


def test_only_what_nothing_disturbed_is_read(tmp_path, write_executions):
    def third_is_pushed(row, _):
        row["kind"] = "pushed" if row["episode"] == 2 else "nominal"

    folder = write_executions(tmp_path, third_is_pushed, train=1, test=4, held_out=2)
    found = read_motions(folder, ("test", "held_out"))
    assert [one.command for one in found["test"]] == [1, 3, 4]
    assert [one.fell for one in found["test"]] == [True, False, False]
    assert len(found["held_out"]) == 2
    assert found["test"][0].q.shape == (91, 30)
    assert found["test"][0].contact.shape == (91, 2, 4)


def test_choosing_is_worth_what_the_scores_know():
    motions = [motion(c, f) for c, f in ((0, True), (0, False), (1, True), (1, False), (2, True))]
    known = motion_figures(motions, np.array([2.0, -2.0, 1.0, -1.0, 3.0]), 0.0, 100, 0)
    assert known["auroc"] == known["chosen_upright"] == known["true_positive_rate"] == 1.0
    assert known["false_positive_rate"] == 0.0
    assert known["commands"], known["commands_mixed"] == (3, 2)
    assert known["drawn_upright"] == 0.5
    wrong = motion_figures(motions, np.array([2.0, -2.0, -1.0, 1.0, 3.0]), 0.0, 100, 0)
    assert wrong["chosen_upright"] == 0.5
    assert wrong["auroc"] == pytest.approx(5.0 / 6.0)


def test_torques_tell_deep_crouches():
    """Trees on torques rank motions by how far the knees are bent, whichever leg it is."""
    rng = np.random.default_rng(0)
    knees = [7 + ROBOT.joint_names.index(f"{side}_KNEE") for side in ("L", "R")]

    def crouches(count):
        made = []
        for command in range(count):
            bent = rng.uniform(0.2, 1.6)
            one = motion(command, bent > 0.9)
            one.q[20:40, knees[command % 2]] = bent
            made.append(one)
        return made

    judged = crouches(30)
    made = torque_logits(ROBOT, crouches(120), crouches(40), [judged, []])
    assert len(made[1]) == 0
    assert auroc(made[0], np.array([one.fell for one in judged])) > 0.95


def test_bootstrap_of_auroc_is_that_of_repeated_clusters():
    rng = np.random.default_rng(0)
    cluster, fall = rng.integers(0, 6, 40), rng.random(40) < 0.4
    score = np.round(fall + rng.normal(size=40), 1)  # with ties
    draws = Draws(cluster, 20, 3)
    found = draws.auroc(score, fall)
    for weight, told in zip(draws._weight, found, strict=True):
        rows = np.repeat(np.arange(40), weight[np.unique(cluster, return_inverse=True)[1]])
        assert told == pytest.approx(auroc(score[rows], fall[rows]))


def test_calibration_is_of_motions_from_rest_alone():
    """It makes probabilities true, and leaves alone what is foreseen of a robot in motion."""
    torch.manual_seed(0)
    network = PPN(PPNOptions(), 78, 103)
    predictor = Predictor(network, ROBOT)
    before = foreseen(predictor, [motion(0, False)])[0]
    history = History.at_rest(ROBOT.standing, network.options.back)
    still = np.tile(ROBOT.standing, (1, 21, 1)), np.ones((1, 21, 2, 4))
    moving = predictor.foresee(*still, history=history).fall_probability

    rng = np.random.default_rng(1)
    logit = rng.normal(size=20_000) * 3.0
    fall = rng.random(20_000) < expit(0.5 * logit - 1.0)
    calibrate(network.motion_calibration, logit, fall)
    slope, offset = network.motion_calibration.tolist()
    assert (slope, offset) == (pytest.approx(0.5, abs=0.02), pytest.approx(-1.0, abs=0.06))
    after = foreseen(predictor, [motion(0, False)])[0]
    assert after == pytest.approx(slope * before + offset, abs=1e-4)
    assert predictor.foresee(*still, history=history).fall_probability == moving

    calibrate(network.motion_calibration, logit, np.zeros_like(fall))  # nothing to learn from
    assert network.motion_calibration.tolist() == [slope, offset]
