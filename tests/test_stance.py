"""Which corners bear load, where the feet are anchored, how the reference follows them."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.optimization.dynamics_terms import TaskMotion
from robomirror_drake.optimization.reference_trajectory import ReferenceSample
from robomirror_drake.optimization.stance import (
    EARLY,
    HANGING,
    Stance,
    bearing,
    initial_stance,
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


def _sample(load: np.ndarray, wait: np.ndarray = NEVER) -> ReferenceSample:
    return ReferenceSample(np.zeros(30), np.zeros(29), np.zeros(29), np.zeros((2, 6)), load, wait)


def test_corners_in_the_air_bear_nothing_and_early_ones_some() -> None:
    planned = np.array([[1.0, 1.0, 0.5, 1.0], [0.0, 0.0, 0.0, 0.0]])
    height = np.array([[0.0, 2 * HANGING, 0.0, HANGING], [-1e-4, -1e-4, 1e-3, -1e-4]])
    wait = np.array([[-1.0] * 4, [EARLY / 2, 2 * EARLY, EARLY / 2, np.inf]])
    load = bearing(planned, wait, height)
    np.testing.assert_array_equal(load[0], [1.0, 0.0, 0.5, 0.0])
    assert load[1, 0] > 0.0  # came down a little before its time
    np.testing.assert_array_equal(load[1, 1:], 0.0)


def test_a_sole_is_anchored_where_its_loaded_corners_come_down_and_stays() -> None:
    both = np.ones((2, 4))
    reference = _motion((0.0, 0.1, 0.0), (0.0, -0.1, 0.0))
    landed = _motion((0.02, 0.1, 0.001), (0.0, -0.1, 0.0))
    stance = update_stance(initial_stance(), landed, reference, _sample(both), CORNERS, 0.004)
    np.testing.assert_allclose(stance.anchor, [[0.02, 0.1, 0.0], [0.0, -0.1, 0.0]])
    slid = _motion((0.03, 0.1, 0.0), (0.0, -0.1, 0.0))
    stance = update_stance(stance, slid, reference, _sample(both), CORNERS, 0.004)
    np.testing.assert_allclose(stance.anchor[0], [0.02, 0.1, 0.0])
    toes = both.copy()
    toes[0, 2:] = 0.0
    stance = update_stance(stance, slid, reference, _sample(toes), CORNERS, 0.004)
    np.testing.assert_allclose(stance.anchor[0], [0.13, 0.1, 0.0])


def test_the_reference_moves_to_the_feet_that_stand() -> None:
    load = np.array([[1.0] * 4, [0.0] * 4])
    reference = _motion((0.0, 0.1, 0.0), (0.0, -0.1, 0.3))
    aside = _motion((0.02, 0.11, 0.0), (0.5, -0.1, 0.3))
    stance = initial_stance()
    for _ in range(500):
        stance = update_stance(stance, aside, reference, _sample(load), CORNERS, 0.004)
    np.testing.assert_allclose(stance.offset, [0.02, 0.01], atol=1e-5)
    moved = stance.shift(reference)
    np.testing.assert_allclose(moved.com[0] - reference.com[0], [0.02, 0.01, 0.0], atol=1e-5)
    np.testing.assert_allclose(moved.p[3] - reference.p[3], [0.02, 0.01, 0.0], atol=1e-5)


def test_offset_is_kept_in_flight() -> None:
    flying = _motion((0.5, 0.1, 0.3), (0.5, -0.1, 0.3))
    before = Stance(np.ones((2, 4)), np.zeros((2, 3)), np.array([0.03, -0.01]), np.ones(2))
    after = update_stance(before, flying, flying, _sample(np.zeros((2, 4))), CORNERS, 0.004)
    np.testing.assert_array_equal(after.offset, before.offset)


@pytest.mark.parametrize("seed", range(3))
def test_packing_loses_nothing(seed: int) -> None:
    vector = np.random.default_rng(seed).standard_normal(initial_stance().pack().size)
    np.testing.assert_array_equal(Stance.unpack(vector).pack(), vector)
