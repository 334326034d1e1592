"""What a control tick says about itself: failures, slack, margins, active set, contacts."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Final, NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.dynamics_terms import ControlModel
from robomirror_drake.optimization.stance import Stance
from robomirror_drake.optimization.whole_body_qp import QP, Solution, foot_wrench_from, torque_from
from robomirror_drake.robot import FEET

ACTIVE: Final = 1e-3
"""How near to its limit, as a share of it, a quantity counts as limited by it."""

LEAST_FORCE: Final = 1.0
"""Normal force from which on a foot has a friction margin [N]."""


class Diagnostics(NamedTuple):
    """One tick's diagnostics; zero where there is no solution, ``qp_failures`` apart.

    Many ticks have time as the first axis.

    Attributes:
        qp_failures: () control ticks in a row without a solution.
        residual: () largest violation of the QP's constraints, in its own units.
        slack: () by how much joint accelerations had to leave their bounds, because the QP
            has no solution within them [rad/s²].
        friction_margin: (2,) µ − |f_t| / f_n that is planned for each foot; µ without load.
        torque_limit: (n,) +1 where a joint's torque is at its upper limit, −1 at its lower.
        joint_limit: (n,) the same of its acceleration, bounded by the joint limits ahead.
        friction: (2,) whether the foot's force is on the edge of the friction pyramid.
        unilateral: (2,) share of the corners that may bear load and bear none: the ground
            would have to pull.
        planned_contact: (2,) share of the corners that the schedule wants on the ground.
        measured_contact: (2,) whether the foot is felt to be on the ground.
    """

    qp_failures: Array
    residual: Array
    slack: Array
    friction_margin: Array
    torque_limit: Array
    joint_limit: Array
    friction: Array
    unilateral: Array
    planned_contact: Array
    measured_contact: Array

    def pack(self) -> Array:
        """(13 + 2 n,) everything in one vector, in the order of :func:`names`."""
        return np.concatenate([np.ravel(value) for value in self])


def unpack(vector: Array) -> Diagnostics:
    """The inverse of :meth:`Diagnostics.pack`; leading axes are kept."""
    joints = (vector.shape[-1] - 13) // 2
    sizes = (2, joints, joints, 2, 2, 2, 2)
    ends = list(accumulate(sizes, initial=3))
    arrays = (vector[..., a:b] for a, b in pairwise(ends))
    return Diagnostics(vector[..., 0], vector[..., 1], vector[..., 2], *arrays)


def names(joint_names: tuple[str, ...]) -> tuple[str, ...]:
    """Name of each element of :meth:`Diagnostics.pack`, as ``torque_limit.L_KNEE``."""
    per_foot, per_joint = FEET, joint_names
    of = {
        "friction_margin": per_foot,
        "torque_limit": per_joint,
        "joint_limit": per_joint,
        "friction": per_foot,
        "unilateral": per_foot,
        "planned_contact": per_foot,
        "measured_contact": per_foot,
    }
    return tuple(
        f"{field}.{part}" if part else field
        for field in Diagnostics._fields
        for part in of.get(field, ("",))
    )


def nothing(joints: int, failures: float) -> Diagnostics:
    """Diagnostics of a tick that has no solution."""
    zero, feet, each = np.array(0.0), np.zeros(2), np.zeros(joints)
    return Diagnostics(np.array(failures), zero, zero, feet, each, each, feet, feet, feet, feet)


def diagnose(
    qp: QP,
    solution: Solution,
    scheduled: BoolArray,
    stance: Stance,
    robot: ControlModel,
    friction: float,
) -> Diagnostics:
    """Diagnostics of a solution.

    Args:
        qp: The problem as it was first posed, with joint limits.
        solution: Of that, or of what had to be solved in its place.
        scheduled: (2, 4) which corners the schedule wants on the ground.
        stance: Where the feet stand.
        robot: The model.
        friction: µ that the planned forces keep to.
    """
    x, solved, joints = solution.x, solution.problem, robot.effort.size
    torque, force = torque_from(solution), foot_wrench_from(solution)[:, :3]
    bound = np.maximum(np.abs(force[:, 2]), LEAST_FORCE)
    slip = np.hypot(force[:, 0], force[:, 1]) / bound
    edge = np.abs(force[:, :2]).sum(axis=1) / bound
    loaded = force[:, 2] > LEAST_FORCE
    lower, upper, bounded = qp.lb[:joints], qp.ub[:joints], x[:joints]
    tolerance = ACTIVE * (upper - lower)
    normal = np.zeros((2, 4))
    normal[stance.load > 0.0] = x[joints:].reshape(-1, 4).sum(axis=1)
    idle = (stance.load > 0.0) & (normal <= ACTIVE)
    return Diagnostics(
        qp_failures=np.array(0.0),
        residual=np.max(
            np.concatenate([np.abs(torque) - robot.effort, solved.lb - x, x - solved.ub]),
            initial=0.0,
        ),
        slack=np.max(np.concatenate([lower - bounded, bounded - upper]), initial=0.0),
        friction_margin=friction - np.where(loaded, slip, 0.0),
        torque_limit=np.sign(torque) * (np.abs(torque) >= (1.0 - ACTIVE) * robot.effort),
        joint_limit=1.0 * (bounded >= upper - tolerance) - 1.0 * (bounded <= lower + tolerance),
        friction=1.0 * (loaded & (edge >= (1.0 - ACTIVE) * friction)),
        unilateral=idle.mean(axis=1),
        planned_contact=scheduled.mean(axis=1),
        measured_contact=np.where(stance.touching > 0.0, 1.0, 0.0),
    )
