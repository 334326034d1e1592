"""One tick of whole-body control: where robot and reference are, to a QP."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.control.collision import apart_rows
from robomirror_drake.optimization.control.dynamics_terms import (
    ControlModel,
    dynamics_terms,
    memory,
    task_motion,
)
from robomirror_drake.optimization.control.pinocchio_memory import Memory
from robomirror_drake.optimization.control.preview import NO_PREVIEW, Preview, steered
from robomirror_drake.optimization.control.qp import (
    QP,
    Solution,
    Solver,
    Targets,
    Tuning,
    build_qp,
    without_joint_limits,
)
from robomirror_drake.optimization.control.reference_trajectory import (
    ReferenceTrajectory,
    sample_reference,
)
from robomirror_drake.optimization.control.solvers import solve_qp
from robomirror_drake.optimization.control.stance import Stance, moved, shifted, update_stance
from robomirror_drake.optimization.control.step_adjustment import adjusted_steps

_UNFELT = np.full((2, 3), np.nan)  # force on each foot where it is not measured


class Scratch(NamedTuple):
    """Memory that Pinocchio works in, for the robot and for the reference."""

    robot: Memory
    reference: Memory


class Tick(NamedTuple):
    """One control tick.

    Attributes:
        qp: What to solve.
        stance: What to remember for the next tick.
        scheduled: (2, 4) which sole corners the reference wants on the ground.
    """

    qp: QP
    stance: Stance
    scheduled: BoolArray


def scratch(robot: ControlModel) -> Scratch:
    """Scratch memory for a robot."""
    return Scratch(memory(robot), memory(robot))


def predicted(
    robot: ControlModel, q: Array, v: Array, a: Array, delay: float
) -> tuple[Array, Array]:
    """Positions and velocities after a delay at constant acceleration.

    Args:
        robot: The model.
        q, v, a: (30,), (29,), (29,) now, Pinocchio's order.
        delay: Time from now [s].
    """
    if delay == 0.0:
        return q, v
    return pin.integrate(robot.model, q, delay * (v + 0.5 * delay * a)), v + delay * a


def control_problem(
    robot: ControlModel,
    room: Scratch,
    tuned: Tuning,
    q: Array,
    v: Array,
    trajectory: ReferenceTrajectory,
    time: float,
    last: Stance,
    period: float,
    foot_force: Array | None = None,
    preview: Preview | None = None,
) -> Tick:
    """The QP of one control tick, and the stance to remember for the next.

    Args:
        robot: The model.
        room: From :func:`scratch`, to work in.
        tuned: Weights and gains.
        q, v: (30,), (29,) the robot's state, Pinocchio's order.
        trajectory: What to follow.
        time: Where in the trajectory [s].
        last: The stance of the last tick.
        period: Time since then [s].
        foot_force: (2, 3) of the ground on each foot, in world [N], where it is measured.
        preview: Feedback of centre of mass and angular momentum, in place of their fixed gains.
    """
    terms = dynamics_terms(robot, room.robot, q, v)
    wanted = sample_reference(trajectory, time, tuned.options.contact_ramp)
    motion = task_motion(robot, room.reference, wanted.q, wanted.v, wanted.a)
    stance, target = _followed(
        last,
        terms.motion,
        motion,
        wanted,
        robot.corners,
        period,
        tuned.options.contact_ramp,
        _UNFELT if foot_force is None else foot_force,
        tuned.steps,
        NO_PREVIEW if preview is None else preview,
        time,
    )
    targets = Targets(
        motion=target,
        q=wanted.q[7:],
        v=wanted.v[6:],
        a=wanted.a[6:],
        load=stance.load,
        force=wanted.force,
        planned=trajectory.planned,
        anchor=stance.anchor,
    )
    apart = apart_rows(robot.collision, room.robot, terms.rates, tuned.options.collision)
    return Tick(build_qp(robot, terms, targets, tuned, apart), stance, wanted.load > 0.0)


@njit(cache=True)
def _followed(  # type: ignore[no-untyped-def]
    last, motion, reference, sample, corners, period, ramp, force, limits, preview, time
):
    """The stance of this tick and the TaskMotion to ask for, all arguments as in their parts."""
    new = update_stance(last, motion, reference, sample, corners, period, ramp, force)
    near = moved(reference, new.offset)
    steps = adjusted_steps(last.steps, new.load, motion, near, sample, limits, period)
    wanted = shifted(near, motion, new.late, steps)
    if len(preview.time) > 0:
        wanted = steered(preview, time, wanted, motion)
    return Stance(new.load, new.anchor, new.offset, new.touching, new.late, steps), wanted


def solve_with_retry(qp: QP, solver: Solver) -> Solution:
    """Solves the QP, or where it has no solution, the one without joint limits and links apart."""
    solution = solve_qp(qp, solver)
    return solution if solution.found else solve_qp(without_joint_limits(qp), solver)
