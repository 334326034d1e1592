"""Windows of a motion that goes on: continuous with what came before, and feasible."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.planning.window import PlannedWindow, State, Warm, plan_window
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
STEP = 6  # frames from one window to the next: two knots
SHIFT = 2


@lru_cache
def whole() -> RobotReference:
    motion = load_clip("walk")
    return plan_dynamics(ROBOT, retarget(ROBOT, motion, foot_contacts(motion)))


def window(start: int, length: int = 61) -> RobotReference:
    plan, part = whole(), slice(start, start + length)
    time = plan.time[part] - plan.time[start]
    return RobotReference(time, plan.q[part], plan.v[part], plan.a[part], plan.contact[part])


def state(frame: int) -> State:
    return State(whole().q[frame], whole().v[frame], whole().a[frame])


@lru_cache
def chain() -> tuple[PlannedWindow, ...]:
    """Windows in mid-walk, each from the one before."""
    made = [plan_window(ROBOT, window(60), state(60))]
    for start in range(60 + STEP, 60 + 4 * STEP, STEP):
        made.append(plan_window(ROBOT, window(start), Warm(made[-1].control, SHIFT)))
    return tuple(made)


def test_starts_in_the_given_state_of_motion() -> None:
    first, now = chain()[0].reference, state(60)
    assert np.abs(now.v).max() > 0.5
    np.testing.assert_allclose(first.q[0], now.q, atol=1e-9)
    np.testing.assert_allclose(first.v[0], now.v, atol=1e-9)
    np.testing.assert_allclose(first.a[0], now.a, atol=1e-7)


def test_goes_on_with_equal_position_velocity_and_acceleration() -> None:
    for before, after in zip(chain(), chain()[1:], strict=False):
        for kind in "qva":
            then, now = getattr(before.reference, kind)[STEP], getattr(after.reference, kind)[0]
            np.testing.assert_allclose(now, then, atol=1e-8)


def test_does_not_end_at_rest_but_where_the_motion_goes_on() -> None:
    for made, start in zip(chain(), range(60, 200, STEP), strict=False):
        plan = made.reference
        assert np.abs(plan.v[-1]).max() > 0.3
        np.testing.assert_allclose(plan.q[-1, 4:7], whole().q[start + 60, 4:7], atol=0.02)


def test_stays_feasible_window_after_window() -> None:
    for made in chain():
        figures = made.reference.residuals
        assert figures["dynamic_violation"] < 0.01
        assert figures["stance_drift"] < 5e-3
        assert figures["distance_to_raw"] < 0.03


def test_gets_a_pushed_robot_back() -> None:
    now = state(60)
    v = now.v.copy()
    v[3:5] += [0.1, 0.05]
    made = plan_window(ROBOT, window(60), State(now.q, v, now.a)).reference
    np.testing.assert_allclose(made.v[0], v, atol=1e-9)
    np.testing.assert_allclose(made.q[-1, 4:7], whole().q[120, 4:7], atol=0.03)
    assert made.residuals["stance_drift"] < 0.01


def test_the_last_window_ends_at_rest() -> None:
    count = len(whole().time)
    made = plan_window(ROBOT, window(count - 50, 50), state(count - 50), last=True)
    np.testing.assert_allclose(made.reference.v[-1], 0.0, atol=1e-9)
    np.testing.assert_allclose(made.reference.a[-1], 0.0, atol=1e-7)
    assert made.reference.duration >= window(count - 50, 50).duration
    assert len(made.control) == pytest.approx(made.reference.duration / 0.05 + 3)


def test_same_input_same_bytes() -> None:
    again = plan_window(ROBOT, window(60), state(60))
    assert again.reference == chain()[0].reference
