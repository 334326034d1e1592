"""Why a robot fell: the first thing that went wrong, and the figures that say so.

At the end of a fall everything is at its limit, so the end is not looked at. The capture
point, ξ = c + ċ √(z/g), tells when the fall began: it is the place where the robot would have
to step to come to rest, and from when on it leaves the reference's for good, no controller
brought the robot back. Of all signs in a short time before, the earliest is the cause; where
there is none, the controller let go of a motion that was within every limit.

Source of the capture point: J. Pratt et al., "Capture point: a step toward humanoid push
recovery", Humanoids 2006; in three dimensions, J. Englsberger et al., "Three-dimensional
bipedal walking control based on divergent component of motion", IEEE T-RO 31 (2), 2015.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Final, Literal, NamedTuple, cast

import numpy as np

from robomirror_drake.disturbance import DisturbanceOptions, Push
from robomirror_drake.disturbance_draw import random_push
from robomirror_drake.fall_signs import Sign, signs
from robomirror_drake.messages import Array, Execution, Outcome, RobotReference
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.centroidal_motion import CentroidalMotion, centroidal_motion
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.outcome import LOADED_FORCE, evaluate, find_fall, until_fall
from robomirror_drake.robot import FEET, Robot
from robomirror_drake.simulation import SimulationOptions, draw_run
from robomirror_drake.systems.pusher import full_force

Cause = Literal[
    "reference_infeasible", "torque_saturated", "friction_lost", "contact_mismatch", "controller"
]

DIVERGED: Final = 0.06
"""Distance of the capture point from the reference's at which a fall has begun [m]."""

LOOK_BACK: Final = 0.5
"""How long before that the cause is looked for [s]."""

LOOK_AHEAD: Final = 0.1
"""How long after it: a foot is seen to slide only once it is fast [s]."""

OFFSET_TIME: Final = 0.15
"""Time constant with which the reference is moved to where the robot's feet stand [s]."""

PUSHED: Final = 0.1
"""Change of the robot's speed from which on a push counts [m/s]."""


class FallCause(NamedTuple):
    """Why it fell.

    Attributes:
        cause: What came first.
        evidence: One sentence with figures.
    """

    cause: Cause
    evidence: str


def explain_fall(
    robot: Robot,
    execution: Execution,
    reference: RobotReference,
    friction: float,
    effort_limit: Array | None = None,
    pushes: Sequence[Push] = (),
) -> FallCause | None:
    """Why the robot fell, or None if it did not.

    Args:
        robot: The robot as the controller knows it.
        execution: What it did.
        reference: What it was told.
        friction: Coefficient µ between soles and ground.
        effort_limit: (23,) the joints' true torque limits [N·m]; the robot's own by default.
        pushes: What pushed it.
    """
    if find_fall(execution) is None:
        return None
    execution = until_fall(execution)
    limit = robot.effort_limits if effort_limit is None else effort_limit
    row = reference.rows_at(execution.time)
    moving = (execution.time <= reference.duration)[:, None]
    told = centroidal_motion(
        robot, execution.q_ref, execution.v_ref, np.where(moving, reference.a[row], 0.0)
    )
    done = centroidal_motion(robot, execution.q, execution.v)
    begin = divergence(execution, told, done)
    seen = signs(robot, execution, reference, told, done, friction, limit)
    pushed = _pushed(execution.time, pushes, robot.mass)
    first = earliest(execution.time, begin, [*pushed, *seen])
    if first is not None:
        return first
    stood = _stance(execution.foot_force[begin])
    when = f"at {execution.time[begin]:.2f} s"
    return FallCause(
        "controller", f"within every limit, the capture point left the reference {when}, {stood}"
    )


def divergence(execution: Execution, told: CentroidalMotion, done: CentroidalMotion) -> int:
    """The sample from which on the capture point stays away from the reference's, until the fall.

    The reference is moved to where the robot's loaded feet stand, as the controller does.
    """
    shift = _feet_offset(execution, told, done)
    omega = np.sqrt(GRAVITY / np.maximum(told.com[:, 2:], 0.3))
    away = done.com - told.com + (done.com_velocity - told.com_velocity) / omega
    away[:, :2] -= shift
    near = np.flatnonzero(np.linalg.norm(away, axis=1) < DIVERGED)
    return min(int(near[-1]) + 1 if len(near) else 0, len(away) - 1)


def _feet_offset(execution: Execution, told: CentroidalMotion, done: CentroidalMotion) -> Array:
    """(N, 2) way from the reference's loaded feet to the robot's, smoothed [m]."""
    apart = (done.corners - told.corners).mean(axis=2)[..., :2]
    load = np.maximum(execution.foot_force[..., 2], 0.0)
    follow = min(1.0, float(np.diff(execution.time[:2])[0]) / OFFSET_TIME)
    offset, shift = np.zeros(2), np.zeros((len(apart), 2))
    for k, (share, way) in enumerate(zip(load, apart, strict=True)):
        if share.sum() > LOADED_FORCE:
            offset = offset + follow * (share @ way / share.sum() - offset)
        shift[k] = offset
    return shift


def _stance(foot_force: Array) -> str:
    """What the robot stands on, from (2, 3) ground forces."""
    down = [name for name, force in zip(FEET, foot_force, strict=True) if force[2] > LOADED_FORCE]
    if len(down) == 2:
        return "on both feet"
    return f"on the {down[0]} foot" if down else "in the air"


def earliest(time: Array, begin: int, seen: Sequence[Sign]) -> FallCause | None:
    """The first sign that still held a short time before a fall began, if there is any.

    Args:
        time: (N,) [s].
        begin: Sample at which the fall began.
        seen: All signs; of two that begin together the first one counts.
    """
    period = float(np.diff(time[:2])[0])
    first, last = begin - round(LOOK_BACK / period), begin + round(LOOK_AHEAD / period)
    found: list[tuple[int, Sign, int]] = []
    for sign in seen:
        least = max(1, round(sign.least / period))
        found += [
            (start, sign, end)
            for start, end in runs(sign.holds)
            if start <= last and end > first and end - start >= least
        ]
    if not found:
        return None
    start, sign, end = min(found, key=lambda entry: entry[0])
    return FallCause(cast(Cause, sign.cause), sign.evidence(start, end))


def _pushed(time: Array, pushes: Sequence[Push], mass: float) -> Iterator[Sign]:
    """Pushes, which count as the controller's: it is there to take them."""
    for push in pushes:
        speed = float(np.linalg.norm(full_force(push, mass))) * push.duration / mass
        words = f"pushed by {speed:.2f} m/s at {push.time:.2f} s"
        during = (time >= push.time) & (time <= push.time + push.duration)
        if speed > PUSHED:
            yield Sign("controller", during, 0.0, lambda *_, words=words: words)


def judge(
    robot: Robot, execution: Execution, reference: RobotReference, options: SimulationOptions
) -> Outcome:
    """The outcome of an execution, with the cause of the fall if there was one.

    Args:
        robot: The robot as the controller knows it.
        execution: What it did; its seed is that of the disturbances.
        reference: What it was told.
        options: Of the physics, disturbances included.
    """
    drawn, friction = draw_run(robot, options, execution.seed)
    limits = drawn.strength * robot.effort_limits
    pushes = pushes_until(options.disturbance, execution.seed, float(execution.time[-1]))
    outcome = evaluate(execution, limits, friction)
    why = explain_fall(robot, execution, reference, friction, limits, pushes)
    if why is None:
        return outcome
    return dataclasses.replace(outcome, cause=why.cause, cause_evidence=why.evidence)


def pushes_until(options: DisturbanceOptions, seed: int, end: float) -> tuple[Push, ...]:
    """All pushes of a run that begin before its end [s], those at given times first."""
    at_random = options.random_pushes
    count = math.ceil(end / at_random.interval) if at_random.speed[1] > 0.0 else 0
    drawn = (random_push(at_random, seed, interval) for interval in range(count))
    return tuple(push for push in (*options.pushes, *drawn) if push.time < end)
