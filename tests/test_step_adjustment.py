"""Where a robot that was pushed steps."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.control.dynamics_terms import TaskMotion
from robomirror_drake.optimization.control.reference_trajectory import ReferenceSample
from robomirror_drake.optimization.control.step_adjustment import (
    StepOptions,
    adjusted_steps,
    captured,
    divergent_component,
    without_crossing,
)

LIMITS = StepOptions().limits()
LEFT_STANDS = np.array([[1.0] * 4, [0.0] * 4])


def _motion(velocity: tuple[float, float] = (0.0, 0.0)) -> TaskMotion:
    com = np.zeros((3, 3))
    com[0], com[1, :2] = [0.0, 0.0, 0.8], velocity
    p = np.array([[0.0, 0.0, 0.85], [0.0, 0.0, 1.0], [0.0, 0.1, 0.0], [0.1, -0.1, 0.05]])
    still = np.zeros((4, 6))
    return TaskMotion(com, np.zeros((2, 3)), np.tile(np.eye(3), (4, 1, 1)), p, still, still)


def _sample(remaining: float) -> ReferenceSample:
    wait = np.array([[-1.0] * 4, [remaining] * 4])
    nowhere = np.zeros(30), np.zeros(29), np.zeros(29), np.zeros((2, 6))
    return ReferenceSample(*nowhere, LEFT_STANDS, wait, -np.ones((2, 4)))


def _settled(velocity: tuple[float, float], remaining: float = 0.3) -> np.ndarray:
    steps = np.zeros((2, 2))
    for _ in range(500):
        steps = adjusted_steps(
            steps, LEFT_STANDS, _motion(velocity), _motion(), _sample(remaining), LIMITS, 0.004
        )
    return steps


def test_a_captured_pendulum_comes_to_rest() -> None:
    """Pushed, then with its support moved at touchdown, ξ is where that support can hold it."""
    error, height, remaining, step = np.array([0.06, -0.03]), 0.8, 0.25, 1e-5
    omega, xi = np.sqrt(GRAVITY / height), error.copy()
    for _ in range(round(remaining / step)):  # the old support does all it can
        xi += step * omega * (xi - LIMITS.room * xi / np.linalg.norm(xi))
    shift = captured(error, height, remaining, LIMITS)
    assert np.linalg.norm(xi - shift) == pytest.approx(LIMITS.room, rel=1e-3)


def test_small_errors_are_left_to_the_centre_of_pressure_and_large_ones_bounded() -> None:
    np.testing.assert_array_equal(captured(np.array([0.02, 0.01]), 0.8, 0.5, LIMITS), 0.0)
    far = captured(np.array([0.0, 2.0]), 0.8, 0.5, LIMITS)
    np.testing.assert_allclose(far, [0.0, LIMITS.longest])


def test_the_swing_foot_goes_where_the_robot_falls() -> None:
    omega = np.sqrt(GRAVITY / 0.8)
    for direction in ((1.0, 0.0), (-1.0, 0.0), (0.0, -1.0)):
        velocity = 0.08 * omega * np.array(direction)
        steps = _settled((velocity[0], velocity[1]))
        expected = 0.05 * np.exp(0.3 * omega) * np.array(direction)
        np.testing.assert_allclose(steps[1], expected, atol=1e-6)
        np.testing.assert_array_equal(steps[0], 0.0)  # the foot that stands is where it is


def test_legs_do_not_cross() -> None:
    steps = _settled((0.0, 1.5))  # over the left foot, with the right one in the air
    assert _motion().p[2, 1] - (_motion().p[3, 1] + steps[1, 1]) == pytest.approx(
        LIMITS.least_width
    )
    narrow = without_crossing(
        np.array([0.0, 0.2]), np.array([0.0, 0.02]), np.zeros(2), np.array([0.0, 1.0]), -1.0, 0.17
    )
    np.testing.assert_allclose(narrow, [0.0, 0.02])  # a plan that crosses is not widened


def test_targets_move_at_a_bounded_speed_and_stay_before_touchdown() -> None:
    once = adjusted_steps(
        np.zeros((2, 2)), LEFT_STANDS, _motion((1.0, 0.0)), _motion(), _sample(0.3), LIMITS, 0.004
    )
    assert np.linalg.norm(once[1]) == pytest.approx(LIMITS.speed * 0.004)
    np.testing.assert_array_equal(_settled((1.0, 0.0), remaining=0.04), 0.0)


def test_a_foot_that_lifts_off_starts_from_where_it_is() -> None:
    aside = _motion()
    aside.p[2, :2] += [0.05, -0.02]
    steps = adjusted_steps(
        np.zeros((2, 2)), LEFT_STANDS, aside, _motion(), _sample(0.3), LIMITS, 0.004
    )
    np.testing.assert_allclose(steps[0], [0.05, -0.02])


def test_divergent_component_is_ahead_of_the_motion() -> None:
    xi = divergent_component(_motion((0.35, 0.0)))
    np.testing.assert_allclose(xi, [0.35 / np.sqrt(GRAVITY / 0.8), 0.0])
