"""The state that a known delay leads to."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from robomirror_drake.optimization.control.dynamics_terms import control_model
from robomirror_drake.optimization.control.tick import predicted
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
CONTROL = control_model(ROBOT)


def test_prediction_is_motion_at_constant_acceleration() -> None:
    rng = np.random.default_rng(0)
    q = ROBOT.to_pinocchio(ROBOT.standing)
    v, a, delay, steps = rng.standard_normal(29), 5.0 * rng.standard_normal(29), 0.012, 2000
    expected, rate, step = q, v, delay / steps
    for _ in range(steps):
        expected = pin.integrate(CONTROL.model, expected, step * (rate + 0.5 * step * a))
        rate = rate + step * a
    ahead, speed = predicted(CONTROL, q, v, a, delay)
    np.testing.assert_allclose(speed, rate, atol=1e-9)
    np.testing.assert_allclose(ahead[7:], expected[7:], atol=1e-9)
    np.testing.assert_allclose(ahead[:7], expected[:7], atol=1e-5)  # turns do not commute


def test_without_delay_nothing_is_predicted() -> None:
    q, v = ROBOT.to_pinocchio(ROBOT.standing), np.full(29, 0.3)
    ahead, speed = predicted(CONTROL, q, v, np.full(29, 9.0), 0.0)
    assert ahead is q
    assert speed is v
