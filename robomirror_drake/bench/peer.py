"""Hands the recorded ticks of a walk to TSID, in an environment of its own."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robomirror_drake.exceptions import BenchError
from robomirror_drake.messages import Array, Execution, RobotReference
from robomirror_drake.optimization.control.dynamics_terms import (
    TaskMotion,
    control_model,
    memory,
    task_motion,
)
from robomirror_drake.optimization.control.qp import WholeBodyOptions, tuning
from robomirror_drake.optimization.control.reference_trajectory import (
    ReferenceSample,
    reference_trajectory,
    sample_reference,
)
from robomirror_drake.robot import FEET, Robot

PYTHON = Path(".venv-tsid/bin/python")
"""Where ``make bench`` puts the peer's environment."""

TASKS = ("com_horizontal", "com_vertical", "angular_momentum", "pelvis", "trunk", "swing", "stance")
"""Rows of :attr:`~robomirror_drake.optimization.control.qp.Tuning.gains`."""


class PeerTicks(NamedTuple):
    """(N,) assembly and (N,) solution times [µs], (N, 23) torques, NaN where unsolved."""

    assembly: Array
    solve: Array
    torque: Array


def peer_ticks(
    robot: Robot,
    reference: RobotReference,
    execution: Execution,
    load: Array,
    repeats: int,
    python: Path = PYTHON,
) -> PeerTicks:
    """What TSID needs for the same states, references, tasks, bounds and contacts.

    Args:
        robot: The robot.
        reference: What it was told.
        execution: Where its states are from.
        load: (N, 2, 4) share of its full force that each corner may bear.
        repeats: Each time is the least of so many.
        python: Interpreter that has the peer.

    Raises:
        BenchError: There is no such environment, or the peer failed in it.
    """
    if not python.exists():
        raise BenchError(f"no peer: {python} is missing; `make bench` builds it")
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "ticks.npz"), Path(folder, "times.npz")
        np.savez(source, **_given(robot, reference, execution, load), repeats=repeats)  # type: ignore[arg-type]
        script = Path(__file__).with_name("tsid_ticks.py")
        # Its Python shall not see this package, whose modules are for another one.
        own = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
        done = subprocess.run(
            [python, "-P", script, source, target],
            capture_output=True,
            text=True,
            env=own | {"OMP_NUM_THREADS": "1"},
        )
        if done.returncode:
            said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
            raise BenchError(f"the peer failed in {python}: {said[-1]}")
        with np.load(target) as times:
            return PeerTicks(1e6 * times["assembly"], 1e6 * times["solve"], times["torque"])


def _given(
    robot: Robot, reference: RobotReference, execution: Execution, load: Array
) -> dict[str, object]:
    """All that the peer is told, by the names under which it reads it."""
    options = WholeBodyOptions()
    model = control_model(robot)
    tuned, scratch = tuning(model, options), memory(model)
    trajectory = reference_trajectory(robot, reference)
    wanted: list[ReferenceSample] = []
    motion: list[TaskMotion] = []
    for now in execution.time:
        sample = sample_reference(trajectory, float(now), options.contact_ramp)
        wanted.append(sample)
        motion.append(task_motion(model, scratch, sample.q, sample.v, sample.a))
    keypoints = robot.spec.keypoints
    return {
        "urdf": str(robot.urdf),
        "armature": robot.model.armature[6:],
        "effort": model.effort,
        "speed": robot.velocity_limits,
        "frames": [
            robot.spec.base_link,
            keypoints["neck"].link,
            *(robot.spec.feet[foot].link for foot in FEET),
        ],
        "center": [robot.spec.feet[foot].center for foot in FEET],
        "corners": model.corners,
        "tasks": TASKS,
        "gains": tuned.gains,
        "posture": tuned.posture,
        "posture_stiffness": options.posture_stiffness,
        "posture_damping": options.posture_damping,
        "horizon": options.limit_horizon,
        "acceleration_limit": options.acceleration_limit,
        "friction": options.friction,
        "time": execution.time,
        "q": robot.to_pinocchio(execution.q),
        "v": robot.v_to_pinocchio(execution.q, execution.v),
        "load": load > 0.0,
        "com": [m.com for m in motion],
        "angular": [m.angular for m in motion],
        "R": [m.R for m in motion],
        "p": [m.p for m in motion],
        "rate": [m.v for m in motion],
        "surge": [m.a for m in motion],
        "joint_q": [w.q[7:] for w in wanted],
        "joint_v": [w.v[6:] for w in wanted],
        "joint_a": [w.a[6:] for w in wanted],
    }
