"""The compiled kinematics agree with Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.optimization import kinematics
from robomirror_drake.robot import load_robot

FRAMES = 7


@pytest.fixture(scope="module")
def robot():
    return load_robot()


@pytest.fixture(scope="module")
def frames():
    """Random reference rotations and frames."""
    rng = np.random.default_rng(1)
    return Rotation.random(FRAMES, rng).as_matrix(), rng.normal(scale=0.5, size=(FRAMES, 29))


@pytest.fixture(scope="module")
def poses(robot, frames):
    return kinematics.body_poses(kinematics.make_tree(robot), *frames)


def configuration(frames, t):
    reference, x = frames
    turn = Rotation.from_matrix(reference[t]) * Rotation.from_rotvec(x[t, 3:6])
    return np.concatenate([x[t, :3], turn.as_quat(), x[t, 6:]])


def test_body_poses(robot, frames, poses):
    data = robot.model.createData()
    for t in range(FRAMES):
        pin.forwardKinematics(robot.model, data, configuration(frames, t))
        for b, pose in enumerate(list(data.oMi)[1:]):
            np.testing.assert_allclose(poses[0][t, b], pose.rotation, atol=1e-12)
            np.testing.assert_allclose(poses[1][t, b], pose.translation, atol=1e-12)


def test_points_of_links(robot, frames, poses):
    spec = robot.spec
    points = kinematics.make_points(robot, [(k.link, k.point) for k in spec.keypoints.values()])
    found = kinematics.positions(points, *poses)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, configuration(frames, 0))
    for k, keypoint in enumerate(spec.keypoints.values()):
        expected = data.oMf[robot.frame_id(keypoint.link)].act(np.array(keypoint.point))
        np.testing.assert_allclose(found[0, k], expected, atol=1e-12)


def test_center_of_mass(robot, frames, poses):
    found = kinematics.center_of_mass(kinematics.make_tree(robot), *poses)
    data = robot.model.createData()
    for t in range(FRAMES):
        expected = pin.centerOfMass(robot.model, data, configuration(frames, t))
        np.testing.assert_allclose(found[t], expected, atol=1e-12)


def test_capsule_distances(robot, poses):
    """Against a fine sampling of both axes, which can only be too long, and not by much."""
    capsules = kinematics.make_capsules(robot)
    found = kinematics.distances(capsules, *poses)
    along = np.linspace(0.0, 1.0, 201)
    for m, (a, b) in enumerate(capsules.pairs):
        axes = []
        for k in (a, b):
            R, p = poses[0][0, capsules.body[k]], poses[1][0, capsules.body[k]]
            ends = p + capsules.ends[k] @ R.T
            axes.append(ends[0] + along[:, None] * (ends[1] - ends[0]))
        sampled = np.linalg.norm(axes[0][:, None] - axes[1][None], axis=2).min()
        gap = found[0, m] + capsules.radius[a] + capsules.radius[b]
        assert gap <= sampled + 1e-12
        assert gap == pytest.approx(sampled, abs=3e-3)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-4, 0.3, 2.5])
def test_rotation_and_its_left_jacobian(angle):
    phi = angle * np.array([0.6, -0.48, 0.64])
    E, J = np.empty((3, 3)), np.empty((3, 3))
    kinematics.rotation_exp(phi, E, J)
    np.testing.assert_allclose(E, Rotation.from_rotvec(phi).as_matrix(), atol=1e-12)
    step = 1e-6
    for i in range(3):
        ahead, behind = (Rotation.from_rotvec(phi + s * step * np.eye(3)[i]) for s in (1.0, -1.0))
        column = (ahead * behind.inv()).as_rotvec() / (2 * step)
        np.testing.assert_allclose(J[:, i], column, atol=1e-7)
