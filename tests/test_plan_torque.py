"""Torques of a plan: derivatives, agreement with inverse dynamics, limits that plans keep."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.planning.contacts import ConeOptions
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.planning.torque import Split, joint_torques, split_of
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
WEIGHT = ROBOT.mass * centroidal.GRAVITY
CARRIES = centroidal.frame_support(ROBOT.model, list(ROBOT.foot_frames))
DAMPING = np.array([joint.damping for joint in ROBOT.spec.joints.values()])


def random_trajectory() -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    x = ROBOT.standing + 0.3 * rng.normal(size=(4, 30))
    x[:, :4] = rng.normal(size=(4, 4))
    return [x, rng.normal(size=(4, 30)), 3.0 * rng.normal(size=(4, 30))]


def random_split() -> Split:
    rng = np.random.default_rng(4)
    return Split(rng.normal(size=(4, 2, 6, 6)), 50.0 * rng.normal(size=(4, 2, 6)))


def test_torque_jacobians_by_finite_differences() -> None:
    trajectory, split, h = random_trajectory(), random_split(), 1e-6

    def torques(at: list[np.ndarray], derivatives: bool):
        samples = centroidal.sample(ROBOT, [], *at, derivatives=derivatives)
        return joint_torques(ROBOT, samples, split, CARRIES)

    torque, exact = torques(trajectory, True)
    assert exact is not None
    np.testing.assert_allclose(torque, torques(trajectory, False)[0], atol=1e-9)
    for order in range(3):
        for column in range(30):
            sides = []
            for sign in (-1.0, 1.0):
                moved = [part.copy() for part in trajectory]
                moved[order][:, column] += sign * h
                sides.append(torques(moved, False)[0])
            numeric = (sides[1] - sides[0]) / (2 * h)
            scale = 1.0 + np.abs(numeric).max()
            np.testing.assert_allclose(exact[order, :, :, column], numeric, atol=5e-5 * scale)


def test_torques_are_those_of_inverse_dynamics_with_external_forces() -> None:
    trajectory, split = random_trajectory(), random_split()
    samples = centroidal.sample(ROBOT, [], *trajectory, derivatives=False)
    torque, _ = joint_torques(ROBOT, samples, split, CARRIES)
    at, data = samples.at, ROBOT.model.createData()
    for t in range(4):
        pin.forwardKinematics(ROBOT.model, data, at.q[t])
        external = pin.StdVec_Force()
        for _ in range(ROBOT.model.njoints):
            external.append(pin.Force.Zero())
        for foot, frame in enumerate(ROBOT.foot_frames):
            joint = ROBOT.model.frames[frame].parentJoint
            moment, force = np.split(
                split.gain[t, foot] @ samples.wrench[t] + split.offset[t, foot], 2
            )
            external[joint] = data.oMi[joint].actInv(pin.Force(force, moment))
        expected = pin.rnea(ROBOT.model, data, at.q[t], at.v[t], at.a[t], external)[6:]
        np.testing.assert_allclose(torque[t], expected + DAMPING * at.v[t, 6:], atol=1e-8)


def test_split_sums_up_and_loads_only_feet_on_the_ground() -> None:
    q = np.repeat(ROBOT.standing[None], 20, axis=0)
    pose = centroidal.sample(ROBOT, list(ROBOT.foot_frames), q, 0 * q, 0 * q, derivatives=False)
    turned = np.einsum("tfij,fcj->tfci", pose.links[..., :3, :3], ROBOT.sole_corners)
    standing = turned + pose.links[:, :, None, :3, 3]
    loaded = np.ones((20, 2, 4), dtype=bool)
    loaded[8:12, 0] = False
    loaded[15:] = False
    cone = ConeOptions(friction=0.4, margin=0.01, max_normal_force=3.0, weight=WEIGHT)
    wrench = pose.wrench.copy()
    wrench[15:] = 0.0
    split = split_of(wrench, standing, loaded, cone)
    total = split.gain.sum(axis=1)
    np.testing.assert_allclose(total[:15], np.tile(np.eye(6), (15, 1, 1)), atol=1e-9)
    assert not split.gain[15:].any()
    assert not split.offset[15:].any()
    assert not split.gain[8:12, 0].any()
    feet = np.einsum("tfij,tj->tfi", split.gain, wrench) + split.offset
    assert np.all(feet[:8, :, 5] > 0.1 * WEIGHT)


def torques_of(
    plan: RobotReference, time: np.ndarray, x: np.ndarray, xd: np.ndarray, xdd: np.ndarray
) -> np.ndarray:
    """(T, 23) torques of a plan that moves so, its foot forces interpolated."""
    samples = centroidal.sample(ROBOT, list(ROBOT.foot_frames), x, xd, xdd, derivatives=False)
    centers = ROBOT.sole_corners.mean(axis=1)
    centers = np.einsum("tfij,fj->tfi", samples.links[..., :3, :3], centers)
    centers += samples.links[..., :3, 3]
    shares = np.empty((len(time), 2, 6))
    for foot in range(2):
        for axis in range(6):
            shares[:, foot, axis] = np.interp(time, plan.time, plan.foot_force[:, foot, axis])
    shares[..., :3] += np.cross(centers, shares[..., 3:])
    split = Split(np.zeros((len(time), 2, 6, 6)), shares)
    return joint_torques(ROBOT, samples, split, CARRIES)[0]


def test_a_real_jump_needs_no_more_torque_than_there_is(resampled) -> None:
    motion = load_clip("jump")
    raw = retarget(ROBOT, motion, foot_contacts(motion))
    plan = plan_dynamics(ROBOT, raw)
    torque = np.abs(torques_of(plan, *resampled(plan, 200.0))) / ROBOT.effort_limits
    assert torque.max() < 1.0
    assert np.mean(torque > 0.8) < 4e-3
    assert plan.residuals["distance_to_raw"] < 0.11
    assert plan.residuals["self_penetration"] < 1e-3
