"""The robot in Drake and in Pinocchio is one robot."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder

from robomirror_drake import urdf
from robomirror_drake.exceptions import ConfigError, RobotModelError
from robomirror_drake.robot import Robot, load_robot, rotation_matrix
from robomirror_drake.robot_spec import load_spec


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def plant(robot: Robot) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    robot.add_to_plant(plant, collision=False)
    plant.Finalize()
    return plant


def random_state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    low, high = robot.position_limits
    quaternion = rng.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    q = np.concatenate([quaternion, rng.normal(size=3), rng.uniform(low, high)])
    return q, rng.normal(size=29)


def test_order_of_joints_is_the_specs_in_both(robot, plant) -> None:
    assert tuple(robot.model.names)[2:] == robot.joint_names
    for i, name in enumerate(robot.joint_names):
        joint = plant.GetJointByName(name)
        assert (joint.position_start(), joint.velocity_start()) == (7 + i, 6 + i)
    assert plant.num_actuators() == len(robot.joint_names) == 23
    B = plant.MakeActuationMatrix()
    np.testing.assert_array_equal(B[6:], np.eye(23))


def test_mass_matrix_bias_and_gravity_agree(robot, plant) -> None:
    rng = np.random.default_rng(0)
    context = plant.CreateDefaultContext()
    data = robot.model.createData()
    for _ in range(20):
        q, v = random_state(robot, rng)
        a = rng.normal(size=29)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        # T maps Drake's velocities to Pinocchio's; generalized forces map with its transpose.
        T = np.column_stack([robot.v_to_pinocchio(q, e) for e in np.eye(29)])
        q_pin, v_pin = robot.to_pinocchio(q), robot.v_to_pinocchio(q, v)
        M = pin.crba(robot.model, data, q_pin)
        np.testing.assert_allclose(T.T @ M @ T, plant.CalcMassMatrix(context), atol=1e-9, rtol=1e-9)
        gravity = -plant.CalcGravityGeneralizedForces(context)
        g = pin.computeGeneralizedGravity(robot.model, data, q_pin)
        np.testing.assert_allclose(T.T @ g, gravity, atol=1e-9, rtol=1e-9)
        drake = plant.CalcMassMatrix(context) @ a + plant.CalcBiasTerm(context) + gravity
        pinocchio = pin.rnea(robot.model, data, q_pin, v_pin, robot.a_to_pinocchio(q, v, a))
        np.testing.assert_allclose(T.T @ pinocchio, drake, atol=1e-9, rtol=1e-9)


def test_frame_jacobians_and_poses_agree(robot, plant) -> None:
    rng = np.random.default_rng(1)
    context = plant.CreateDefaultContext()
    data = robot.model.createData()
    for _ in range(5):
        q, _ = random_state(robot, rng)
        plant.SetPositions(context, q)
        q_pin = robot.to_pinocchio(q)
        T = np.column_stack([robot.v_to_pinocchio(q, e) for e in np.eye(29)])
        pin.computeJointJacobians(robot.model, data, q_pin)
        pin.updateFramePlacements(robot.model, data)
        for link in ("PELVIS_S", "L_ANKLE_P_S", "R_ELBOW_P_S", "WAIST_R_S"):
            body = plant.GetBodyByName(link)
            frame = robot.frame_id(link)
            pose = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
            np.testing.assert_allclose(data.oMf[frame].homogeneous, pose, atol=1e-9)
            J = plant.CalcJacobianSpatialVelocity(
                context,
                JacobianWrtVariable.kV,
                body.body_frame(),
                np.zeros(3),
                plant.world_frame(),
                plant.world_frame(),
            )
            J_pin = pin.getFrameJacobian(
                robot.model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
            np.testing.assert_allclose(J_pin[[3, 4, 5, 0, 1, 2]] @ T, J, atol=1e-9)


def test_conversion_round_trips_and_differentiates(robot) -> None:
    rng = np.random.default_rng(2)
    q, v = random_state(robot, rng)
    a = rng.normal(size=29)
    np.testing.assert_array_equal(robot.to_drake(robot.to_pinocchio(q)), q)
    v_pin = robot.v_to_pinocchio(q, v)
    np.testing.assert_allclose(robot.v_to_drake(q, v_pin), v, atol=1e-14)
    a_pin = robot.a_to_pinocchio(q, v, a)
    np.testing.assert_allclose(robot.a_to_drake(q, v, a_pin), a, atol=1e-13)
    # Along a motion, the rate of the converted velocity is the converted acceleration.
    h = 1e-6

    def v_pin_at(t: float) -> np.ndarray:
        moved = pin.integrate(robot.model, robot.to_pinocchio(q), v_pin * t)
        return robot.v_to_pinocchio(robot.to_drake(moved), v + a * t)

    rate = (v_pin_at(h) - v_pin_at(-h)) / (2 * h)
    np.testing.assert_allclose(rate, a_pin, atol=1e-6)


def test_reduction_keeps_the_inertia_of_the_whole_description(robot) -> None:
    source = urdf._description(robot.spec)
    reduced = urdf.reduced_model(robot.spec, source)
    rng = np.random.default_rng(3)
    q = robot.to_pinocchio(random_state(robot, rng)[0])
    model = robot.model.copy()
    model.armature = np.zeros(model.nv)
    ours = pin.crba(model, model.createData(), q)
    np.testing.assert_allclose(ours, pin.crba(reduced, reduced.createData(), q), atol=1e-9)
    assert robot.mass == pytest.approx(62.4)


def test_stands_on_the_floor(robot, plant) -> None:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.standing)
    for foot, corners in zip(("L", "R"), robot.sole_corners, strict=True):
        X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(f"{foot}_ANKLE_P_S"))
        np.testing.assert_allclose((X @ corners.T)[2], 0.0, atol=1e-12)


def test_collision_pairs_are_apart_when_standing_and_only_they_can_meet(robot) -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
    instance = robot.add_to_plant(plant)
    plant.Finalize()
    robot.filter_self_collision(plant, scene_graph, instance)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), robot.standing)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    pairs = query.inspector().GetCollisionCandidates()
    assert len(pairs) == len(robot.spec.collision_pairs)
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.5):
        assert pair.distance > 0.005


def test_visual_meshes_are_there_for_drake_and_meshcat(robot) -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    robot.add_to_plant(plant, collision=False)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    files = [
        Path(str(inspector.GetShape(g).source().path()))
        for body in plant.GetBodyIndices(plant.GetModelInstanceByName("jvrc1"))
        for g in plant.GetVisualGeometriesForBody(plant.get_body(body))
    ]
    assert len(files) == 35
    assert all(f.suffix == ".obj" and f.stat().st_size > 1000 for f in files)


def test_two_builders_racing_leave_one_whole_model(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(urdf.platformdirs, "user_cache_path", lambda _: tmp_path)
    spec = load_spec()
    results: list[Path] = []
    threads = [
        threading.Thread(target=lambda: results.append(urdf.cached_urdf(spec))) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 2
    assert results[0] == results[1]
    assert [f.name for f in (tmp_path / "robots").iterdir()] == [results[0].parent.name]
    pin.buildModelFromUrdf(str(results[0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"colour": "red"}, "colour"),
        ({"stand": {"NOSE": 1.0}}, "NOSE"),
        ({"contact": {"stiffness": -1, "dissipation": 1, "friction": 0.5}}, "stiffness"),
        ({"self_collision": [[["tail"], ["head"]]]}, "tail"),
    ],
)
def test_a_wrong_spec_is_refused_with_the_reason(tmp_path, change, message) -> None:
    data = load_spec().model_dump(mode="json") | change
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError, match=message):
        load_spec(file)


def test_unknown_robots_joints_and_packages_are_refused(robot) -> None:
    with pytest.raises(ConfigError, match=r"known: .*jvrc1"):
        load_spec("r2d2")
    with pytest.raises(RobotModelError, match="TAIL"):
        robot.frame_id("TAIL")
    absent = robot.spec.description.model_copy(update={"package": "no_such_package"})
    with pytest.raises(RobotModelError, match="no_such_package"):
        urdf.cached_urdf(robot.spec.model_copy(update={"description": absent}))


def test_poses_are_rigid(robot) -> None:
    rng = np.random.default_rng(4)
    q, _ = random_state(robot, rng)
    R = rotation_matrix(q[:4])
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert RigidTransform(np.block([[R, np.zeros((3, 1))]])).IsNearlyEqualTo(
        RigidTransform(np.block([[pin.Quaternion(*q[:4]).matrix(), np.zeros((3, 1))]])), 1e-12
    )


def test_one_state_is_converted_as_many_are(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    q, v = rng.standard_normal((4, 30)), rng.standard_normal((4, 29))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    for convert in (robot.v_to_pinocchio, robot.v_to_drake):
        each = [convert(*state) for state in zip(q, v, strict=True)]
        np.testing.assert_allclose(each, convert(q, v), rtol=1e-13, atol=1e-15)
