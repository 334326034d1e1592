"""Motions at another tempo, and plans that slow down as far as they must."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from pydantic import ValidationError

from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.planning.plan import PlanOptions, plan_dynamics
from robomirror_drake.optimization.planning.tempo import chart_acceleration, chart_rate, slowed
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()


@lru_cache
def raw(clip: str) -> RobotReference:
    motion = load_clip(clip)
    return retarget(ROBOT, motion, foot_contacts(motion))


@lru_cache
def walked(options: PlanOptions) -> RobotReference:
    return plan_dynamics(ROBOT, raw("walk"), options)


def com(q: np.ndarray) -> np.ndarray:
    """(T, 2) path of the centre of pressure of a robot that stands still in each pose."""
    wrench = centroidal.sample(ROBOT, [], q, 0 * q, 0 * q, derivatives=False).wrench
    return np.stack([-wrench[:, 1], wrench[:, 0]], axis=1) / wrench[:, 5:]


def test_full_tempo_gives_the_reference_back() -> None:
    assert slowed(raw("walk"), 1.0) is raw("walk")


def test_half_tempo_passes_through_the_same_states() -> None:
    fast = raw("walk")
    slow = slowed(fast, 0.5)
    assert slow.duration == pytest.approx(2.0 * fast.duration)
    np.testing.assert_allclose(np.abs(slow.q[::2]), np.abs(fast.q), atol=1e-9)
    np.testing.assert_allclose(slow.v[::2], 0.5 * fast.v, atol=1e-9)
    np.testing.assert_allclose(slow.a[::2], 0.25 * fast.a, atol=1e-6)
    np.testing.assert_array_equal(slow.contact[::2], fast.contact)


def test_velocities_and_accelerations_are_derivatives_at_any_tempo() -> None:
    slow = slowed(raw("jump"), 0.7)  # with a flight, around which the tempo changes
    dt = slow.time[1]
    joints = slow.q[:, 7:]
    numeric = (joints[2:] - joints[:-2]) / (2 * dt)
    np.testing.assert_allclose(slow.v[1:-1, 6:], numeric, atol=0.05 * np.abs(numeric).max())
    numeric = (slow.v[2:] - slow.v[:-2]) / (2 * dt)
    off = np.abs(slow.a[1:-1] - numeric)
    assert off.max() < 0.1 * np.abs(numeric).max()


def test_what_flies_keeps_its_tempo() -> None:
    fast = raw("jump")
    air = [int((~r.contact.any(axis=(1, 2))).sum()) for r in (fast, slowed(fast, 0.5))]
    assert air[0] > 10
    assert abs(air[1] - air[0]) <= 1
    assert slowed(fast, 0.5).duration > 1.3 * fast.duration


def test_chart_rates_belong_to_drakes_velocities() -> None:
    rng = np.random.default_rng(1)
    q = ROBOT.standing + 0.3 * rng.normal(size=(5, 30))
    q[:, :4] = rng.normal(size=(5, 4))
    q = centroidal.unit_quaternions(q)
    v, a = rng.normal(size=(2, 5, 29))
    back = centroidal.drake_velocities(q, chart_rate(q, v), chart_acceleration(q, v, a))
    np.testing.assert_allclose(back[0], v, atol=1e-12)
    np.testing.assert_allclose(back[1], a, atol=1e-12)


def test_a_walk_planned_slowly_goes_the_same_way_in_more_time() -> None:
    fast, slow = (walked(PlanOptions(time_scale=s)) for s in (1.0, 0.8))
    assert fast.residuals["time_scale"] == pytest.approx(1.0)
    assert slow.residuals["time_scale"] == pytest.approx(0.8, abs=0.01)
    assert slow.residuals["dynamic_violation"] < 0.01
    own = slice(round(0.8 * 60), -round(0.8 * 60))  # without the time added at the ends
    paths = [com(plan.q[own]) for plan in (fast, slow)]
    share = [np.linspace(0.0, 1.0, len(path)) for path in paths]
    along = np.interp(share[0], share[1], paths[1][:, 0])
    assert np.abs(along - paths[0][:, 0]).max() < 0.1  # forwards the same, sideways it sways more
    speeds = [np.abs(plan.v[own, 6:]).mean() for plan in (fast, slow)]
    assert 0.7 < speeds[1] / speeds[0] < 0.95


def test_only_what_is_too_hard_is_slowed_and_no_more_than_it_must() -> None:
    full = walked(PlanOptions()).residuals["distance_to_raw"]
    assert walked(PlanOptions(slowest=0.7)) == walked(PlanOptions())
    near = PlanOptions(slowest=0.7, farthest=0.93 * full)
    plan = walked(near)
    assert plan.residuals["distance_to_raw"] <= near.farthest
    assert 0.69 < plan.residuals["time_scale"] < 0.99


def test_the_better_of_two_is_given_where_no_tempo_helps() -> None:
    never = walked(PlanOptions(slowest=0.8, farthest=1e-3))
    best = min(walked(PlanOptions(time_scale=s)).residuals["distance_to_raw"] for s in (0.8, 1.0))
    assert never.residuals["distance_to_raw"] == pytest.approx(best, rel=0.05)


@pytest.mark.parametrize("name", ["slowest", "time_scale"])
def test_tempos_above_full_are_refused(name: str) -> None:
    with pytest.raises(ValidationError, match=name):
        PlanOptions(**{name: 1.2})
    with pytest.raises(ValidationError, match=r"slowest .* time_scale"):
        PlanOptions(slowest=0.9, time_scale=0.6)
