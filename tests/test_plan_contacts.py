"""Contacts of a plan: schedules mended, feet anchored, wrenches bounded where they stand."""

from __future__ import annotations

import numpy as np

from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.plan_contacts import anchors
from robomirror_drake.optimization.plan_schedule import loaded_corners, standing_end, steady
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
REST = np.zeros(40)


def corners_of(q: np.ndarray) -> np.ndarray:
    """(T, 2, 4, 3) sole corners in world."""
    links = centroidal.sample(
        ROBOT, list(ROBOT.foot_frames), q, 0 * q, 0 * q, derivatives=False
    ).links
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
    np.testing.assert_array_equal(np.flatnonzero(both), np.arange(18, 23))


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
