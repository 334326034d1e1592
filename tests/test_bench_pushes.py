"""Pushes on a walking robot: when, which way, and how they are told."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
import pytest
from rich.console import Console

from robomirror_drake.bench import pushes
from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import RobotReference
from robomirror_drake.robot import Robot, load_robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


def _standing(robot: Robot, samples: int, yaw: float = 0.0) -> RobotReference:
    q = np.tile(robot.standing, (samples, 1))
    q[:, :4] = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
    nothing = np.zeros((samples, 29))
    contact = np.ones((samples, 2, 4), dtype=np.bool_)
    return RobotReference(np.arange(samples) / 60.0, q, nothing, nothing, contact, text="a walk")


def test_pushes_fall_into_a_step_of_the_second_half(robot: Robot) -> None:
    stand = _standing(robot, 241)  # 4 s
    contact = stand.contact.copy()
    for begin, foot in ((30, 0), (60, 1), (120, 0), (160, 1), (200, 0)):
        contact[begin : begin + 20, foot] = False
    walk = dataclasses.replace(stand, contact=contact)
    first, second = pushes.step_in_the_middle(walk)
    assert first == pytest.approx(119 / 60)
    assert second == pytest.approx(159 / 60)
    with pytest.raises(InputError, match="too few steps"):
        pushes.step_in_the_middle(stand)


def test_a_push_goes_where_the_robot_sees_it_go(robot: Robot) -> None:
    """Facing world's y, the robot is pushed over to its left: towards world's −x."""
    turned = _standing(robot, 20, yaw=np.pi / 2)
    scenario = Scenario(command="a walk")
    hard = pushes.execute((turned, scenario, 2.0, "left", 0.0, 0.1))
    x, y = hard.q[30, 4:6] - turned.q[0, 4:6]  # before its steps lead it elsewhere
    assert x < -0.2
    assert abs(y) < 0.1


def test_table_tells_every_push() -> None:
    rows = [
        dataclasses.asdict(pushes.Row(0.5, direction, phase, 2.0, fell, 3.1 if fell else None))
        for direction, fell in (("left", True), ("right", False))
        for phase in pushes.PHASES
    ]
    figures = {"command": "a walk", "seed": 0, "survived": 3, "pushes": 6, "rows": rows}
    page = io.StringIO()
    pushes.print_table(figures, Console(file=page, width=120))
    assert page.getvalue().count("fell after 1.1 s") == 3
    assert page.getvalue().count("upright") == 3
    assert "3 of 6 survived" in page.getvalue()
