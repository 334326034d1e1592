"""From a human motion to a robot's reference by trajectory optimisation (the paper's g_h2r).

:func:`retarget` takes one motion, :func:`retarget_batch` a pool of candidates, each
warm from its neighbour. :func:`retarget_window` is the part between: it takes
targets that are already scaled, so that a long motion can be done window by window.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import Array, BoolArray, HumanMotion, RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.floating_base import Path, reference_rotation, sample
from robomirror_drake.optimization.kinematics import body_poses, positions
from robomirror_drake.optimization.retargeting.footholds import heading
from robomirror_drake.optimization.retargeting.metrics import RobotTables, make_tables, residuals
from robomirror_drake.optimization.retargeting.options import RetargetOptions
from robomirror_drake.optimization.retargeting.problem import STRIDE, Problem, make_problem
from robomirror_drake.optimization.retargeting.solver import Solution, solve
from robomirror_drake.optimization.retargeting.targets import Targets, make_targets
from robomirror_drake.robot import Robot

__all__ = [
    "RetargetOptions",
    "Retargeted",
    "Warm",
    "retarget",
    "retarget_batch",
    "retarget_solution",
    "retarget_window",
    "scale_motion",
    "window_of",
]


class Warm(NamedTuple):
    """Where a solve may start from.

    Attributes:
        path: The solution of a neighbouring candidate, or of the window before.
        shift: For the window before, by how many knots the new one begins later; the new
            path then goes on from the old with equal position, velocity and acceleration.
            None for a neighbour.
    """

    path: Path
    shift: int | None = None


class Retargeted(NamedTuple):
    """A reference and what it was made from.

    Attributes:
        reference: The reference.
        path: Its splines, from which other solves can start.
        targets: What it followed; ``contact`` as the reference has it.
        problem: The problem that was solved.
        solution: What the solver found.
    """

    reference: RobotReference
    path: Path
    targets: Targets
    problem: Problem
    solution: Solution


@lru_cache(maxsize=8)
def robot_tables(robot: Robot) -> RobotTables:
    """The tables of a robot, worked out once."""
    return make_tables(robot)


def retarget(
    robot: Robot,
    motion: HumanMotion,
    contacts: BoolArray | None = None,
    options: RetargetOptions | None = None,
    warm: Warm | None = None,
) -> RobotReference:
    """Turns a human motion into a reference for the robot.

    Args:
        robot: The robot.
        motion: The human motion.
        contacts: (T, 2, 2) contact of (left, right) foot × (heel, toe) in its frames; by
            default what :func:`foot_contacts` reads off the motion.
        options: Weights, limits, margins and the gate.
        warm: Where to start from.

    Raises:
        ValueError: ``contacts`` does not fit the motion.
        RetargetingError: No reference within the gate was found.
    """
    return retarget_solution(robot, motion, contacts, options, warm).reference


def retarget_solution(
    robot: Robot,
    motion: HumanMotion,
    contacts: BoolArray | None = None,
    options: RetargetOptions | None = None,
    warm: Warm | None = None,
) -> Retargeted:
    """As :func:`retarget`, with all that the reference was made from."""
    options = options or RetargetOptions()
    contacts = foot_contacts(motion) if contacts is None else contacts
    targets = scale_motion(robot, motion, contacts)
    return retarget_window(robot, targets, options, warm, motion.text, motion.source)


def retarget_batch(
    robot: Robot,
    motions: Sequence[HumanMotion],
    contacts: Sequence[BoolArray] | None = None,
    options: RetargetOptions | None = None,
) -> tuple[Retargeted | RetargetingError, ...]:
    """Retargets candidates, each from its neighbour's solution, and reports those that fail.

    A candidate whose warm start leads nowhere is solved again from nothing.
    """
    contacts = [foot_contacts(motion) for motion in motions] if contacts is None else contacts
    results: list[Retargeted | RetargetingError] = []
    warm: Warm | None = None
    for motion, labels in zip(motions, contacts, strict=True):
        try:
            result = retarget_solution(robot, motion, labels, options, warm)
        except RetargetingError as error:
            results.append(error)
        else:
            results.append(result)
            warm = Warm(result.path)
    return tuple(results)


def scale_motion(robot: Robot, motion: HumanMotion, contacts: BoolArray) -> Targets:
    """The motion in the robot's proportions; slice it with :func:`window_of` for windows.

    Raises:
        ValueError: ``contacts`` does not fit the motion.
        RetargetingError: The human has no legs to be scaled by.
    """
    if np.shape(contacts) != (len(motion.positions), 2, 2):
        raise ValueError(
            f"contacts has shape {np.shape(contacts)}, expected {(len(motion.positions), 2, 2)}"
        )
    tables = robot_tables(robot)
    return make_targets(tables.body, motion, contacts)


def window_of(targets: Targets, start: int, stop: int) -> Targets:
    """Samples ``start`` to ``stop`` (exclusive) of targets, with time from 0 again."""
    part = slice(start, stop)
    return Targets(
        time=targets.time[part] - targets.time[start],
        keypoints=targets.keypoints[part],
        directions=targets.directions[part],
        pelvis=targets.pelvis[part],
        contact=targets.contact[part],
        anchor=targets.anchor[part],
    )


def retarget_window(
    robot: Robot,
    targets: Targets,
    options: RetargetOptions,
    warm: Warm | None = None,
    text: str = "",
    source: str = "",
) -> Retargeted:
    """Solves for targets that are already scaled.

    Where a warm start does not lead within the gate, and where a cold one does not in the
    given number of iterations, the solve is repeated from nothing with more of them; with every
    sample in sight where the robot passes through itself.

    Raises:
        RetargetingError: No reference within the gate was found.
    """
    tables = robot_tables(robot)
    if warm is not None and warm.shift is not None:
        targets = _carry_footholds(tables, targets, warm)
    # What goes on from a window before has to start where that one is; a neighbour is a hint.
    again = warm if warm is not None and warm.shift is not None else None
    stride = STRIDE
    for start, factor in ((warm, 1), (again, 2)):
        iterations = factor * options.iterations
        result = _solve(robot, targets, options, start, iterations, stride, text, source)
        figures, gate = result.reference.residuals, options.gate.model_dump()
        exceeded = [name for name, most in gate.items() if figures[name] > most]
        if not exceeded:
            return result
        if "self_penetration" in exceeded:
            stride = 1
    raise RetargetingError(_name(text, source), figures, exceeded)


def _name(text: str, source: str) -> str:
    return source or text or "without a name"


def _solve(
    robot: Robot,
    targets: Targets,
    options: RetargetOptions,
    warm: Warm | None,
    iterations: int,
    stride: int,
    text: str,
    source: str,
) -> Retargeted:
    tables = robot_tables(robot)
    fixed, kept = 0, None
    if warm is not None and warm.shift is not None:
        fixed = spline.ORDER - 1
        kept = warm.path.reference[warm.shift : warm.shift + fixed]
    problem = make_problem(tables, robot.standing[7:], targets, options, kept, stride)
    start = problem.start if warm is None else _warm_start(problem, warm)
    solution = solve(
        problem,
        start,
        fixed=fixed,
        iterations=iterations,
        tolerance=options.tolerance,
        flatness=options.flatness,
        warm=warm is not None,
    )
    path = Path(solution.control, problem.reference, problem.spacing)
    targets = targets._replace(contact=_held(targets.contact, problem.picked, solution.standing))
    motion = sample(path, targets.time)
    figures = residuals(tables, targets, motion.q, motion.v)
    figures["iterations"] = float(solution.iterations)
    reference = RobotReference(
        time=targets.time,
        q=motion.q,
        v=motion.v,
        a=motion.a,
        contact=targets.contact,
        text=text,
        source=source,
        residuals=figures,
    )
    return Retargeted(reference, path, targets, problem, solution)


def _warm_start(problem: Problem, warm: Warm) -> Array:
    """(K, 29) control points to start with."""
    old, start = warm.path.control, problem.start.copy()
    points = len(start)
    if warm.shift is None:
        # A neighbour moves alike in its own tempo; the path over the floor is one's own.
        start[:, 3:] = spline.stretched(old, points)[:, 3:]
        return start
    moved = old[warm.shift :][:points]
    gap = moved[-1, :3] - start[len(moved) - 1, :3]
    start[len(moved) :, :3] += gap
    start[len(moved) :, 3:] = moved[-1, 3:]
    start[: len(moved)] = moved
    return start


def _carry_footholds(tables: RobotTables, targets: Targets, warm: Warm) -> Targets:
    """Targets whose feet, where they stand at the start, stand where the path before has them."""
    assert warm.shift is not None
    path = warm.path
    time = np.array([warm.shift * path.spacing])
    basis = spline.basis(time, path.spacing, len(path.control))
    R, p = body_poses(
        tables.tree,
        reference_rotation(basis, path.reference),
        spline.evaluate(basis, path.control),
    )
    corners = positions(tables.corners, R, p).reshape(2, 4, 3) * [1.0, 1.0, 0.0]
    anchor = targets.anchor.copy()
    for foot in (0, 1):
        for start, stop in runs(np.asarray(targets.contact[:, foot].any(axis=1)))[:1]:
            if start == 0:
                bears = targets.contact[0, foot]
                old, new = anchor[0, foot], corners[foot]
                yaw = float(heading(new[None])[0] - heading(old[None])[0])
                arm = anchor[:stop, foot] - old[bears].mean(axis=0)
                turn = Rotation.from_euler("z", yaw).as_matrix()
                anchor[:stop, foot] = arm @ turn.T + new[bears].mean(axis=0)
    return targets._replace(anchor=anchor)


def _held(contact: BoolArray, picked: npt.NDArray[np.int64], standing: BoolArray) -> BoolArray:
    """(T, 2, 4) contacts between samples (S, 8) at both of which the solver still held them."""
    after = np.searchsorted(picked, np.arange(len(contact)))
    before = np.searchsorted(picked, np.arange(len(contact)), side="right") - 1
    held = contact & (standing[before] & standing[after]).reshape(contact.shape)
    return np.asarray(held)
