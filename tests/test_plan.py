"""Dynamic plans: consistent with the laws of motion, near to their references, repeatable."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from pydrake.common.value import Value

from robomirror_drake.exceptions import PlanningError, PortError
from robomirror_drake.messages import RobotReference
from robomirror_drake.optimization import centroidal, spline
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.planning.contacts import (
    ConeOptions,
    hull_edges,
    outside,
    wrench_cones,
)
from robomirror_drake.optimization.planning.forces import share_wrench
from robomirror_drake.optimization.planning.penalty import Penalty, Rows, bound_terms
from robomirror_drake.optimization.planning.plan import PlanOptions, plan_dynamics
from robomirror_drake.optimization.planning.problem import GROUPS, Problem, at_rest
from robomirror_drake.optimization.planning.schedule import loaded_corners
from robomirror_drake.optimization.planning.setup import Knots, first_guess, pad, problem
from robomirror_drake.optimization.planning.solver import anchored, shared
from robomirror_drake.optimization.planning.step import StepModel
from robomirror_drake.robot import load_robot
from robomirror_drake.systems.dynamic_planner import DynamicPlanner

ROBOT = load_robot()
RATE = 60.0
WEIGHT = ROBOT.mass * centroidal.GRAVITY


def rise(time: np.ndarray, start: float, end: float) -> np.ndarray:
    """A minimum-jerk step from 0 to 1."""
    s = np.clip((time - start) / (end - start), 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def posed(time: np.ndarray, angles: dict[str, np.ndarray], height=0.0) -> np.ndarray:
    """(T, 30) standing configuration plus joint angles, its lowest corner at ``height``."""
    q = np.tile(ROBOT.standing, (len(time), 1))
    for name, angle in angles.items():
        q[:, 7 + ROBOT.joint_names.index(name)] += angle
    z = corners_of(q)[..., 2]
    q[:, 6] += height - z.min(axis=(1, 2))
    return q


def corners_of(q: np.ndarray) -> np.ndarray:
    """(T, 2, 4, 3) sole corners in world."""
    links = centroidal.link_poses(ROBOT, list(ROBOT.foot_frames), q)
    turned = np.einsum("tfij,fcj->tfci", links[..., :3, :3], ROBOT.sole_corners)
    return turned + links[:, :, None, :3, 3]


def reference(time: np.ndarray, q: np.ndarray, contact: np.ndarray) -> RobotReference:
    rates = np.gradient(q, 1 / RATE, axis=0)
    v = np.concatenate([np.zeros((len(q), 3)), rates[:, 4:]], axis=1)
    return RobotReference(time, q, v, np.gradient(v, 1 / RATE, axis=0), contact, text="test")


@lru_cache
def squat() -> RobotReference:
    time = np.arange(151) / RATE
    depth = 0.5 * (rise(time, 0.3, 1.0) - rise(time, 1.4, 2.2))
    angles = {}
    for side in "LR":
        angles |= {
            f"{side}_HIP_P": -depth,
            f"{side}_KNEE": 2 * depth,
            f"{side}_ANKLE_P": -depth,
        }
    return reference(time, posed(time, angles), np.ones((151, 2, 4), dtype=bool))


@lru_cache
def lifted_foot() -> RobotReference:
    """One foot up with no thought of balance."""
    time = np.arange(121) / RATE
    lift = rise(time, 0.7, 1.0) - rise(time, 1.1, 1.4)
    angles = {"L_HIP_P": -0.5 * lift, "L_KNEE": 0.8 * lift, "L_ANKLE_P": -0.3 * lift}
    contact = np.ones((121, 2, 4), dtype=bool)
    contact[(time > 0.73) & (time < 1.37), 0] = False
    return reference(time, posed(time, angles), contact)


@lru_cache
def hop() -> RobotReference:
    time = np.arange(151) / RATE
    up, flight = 1.0, 0.3
    crouch = rise(time, 0.2, 0.7) - rise(time, 0.7, up)
    crouch += rise(time, up + flight, 1.6) - rise(time, 1.6, 2.3)
    angles = {}
    for side in "LR":
        angles |= {
            f"{side}_HIP_P": -0.3 * crouch,
            f"{side}_KNEE": 0.6 * crouch,
            f"{side}_ANKLE_P": -0.3 * crouch,
        }
    in_flight = np.clip(time - up, 0.0, flight)
    height = 0.5 * centroidal.GRAVITY * in_flight * (flight - in_flight)
    contact = np.ones((151, 2, 4), dtype=bool)
    contact[(time > up) & (time < up + flight)] = False
    return reference(time, posed(time, angles, height), contact)


@lru_cache
def planned(make) -> RobotReference:
    return plan_dynamics(ROBOT, make())


def wrench_of(*trajectory: np.ndarray) -> np.ndarray:
    """(T, 6) wrench that x, ẋ, ẍ need."""
    return centroidal.sample(ROBOT, [], *trajectory, derivatives=False).wrench


@pytest.mark.parametrize("make", [squat, lifted_foot, hop])
def test_starts_and_ends_at_rest_on_both_feet(make) -> None:
    plan = planned(make)
    assert plan.planned
    for frame in (0, -1):
        np.testing.assert_allclose(plan.v[frame], 0.0, atol=1e-9)
        np.testing.assert_allclose(plan.a[frame], 0.0, atol=1e-7)
        assert plan.contact[frame].all()


@pytest.mark.parametrize("make", [squat, lifted_foot])
def test_centre_of_pressure_is_within_the_support_at_200_hz(make, resampled) -> None:
    plan = planned(make)
    time, x, xd, xdd = resampled(plan, 200.0)
    wrench = wrench_of(x, xd, xdd)
    loaded = loaded_corners(plan.contact, time * RATE, 0.0)
    feet = corners_of(centroidal.unit_quaternions(x))
    for t in range(len(time)):
        points = feet[t][loaded[t]][:, :2]
        cop = np.array([-wrench[t, 1], wrench[t, 0]]) / wrench[t, 5]
        normals, offsets = hull_edges(points)
        assert np.min(normals @ cop - offsets) > 0.005, f"at {time[t]:.3f} s"
    assert plan.residuals["dynamic_violation"] < 1e-3


@pytest.mark.parametrize("make", [squat, lifted_foot, hop])
def test_feet_stay_within_2_mm_in_stance(make) -> None:
    plan = planned(make)
    corners = corners_of(plan.q)
    for foot in range(2):
        for start, end in runs(plan.contact[:, foot].any(axis=1)):
            stance = corners[start:end, foot]
            assert np.max(np.ptp(stance, axis=0)) < 2e-3
            assert np.max(np.abs(stance[..., 2])) < 2e-3


def test_weight_is_shifted_before_a_foot_is_lifted() -> None:
    raw, plan = lifted_foot(), planned(lifted_foot)
    away = wrench_of(raw.q, 0 * raw.q, 0 * raw.q)
    assert -away[60, 1] / away[60, 5] < 1.0  # the reference is a pose, not flight
    load = plan.foot_force[:, :, 5]
    air = ~plan.contact[:, 0].any(axis=1)
    assert np.all(load[air, 0] == 0.0)
    np.testing.assert_allclose(load[air, 1], WEIGHT, rtol=0.4)
    assert plan.residuals["distance_to_raw"] < 0.08


def test_flight_is_ballistic(resampled) -> None:
    plan = planned(hop)
    air = ~plan.contact.any(axis=(1, 2))
    assert air.sum() > 12
    _, *trajectory = resampled(plan, RATE)
    wrench = wrench_of(*trajectory)
    inner = np.flatnonzero(air)[2:-2]
    assert np.max(np.abs(wrench[inner, 3:])) < 0.03 * WEIGHT
    assert np.all(plan.foot_force[air] == 0.0)


def test_swing_foot_clears_the_ground() -> None:
    plan = planned(lifted_foot)
    air = np.flatnonzero(~plan.contact[:, 0].any(axis=1))
    heights = corners_of(plan.q)[air, 0, :, 2].min(axis=1)
    assert heights.min() > -1e-3
    assert heights[len(heights) // 2] > 0.025


def test_foot_forces_carry_the_wrench_within_friction(resampled) -> None:
    plan = planned(lifted_foot)
    _, *trajectory = resampled(plan, RATE)
    wrench = wrench_of(*trajectory)
    force = plan.foot_force[: len(wrench)]
    np.testing.assert_allclose(force[..., 3:].sum(axis=1), wrench[:, 3:], atol=0.02 * WEIGHT)
    tangential = np.abs(force[..., 3:5]).max(axis=-1)
    assert np.all(tangential <= 0.4 * force[..., 5] + 0.005 * WEIGHT)
    # Loads ramp: no step larger than what a foot takes up in 0.1 s.
    assert np.max(np.abs(np.diff(force[..., 5], axis=0))) < 0.35 * WEIGHT


def test_strength_zero_passes_through() -> None:
    assert plan_dynamics(ROBOT, squat(), PlanOptions(strength=0.0)) is squat()


def test_half_strength_stands_between() -> None:
    raw = plan_dynamics(ROBOT, lifted_foot(), PlanOptions(strength=0.5))
    full = planned(lifted_foot)
    assert raw.residuals["distance_to_raw"] < full.residuals["distance_to_raw"]


def test_same_input_same_bytes() -> None:
    assert plan_dynamics(ROBOT, lifted_foot()) == planned(lifted_foot)


def test_a_reference_cut_in_mid_motion_gets_time_to_stop() -> None:
    whole = lifted_foot()
    cut = RobotReference(
        whole.time[:61], whole.q[:61], whole.v[:61], whole.a[:61], whole.contact[:61]
    )
    plan = plan_dynamics(ROBOT, cut)
    assert plan.duration > cut.duration + 0.5
    assert plan.contact[-1].all()
    np.testing.assert_allclose(plan.v[-1], 0.0, atol=1e-9)


def test_unusable_references_are_refused_with_figures() -> None:
    good = squat()
    time = good.time + 0.01 * np.arange(len(good.time)) ** 2
    uneven = RobotReference(time, good.q, good.v, good.a, good.contact)
    with pytest.raises(PlanningError, match="constant rate"):
        plan_dynamics(ROBOT, uneven)
    short = RobotReference(good.time[:5], good.q[:5], good.v[:5], good.a[:5], good.contact[:5])
    with pytest.raises(PlanningError, match=r"0\.2 s") as raised:
        plan_dynamics(ROBOT, short)
    assert raised.value.figures["duration"] == pytest.approx(4 / RATE)


@lru_cache
def posed_problem() -> tuple[Problem, np.ndarray]:
    """A problem with all its rows, and control points off its solution."""
    padded = pad(ROBOT, lifted_foot(), PlanOptions())
    knots = Knots(0.1, 20)
    made, standing = problem(ROBOT, padded, knots, PlanOptions())
    control = first_guess(padded, knots)
    made = anchored(made, standing, made.target_points)
    made = shared(made, standing, made.evaluate(control))
    made = replace(made, ending=control[-3:] + 0.1)
    return made, control + 0.02 * np.random.default_rng(5).normal(size=control.shape)


def model_of(made: Problem, control: np.ndarray) -> StepModel:
    penalty = {"wrench": Penalty(30.0, 2e-3), "corners": Penalty(1e3, 1e-3)}
    penalty |= {"speed": Penalty(1.0, 2e-3), "gaps": Penalty(300.0, 1e-4)}
    penalty |= {"torque": Penalty(10.0, 2e-3), "limits": Penalty(300.0, 1e-4)}
    rng = np.random.default_rng(7)
    multipliers = {name: rng.normal(size=rows.lower.shape) for name, rows in made.rows.items()}
    return StepModel(made, made.linearize(control), penalty, multipliers)


def test_all_rows_by_finite_differences() -> None:
    made, control = posed_problem()
    model, h = model_of(made, control), 1e-6
    way = np.random.default_rng(6).normal(size=control.shape)
    low, high = (made.evaluate(control + s * h * way).values for s in (-1.0, 1.0))
    change = model.change(way)
    assert set(change) == set(GROUPS)
    for name, exact in change.items():
        numeric = (high[name] - low[name]) / (2 * h)
        np.testing.assert_allclose(exact, numeric, atol=2e-5 * (1.0 + np.abs(numeric).max()))


def test_gradient_of_the_problem_by_finite_differences() -> None:
    made, control = posed_problem()
    model, h = model_of(made, control), 1e-6
    gradient = model.at.gradient + model.derivatives(model.terms(model.at.at.values))[1]
    rng = np.random.default_rng(8)
    for _ in range(3):
        way = rng.normal(size=control.shape)
        costs = [model.cost(made.evaluate(control + s * h * way)) for s in (-1.0, 1.0)]
        slope = float(np.sum(gradient * way))
        assert (costs[1] - costs[0]) / (2 * h) == pytest.approx(slope, rel=2e-3)


def test_a_step_minimises_its_model() -> None:
    """Nothing near the step costs less in the model, and the fixed points stay."""
    made, control = posed_problem()
    model = model_of(replace(made, fixed=3), control)
    step, decrease = model.minimise(1e-3)
    assert decrease > 0.0
    np.testing.assert_array_equal(step[:3], 0.0)
    inertia = model.derivatives(model.terms(model.at.at.values))[0][:, 0] + model.at.band[:, 0]

    def cost(d: np.ndarray) -> float:
        change = model.change(d)
        values = {name: y + change[name] for name, y in model.at.at.values.items()}
        flat = d.ravel()
        bent = spline.multiply(model.at.band, flat) + 1e-3 * inertia * flat
        total = sum(term.cost for term in model.terms(values).values())
        return float(total + flat @ (model.at.gradient.ravel() + 0.5 * bent))

    rng = np.random.default_rng(9)
    best = cost(step)
    for size in (1e-1, 1e-2):
        way = size * rng.normal(size=step.shape) * np.abs(step).max()
        way[:3] = 0.0
        assert cost(step + way) > best - 0.05 * decrease


def test_bound_terms_by_finite_differences() -> None:
    y = np.linspace(-1.0, 1.0, 41)[None] + 1e-4
    rows = Rows(np.full_like(y, -0.4), np.full_like(y, 0.5))
    rows.lower[0, ::3] = -np.inf
    rows.lower[0, 1::7] = rows.upper[0, 1::7] = 0.1
    multipliers = np.ones_like(y)
    penalty, h = Penalty(20.0, 0.1), 1e-6
    at = bound_terms(y, rows, penalty, multipliers)
    for i in range(y.shape[1]):
        step = np.zeros_like(y)
        step[0, i] = h
        low, high = (bound_terms(y + s * step, rows, penalty, multipliers) for s in (-1, 1))
        assert (high.cost - low.cost) / (2 * h) == pytest.approx(at.slope[0, i], abs=1e-5)
        numeric = (high.slope - low.slope)[0, i] / (2 * h)
        assert numeric == pytest.approx(at.curvature[0, i], rel=1e-3, abs=1e-5)


def test_rest_basis_reaches_every_sample_with_unit_weight() -> None:
    time = np.linspace(0.0, 2.0, 81)
    made = at_rest(spline.basis(time, 0.1, 23), True, True)
    np.testing.assert_allclose(made.weights[0].sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(made.weights[1].sum(axis=1), 0.0, atol=1e-9)
    assert made.first.min() == 0
    assert made.first.max() + spline.ORDER == made.points


def test_cones_hold_single_corner_forces_and_refuse_others() -> None:
    standing = corners_of(ROBOT.standing[None])
    standing[..., 2] = 0.0
    options = ConeOptions(friction=0.5, margin=0.0, max_normal_force=3.0, weight=WEIGHT)
    loaded = np.ones((1, 2, 4), dtype=bool)
    cones = wrench_cones(standing, loaded, options)
    rng = np.random.default_rng(2)
    for _ in range(20):
        share = rng.dirichlet(np.ones(8)).reshape(2, 4)
        force = np.zeros((2, 4, 3))
        force[..., 2] = share * WEIGHT
        moment = np.cross(standing[0], force).sum(axis=(0, 1))
        wrench = np.r_[moment, force.sum(axis=(0, 1))][None]
        assert outside(cones, wrench).max() < 1e-9
    toppling = np.r_[0.0, -0.5 * WEIGHT, 0.0, 0.0, 0.0, WEIGHT][None]
    slipping = np.r_[0.0, 0.0, 0.0, 0.6 * WEIGHT, 0.0, WEIGHT][None]
    assert outside(cones, toppling).max() > 0.2
    assert outside(cones, slipping).max() > 0.02
    flight = wrench_cones(standing, ~loaded, options)
    assert outside(flight, np.zeros((1, 6))).max() == 0.0


def test_shared_forces_sum_up() -> None:
    standing = np.repeat(corners_of(ROBOT.standing[None]), 30, axis=0)
    options = ConeOptions(friction=0.4, margin=0.01, max_normal_force=3.0, weight=WEIGHT)
    wrench = np.zeros((30, 6))
    middle = standing[0].mean(axis=(0, 1)) + np.array([0.01, 0.03, 0.0])
    wrench[:, 3:] = [20.0, -15.0, WEIGHT]
    wrench[:, :3] = np.cross([*middle[:2], 0.0], wrench[0, 3:])
    force = share_wrench(wrench, standing, np.ones((30, 2, 4), dtype=bool), options)
    centers = standing.mean(axis=2)
    moment = force[..., :3] + np.cross(centers, force[..., 3:])
    np.testing.assert_allclose(force[..., 3:].sum(axis=1), wrench[:, 3:], atol=0.5)
    np.testing.assert_allclose(moment.sum(axis=1), wrench[:, :3], atol=0.5)


def test_system_plans_once_and_passes_errors() -> None:
    system = DynamicPlanner(ROBOT)
    context = system.CreateDefaultContext()
    system.GetInputPort("reference").FixValue(context, Value[object](lifted_foot()))
    plan = system.GetOutputPort("plan").Eval(context)
    assert plan == planned(lifted_foot)
    context.SetTime(1.0)
    assert system.GetOutputPort("plan").Eval(context) is plan
    system.GetInputPort("reference").FixValue(context, Value[object](3))
    with pytest.raises(PortError, match="carries a int"):
        system.GetOutputPort("plan").Eval(context)
