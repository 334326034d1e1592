"""Which corners bear load, where the feet are anchored, how the reference follows them."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.optimization.control.dynamics_terms import TaskMotion
from robomirror_drake.optimization.control.reference_trajectory import ReferenceSample
from robomirror_drake.optimization.control.stance import (
    DESCENT,
    EARLY,
    HANGING,
    Stance,
    bearing,
    feel,
    initial_stance,
    moved,
    shifted,
    update_stance,
)

CORNERS = np.array([[[0.1, 0.04, 0.0], [0.1, -0.04, 0.0], [-0.1, -0.04, 0.0], [-0.1, 0.04, 0.0]]])
CORNERS = np.concatenate([CORNERS, CORNERS])
NEVER = np.full((2, 4), np.inf)


def _motion(left: tuple[float, float, float], right: tuple[float, float, float]) -> TaskMotion:
    p = np.array([[0.0, 0.0, 0.85], [0.0, 0.0, 1.0], left, right])
    return TaskMotion(
        com=np.array([[0.0, 0.0, 0.9], [0.0] * 3, [0.0] * 3]),
        angular=np.zeros((2, 3)),
        R=np.tile(np.eye(3), (4, 1, 1)),
        p=p,
        v=np.zeros((4, 6)),
        a=np.zeros((4, 6)),
    )


def _sample(
    load: np.ndarray, wait: np.ndarray = NEVER, left: np.ndarray = -NEVER
) -> ReferenceSample:
    nowhere = np.zeros(30), np.zeros(29), np.zeros(29), np.zeros((2, 6))
    return ReferenceSample(*nowhere, load, wait, left)


def _update(
    last: Stance,
    motion: TaskMotion,
    reference: TaskMotion,
    sample: ReferenceSample,
    force: tuple[float, float] | None = None,
) -> Stance:
    vertical = np.outer((np.nan, np.nan) if force is None else force, [0.0, 0.0, 1.0])
    return update_stance(last, motion, reference, sample, CORNERS, 0.004, 0.03, vertical)


def test_corners_in_the_air_bear_nothing_and_early_ones_do() -> None:
    planned = np.array([[1.0, 1.0, 0.5, 1.0], [0.0, 0.0, 0.0, 0.0]])
    height = np.array([[0.0, 2 * HANGING, 0.0, HANGING], [-1e-4, -1e-4, 1e-3, -1e-4]])
    wait = np.array([[-1.0] * 4, [EARLY / 2, 2 * EARLY, EARLY / 2, np.inf]])
    long, short = np.ones(2), np.array([0.015, 0.0])
    load = bearing(_sample(planned, wait), long, height, 0.03)
    np.testing.assert_array_equal(load[0], [1.0, 0.0, 0.5, 0.0])
    # The other foot came down a little before its time; corners that are far from theirs wait.
    np.testing.assert_array_equal(load[1], [1.0, 0.0, 1.0, 0.0])
    # Not if it has hardly left the ground.
    load = bearing(_sample(planned, wait, left=np.full((2, 4), -0.01)), long, height, 0.03)
    np.testing.assert_array_equal(load[1], 0.0)
    # Loads are taken up within the ramp, and not at all in the air.
    load = bearing(_sample(planned, wait), short, height, 0.03)
    np.testing.assert_allclose(load[0], [0.5, 0.0, 0.25, 0.0])
    np.testing.assert_array_equal(load[1], 0.0)


def test_a_foot_that_is_felt_stands_on_its_lowest_corner() -> None:
    height = 0.02 + np.array([[0.0, 0.0, HANGING, HANGING]] * 2)
    load = bearing(_sample(np.ones((2, 4))), np.array([1.0, 0.0]), height, 0.03)
    np.testing.assert_allclose(load, [[1.0, 1.0, 0.0, 0.0], [0.0] * 4], atol=1e-12)


def test_the_last_foot_is_not_relieved_while_the_other_is_late() -> None:
    handover = np.array([[0.0] * 4, [1.0] * 4])
    for right, expected in ((0.0, 1.0), (0.1, 0.0)):
        load = bearing(_sample(handover), np.array([1.0, right]), np.zeros((2, 4)), 0.03)
        np.testing.assert_array_equal(load[0], expected)


def test_touch_is_felt_by_force_and_lost_when_height_agrees() -> None:
    air, ground = np.full((2, 4), 0.05), np.zeros((2, 4))
    strong, weak, none = (np.outer([f, 0.0], [0.0, 0.0, 1.0]) for f in (50.0, 20.0, 0.0))
    last = np.zeros(2)
    np.testing.assert_array_equal(feel(last, weak, ground, 0.004), 0.0)
    felt = feel(last, strong, air, 0.004)
    np.testing.assert_array_equal(felt, [0.004, 0.0])
    np.testing.assert_array_equal(feel(felt, weak, air, 0.004), [0.008, 0.0])
    np.testing.assert_array_equal(feel(felt, none, ground, 0.004), [0.008, 0.0])
    np.testing.assert_array_equal(feel(felt, none, air, 0.004), 0.0)
    np.testing.assert_array_equal(feel(last, np.full((2, 3), np.nan), ground, 0.004), 0.004)


def test_a_late_foot_goes_down_faster_than_the_body_falls() -> None:
    both = np.ones((2, 4))
    reference = _motion((0.0, 0.1, 0.0), (0.0, -0.1, 0.0))
    hanging = _motion((0.0, 0.1, 0.02), (0.0, -0.1, 0.0))
    com = hanging.com.copy()
    com[1, 2] = -0.4
    hanging = hanging._replace(com=com)
    stance = _update(initial_stance(), hanging, reference, _sample(both), (0.0, 600.0))
    np.testing.assert_array_equal(stance.late, [1.0, 0.0])
    wanted = shifted(moved(reference, stance.offset), hanging, stance.late, stance.steps)
    assert wanted.p[2, 2] == pytest.approx(0.02)
    assert wanted.v[2, 2] == pytest.approx(-0.4 - DESCENT)
    np.testing.assert_array_equal(wanted.v[3], 0.0)


def test_a_sole_is_anchored_where_its_loaded_corners_come_down_and_stays() -> None:
    both = np.ones((2, 4))
    reference = _motion((0.0, 0.1, 0.0), (0.0, -0.1, 0.0))
    landed = _motion((0.02, 0.1, 0.001), (0.0, -0.1, 0.0))
    stance = _update(initial_stance(), landed, reference, _sample(both))
    np.testing.assert_allclose(stance.anchor, [[0.02, 0.1, 0.0], [0.0, -0.1, 0.0]])
    slid = _motion((0.03, 0.1, 0.0), (0.0, -0.1, 0.0))
    stance = _update(stance, slid, reference, _sample(both))
    np.testing.assert_allclose(stance.anchor[0], [0.02, 0.1, 0.0])
    toes = both.copy()
    toes[0, 2:] = 0.0
    stance = _update(stance, slid, reference, _sample(toes))
    np.testing.assert_allclose(stance.anchor[0], [0.13, 0.1, 0.0])


def test_the_reference_moves_to_the_feet_that_stand() -> None:
    load = np.array([[1.0] * 4, [0.0] * 4])
    reference = _motion((0.0, 0.1, 0.0), (0.0, -0.1, 0.3))
    aside = _motion((0.02, 0.11, 0.0), (0.5, -0.1, 0.3))
    stance = initial_stance()
    for _ in range(500):
        stance = _update(stance, aside, reference, _sample(load))
    np.testing.assert_allclose(stance.offset, [0.02, 0.01, 0.0], atol=1e-5)
    near = moved(reference, stance.offset)
    np.testing.assert_allclose(near.com[0] - reference.com[0], [0.02, 0.01, 0.0], atol=1e-5)
    np.testing.assert_allclose(near.p[3] - reference.p[3], [0.02, 0.01, 0.0], atol=1e-5)


def test_in_flight_the_reference_moves_with_the_centre_of_mass() -> None:
    reference = _motion((0.5, 0.1, 0.3), (0.5, -0.1, 0.3))
    com = reference.com.copy()
    com[0] += [0.01, 0.02, -0.03]
    stance = _update(
        initial_stance(), reference._replace(com=com), reference, _sample(np.zeros((2, 4)))
    )
    np.testing.assert_allclose(stance.offset, [0.01, 0.02, -0.03])
    np.testing.assert_array_equal(stance.late, 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_packing_loses_nothing(seed: int) -> None:
    vector = np.random.default_rng(seed).standard_normal(initial_stance().pack().size)
    np.testing.assert_array_equal(Stance.unpack(vector).pack(), vector)
