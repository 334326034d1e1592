"""The controller's bench: what is timed is solved, and the peer solves the same."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from robomirror_drake.bench import controller
from robomirror_drake.bench.controller import Ticks, print_table
from robomirror_drake.bench.peer import PYTHON, peer_ticks
from robomirror_drake.exceptions import BenchError
from robomirror_drake.messages import Execution, RobotReference
from robomirror_drake.robot import Robot, load_robot

PEER = Path(__file__).parents[1] / PYTHON


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def standing(robot, make_execution) -> Execution:
    q = np.tile(robot.standing, (12, 1))
    q[:, 4] += 0.002  # a little beside the reference
    return make_execution(12, q=q, q_ref=q)


@pytest.fixture(scope="module")
def reference(robot) -> RobotReference:
    q, still = np.tile(robot.standing, (12, 1)), np.zeros((12, 29))
    contact = np.ones((12, 2, 4), dtype=np.bool_)
    return RobotReference(np.arange(12) / 60.0, q, still, still, contact)


@pytest.fixture(scope="module")
def ours(robot, reference, standing) -> Ticks:
    return controller._ticks(robot, reference, standing, "daqp")


def test_ticks_are_timed_and_solved(ours) -> None:
    assert np.isfinite(ours.torque).all()
    assert (ours.assembly > 0.0).all()
    assert (ours.solve > 0.0).all()
    assert (ours.load[-1] > 0.0).all()


@pytest.mark.skipif(not PEER.exists(), reason="the peer's environment is not built")
def test_the_peer_solves_the_same_problem(robot, reference, standing, ours) -> None:
    theirs = peer_ticks(robot, reference, standing, ours.load, 1, PEER)
    assert (theirs.assembly > 0.0).all()
    assert (theirs.solve > 0.0).all()
    # Not the same regularisation, and a posture of one weight: near, not equal.
    apart = np.abs(theirs.torque - ours.torque)[-1]
    assert apart.max() < 5.0
    assert np.median(apart) < 1.0


def test_a_missing_peer_is_said_clearly(robot, reference, standing, ours, tmp_path) -> None:
    with pytest.raises(BenchError, match="make bench"):
        peer_ticks(robot, reference, standing, ours.load, 1, tmp_path / "python")


def test_a_failing_peer_is_said_clearly(robot, reference, standing, ours, tmp_path) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho 'no module tsid' >&2\nexit 3\n")
    python.chmod(0o755)
    with pytest.raises(BenchError, match="no module tsid"):
        peer_ticks(robot, reference, standing, ours.load, 1, python)


@pytest.mark.parametrize("peer", [True, False])
def test_table_shows_the_ratio_or_why_there_is_none(ours, peer) -> None:
    row = controller._figures("daqp", ours, ours) | {"real_time_factor": 1.5}
    figures = {
        "command": "walk",
        "ticks": 12,
        "rows": [row],
        "reference_us_median": 50.0,
        "peer": row | {"solver": "tsid"} if peer else None,
        "ratio": 1.25 if peer else None,
        "ratio_without_reference": 0.9 if peer else None,
        "no_peer": None if peer else "no peer: it is missing",
    }
    text = io.StringIO()
    print_table(figures, Console(file=text, width=160))
    assert ("daqp / tsid: 1.25; 0.90" in text.getvalue()) == peer
    assert ("no peer: it is missing" in text.getvalue()) != peer
