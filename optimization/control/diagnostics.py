"""What a control tick says about itself: failures, slack, margins, active set, contacts."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.control.dynamics_terms import ControlModel
from robomirror_drake.optimization.control.kernels import GENERATORS
from robomirror_drake.optimization.control.qp import QP, Solution, torque_from
from robomirror_drake.optimization.control.stance import Stance
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


def packed_diagnosis(
    qp: QP,
    solution: Solution,
    scheduled: BoolArray,
    stance: Stance,
    robot: ControlModel,
    friction: float,
) -> Array:
    """(13 + 2 n,) the diagnostics of a solution, as :meth:`Diagnostics.pack` has them.

    Args:
        qp: The problem as it was first posed, with joint limits.
        solution: Of that, or of what had to be solved in its place.
        scheduled: (2, 4) which corners the schedule wants on the ground.
        stance: Where the feet stand.
        robot: The model.
        friction: µ that the planned forces keep to.
    """
    vector: Array = _diagnosed(
        solution.x,
        torque_from(solution),
        robot.effort,
        (solution.problem.lb, solution.problem.ub),
        (qp.lb, qp.ub),
        qp.W,
        stance.load,
        scheduled,
        stance.touching,
        friction,
    )
    return vector


@njit(cache=True)
def _diagnosed(  # type: ignore[no-untyped-def]
    x, torque, effort, solved, posed, W, load, scheduled, touching, friction
):
    """The packed diagnostics; bounds are pairs (lower, upper), of x as solved and as posed."""
    joints = len(effort)
    out = np.zeros(13 + 2 * joints)
    for i in range(len(x)):
        out[1] = max(out[1], solved[0][i] - x[i], x[i] - solved[1][i])
    for j in range(joints):
        lower, upper, size = posed[0][j], posed[1][j], abs(torque[j])
        out[1] = max(out[1], size - effort[j])
        out[2] = max(out[2], lower - x[j], x[j] - upper)
        if size >= (1.0 - ACTIVE) * effort[j]:
            out[5 + j] = np.sign(torque[j])
        tolerance = ACTIVE * (upper - lower)
        out[5 + joints + j] += 1.0 * (x[j] >= upper - tolerance) - (x[j] <= lower + tolerance)
    tail, generator = out[5 + 2 * joints :].reshape((4, 2)), joints
    for foot in range(2):
        force = np.zeros(3)
        for axis in range(3):
            for g in range(W.shape[2]):
                force[axis] += W[foot, axis, g] * x[joints + g]
        bound, out[3 + foot] = max(abs(force[2]), LEAST_FORCE), friction
        if force[2] > LEAST_FORCE:
            out[3 + foot] -= np.hypot(force[0], force[1]) / bound
            edge = (abs(force[0]) + abs(force[1])) / bound
            tail[0, foot] = 1.0 * (edge >= (1.0 - ACTIVE) * friction)
        for corner in range(4):
            tail[2, foot] += 0.25 * scheduled[foot, corner]
            if load[foot, corner] > 0.0:
                normal = np.sum(x[generator : generator + GENERATORS])
                tail[1, foot] += 0.25 * (normal <= ACTIVE)
                generator += GENERATORS
        tail[3, foot] = 1.0 * (touching[foot] > 0.0)
    return out
