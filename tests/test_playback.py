"""Playback: poses against the kinematics; pages and servers that keep to this machine."""

from __future__ import annotations

import re
import socket
import urllib.request

import numpy as np
import pinocchio as pin
import pytest

from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.skeleton import INDEX, PARENTS
from robomirror_drake.outcome import evaluate
from robomirror_drake.playback.playback import play, render_playback
from robomirror_drake.playback.scene import HUMAN_OFFSET, build_scene, human_bodies, robot_bodies
from robomirror_drake.results import Result
from robomirror_drake.robot import load_robot, rotation_matrix


@pytest.fixture
def result(candidates, reference, noisy_execution) -> Result:
    outcome = evaluate(noisy_execution, load_robot().effort_limits, 0.6)
    return Result("sway", "", candidates, 0, reference, noisy_execution, outcome)


def test_links_are_where_the_kinematics_put_them(noisy_execution):
    robot = load_robot()
    q = noisy_execution.q[:5]
    bodies = {body.path: body for body in robot_bodies(robot, q, "robot")}
    data = robot.model.createData()
    for frame in range(5):
        pin.forwardKinematics(robot.model, data, robot.to_pinocchio(q[frame]))
        for name in ("L_ANKLE_P", "R_ELBOW_P", "WAIST_R"):
            placement = data.oMi[robot.model.getJointId(name)]
            body = bodies[f"robot/{name}"]
            np.testing.assert_allclose(body.position[frame], placement.translation, atol=1e-12)
            R = rotation_matrix(body.quaternion[frame])
            np.testing.assert_allclose(R, placement.rotation, atol=1e-12)


def test_bones_reach_from_joint_to_joint():
    rng = np.random.default_rng(2)
    start = rng.standard_normal((22, 3))
    turns = [pin.exp3(np.array([0.0, 0.4 * i, 0.3 * i])) for i in range(9)]
    motion = HumanMotion(positions=np.array([start @ R.T for R in turns]), fps=10.0)
    bodies = {body.path: body for body in human_bodies(motion, motion.time)}
    for name, child in INDEX.items():
        if PARENTS[child] < 0:
            continue
        body = bodies[f"human/{name}"]
        middle = rotation_matrix(body.quaternion) @ body.meshes[0].pose[:3, 3]
        joints = motion.positions + HUMAN_OFFSET
        end = body.position + 2.0 * middle
        np.testing.assert_allclose(body.position, joints[:, PARENTS[child]], atol=1e-12)
        np.testing.assert_allclose(end, joints[:, child], atol=1e-9)


def test_human_holds_its_last_frame(candidates):
    bodies = human_bodies(candidates[2], np.array([0.0, 0.4, 5.0]))
    for body in bodies:
        np.testing.assert_array_equal(body.position[1], body.position[2])


def test_all_bodies_move_together(result):
    scene = build_scene(result, load_robot())
    lengths = {len(body.position) for body in scene.bodies}
    assert lengths == {60}
    assert len({body.path for body in scene.bodies}) == len(scene.bodies)
    assert {body.path.split("/")[0] for body in scene.bodies} == {"human", "robot", "reference"}


def test_page_stands_alone(result):
    html = render_playback(result, load_robot())
    assert not re.search(r"<(script|link|img|iframe)[^>]*https?:", html)
    assert 2_000_000 < len(html) < 25_000_000


def test_live_viewer_is_served_to_this_machine_only(result):
    viewer = play(result, load_robot())
    with urllib.request.urlopen(viewer.url(), timeout=10) as page:
        assert b"<html" in page.read().lower()
    port = int(re.search(r":(\d+)/", viewer.url())[1])
    with socket.socket() as other, pytest.raises(OSError, match="refused"):
        other.connect(("127.0.0.2", port))  # answered by whatever listens on every address
