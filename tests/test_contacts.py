"""Contact labels on the real clips: who stands when, and no false flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.contacts import foot_contacts, pelvis_acceleration
from robomirror_drake.motion.ground import clearance
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS, load_clip
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.skeleton import INDEX

WALKS = ("walk", "walk_forward", "turn_left0", "turn_left1", "turn_right0", "turn_right1")


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Half-open intervals where the mask holds."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return list(zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True))


def flights(motion: HumanMotion) -> list[tuple[float, float]]:
    """Start and length [s] of every flight."""
    free = ~foot_contacts(motion).any(axis=(1, 2))
    return [(a / motion.fps, (b - a) / motion.fps) for a, b in runs(free)]


@pytest.mark.parametrize("name", WALKS)
def test_walk_alternates_with_double_support(name: str) -> None:
    motion = load_clip(name)
    stance = foot_contacts(motion).any(axis=2)
    assert stance.any(axis=1).all()
    double = runs(stance.all(axis=1))
    assert 2 <= len(double) <= 4
    assert all(b - a <= 0.25 * motion.fps for a, b in double)
    swings = [runs(~stance[:, foot]) for foot in range(2)]
    assert [len(s) for s in swings] == [1, 1]  # a clip is one cycle: one swing each
    assert swings[0][0][1] <= swings[1][0][0]  # the left before the right, and not both
    for (a, b), foot in ((swings[0][0], 0), (swings[1][0], 1)):
        assert 0.25 < (b - a) / motion.fps < 0.65
        assert clearance(motion.positions)[a:b, foot].max() > 0.1


def test_walk_lands_on_the_heel_and_leaves_by_the_toe() -> None:
    contact = foot_contacts(load_clip("walk"))
    left = contact[:, 0]
    touchdown = runs(left.any(axis=1))[-1][0]
    assert left[touchdown, 0]
    assert not left[touchdown, 1]
    right = contact[:, 1]
    lift_off = runs(right.any(axis=1))[0][1] - 1
    assert right[lift_off, 1]
    assert not right[lift_off, 0]


def test_jump_is_one_flight() -> None:
    motion = load_clip("jump")
    ((start, length),) = flights(motion)
    assert 0.7 < start < 0.9
    assert 0.3 < length < 0.6
    contact = foot_contacts(motion)
    assert contact[: int(0.3 * motion.fps)].all()
    assert contact[int(1.35 * motion.fps) :].all()


def test_run_flies_between_the_feet() -> None:
    motion = load_clip("run")
    air = flights(motion)
    assert len(air) == 2
    assert all(0.08 < length < 0.2 for _, length in air)
    stance = foot_contacts(motion).any(axis=2)
    assert not stance.all(axis=1).any()


def test_kick_stands_on_the_left_leg() -> None:
    motion = load_clip("kick")
    stance = foot_contacts(motion).any(axis=2)
    assert not flights(motion)
    kicking = motion.positions[:, INDEX["right_ankle"], 2] > 0.2
    assert kicking.sum() / motion.fps > 0.4
    assert (stance[kicking] == [True, False]).all()
    assert stance[:6].all()
    assert stance[-6:].all()


@pytest.mark.parametrize("name", FEET_ONLY_CLIPS)
@pytest.mark.parametrize("fps", [None, 60.0])
def test_flight_only_with_evidence(name: str, fps: float | None) -> None:
    motion = load_clip(name) if fps is None else resample(load_clip(name), fps)
    free = ~foot_contacts(motion).any(axis=(1, 2))
    falling = pelvis_acceleration(motion) < -5.0
    high = clearance(motion.positions).min(axis=(1, 2)) > 0.2
    assert not (free & ~falling & ~high).any()
    assert all(length > 0.05 for _, length in flights(motion))


def test_dance_flies_only_in_its_two_hops() -> None:
    """In both the pelvis falls at about 8 m/s² and the lower foot is over 7 cm up."""
    motion = load_clip("dance_b")
    air = flights(motion)
    assert len(air) == 2
    height = clearance(motion.positions).min(axis=(1, 2))
    drop = pelvis_acceleration(motion)
    for start, length in air:
        hop = slice(round(start * motion.fps), round((start + length) * motion.fps))
        assert length < 0.25
        assert height[hop].max() > 0.07
        assert drop[hop].min() < -7.0


@pytest.mark.parametrize("name", FEET_ONLY_CLIPS)
def test_phases_are_no_flicker(name: str) -> None:
    motion = load_clip(name)
    stance = foot_contacts(motion).any(axis=2)
    for foot in range(2):
        inner = [r for r in runs(~stance[:, foot]) if r[0] > 0 and r[1] < len(stance)]
        assert all(b - a >= 0.05 * motion.fps for a, b in inner)


@pytest.mark.parametrize("name", ["walk", "jump", "kick", "dance_b"])
def test_labels_hardly_depend_on_the_rate(name: str) -> None:
    motion = load_clip(name)
    coarse = foot_contacts(motion).any(axis=2)
    fine = foot_contacts(resample(motion, 4.0 * motion.fps)).any(axis=2)[::4]
    assert (coarse == fine).mean() > 0.93


def test_mirror_swaps_the_feet() -> None:
    motion = load_clip("kick")
    swap = [INDEX[j.replace("left", "?").replace("right", "left").replace("?", "right")]
            for j in INDEX]  # fmt: skip
    mirrored = replace(motion, positions=motion.positions[:, swap] * [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(foot_contacts(mirrored), foot_contacts(motion)[:, ::-1])


def test_floating_and_standing_still() -> None:
    """A body that hangs 10 cm too high, at rest, stands all the same."""
    still = np.repeat(load_clip("jump").positions[:1], 30, axis=0)
    assert foot_contacts(HumanMotion(still, 30.0)).all()
    hung = HumanMotion(still + np.array([0.0, 0.0, 0.1]), 30.0)
    assert foot_contacts(hung).any(axis=(1, 2)).all()
