"""How an execution went: when the robot fell, and how well it tracked until then.

This is the one place where a fall is defined. The robot has fallen at the first
sample where one of these holds:

* ``contact``: a link other than the feet touches the ground, which no reference
  here asks for;
* ``height``: the pelvis is more than 0.30 m below where the reference has it;
* ``tilt``: the trunk leans more than 60° away from where the reference has it.
  The lean is the angle between the two upward axes of the pelvis, so that a robot
  which faces the wrong way has not fallen for that.

All errors are means over the samples up to and including the fall.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from robomirror_drake.messages import Array, BoolArray, Execution, Outcome, RobotReference

TOUCH_FORCE: Final = 1.0
"""Ground force on a link from which on it counts as touching [N]."""

HEIGHT_DROP: Final = 0.30
"""How far the pelvis may be below the reference [m]."""

LEAN: Final = np.deg2rad(60.0)
"""How far the trunk may lean away from the reference [rad]."""

LOADED_FORCE: Final = 30.0
"""Normal force from which on a foot counts as loaded [N]."""

SATURATED: Final = 0.999
"""Share of the torque limit from which on a joint counts as saturated."""


class Fall(NamedTuple):
    """The first sample at which the robot had fallen."""

    sample: int
    time: float
    cause: str


class TrackingErrors(NamedTuple):
    """Errors sample by sample; their means are the paper's A_q … A_θ.

    Attributes:
        q: (N,) mean over the joints of ``|q_j - q_ref_j|`` [rad].
        qd: (N,) the same of the joint velocities [rad/s].
        qdd: (N - 1,) the same of the accelerations, differences of the recorded
            velocities over one sampling period [rad/s²].
        p: (N,) distance of the root from the reference's [m].
        theta: (N,) angle of the rotation between the two roots [rad].
    """

    q: Array
    qd: Array
    qdd: Array
    p: Array
    theta: Array


def rotation_angle(a: Array, b: Array) -> Array:
    """Angle of the rotation between orientations, in [0, π] and exact near 0.

    Args:
        a, b: (..., 4) quaternions wxyz, of any length but 0.
    """
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    near = np.linalg.norm(a - b, axis=-1)
    far = np.linalg.norm(a + b, axis=-1)
    return np.asarray(4.0 * np.arctan2(np.minimum(near, far), np.maximum(near, far)))


def lean_angle(a: Array, b: Array) -> Array:
    """Angle between the upward axes of two orientations; turning about them adds nothing.

    Args:
        a, b: (..., 4) quaternions wxyz, of any length but 0.
    """
    up_a, up_b = _up(a), _up(b)
    near = np.linalg.norm(up_a - up_b, axis=-1)
    far = np.linalg.norm(up_a + up_b, axis=-1)
    return np.asarray(2.0 * np.arctan2(near, far))


def _up(quaternion: Array) -> Array:
    """(..., 3) the third column of the rotation matrix."""
    w, x, y, z = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def fallen(q: Array, q_ref: Array, other_force: Array) -> dict[str, BoolArray]:
    """Which conditions of a fall hold, by name, the first named first.

    Args:
        q, q_ref: (..., 30) what the robot does and what it was told, Drake order.
        other_force: (...) norm of the ground force on all links but the feet [N].
    """
    return {
        "contact": np.asarray(other_force > TOUCH_FORCE),
        "height": np.asarray(q_ref[..., 6] - q[..., 6] > HEIGHT_DROP),
        "tilt": np.asarray(lean_angle(q[..., :4], q_ref[..., :4]) > LEAN),
    }


def find_fall(execution: Execution) -> Fall | None:
    """The first sample where the definition of this module holds; None if it never does.

    Where several conditions are met first at the same sample, the cause is the one
    named first above.
    """
    conditions = fallen(execution.q, execution.q_ref, execution.other_force)
    down = np.logical_or.reduce(list(conditions.values()))
    if not down.any():
        return None
    sample = int(np.argmax(down))
    cause = next(name for name, met in conditions.items() if met[sample])
    return Fall(sample, float(execution.time[sample]), cause)


def until_fall(execution: Execution) -> Execution:
    """The execution up to and including the fall, 2 samples at least; all of it without one."""
    fall = find_fall(execution)
    if fall is None:
        return execution
    stop = max(fall.sample + 1, 2)
    values: dict[str, Any] = {
        f.name: getattr(execution, f.name) for f in dataclasses.fields(execution)
    }
    arrays = {name: v[:stop] for name, v in values.items() if isinstance(v, np.ndarray)}
    return Execution(**(values | arrays))


class Tracked(Protocol):
    """What tracking is judged by: (N,) times [s], and N states of a robot and a reference."""

    @property
    def time(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def v(self) -> Array: ...
    @property
    def q_ref(self) -> Array: ...
    @property
    def v_ref(self) -> Array: ...


def tracking_errors(execution: Tracked) -> TrackingErrors:
    """Errors between what the robot did and what it was told, sample by sample."""
    joint_q = execution.q[:, 7:] - execution.q_ref[:, 7:]
    joint_v = execution.v[:, 6:] - execution.v_ref[:, 6:]
    joint_a = np.diff(joint_v, axis=0) / np.diff(execution.time)[:, None]
    return TrackingErrors(
        q=np.abs(joint_q).mean(axis=1),
        qd=np.abs(joint_v).mean(axis=1),
        qdd=np.abs(joint_a).mean(axis=1),
        p=np.linalg.norm(execution.q[:, 4:7] - execution.q_ref[:, 4:7], axis=1),
        theta=rotation_angle(execution.q[:, :4], execution.q_ref[:, :4]),
    )


def errors_to_raw(
    execution: Execution, raw: RobotReference, lead: float
) -> tuple[float, float] | None:
    """Mean joint [rad] and root [m] error against the reference that a plan was made from.

    Only while the motion lasts, and up to a fall; None if it was over before the motion began.

    Args:
        execution: What the robot did with the plan.
        raw: The reference before planning, at the plan's tempo.
        lead: When its motion begins in the plan [s].
    """
    upright = until_fall(execution)
    time = upright.time - lead
    within = (time >= 0.0) & (time <= raw.duration)
    if not within.any():
        return None
    row = np.abs(raw.time - time[within, None]).argmin(axis=1)
    away = upright.q[within] - raw.q[row]
    joints, root = np.abs(away[:, 7:]).mean(), np.linalg.norm(away[:, 4:7], axis=1).mean()
    return float(joints), float(root)


def friction_margin(foot_force: Array, friction: float) -> float:
    """Least ``µ - |f_t| / f_n`` over samples of loaded feet; ``µ`` if none was loaded.

    Args:
        foot_force: (..., 3) ground forces, z normal to the ground [N].
        friction: Coefficient µ.
    """
    tangential = np.linalg.norm(foot_force[..., :2], axis=-1)
    normal = foot_force[..., 2]
    loaded = normal > LOADED_FORCE
    return friction - float(np.max(tangential[loaded] / normal[loaded], initial=0.0))


def joint_work(execution: Execution) -> Array:
    """(N - 1,) positive mechanical work of all joints in each sampling period [J].

    The trapezoidal rule on ``Σ_j max(τ_j q̇_j, 0)``.
    """
    power = np.maximum(execution.torque * execution.v[:, 6:], 0.0).sum(axis=1)
    return np.asarray(0.5 * (power[1:] + power[:-1]) * np.diff(execution.time))


def evaluate(execution: Execution, effort_limit: Array, friction: float) -> Outcome:
    """The outcome of an execution.

    Args:
        execution: At least two samples.
        effort_limit: (23,) torque limits in the order of the joints [N·m].
        friction: Coefficient µ between soles and ground.

    Raises:
        ValueError: The execution has fewer than two samples, so that it has no acceleration.
    """
    if len(execution.time) < 2:
        raise ValueError(f"an outcome needs 2 samples at least, got {len(execution.time)}")
    fall, upright = find_fall(execution), until_fall(execution)
    errors = tracking_errors(upright)
    saturated = np.abs(upright.torque) >= SATURATED * effort_limit
    return Outcome(
        fell=fall is not None,
        fall_time_s=None if fall is None else fall.time,
        fall_cause=None if fall is None else fall.cause,
        A_q=float(errors.q.mean()),
        A_qd=float(errors.qd.mean()),
        A_qdd=float(errors.qdd.mean()),
        A_p=float(errors.p.mean()),
        A_theta=float(errors.theta.mean()),
        torque_saturation=float(saturated.mean()),
        friction_margin=friction_margin(upright.foot_force, friction),
        energy_j=float(joint_work(upright).sum()),
        duration_s=float(execution.time[-1] - execution.time[0]),
    )
