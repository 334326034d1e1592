"""From a human motion to a robot's reference by trajectory optimisation (the paper's g_h2r)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import Array, BoolArray, HumanMotion, RobotReference
from robomirror_drake.optimization.floating_base import Path, sample
from robomirror_drake.optimization.retarget_metrics import RobotTables, make_tables, residuals
from robomirror_drake.optimization.retarget_options import RetargetOptions
from robomirror_drake.optimization.retarget_problem import Problem, make_problem, picked_samples
from robomirror_drake.optimization.retarget_solver import Solution, solve
from robomirror_drake.optimization.retarget_targets import Targets, make_targets
from robomirror_drake.robot import Robot


class Retargeted(NamedTuple):
    """A reference with what it was made from.

    Attributes:
        reference: The reference.
        path: Its splines, from which other solves can start.
        targets: What it followed.
        problem: The problem that was solved.
        solution: What the solver found.
    """

    reference: RobotReference
    path: Path
    targets: Targets
    problem: Problem
    solution: Solution


@lru_cache(maxsize=4)
def robot_tables(urdf: str, robot: Robot) -> RobotTables:
    return make_tables(robot)


def retarget(
    robot: Robot,
    motion: HumanMotion,
    contacts: BoolArray,
    options: RetargetOptions | None = None,
    warm: Path | None = None,
) -> Retargeted:
    options = options or RetargetOptions()
    tables = make_tables(robot)
    targets = make_targets(tables.body, motion, contacts, options.support_margin)
    return _solve(robot, tables, targets, motion, options, warm)


def _solve(robot, tables, targets, motion, options, warm):
    problem = make_problem(tables, robot.standing[7:], targets, options)
    solution = solve(
        problem,
        problem.start if warm is None else warm.control,
        iterations=options.iterations,
        tolerance=options.tolerance,
        warm=warm is not None,
    )
    path = Path(solution.control, problem.reference, problem.spacing)
    q, v, a = sample(path, targets.time)
    targets = targets._replace(contact=_held(targets.contact, solution.standing))
    figures = residuals(tables, targets, q, v)
    ref = RobotReference(
        targets.time, q, v, a, targets.contact, motion.text, motion.source, figures
    )
    return Retargeted(ref, path, targets, problem, solution)


def _held(contact: BoolArray, standing: BoolArray) -> BoolArray:
    """(T, 2, 4) contacts between samples (S, 8) at both of which the solver still held them."""
    picked = picked_samples(contact)
    after = np.searchsorted(picked, np.arange(len(contact)))
    before = np.searchsorted(picked, np.arange(len(contact)), side="right") - 1
    return contact & (standing[before] & standing[after]).reshape(contact.shape)
