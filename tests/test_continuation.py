"""Going on otherwise with a motion that runs: halts, other tempos, and the joint between them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.adaptation.continuation import (
    Change,
    Course,
    begun,
    changed,
    foreseen,
    handed_over,
    remainder,
    stopped,
)
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
FRAME = 70  # in mid-walk, with a foot in the air
STEP = 1.0 / 60.0
SLOWER = Change(tempo=0.7)


@lru_cache
def raw() -> RobotReference:
    motion = load_clip("walk")
    return retarget(ROBOT, motion, foot_contacts(motion))


@lru_cache
def course() -> Course:
    return begun(raw(), plan_dynamics(ROBOT, raw()))


@lru_cache
def rest() -> RobotReference:
    return remainder(course().commanded, FRAME)


def way(reference: RobotReference) -> float:
    return float(np.linalg.norm(reference.q[-1, 4:6] - reference.q[0, 4:6]))


def test_the_commanded_motion_is_put_on_the_plans_time() -> None:
    commanded, plan, asked, change = course()
    assert asked is raw()
    assert change == Change(1.0, 1.0, 1.0)
    lead = round(plan.lead / STEP)
    assert lead > 0
    np.testing.assert_array_equal(commanded.time, plan.time)
    np.testing.assert_array_equal(commanded.contact, plan.contact)
    np.testing.assert_array_equal(commanded.q[lead : lead + len(raw().q)], raw().q)
    np.testing.assert_array_equal(commanded.q[0], raw().q[0])
    assert not commanded.v[:lead].any()
    assert not commanded.planned


def test_a_halt_begins_as_the_motion_does_and_ends_at_rest_on_both_feet() -> None:
    (made,) = stopped(rest(), 0.25, 0.8, 0.6)
    assert not rest().contact[0].any(axis=1).all()
    assert np.abs(rest().v[0]).max() > 0.5
    for kind in "qva":
        np.testing.assert_allclose(getattr(made, kind)[0], getattr(rest(), kind)[0], atol=1e-9)
    assert made.contact[-1].any(axis=1).all()
    assert np.abs(np.diff(made.q[-20:], axis=0)).max() < 1e-12
    np.testing.assert_array_equal(made.v[-20:], 0.0)
    assert way(made) < way(rest()) - 0.1
    # It goes through poses of the motion only.
    nearest = np.abs(made.q[:, None] - rest().q).max(axis=2).min(axis=1)
    assert nearest.max() < 0.05
    # Velocities are those of the positions.
    rate = (made.q[2:, 7:] - made.q[:-2, 7:]) / (2.0 * STEP)
    np.testing.assert_allclose(rate, made.v[1:-1, 6:], atol=0.15)


def test_later_halts_come_later_and_a_motion_without_one_goes_to_its_end() -> None:
    first, second = stopped(rest(), 0.25, 0.8, 0.6, 2)
    assert first.duration < second.duration
    air = rest()
    contact = np.array(air.contact)
    contact[:, 0] = False
    (made,) = stopped(RobotReference(air.time, air.q, air.v, air.a, contact), 0.25, 0.8, 0.6)
    np.testing.assert_allclose(made.q[-1], air.q[-1], atol=1e-9)


def test_nothing_slows_down_in_flight() -> None:
    count = 90
    q = np.tile(ROBOT.standing, (count, 1))
    q[:, 4] = 0.02 * np.arange(count)  # walks at an even speed
    v, contact = np.zeros((count, 29)), np.ones((count, 2, 4), dtype=bool)
    v[:, 3] = 0.02 / STEP
    contact[10:40] = False
    time = STEP * np.arange(count)
    made = stopped(RobotReference(time, q, v, 0.0 * v, contact), 0.25, 2.0, 0.4)[0]
    np.testing.assert_allclose(made.q[:40], q[:40], atol=1e-9)
    assert made.v[45, 3] < v[0, 3]


def test_a_slower_rest_begins_where_the_motion_is_and_takes_longer() -> None:
    slow, small = changed(ROBOT, rest(), [Change(0.5, 1.0, 1.0), Change(1.0, 0.5, 0.5)])
    for made in (slow, small):
        np.testing.assert_allclose(made.q[0], rest().q[0], atol=1e-6)
    assert 1.6 * rest().duration < slow.duration < 2.0 * rest().duration
    assert small.duration == pytest.approx(rest().duration)
    assert way(slow) == pytest.approx(way(rest()), rel=1e-3)
    assert 0.4 * way(rest()) < way(small) < 0.7 * way(rest())


@lru_cache
def joined(halts: bool) -> Course:
    made = stopped(rest(), 0.25, 0.8, 0.6) if halts else changed(ROBOT, rest(), [SLOWER])
    return handed_over(ROBOT, course(), FRAME, made[0], change=None if halts else SLOWER)


@pytest.mark.parametrize("halts", [True, False])
def test_position_velocity_and_acceleration_go_on_without_a_jump(halts: bool) -> None:
    old, new = course().plan, joined(halts).plan
    assert np.abs(old.v[FRAME]).max() > 0.5
    for kind in "qva":
        np.testing.assert_allclose(getattr(new, kind)[FRAME], getattr(old, kind)[FRAME], atol=1e-9)
        np.testing.assert_array_equal(getattr(new, kind)[:FRAME], getattr(old, kind)[:FRAME])
    # And it truly goes on from there: what is left of the next sample is of third order.
    change = new.q[FRAME + 1, 4:] - new.q[FRAME, 4:]
    foretold = STEP * new.v[FRAME, 3:] + 0.5 * STEP**2 * new.a[FRAME, 3:]
    jerk = np.abs(new.a[FRAME + 1, 3:] - new.a[FRAME, 3:]).max() / STEP
    assert np.abs(change - foretold).max() <= 0.5 * jerk * STEP**3
    assert np.abs(new.q[FRAME + 30] - old.q[FRAME + 30]).max() > 0.01


@pytest.mark.parametrize("halts", [True, False])
def test_a_joined_course_is_one_feasible_motion_on_one_time_base(halts: bool) -> None:
    commanded, plan, asked, _ = joined(halts)
    assert asked is raw()
    np.testing.assert_allclose(np.diff(plan.time), STEP, atol=1e-9)
    np.testing.assert_array_equal(plan.time[:FRAME], course().plan.time[:FRAME])
    assert len(commanded.time) == len(plan.time)
    assert plan.planned
    assert plan.lead == course().plan.lead
    assert plan.residuals["dynamic_violation"] < 0.05
    assert plan.residuals["stance_drift"] < 5e-3
    np.testing.assert_allclose(plan.v[-1], 0.0, atol=1e-8)
    np.testing.assert_array_equal(commanded.q[:FRAME], course().commanded.q[:FRAME])


def test_a_course_can_be_changed_again() -> None:
    once = joined(False)
    frame = FRAME + 4
    (halt,) = stopped(remainder(once.commanded, frame), 0.25, 0.8, 0.6)
    twice = handed_over(ROBOT, once, frame, halt, change=SLOWER)
    assert twice.change == pytest.approx(Change(0.49, 1.0, 1.0))
    for kind in "qva":
        now, then = getattr(twice.plan, kind), getattr(once.plan, kind)
        np.testing.assert_allclose(now[frame], then[frame], atol=1e-9)
        np.testing.assert_array_equal(now[:frame], then[:frame])
    assert way(twice.plan) < way(once.plan) - 0.1


def test_a_robot_on_its_plan_is_foreseen_to_stay_on_it() -> None:
    plan, rows = course().plan, np.arange(60, 91, 3)
    at = plan.time[rows] + 0.3
    q, v = foreseen(plan.time[rows], plan.q[rows], plan.v[rows], plan, at)
    np.testing.assert_allclose(q, plan.q[rows + 18], atol=1e-6)
    np.testing.assert_allclose(v, plan.v[rows + 18], atol=1e-6)


def test_a_robot_beside_its_plan_is_foreseen_to_stay_beside_it() -> None:
    plan, rows = course().plan, np.arange(60, 91, 3)
    q, v = plan.q[rows].copy(), plan.v[rows].copy()
    q[:, 5] += 0.1
    q[:, 20] += 0.2
    v[:, 3] -= 0.3
    known = plan.time[rows]
    ahead, speed = foreseen(known, q, v, plan, known + 0.3)
    still = known + 0.3 <= known[-1] + 1e-9
    np.testing.assert_allclose(ahead[still], q[-int(still.sum()) :], atol=1e-9)
    beside = ahead[-1] - plan.q[rows[-1] + 18]
    np.testing.assert_allclose(beside[[5, 20]], [0.1, 0.2], atol=1e-9)
    # What is left of a speed away from the plan has become a deviation.
    left = speed[-1, 3] - plan.v[rows[-1] + 18, 3]
    assert -0.05 < left < 0.0
    np.testing.assert_allclose(beside[4], 0.1 * (-0.3 - left), atol=1e-9)
