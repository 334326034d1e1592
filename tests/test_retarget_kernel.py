"""Gradient and Gauss–Newton Hessian of the fused kernel, by finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.optimization import kinematics
from robomirror_drake.optimization.retargeting import kernel
from robomirror_drake.robot import FEET, load_robot

FRAMES = 4


@pytest.fixture(scope="module")
def rng():
    return np.random.default_rng(3)


@pytest.fixture(scope="module")
def terms(rng):
    """Every kind of term at random, limbs folded enough that capsules meet."""
    robot = load_robot()
    spec = robot.spec
    points = kinematics.make_points(robot, [(k.link, k.point) for k in spec.keypoints.values()])
    soles = [(spec.feet[f].link, corner) for f in FEET for corner in spec.feet[f].corners]
    directions = kinematics.Points(np.array([0, 15, 6, 12]), rng.normal(size=(4, 3)))
    return kernel.Terms(
        tree=kinematics.make_tree(robot),
        reference=Rotation.random(FRAMES, rng).as_matrix(),
        points=points,
        target=rng.normal(size=(FRAMES, 16, 3)),
        weight=rng.uniform(size=(FRAMES, 16)),
        directions=directions,
        goal=rng.normal(size=(FRAMES, 4, 3)),
        direction_weight=rng.uniform(size=(FRAMES, 4)),
        corners=kinematics.make_points(robot, soles),
        anchor=rng.normal(size=(FRAMES, 8, 3)),
        standing=rng.uniform(size=(FRAMES, 8)) > 0.5,
        support=rng.normal(size=(FRAMES, 5, 3)),
        support_weight=rng.uniform(size=FRAMES),
        capsules=kinematics.make_capsules(robot),
        margin=0.02,
    )


@pytest.fixture(scope="module")
def multipliers(terms, rng):
    pairs = len(terms.capsules.pairs)
    return kernel.Multipliers(
        stance=rng.normal(size=(FRAMES, 8, 3)),
        floor=rng.uniform(size=(FRAMES, 8)),
        collision=rng.uniform(size=(FRAMES, pairs)),
        stance_penalty=3.0,
        floor_penalty=4.0,
        collision_penalty=50.0,
    )


@pytest.fixture(scope="module")
def x(rng):
    return rng.normal(scale=0.4, size=(FRAMES, 29))


def test_cost_and_normal_equations_agree(terms, multipliers, x):
    costs, *_ = kernel.normal_equations(terms, multipliers, x)
    assert kernel.cost(terms, multipliers, x)[1] == pytest.approx(costs.sum(), rel=1e-14)
    for t in range(FRAMES):
        one = terms._replace(
            **{
                name: getattr(terms, name)[t : t + 1]
                for name in (
                    "reference", "target", "weight", "goal", "direction_weight", "anchor",
                    "standing", "support", "support_weight",
                )
            }
        )  # fmt: skip
        mine = multipliers._replace(
            **{name: getattr(multipliers, name)[t : t + 1] for name in multipliers._fields[:3]}
        )
        assert kernel.cost(one, mine, x[t : t + 1])[1] == pytest.approx(costs[t])


def test_gradient(terms, multipliers, x):
    *_, residuals, gradient, _ = kernel.normal_equations(terms, multipliers, x)
    assert (residuals.distance < 0.0).any(), "no capsules meet: the test would miss a term"
    step = 1e-6
    for t, i in np.ndindex(x.shape):
        ahead, behind = x.copy(), x.copy()
        ahead[t, i] += step
        behind[t, i] -= step
        difference = (
            kernel.cost(terms, multipliers, ahead)[1] - kernel.cost(terms, multipliers, behind)[1]
        ) / (2 * step)
        assert gradient[t, i] == pytest.approx(difference, abs=2e-6 * np.abs(gradient).max())


def test_hessian_of_points_is_the_sum_of_their_jacobians_squares(terms, multipliers, x):
    frames = len(x)
    only_points = terms._replace(
        direction_weight=np.zeros_like(terms.direction_weight),
        support_weight=np.zeros(frames),
        margin=-1.0,
        standing=np.ones_like(terms.standing),
    )
    *_, hessian = kernel.normal_equations(only_points, multipliers, x)

    def stacked(y):
        poses = kinematics.body_poses(terms.tree, terms.reference, y)
        keypoints = kinematics.positions(terms.points, *poses)
        corners = kinematics.positions(terms.corners, *poses)
        weighted = np.sqrt(terms.weight)[..., None] * keypoints
        held = np.sqrt(multipliers.stance_penalty) * corners
        return np.concatenate([weighted, held], axis=1).reshape(frames, -1)

    step = 1e-6
    J = np.stack(
        [(stacked(x + step * e) - stacked(x - step * e)) / (2 * step) for e in np.eye(29)], axis=2
    )
    np.testing.assert_allclose(hessian, J.transpose(0, 2, 1) @ J, atol=1e-7)


def test_hessian_is_symmetric_and_positive(terms, multipliers, x):
    *_, hessian = kernel.normal_equations(terms, multipliers, x)
    np.testing.assert_array_equal(hessian, hessian.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(hessian).min() > -1e-9
