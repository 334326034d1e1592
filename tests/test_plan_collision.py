"""Gaps between the robot's own links against independent distances and finite differences."""

from __future__ import annotations

import numpy as np

from robomirror_drake.optimization import centroidal, kinematics
from robomirror_drake.optimization.planning.collision import gap_jacobians, gaps
from robomirror_drake.optimization.planning.frames import Frames
from robomirror_drake.robot import load_robot, rotation_matrix

ROBOT = load_robot()
FRAMES = Frames.of(ROBOT)


def configurations() -> np.ndarray:
    rng = np.random.default_rng(8)
    x = ROBOT.standing + 0.4 * rng.normal(size=(6, 30))
    x[:, :4] = rng.normal(size=(6, 4))
    return x


def sampled(x: np.ndarray, derivatives: bool) -> centroidal.Samples:
    return centroidal.sample(ROBOT, FRAMES.links, x, 0 * x, 0 * x, derivatives=derivatives)


def test_distances_are_those_of_the_retargeting_capsules() -> None:
    x = configurations()
    q = centroidal.unit_quaternions(x)
    upright = np.hstack([q[:, 4:7], np.zeros((len(q), 3)), q[:, 7:]])
    poses = kinematics.body_poses(kinematics.make_tree(ROBOT), rotation_matrix(q[:, :4]), upright)
    expected = kinematics.distances(kinematics.make_capsules(ROBOT), *poses)
    at = gaps(FRAMES.capsules, sampled(x, False).links)
    np.testing.assert_allclose(at.distance, expected, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(at.normal, axis=2), 1.0, atol=1e-6)


def test_gap_jacobians_by_finite_differences() -> None:
    x, h = configurations(), 1e-6
    samples = sampled(x, True)
    at = gaps(FRAMES.capsules, samples.links)
    exact = gap_jacobians(FRAMES.capsules, at, samples.motion, FRAMES.support)
    numeric = np.empty((*at.distance.shape, 30))
    for column in range(30):
        sides = []
        for sign in (-1.0, 1.0):
            moved = x.copy()
            moved[:, column] += sign * h
            sides.append(gaps(FRAMES.capsules, sampled(moved, False).links).distance)
        numeric[..., column] = (sides[1] - sides[0]) / (2 * h)
    np.testing.assert_allclose(numeric[..., :7], 0.0, atol=1e-7)
    np.testing.assert_allclose(exact, numeric[..., 7:], atol=1e-5)
