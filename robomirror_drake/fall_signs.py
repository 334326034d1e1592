"""What can be seen in an execution that may end in a fall, sample by sample.

Each :class:`Sign` is a condition over time. :mod:`robomirror_drake.fall_cause` picks the one
that came first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray, Execution, RobotReference
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.centroidal_motion import CentroidalMotion
from robomirror_drake.optimization.control.dynamics_terms import control_model
from robomirror_drake.optimization.planning.contacts import ConeOptions, outside, wrench_cones
from robomirror_drake.outcome import LOADED_FORCE, SATURATED
from robomirror_drake.robot import FEET, Robot

INFEASIBLE: Final = 0.1
"""Distance of a reference's contact wrench from what the ground can give that no controller
makes up for [body weights, and body weights times metres]."""

LIMIT_EXCESS: Final = 0.05
"""By how much a reference may ask for more than a joint's range [rad], or its speed [share]."""

LIFTED: Final = 0.02
"""Height of the lowest corner from which on a reference's foot does not stand [m]."""

SLIDING: Final = 0.08
"""Speed of a sole's slowest corner from which on a loaded foot slides [m/s]."""

FRICTION_USED: Final = 0.9
"""Share of µ in a foot's force from which on it can slide."""

LIGHT, HEAVY = 0.01, 0.15
"""Normal force below which a foot bears nothing, from which on it stands [body weights]."""


class Sign(NamedTuple):
    """A condition that can end in a fall.

    Attributes:
        cause: What it is called.
        holds: (N,) when it holds.
        least: How long it has to, to count [s].
        evidence: What to say of the samples ``start`` to ``end`` in which it does.
    """

    cause: str
    holds: BoolArray
    least: float
    evidence: Callable[[int, int], str]


def signs(
    robot: Robot,
    execution: Execution,
    reference: RobotReference,
    told: CentroidalMotion,
    done: CentroidalMotion,
    friction: float,
    effort_limit: Array,
) -> Iterator[Sign]:
    """Every sign of an execution; where two begin together, the first one named comes first."""
    row = reference.rows_at(execution.time)
    assert reference.foot_force is not None  # always set by the message itself
    weight = robot.mass * GRAVITY
    # After its end the reference stands still, and its last forces mean nothing any more.
    over = execution.time > reference.duration
    planned = np.where(over[:, None], weight, reference.foot_force[row, :, 5])
    planned = planned if reference.planned else np.full_like(planned, weight)
    scheduled = np.asarray(execution.contact_ref.any(axis=2))
    yield from _wrong_labels(execution, told, scheduled)
    yield from _infeasible(robot, execution, told)
    yield from _contact_mismatch(execution, scheduled, planned, weight)
    yield from _slips(execution, done, friction)
    yield from _saturated(robot, execution, effort_limit)
    yield Sign(
        "controller",
        execution.qp_status > 0,
        0.03,
        lambda start, end: (
            f"the controller's QP had no solution {_span(execution, start, end)} "
            f"{_from(execution, start)}"
        ),
    )


def _from(execution: Execution, start: int) -> str:
    return f"from {execution.time[start]:.2f} s on"


def _span(execution: Execution, start: int, end: int) -> str:
    return f"for {(end - start) * np.diff(execution.time[:2])[0]:.2f} s"


def _wrong_labels(
    execution: Execution, told: CentroidalMotion, scheduled: BoolArray
) -> Iterator[Sign]:
    height = told.corners[..., 2].min(axis=2)
    resting = (_resting(told).all(axis=2)) & ~scheduled
    for foot, name in enumerate(FEET):

        def evidence(start: int, end: int, foot: int = foot, name: str = name) -> str:
            most = 100.0 * height[start:end, foot].max()
            return (
                f"the schedule has the {name} foot on the ground {_from(execution, start)}, "
                f"where the reference holds it up to {most:.0f} cm above"
            )

        def standing(start: int, end: int, name: str = name) -> str:
            return (
                f"the schedule has the {name} foot in the air {_from(execution, start)}, "
                f"where the reference keeps it on the ground {_span(execution, start, end)}"
            )

        lifted = scheduled[:, foot] & (height[:, foot] > LIFTED)
        yield Sign("contact_mismatch", lifted, 0.08, evidence)
        yield Sign("contact_mismatch", resting[:, foot], 0.12, standing)


def _resting(told: CentroidalMotion) -> BoolArray:
    """(N, 2, 4) which corners the reference itself keeps on the ground, whatever its schedule."""
    low = told.corners[..., 2] < LIFTED / 2
    return np.asarray(low & (np.linalg.norm(told.corner_velocity, axis=-1) < SLIDING))


def _infeasible(robot: Robot, execution: Execution, told: CentroidalMotion) -> Iterator[Sign]:
    mu, weight = robot.spec.contact.friction, robot.mass * GRAVITY
    # What the schedule forgets may still bear: wrong labels are a fault of their own.
    loaded = execution.contact_ref | _resting(told)
    cones = wrench_cones(told.corners, loaded, ConeOptions(mu, 0.0, 5.0, weight))
    distance = outside(cones, told.wrench)
    flight, worst = np.asarray(~loaded.any(axis=(1, 2))), np.asarray(distance.argmax(axis=1))
    force = np.linalg.norm(told.wrench[:, 3:], axis=1) / weight

    def evidence(start: int, end: int) -> str:
        peak = start + int(distance[start:end].max(axis=1).argmax())
        when = f"at {execution.time[peak]:.2f} s"
        if flight[peak]:
            return f"impossible flight: {when} the reference needs {force[peak]:.1f} body weights"
        if worst[peak] >= 7:
            away = 100.0 * distance[peak, worst[peak]] / max(force[peak], 0.2)
            return f"centre of pressure outside: {when} by {away:.0f} cm in the reference"
        if worst[peak] == 0:
            return f"the ground would have to pull or catch {force[peak]:.1f} body weights {when}"
        if worst[peak] >= 5:
            return f"the reference turns harder {when} than friction µ {mu:.2f} allows"
        used = np.linalg.norm(told.wrench[peak, 3:5]) / max(abs(told.wrench[peak, 5]), 1.0)
        return f"the reference needs friction {used:.2f} {when} where µ is {mu:.2f}"

    yield Sign("reference_infeasible", distance.max(axis=1) > INFEASIBLE, 0.05, evidence)

    lower, upper = robot.position_limits
    q, speed = execution.q_ref[:, 7:], np.abs(execution.v_ref[:, 6:]) / robot.velocity_limits - 1.0
    excess = np.maximum(np.maximum(lower - q, q - upper), speed)

    def limit(start: int, end: int) -> str:
        sample, joint = np.unravel_index(excess[start:end].argmax(), (end - start, q.shape[1]))
        when = execution.time[start + sample]
        return f"joint limits: {robot.joint_names[joint]} beyond its own at {when:.2f} s"

    yield Sign("reference_infeasible", excess.max(axis=1) > LIMIT_EXCESS, 0.05, limit)


def _contact_mismatch(
    execution: Execution, scheduled: BoolArray, planned: Array, weight: float
) -> Iterator[Sign]:
    normal = execution.foot_force[..., 2]
    for foot, name in enumerate(FEET):

        def missing(start: int, end: int, name: str = name) -> str:
            return (
                f"the {name} foot was to stand, but bore nothing "
                f"{_span(execution, start, end)} {_from(execution, start)}"
            )

        def early(start: int, end: int, foot: int = foot, name: str = name) -> str:
            most = normal[start:end, foot].max()
            return (
                f"the {name} foot was to be in the air, but bore up to {most:.0f} N "
                f"{_span(execution, start, end)} {_from(execution, start)}"
            )

        bears, stands = normal[:, foot] > HEAVY * weight, normal[:, foot] > LIGHT * weight
        wanted = scheduled[:, foot] & (planned[:, foot] > HEAVY * weight)
        yield Sign("contact_mismatch", wanted & ~stands, 0.08, missing)
        yield Sign("contact_mismatch", ~scheduled[:, foot] & bears, 0.08, early)


def _slips(execution: Execution, done: CentroidalMotion, friction: float) -> Iterator[Sign]:
    speed = np.linalg.norm(done.corner_velocity[..., :2], axis=-1).min(axis=2)
    force = execution.foot_force
    loaded = force[..., 2] > LOADED_FORCE
    used = np.hypot(force[..., 0], force[..., 1]) / np.maximum(force[..., 2], LOADED_FORCE)
    slides = loaded & (speed > SLIDING) & (used > FRICTION_USED * friction)
    step = np.diff(execution.time[:2])[0]
    for foot, name in enumerate(FEET):

        def evidence(start: int, end: int, foot: int = foot, name: str = name) -> str:
            way = 100.0 * step * speed[start:end, foot].sum()
            most = used[start:end, foot].max()
            return (
                f"the {name} foot slid {way:.0f} cm {_from(execution, start)}, "
                f"|f_t|/f_n {most:.2f} at µ {friction:.2f}"
            )

        yield Sign("friction_lost", slides[:, foot], 0.05, evidence)


def _saturated(robot: Robot, execution: Execution, effort_limit: Array) -> Iterator[Sign]:
    at_limit = np.abs(execution.torque) >= SATURATED * effort_limit
    # Arms at their limit move late; what carries the body lets it fall.
    carries = np.array([limb != "arm" for limb in control_model(robot).limbs])
    for joint in np.flatnonzero(carries & at_limit.any(axis=0)):

        def evidence(start: int, end: int, joint: int = int(joint)) -> str:
            return (
                f"{robot.joint_names[joint]} at its {effort_limit[joint]:.0f} N·m "
                f"{_span(execution, start, end)} {_from(execution, start)}"
            )

        yield Sign("torque_saturated", np.asarray(at_limit[:, joint]), 0.06, evidence)
