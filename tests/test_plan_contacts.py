"""Contacts of a plan: schedules mended, feet anchored, wrenches bounded where they stand."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.planning.contacts import anchors, hull_edges
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.planning.schedule import loaded_corners, standing_end, steady
from robomirror_drake.optimization.retargeting.footholds import heading
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
REST = np.zeros(40)


def corners_of(q: np.ndarray) -> np.ndarray:
    """(T, 2, 4, 3) sole corners in world."""
    links = centroidal.link_poses(ROBOT, list(ROBOT.foot_frames), q)
    turned = np.einsum("tfij,fcj->tfci", links[..., :3, :3], ROBOT.sole_corners)
    return turned + links[:, :, None, :3, 3]


def test_switches_load_only_what_both_sides_share() -> None:
    contact = np.zeros((20, 2, 4), dtype=bool)
    contact[:12, 0] = True
    contact[8:, 1] = True
    loaded = loaded_corners(contact, np.arange(20.0), 1.0)
    np.testing.assert_array_equal(loaded[:, 0, 0], np.arange(20) < 11)
    np.testing.assert_array_equal(loaded[:, 1, 0], np.arange(20) > 8)
    contact[8:12, 1] = False  # no double support now, and no flight either
    assert loaded_corners(contact, np.arange(20.0), 1.0).any(axis=(1, 2)).all()


def test_flicker_is_taken_out_of_a_schedule() -> None:
    still = np.repeat(corners_of(ROBOT.standing[None]), 40, axis=0)
    contact = np.ones((40, 2, 4), dtype=bool)
    contact[10:13, 0] = False
    contact[:2, 1] = False
    assert steady(contact, still, REST, 5).all()
    moved = still.copy()
    moved[12:, 0, :, 0] += 0.1
    assert not steady(contact, moved, REST, 5)[10:13, 0].any()
    contact[:, 0], contact[:, 1] = False, True
    contact[[0, 39], 0] = True
    contact[20:22, 0] = True
    mended = steady(contact, still, REST, 5)
    assert not mended[1:39, 0].any()
    assert mended[:, 1].all()


def test_support_passes_on_while_both_feet_stand() -> None:
    corners = np.repeat(corners_of(ROBOT.standing[None]), 40, axis=0)
    contact = np.zeros((40, 2, 4), dtype=bool)
    contact[:20, 0], contact[21:, 1] = True, True
    both = steady(contact, corners, REST, 7).any(axis=2).all(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(both), np.arange(17, 24))


def test_flight_is_believed_only_of_feet_that_leave_the_ground() -> None:
    corners = np.repeat(corners_of(ROBOT.standing[None]), 40, axis=0)
    corners[10:30, 0, :, 2] += 0.3
    contact = np.ones((40, 2, 4), dtype=bool)
    contact[10:30] = False
    mended = steady(contact, corners, REST, 5)
    assert mended[:, 1].all()
    assert not mended[10:30, 0].any()
    corners[10:30, 1, :, 2] += 0.1
    np.testing.assert_array_equal(steady(contact, corners, REST, 5), contact)
    corners[10:30, ..., 2] = 0.0
    np.testing.assert_array_equal(steady(contact, corners, REST - 8.0, 5), contact)


def test_added_time_brings_both_feet_down() -> None:
    cut = np.zeros((2, 4), dtype=bool)
    assert standing_end(cut, 10).all()  # in flight, both land at once
    cut[0] = True
    added = standing_end(cut, 10)
    assert added[:, 0].all()
    np.testing.assert_array_equal(added[:, 1, 0], np.arange(10) >= 5)


def test_anchors_are_flat_rectangles_at_the_mean_pose() -> None:
    corners = np.repeat(corners_of(ROBOT.standing[None]), 10, axis=0)
    corners[:, 0, :, 0] += np.linspace(0.0, 0.02, 10)[:, None]
    contact = np.ones((10, 2, 4), dtype=bool)
    placed = anchors(corners, contact, ROBOT.sole_corners, corners)
    np.testing.assert_allclose(np.ptp(placed, axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(placed[0, 0, :, :2], corners[:, 0, :, :2].mean(axis=0), atol=1e-9)
    np.testing.assert_array_equal(placed[..., 2], 0.0)


def test_a_pivoting_foot_turns_about_the_middle_of_what_stands() -> None:
    corners = np.repeat(corners_of(ROBOT.standing[None]), 40, axis=0)
    toe = corners[0, 0, :2, :2].mean(axis=0)
    angle = np.linspace(0.0, 1.5, 40)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    corners[:, 0, :, :2] = toe + (corners[:, 0, :, :2] - toe) @ turn.swapaxes(1, 2)
    contact = np.ones((40, 2, 4), dtype=bool)
    contact[:, 0, 2:] = False
    placed = anchors(corners, contact, ROBOT.sole_corners, corners)
    np.testing.assert_allclose(placed[:, 0], corners[:, 0] * [1.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.ptp(placed[:, 1], axis=0), 0.0, atol=1e-12)


def test_a_small_turn_is_no_pivot() -> None:
    corners = np.repeat(corners_of(ROBOT.standing[None]), 40, axis=0)
    corners[:, 0, :2, 1] += np.linspace(-0.02, 0.02, 40)[:, None]
    placed = anchors(corners, np.ones((40, 2, 4), dtype=bool), ROBOT.sole_corners, corners)
    np.testing.assert_allclose(np.ptp(placed, axis=0), 0.0, atol=1e-12)


@lru_cache
def planned(clip: str) -> RobotReference:
    return plan_dynamics(ROBOT, retarget(ROBOT, load_clip(clip)))


@pytest.mark.parametrize(
    ("clip", "most"),
    [("walk", 0.015), ("turn_right0", 0.015), ("jump", 0.03), ("kick", 0.03), ("punch", 0.03)],
)
def test_a_plan_of_a_real_motion_keeps_to_its_contacts_at_200_hz(clip, most, resampled) -> None:
    """The moment by which the ground would tip a sole, in body weights times metres, is small."""
    plan = planned(clip)
    assert plan.residuals["dynamic_violation"] < 0.03
    time, x, xd, xdd = resampled(plan, 200.0)
    soles = corners_of(x)
    wrench = centroidal.sample(ROBOT, [], x, xd, xdd, derivatives=False).wrench
    weight, friction = ROBOT.mass * centroidal.GRAVITY, ROBOT.spec.contact.friction
    # Between two frames with different contacts, the switch may be at either.
    frames = np.minimum(time * 60.0, len(plan.contact) - 1.0)
    loaded = plan.contact[np.floor(frames + 1e-9).astype(int)]
    loaded |= plan.contact[np.ceil(frames - 1e-9).astype(int)]
    bears = wrench[:, 5] > 0.1 * weight
    assert not (bears & ~loaded.any(axis=(1, 2)))[1:-1].any()
    for t in np.flatnonzero(bears):
        assert np.hypot(*wrench[t, 3:5]) < friction * wrench[t, 5] + 0.02 * weight
        normals, offsets = hull_edges(soles[t][loaded[t]][:, :2])
        cop = np.array([-wrench[t, 1], wrench[t, 0]]) / wrench[t, 5]
        outside = -np.min(normals @ cop - offsets) * wrench[t, 5] / weight
        assert outside < most, f"at {time[t]:.3f} s"
    assert soles[..., 2].min() > -0.004
    flying = ~loaded.any(axis=(1, 2))
    inner = flying[:-12] & flying[6:-6] & flying[12:]
    assert np.all(np.linalg.norm(wrench[6:-6][inner, 3:], axis=1) < 0.1 * weight)


@pytest.mark.parametrize("clip", ["walk", "jump", "kick"])
def test_feet_that_do_not_pivot_stay_where_they_stand(clip: str) -> None:
    plan = planned(clip)
    feet, pivots = corners_of(plan.q), 0
    for foot in range(2):
        for start, end in runs(plan.contact[:, foot].any(axis=1)):
            stands = plan.contact[start:end, foot]
            stance = feet[start:end, foot]
            assert np.abs(stance[..., 2][stands]).max() < 4e-3
            if np.ptp(np.unwrap(heading(stance))) > 0.3:
                pivots += 1
                continue
            for corner in range(4):
                moved = stance[stands[:, corner], corner, :2]
                assert len(moved) == 0 or np.ptp(moved, axis=0).max() < 4e-3
    assert pivots == (1 if clip == "kick" else 0)


def test_the_kick_turns_on_one_foot_for_as_long_as_the_human_does() -> None:
    plan = planned("kick")
    stance = plan.contact.any(axis=2)
    assert stance.any(axis=1).all()
    alone = [b - a for a, b in runs(stance[:, 0] & ~stance[:, 1])]
    assert 0.6 < max(alone) / 60.0 < 1.0


def test_a_plan_flies_where_the_human_does() -> None:
    ((start, end),) = runs(~planned("jump").contact.any(axis=(1, 2)))
    assert 0.38 < (end - start) / 60.0 < 0.5
    assert not runs(~planned("punch").contact.any(axis=(1, 2)))
