"""The controller's QP: optimality, dynamics, contacts, solvers, absurd input."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import numpy as np
import pinocchio as pin
import pytest
import qpsolvers
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from robomirror_drake.optimization.control.diagnostics import names, packed_diagnosis, unpack
from robomirror_drake.optimization.control.dynamics_terms import (
    ControlModel,
    DynamicsTerms,
    control_model,
    dynamics_terms,
    memory,
    task_motion,
)
from robomirror_drake.optimization.control.qp import (
    Solver,
    Targets,
    WholeBodyOptions,
    acceleration_from,
    build_qp,
    foot_wrench_from,
    torque_from,
    tuning,
    without_joint_limits,
)
from robomirror_drake.optimization.control.solvers import kkt_residual, solve_qp
from robomirror_drake.optimization.control.stance import Stance
from robomirror_drake.robot import FEET, Robot, load_robot

OPTIONS = WholeBodyOptions()
BOTH, LEFT = np.ones((2, 4)), np.array([[1.0] * 4, [0.0] * 4])
TOES = np.array([[1.0, 1.0, 0.0, 0.0], [1.0] * 4])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def model(robot: Robot) -> ControlModel:
    return control_model(robot)


def _state(robot: Robot, rng: np.random.Generator, scale: float) -> tuple[np.ndarray, np.ndarray]:
    q = pin.integrate(
        robot.model, robot.to_pinocchio(robot.standing), scale * rng.standard_normal(29)
    )
    return q, 5.0 * scale * rng.standard_normal(29)


def _problem(
    robot: Robot, model: ControlModel, load: np.ndarray, seed: int, scale: float = 0.03
) -> tuple[DynamicsTerms, Targets, np.ndarray, np.ndarray]:
    """A state near standing, asked to stand, with a planned wrench."""
    rng = np.random.default_rng(seed)
    q, v = _state(robot, rng, scale)
    terms = dynamics_terms(model, memory(model), q, v)
    stand = robot.to_pinocchio(robot.standing)
    zero = np.zeros(29)
    motion = task_motion(model, memory(model), stand, zero, zero)
    force = np.zeros((2, 6))
    force[:, 2] = 300.0
    targets = Targets(
        motion=motion,
        q=stand[7:],
        v=zero[6:],
        a=zero[6:],
        load=load,
        force=force,
        planned=True,
        anchor=motion.p[2:],
    )
    return terms, targets, q, v


@pytest.fixture(params=[BOTH, LEFT, TOES, 0.0 * BOTH], ids=["both", "left", "toes", "flight"])
def load(request: pytest.FixtureRequest) -> Iterator[np.ndarray]:
    return request.param  # type: ignore[no-any-return]


def test_tasks_accelerate_as_their_terms_say(robot: Robot, model: ControlModel) -> None:
    rng = np.random.default_rng(1)
    q, v = _state(robot, rng, 0.1)
    a = rng.standard_normal(29)
    terms = dynamics_terms(model, memory(model), q, v)
    h = 1e-6
    data = memory(model)
    before, after = (
        task_motion(
            model, data, pin.integrate(model.model, q, v * s + a * s * s / 2), v + a * s, 0 * a
        )
        for s in (-h, h)
    )
    np.testing.assert_allclose(
        terms.J @ a + terms.motion.a, (after.v - before.v) / (2 * h), atol=1e-5
    )
    rate = terms.momentum @ a
    com = rate[:3] / model.mass + terms.motion.com[2]
    np.testing.assert_allclose(com, (after.com[1] - before.com[1]) / (2 * h), atol=1e-5)
    angular = rate[3:] + terms.motion.angular[1]
    np.testing.assert_allclose(angular, (after.angular[0] - before.angular[0]) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(terms.J @ v, terms.motion.v, atol=1e-12)


@pytest.mark.parametrize("solver", ["daqp", "quadprog"])
def test_solution_meets_the_kkt_conditions(
    robot: Robot, model: ControlModel, load: np.ndarray, solver: Solver
) -> None:
    for seed in range(5):
        terms, targets, _, _ = _problem(robot, model, load, seed, scale=0.1)
        qp = build_qp(model, terms, targets, tuning(model, OPTIONS))
        solution = solve_qp(qp, solver)
        assert solution.found
        assert kkt_residual(solution) < 1e-6
        worse = solution._replace(x=solution.x + 1e-5)
        assert kkt_residual(worse) > 1e-6
    relaxed = solve_qp(without_joint_limits(qp), solver)
    assert kkt_residual(relaxed) < 1e-6


def test_torque_is_drakes_inverse_dynamics(
    robot: Robot, model: ControlModel, load: np.ndarray
) -> None:
    terms, targets, q, v = _problem(robot, model, load, seed=3)
    solution = solve_qp(build_qp(model, terms, targets, tuning(model, OPTIONS)), "daqp")
    wrench, a = foot_wrench_from(solution), acceleration_from(solution)

    plant = MultibodyPlant(0.002)
    instance = robot.add_to_plant(plant, collision=False)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q_drake = robot.to_drake(q)
    v_drake = robot.v_to_drake(q_drake, v)
    plant.SetPositions(context, instance, q_drake)
    plant.SetVelocities(context, instance, v_drake)
    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)  # gravity and joint damping
    for foot, name in enumerate(FEET):
        spec = robot.spec.feet[name]
        plant.GetBodyByName(spec.link).AddInForce(
            context,
            terms.motion.R[2 + foot] @ spec.center,
            SpatialForce(tau=wrench[foot, 3:], f=wrench[foot, :3]),
            plant.world_frame(),
            forces,
        )
    tau = plant.CalcInverseDynamics(context, robot.a_to_drake(q_drake, v_drake, a), forces)
    np.testing.assert_allclose(tau[:6], 0.0, atol=1e-6)
    np.testing.assert_allclose(tau[6:], torque_from(solution), atol=1e-6)


def test_forces_stay_in_the_friction_cone_and_torques_within_limits(
    robot: Robot, model: ControlModel, load: np.ndarray
) -> None:
    tuned = tuning(model, OPTIONS)
    for seed in range(20):
        terms, targets, _, _ = _problem(robot, model, load, seed, scale=0.1)
        solution = solve_qp(build_qp(model, terms, targets, tuned), "daqp")
        assert solution.found
        qp = solution.problem
        assert np.abs(torque_from(solution)).max() < model.effort.max() + 1e-5
        generators = solution.x[23:].reshape(-1, 4)
        edges = np.array([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]], dtype=float)
        edges[:, :2] *= OPTIONS.friction
        force = 100.0 * generators @ edges
        assert (np.hypot(force[:, 0], force[:, 1]) <= OPTIONS.friction * force[:, 2] + 1e-6).all()
        wrench = foot_wrench_from(solution)
        np.testing.assert_allclose(force.sum(axis=0), wrench[:, :3].sum(axis=0), atol=1e-6)
        assert (wrench[load.sum(axis=1) == 0] == 0.0).all()
        stance = Stance(
            load, np.zeros((2, 3)), np.zeros(3), np.ones(2), np.zeros(2), np.zeros((2, 2))
        )
        said = unpack(packed_diagnosis(qp, solution, load > 0.0, stance, model, OPTIONS.friction))
        assert said.friction_margin.min() > -1e-6
        assert said.residual < 1e-5
        assert (qp.lb <= qp.ub).all()


def test_daqp_gives_what_qpsolvers_makes_of_it(
    robot: Robot, model: ControlModel, load: np.ndarray
) -> None:
    for seed in range(3):
        terms, targets, _, _ = _problem(robot, model, load, seed, scale=0.1)
        qp = build_qp(model, terms, targets, tuning(model, OPTIONS))
        for problem in (qp, without_joint_limits(qp)):
            ours = solve_qp(problem, "daqp")
            same = qpsolvers.Problem(*problem[:4], None, None, *problem[4:6])
            theirs = qpsolvers.solve_problem(same, "daqp", primal_tol=1e-7, iter_limit=500)
            np.testing.assert_array_equal(ours.x, theirs.x)
            np.testing.assert_array_equal(ours.z, theirs.z)
            np.testing.assert_array_equal(ours.z_box, theirs.z_box)


@pytest.mark.parametrize("solver", get_args(Solver))
def test_solvers_agree(robot: Robot, model: ControlModel, load: np.ndarray, solver: Solver) -> None:
    terms, targets, _, _ = _problem(robot, model, load, seed=4, scale=0.01)
    qp = build_qp(model, terms, targets, tuning(model, OPTIONS))
    best, other = solve_qp(qp, "quadprog"), solve_qp(qp, solver)
    if solver == "osqp" and not other.found:
        return  # it gives up, and says so, where many limits are active at once
    assert other.found

    def objective(x: np.ndarray) -> float:
        return float(0.5 * x @ qp.P @ x + qp.q @ x)

    assert objective(other.x) - objective(best.x) < 1e-7 * abs(objective(best.x))
    np.testing.assert_allclose(torque_from(other), torque_from(best), atol=0.1)
    # So they do without joint limits, and say by which multipliers they got there.
    free = solve_qp(without_joint_limits(qp), solver)
    exact = solve_qp(without_joint_limits(qp), "quadprog")
    np.testing.assert_allclose(torque_from(free), torque_from(exact), atol=0.1)
    scale = float(np.abs(qp.q).max())
    assert kkt_residual(other) < 1e-5 * scale
    assert kkt_residual(free) < 1e-5 * scale


def test_infeasible_and_absurd_problems_are_reported_and_not_raised(
    robot: Robot, model: ControlModel
) -> None:
    terms, targets, _, _ = _problem(robot, model, BOTH, seed=5)
    tuned = tuning(model, OPTIONS)
    qp = build_qp(model, terms, targets, tuned)
    for solver in get_args(Solver):
        infeasible = solve_qp(qp._replace(h=qp.h - 1e6), solver)
        assert not infeasible.found
        assert np.isfinite(torque_from(infeasible)).all()
    broken = solve_qp(build_qp(model, terms._replace(h=terms.h * np.nan), targets, tuned), "daqp")
    assert not broken.found
    for size in (1e3, 1e6, 1e12):
        q, _ = _state(robot, np.random.default_rng(6), 0.1)
        wild = dynamics_terms(model, memory(model), q, np.full(29, size))
        solution = solve_qp(build_qp(model, wild, targets, tuned), "daqp")
        assert np.isfinite(solution.x).all()


def test_joint_limits_bound_the_accelerations(robot: Robot, model: ControlModel) -> None:
    terms, targets, _, _ = _problem(robot, model, BOTH, seed=7)
    knee = robot.joint_names.index("L_KNEE")
    joints, rates = terms.joints.copy(), terms.rates.copy()
    joints[knee], rates[knee] = model.upper[knee] - 1e-3, 2.0
    qp = build_qp(
        model, terms._replace(joints=joints, rates=rates), targets, tuning(model, OPTIONS)
    )
    horizon = OPTIONS.limit_horizon
    ahead = joints[knee] + rates[knee] * horizon + 0.5 * qp.ub[knee] * horizon**2
    assert ahead == pytest.approx(model.upper[knee])


def test_diagnostics_name_what_limits_the_solution(robot: Robot, model: ControlModel) -> None:
    terms, targets, _, _ = _problem(robot, model, TOES, seed=8)
    knee = robot.joint_names.index("L_KNEE")
    shoved = targets.motion.com.copy()
    shoved[2] = [30.0, 0.0, -30.0]  # more than friction gives, and faster down than falling
    a = targets.a.copy()
    a[knee] = 1e9
    stance = Stance(
        TOES, np.zeros((2, 3)), np.zeros(3), np.array([0.0, 1.0]), np.zeros(2), np.zeros((2, 2))
    )
    hard = targets._replace(motion=targets.motion._replace(com=shoved), a=a)
    qp = build_qp(model, terms, hard, tuning(model, OPTIONS))
    solution = solve_qp(qp, "daqp")
    vector = packed_diagnosis(qp, solution, TOES > 0.0, stance, model, OPTIONS.friction)
    said = unpack(vector)
    assert abs(said.torque_limit[knee]) == 1.0 or said.joint_limit[knee] == 1.0
    assert said.slack < 1e-6
    np.testing.assert_array_equal(said.planned_contact, [0.5, 1.0])
    np.testing.assert_array_equal(said.measured_contact, [0.0, 1.0])
    labels = names(robot.joint_names)
    np.testing.assert_array_equal(said.pack(), vector)
    assert vector.shape == (len(labels),)
    assert vector[labels.index("torque_limit.L_KNEE")] == said.torque_limit[knee]
    assert vector[labels.index("measured_contact.right")] == 1.0
    back = unpack(np.stack([vector, vector]))
    assert back.slack.shape == (2,)
    np.testing.assert_array_equal(np.concatenate([np.ravel(f[0]) for f in back]), vector)
    # Bounds that cannot be kept show as slack of what was solved without them.
    tight = qp._replace(lb=qp.lb + 0.0, ub=qp.ub.copy())
    tight.ub[knee] = solution.x[knee] - 5.0
    relaxed = packed_diagnosis(tight, solution, TOES > 0.0, stance, model, OPTIONS.friction)
    assert unpack(relaxed).slack == pytest.approx(5.0)
