"""Real clips within the figures that the retargeter promises; warm starts; what is refused."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.generate import GeneratorOptions, generate
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.retargeting.footholds import (
    TURNS,
    footholds,
    heading,
    let_go,
)
from robomirror_drake.optimization.retargeting.retarget import (
    Retargeted,
    RetargetOptions,
    Warm,
    retarget,
    retarget_batch,
    retarget_solution,
    retarget_window,
    scale_motion,
    window_of,
)
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
OPTIONS = RetargetOptions()


@pytest.fixture(scope="module")
def walk():
    return load_clip("walk")


@pytest.fixture(scope="module")
def walked(walk):
    return retarget_solution(ROBOT, walk)


@pytest.mark.parametrize(
    ("clip", "keypoints"),
    [("walk", 0.025), ("turn_left0", 0.025), ("jump", 0.025), ("run", 0.04), ("spin", 0.03),
     ("kick", 0.04), ("spinkick", 0.04), ("punch", 0.04), ("dance_a", 0.08), ("dance_b", 0.08)],
)  # fmt: skip
def test_real_clips(clip, keypoints):
    reference = retarget(ROBOT, load_clip(clip))
    figures = reference.residuals
    assert figures["keypoint_error"] <= keypoints
    # dance_a turns on its heel faster than the robot's hip.
    assert figures["stance_drift"] <= (0.012 if clip == "dance_a" else 0.006)
    assert figures["penetration"] <= 0.005
    assert figures["self_penetration"] <= 0.005
    assert figures["limit_violation"] <= 1e-12
    np.testing.assert_allclose(np.diff(reference.time), 1 / 60, atol=1e-12)


@pytest.mark.parametrize("text", ["a man makes a batting swing", "a person swings a golf club"])
def test_arms_that_swing_past_each_other_do_not_pass_through_each_other(text):
    (motion,) = generate(text, 1, 0, GeneratorOptions(vigour=1.4))
    assert retarget(ROBOT, motion).residuals["self_penetration"] <= 0.005


def test_limits_hold_between_the_samples_too(walked):
    control, limits = walked.path.control[:, 6:], walked.problem.limits
    h = walked.path.spacing
    assert np.all(control >= limits.lower)
    assert np.all(control <= limits.upper)
    assert np.all(np.abs(np.diff(control, axis=0)) <= limits.speed * h)
    assert np.all(np.abs(np.diff(control, 2, axis=0)) <= limits.acceleration * h**2)


def test_knees_stay_bent(walk):
    reference = retarget(ROBOT, walk, options=RetargetOptions(knee_min=0.4))
    knees = [7 + ROBOT.joint_names.index(name) for name in ("L_KNEE", "R_KNEE")]
    assert reference.q[:, knees].min() >= 0.4


def test_next_window_goes_on_where_the_last_one_is(walk):
    targets = scale_motion(ROBOT, walk, foot_contacts(walk))
    first = retarget_window(ROBOT, window_of(targets, 0, 49), OPTIONS)
    shift = 3
    start = round(shift * OPTIONS.knot_spacing * 60)
    following = retarget_window(
        ROBOT, window_of(targets, start, start + 49), OPTIONS, Warm(first.path, shift)
    )
    for name in ("q", "v", "a"):
        before, after = (getattr(r.reference, name) for r in (first, following))
        np.testing.assert_allclose(after[0], before[start], atol=1e-9)
    assert following.reference.residuals["stance_drift"] <= 0.005


def test_warm_start_takes_fewer_iterations(walk, walked):
    neighbour = dataclasses.replace(walk, positions=walk.positions * [1.03, 1.0, 1.0])
    warm = retarget_solution(ROBOT, neighbour, warm=Warm(walked.path))
    cold = retarget_solution(ROBOT, neighbour)
    assert warm.solution.converged
    assert warm.solution.iterations < cold.solution.iterations


def test_batch_keeps_order_and_reports_what_fails(walk):
    short = dataclasses.replace(walk, positions=walk.positions[:16])
    wild = np.random.default_rng(0).normal(scale=0.4, size=short.positions.shape)
    broken = dataclasses.replace(short, positions=short.positions + wild, source="broken")
    good, bad, again = retarget_batch(ROBOT, [short, broken, short])
    assert isinstance(good, Retargeted)
    assert isinstance(again, Retargeted)
    assert isinstance(bad, RetargetingError)
    assert bad.motion == "broken"
    assert bad.exceeded
    assert all(bad.residuals[name] > 0.0 for name in bad.exceeded)


@pytest.mark.parametrize(("frames", "fps"), [(2, 60.0), (2, 20.0), (3, 30.0), (5, 120.0)])
def test_shortest_motions(walk, frames, fps):
    motion = HumanMotion(walk.positions[:frames], fps)
    contacts = np.ones((frames, 2, 2), dtype=bool)
    reference = retarget(ROBOT, motion, contacts)
    assert reference.duration <= motion.duration + 1e-9


def test_a_human_without_legs_is_refused():
    motion = HumanMotion(np.zeros((10, 22, 3)), 20.0, source="points")
    with pytest.raises(RetargetingError, match="leg_length"):
        retarget(ROBOT, motion, np.zeros((10, 2, 2), dtype=bool))


def test_contacts_of_another_length_are_refused(walk):
    with pytest.raises(ValueError, match="contacts has shape"):
        retarget(ROBOT, walk, np.ones((5, 2, 2), dtype=bool))


def test_a_foothold_is_flat_and_does_not_move_within_a_phase(walked):
    targets = walked.targets
    for foot in (0, 1):
        for start, stop in runs(targets.contact[:, foot].any(axis=1)):
            anchor = targets.anchor[start:stop, foot]
            assert np.ptp(anchor, axis=0).max() == 0.0
            assert np.all(anchor[..., 2] == 0.0)
            front = np.linalg.norm(anchor[0, 0] - anchor[0, 1])
            assert front == pytest.approx(0.084, abs=1e-9)


def test_a_sliding_foot_lets_go_between_footholds():
    corners = np.tile(np.array([[[0.1, 0.05, 0], [0.1, -0.05, 0], [-0.1, -0.05, 0],
                                 [-0.1, 0.05, 0]]]), (2, 1, 1))  # fmt: skip
    slide = np.interp(np.arange(60), [25, 35], [0.0, 0.3])
    soles = corners + np.zeros((60, 2, 4, 3))
    soles[:, 0, :, 0] += slide[:, None]
    ends = np.ones((60, 2, 4), dtype=bool)
    contact, anchor = footholds(soles, ends, corners, np.zeros(60), np.zeros((2, 2)))
    assert contact[:, 1].all()
    assert len(runs(contact[:, 0].any(axis=1))) > 1
    np.testing.assert_allclose(anchor[0, 0], corners[0], atol=0.03)
    np.testing.assert_allclose(anchor[-1, 0], corners[0] + [0.3, 0, 0], atol=0.03)


def test_a_pivoting_foot_turns_on_the_spot():
    corners = np.tile(np.array([[[0.1, 0.05, 0], [0.1, -0.05, 0], [-0.1, -0.05, 0],
                                 [-0.1, 0.05, 0]]]), (2, 1, 1))  # fmt: skip
    yaw = np.interp(np.arange(80), [25, 55], [0.0, 1.5])
    turn = Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    soles = corners + np.zeros((80, 2, 4, 3))
    toe = corners[0, :2].mean(axis=0)
    soles[:, 0] = (corners[0] - toe) @ turn.swapaxes(1, 2) + toe
    ends = np.ones((80, 2, 4), dtype=bool)
    ends[:, 0, 2:] = False
    stiff, agile = np.zeros((2, 2)), np.tile([-2.0, 2.0], (2, 1))
    _, anchor = footholds(soles, ends, corners, yaw, agile)
    assert np.ptp(heading(anchor[:, 0])) == pytest.approx(1.5 - 2 * TURNS, abs=0.02)
    contact, anchor = footholds(soles, ends, corners, yaw, stiff)
    assert contact.all()  # its heel hangs low
    assert np.ptp(anchor[:, 0, :2].mean(axis=1), axis=0).max() < 1e-9
    np.testing.assert_allclose(anchor[:, 0, :2], soles[:, 0, :2], atol=0.01)
    assert np.ptp(anchor[:, 1], axis=0).max() == 0.0


def test_contacts_end_earlier_but_not_where_the_robot_would_fly():
    contact = np.zeros((20, 2, 1), dtype=bool)
    contact[:12, 0], contact[12:, 1] = True, True
    miss = np.zeros((20, 2, 1))
    miss[10:12, 0] = 0.02
    assert let_go(contact, miss, 0.01)[:, 0, 0].sum() == 12
    contact[9:, 1] = True
    assert let_go(contact, miss, 0.01)[:, 0, 0].sum() == 10
    contact[12:, 1], contact[9:12, 1] = False, False
    assert let_go(contact, miss, 0.01)[:, 0, 0].sum() == 12
    assert let_go(contact, miss, 0.01, grace=1)[:, 0, 0].sum() == 11


@pytest.mark.parametrize(
    ("clip", "flights"),
    [("walk", 0), ("turn_right0", 0), ("kick", 0), ("punch", 0), ("jump", 1), ("spinkick", 1),
     ("run", 2), ("dance_a", 1), ("dance_b", 2), ("spin", 2)],
)  # fmt: skip
def test_a_reference_flies_where_the_human_does(clip, flights):
    motion = load_clip(clip)
    contact = retarget(ROBOT, motion).contact
    air = runs(~contact.any(axis=(1, 2)))
    assert len(air) == flights
    free = ~foot_contacts(motion).any(axis=(1, 2))
    for start, stop in air:
        human = free[round(start / 60 * motion.fps) : round(stop / 60 * motion.fps) + 1]
        assert (stop - start) / 60 - human.sum() / motion.fps < 0.08
