"""The retargeter beside per-frame inverse kinematics, on the same keypoints of the same clips.

The peer is mink's differential IK as GMR uses it: a few steps towards the frame's
keypoints, from the frame before. Both are judged by the same figures at 60 Hz.

Source: J. P. Araújo et al., "Retargeting Matters: General Motion Retargeting for
Humanoid Motion Tracking", 2025.
"""

from __future__ import annotations

import importlib
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS, load_clip
from robomirror_drake.optimization.retargeting.metrics import residuals
from robomirror_drake.optimization.retargeting.retarget import (
    RetargetOptions,
    Warm,
    retarget_batch,
    retarget_solution,
    retarget_window,
    robot_tables,
    scale_motion,
    window_of,
)
from robomirror_drake.optimization.retargeting.targets import RATE, Targets
from robomirror_drake.robot import Robot, load_robot

REPEATS = 5
"""Each time is the least of so many."""

IK_STEPS, IK_PROGRESS, IK_DAMPING = 10, 1e-3, 3e-2
"""mink's most steps per frame, the progress [m] below which it stops, and its damping."""

CANDIDATES = 8
WINDOW = round(RATE) + 1
"""Samples in a window of one second."""

T = TypeVar("T")


def run(clips: Sequence[str] | None = None) -> dict[str, Any]:
    """Measures both methods on clips, by default on all that keep to the feet.

    Returns:
        ``rows`` with ``clip``, ``method``, ``frames_per_s``, ``keypoint_cm``,
        ``stance_drift_mm``, ``penetration_mm``, ``self_penetration_mm``, ``jerk_rms``
        [rad/s³] and ``limit_violation`` [rad or rad/s]; ``window_1s_cold_ms`` and
        ``window_1s_warm_ms``, medians over the clips of a second's first solve and of the
        same moved on by two knots; ``pool_8x1s_ms``, eight walks that differ in stride.

    Raises:
        InputError: The ``bench`` extra is not installed.
    """
    mink, mujoco = _import("mink"), _import("mujoco")
    robot = load_robot()
    names = FEET_ONLY_CLIPS if clips is None else tuple(clips)
    motions = {name: load_clip(name) for name in names}
    with threadpool_limits(1):  # one core for both
        retarget_solution(robot, motions[names[0]])  # compiles
        rows = [
            row
            for name, motion in motions.items()
            for row in (_ours(robot, name, motion), _mink(robot, name, motion, mink, mujoco))
        ]
        cold, warm = zip(*(_windows(robot, motion) for motion in motions.values()), strict=True)
        return {
            "rows": rows,
            "window_1s_cold_ms": float(np.median(cold)),
            "window_1s_warm_ms": float(np.nanmedian(warm)),
            "pool_8x1s_ms": _pool(robot, load_clip("walk")),
        }


def print_table(figures: dict[str, Any], console: Console) -> None:
    """Prints what :func:`run` has measured."""
    table = Table(
        "clip",
        "method",
        "frames/s",
        "keypoints [cm]",
        "drift [mm]",
        "sole depth [mm]",
        "self depth [mm]",
        "jerk [rad/s³]",
        "over limit",
        title="Retargeting at 60 Hz",
    )
    for row in figures["rows"]:
        table.add_row(
            row["clip"],
            row["method"],
            f"{row['frames_per_s']:.0f}",
            f"{row['keypoint_cm']:.2f}",
            f"{row['stance_drift_mm']:.1f}",
            f"{row['penetration_mm']:.1f}",
            f"{row['self_penetration_mm']:.1f}",
            f"{row['jerk_rms']:.0f}",
            f"{row['limit_violation']:.2g}",
            end_section=row["method"] == "mink",
        )
    console.print(table)
    console.print(
        f"1 s window: {figures['window_1s_cold_ms']:.1f} ms cold, "
        f"{figures['window_1s_warm_ms']:.1f} ms warm; "
        f"{CANDIDATES} candidates of 1 s: {figures['pool_8x1s_ms']:.1f} ms"
    )


def _import(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"the comparison needs {name}: pip install 'robomirror_drake[bench]'"
        ) from error


def _ours(robot: Robot, clip: str, motion: HumanMotion) -> dict[str, Any]:
    seconds, result = _timed(lambda: retarget_solution(robot, motion))
    return _row(clip, "ours", len(result.targets.time) / seconds, result.reference.residuals)


def _mink(robot: Robot, clip: str, motion: HumanMotion, mink: Any, mujoco: Any) -> dict[str, Any]:
    targets = scale_motion(robot, motion, foot_contacts(motion))
    model = mujoco_model(robot, mujoco)
    seconds, q = _timed(lambda: per_frame_ik(robot, targets, model, mink))
    v = np.hstack([np.zeros((len(q), 6)), np.gradient(q[:, 7:], targets.time, axis=0)])
    figures = residuals(robot_tables(robot), targets, q, v)
    return _row(clip, "mink", len(q) / seconds, figures)


def _row(clip: str, method: str, rate: float, figures: Any) -> dict[str, Any]:
    return {
        "clip": clip,
        "method": method,
        "frames_per_s": rate,
        "keypoint_cm": 100.0 * figures["keypoint_error"],
        "stance_drift_mm": 1e3 * figures["stance_drift"],
        "penetration_mm": 1e3 * figures["penetration"],
        "self_penetration_mm": 1e3 * figures["self_penetration"],
        "jerk_rms": figures["jerk_rms"],
        "limit_violation": figures["limit_violation"],
    }


def _windows(robot: Robot, motion: HumanMotion) -> tuple[float, float]:
    """Time of a cold and of a warm window of one second [ms]; NaN where the clip is shorter."""
    options = RetargetOptions()
    targets = scale_motion(robot, motion, foot_contacts(motion))
    cold, first = _timed(lambda: retarget_window(robot, window_of(targets, 0, WINDOW), options))
    shift = 2
    start = round(shift * options.knot_spacing * RATE)
    if len(targets.time) < start + WINDOW:
        return 1e3 * cold, float("nan")
    ahead = window_of(targets, start, start + WINDOW)
    on = Warm(first.path, shift)
    warm, _ = _timed(lambda: retarget_window(robot, ahead, options, on))
    return 1e3 * cold, 1e3 * warm


def _pool(robot: Robot, motion: HumanMotion) -> float:
    """Time to label and retarget one second of eight walks that differ in stride [ms]."""
    second = motion.positions[: round(motion.fps) + 1]
    strides = np.linspace(0.85, 1.15, CANDIDATES)
    pool = [replace(motion, positions=second * [stride, 1.0, 1.0]) for stride in strides]
    return 1e3 * _timed(lambda: retarget_batch(robot, pool))[0]


def _timed(work: Callable[[], T]) -> tuple[float, T]:
    """Least time of some repetitions [s], and the last result."""
    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - begin)
    return min(seconds), result


def mujoco_model(robot: Robot, mujoco: Any) -> Any:
    """The robot's URDF in MuJoCo, without geometry, on a free joint, a site at each keypoint."""
    tree = ET.parse(robot.urdf).getroot()
    for link in tree.iter("link"):
        for geometry in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(geometry)
    ET.SubElement(tree, "link", name="world")
    joint = ET.SubElement(tree, "joint", name="floating_base", type="floating")
    ET.SubElement(joint, "parent", link="world")
    ET.SubElement(joint, "child", link=robot.spec.base_link)
    mujoco_options = ET.SubElement(tree, "mujoco")
    ET.SubElement(mujoco_options, "compiler", fusestatic="false", balanceinertia="true")
    spec = mujoco.MjSpec.from_string(ET.tostring(tree, encoding="unicode"))
    for name, keypoint in robot.spec.keypoints.items():
        spec.body(keypoint.link).add_site(name=name, pos=list(keypoint.point))
    return spec.compile()


def per_frame_ik(robot: Robot, targets: Targets, model: Any, mink: Any) -> Array:
    """(T, 30) positions that mink finds frame by frame, Drake order."""
    names = list(robot.spec.keypoints)
    order = [model.joint(name).qposadr[0] for name in robot.joint_names]
    configuration = mink.Configuration(model)
    start = np.zeros(model.nq)
    start[:3], start[3:7] = targets.keypoints[0, names.index("pelvis")], robot.standing[:4]
    start[order] = robot.standing[7:]
    configuration.update(start)
    tasks = [
        mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=0.0) for name in names
    ]
    posture = mink.PostureTask(model, cost=1e-2)
    posture.set_target(start)
    limits = [mink.ConfigurationLimit(model)]
    dt = 1.0 / RATE
    q = np.empty((len(targets.time), robot.model.nq))
    for t, keypoints in enumerate(targets.keypoints):
        for task, point in zip(tasks, keypoints, strict=True):
            task.set_target(mink.SE3.from_translation(point))
        error = np.inf
        for _ in range(IK_STEPS):
            v = mink.solve_ik(
                configuration, [*tasks, posture], dt, "daqp", damping=IK_DAMPING, limits=limits
            )
            configuration.integrate_inplace(v, dt)
            now = float(np.linalg.norm([task.compute_error(configuration) for task in tasks]))
            if error - now < IK_PROGRESS:
                break
            error = now
        found = configuration.q
        q[t] = np.concatenate([found[3:7], found[:3], found[order]])
    return q
