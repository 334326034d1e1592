"""What becomes of a motion that runs: its remainder, other ones to go on with, and the joint.

A motion that runs is two references on one time base: what is commanded (kinematic), and its
dynamic plan, which the robot follows. At a hand-over both get a new remainder; time, and all
that has happened, stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization import rotations
from robomirror_drake.optimization.adaptation.adapt import robot_legs
from robomirror_drake.optimization.adaptation.options import AdaptOptions
from robomirror_drake.optimization.adaptation.problem import make_problem
from robomirror_drake.optimization.adaptation.reference import adapted_reference
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.optimization.floating_base import continuous, product
from robomirror_drake.optimization.planning.options import PlanOptions
from robomirror_drake.optimization.planning.tempo import chart_rate, slowed
from robomirror_drake.optimization.planning.window import State, plan_window
from robomirror_drake.optimization.retargeting.retarget import robot_tables
from robomirror_drake.robot import Robot

_GLOBAL = AdaptOptions(variables=("tempo", "amplitude", "stride"))
_FADING = 0.1  # time in which a deviation's speed fades away [s]
_SAME = 1e-6  # as which tempos count that differ by less
_STANDING = 0.1  # for which both feet have stood when a motion stops, or else half of it [s]


class Change(NamedTuple):
    """Shares of the motion's own tempo, amplitude and way; 1 changes nothing."""

    tempo: float = 1.0
    amplitude: float = 1.0
    stride: float = 1.0

    def after(self, earlier: Change) -> Change:
        """Both together, this one of what another one has left."""
        return Change(*(own * other for own, other in zip(self, earlier, strict=True)))

    @property
    def size(self) -> float:
        """How much is changed, 0 to 1."""
        return 1.0 - sum(self) / len(self)


class Course(NamedTuple):
    """A motion that runs.

    Attributes:
        commanded: What is to be done, with the plan's contacts.
        plan: How; of equally many samples.
        asked: What was commanded at first; it says what is meant.
        change: By how much its end was changed from what was commanded at first.
    """

    commanded: RobotReference
    plan: RobotReference
    asked: RobotReference
    change: Change = Change()

    @property
    def step(self) -> float:
        """From one sample to the next [s]."""
        return _step(self.plan)


def begun(commanded: RobotReference, plan: RobotReference) -> Course:
    """The course of a plan.

    Args:
        commanded: The kinematic reference that the plan was made from.
        plan: Its ``lead`` says when ``commanded`` begins in it, its residual ``time_scale`` at
            which tempo; in added time the robot is meant to be as at the nearer end.
    """
    tempo = plan.residuals.get("time_scale", 1.0) if plan.planned else 1.0
    raw = commanded if abs(tempo - 1.0) < _SAME else slowed(commanded, tempo)
    return Course(_led(raw, plan), plan, commanded)


def _led(raw: RobotReference, plan: RobotReference) -> RobotReference:
    """A kinematic reference on the time of its plan, with its contacts, at rest in added time."""
    own = np.arange(len(plan.time)) - round(plan.lead / _step(plan))
    row = np.clip(own, 0, len(raw.time) - 1)
    moving = (row == own)[:, None]
    return replace(
        plan,
        q=raw.q[row],
        v=np.where(moving, raw.v[row], 0.0),
        a=np.where(moving, raw.a[row], 0.0),
        residuals=raw.residuals,
        foot_force=None,
        planned=False,
    )


def _step(reference: RobotReference) -> float:
    """From one sample to the next [s]."""
    return reference.duration / (len(reference.time) - 1)


def remainder(reference: RobotReference, frame: int) -> RobotReference:
    """A reference from one of its samples on, with time from 0; it has two samples at least."""
    rows = slice(min(frame, len(reference.time) - 2), None)
    return replace(
        reference,
        time=reference.time[: len(reference.time[rows])] - reference.time[0],
        **{
            name: getattr(reference, name)[rows]
            for name in ("q", "v", "a", "contact", "foot_force")
        },
        lead=0.0,
    )


def changed(robot: Robot, rest: RobotReference, changes: Sequence[Change]) -> list[RobotReference]:
    """A motion with other tempo, amplitude and stride, which change smoothly from its start on.

    A tempo is eased into, kept to in stance and left in flight; standing feet stand. What comes
    back may be less changed where there is nothing to change.

    Args:
        robot: The robot.
        rest: Kinematic; it may begin in mid-motion.
        changes: What is asked for.

    Raises:
        InputError: There are less than five samples.
    """
    problem = make_problem(robot, robot_legs(robot), rest, (), _GLOBAL)
    layout, tables = problem.layout, robot_tables(robot)
    made = []
    for change in changes:
        z = np.zeros(layout.size)
        asked = {
            "tempo": 1.0 / change.tempo - 1.0,
            "amplitude": change.amplitude - 1.0,
            "stride": change.stride - 1.0,
        }
        for name, block in layout.blocks.items():
            z[block] = asked[name] / layout.scale[block]
        made.append(adapted_reference(tables, problem, z))
    return made


def stopped(
    rest: RobotReference, soonest: float, braking: float, settling: float, count: int = 1
) -> list[RobotReference]:
    """The same motion brought to a halt where both feet stand: at the next chance, at that after …

    Its own time τ runs as before, then slows down smoothly,

        τ(t) = τ_b + T (s − s⁴ (5/2 − 3 s + s²)),     s = (t − τ_b) / T,

    and stands still from s = 1 on. Nothing slows down in flight. Where both feet do not stand
    together any more it goes on to its end.

    Args:
        rest: Kinematic; it may begin in mid-motion.
        soonest: Least of its own time that is still gone through [s].
        braking: How long slowing down takes at most [s].
        settling: Time to come to rest that is added at the end [s].
        count: How many halts to look for.
    """
    step, frames = _step(rest), len(rest.time)
    stands: BoolArray = np.asarray(rest.contact.any(axis=2))
    least, margin = round(soonest / step), round(_STANDING / step)
    flight = np.flatnonzero(~stands.any(axis=1))
    halts = []
    for start, end in runs(np.asarray(stands.all(axis=1))):
        ready = start + min(margin, (end - start) // 2) if start else 0
        first, last = max(ready, least), end - 1
        if first <= last:
            halts.append(first if end == frames else max(first, (start + end) // 2))
    made = []
    for halt in halts[:count] or [frames - 1]:
        landed = flight[flight < halt].max(initial=0)
        brake = min(braking, 2.0 * (halt - landed) * step)
        made.append(_halted(rest, halt * step, brake, settling))
    return made


def _halted(rest: RobotReference, halt: float, brake: float, settling: float) -> RobotReference:
    """A motion that slows down over a time ``brake`` to rest at ``halt`` in its own time [s]."""
    step = _step(rest)
    begin = halt - 0.5 * brake
    count = int(np.ceil((begin + brake + settling) / step))
    time = np.arange(count + 1, dtype=np.float64) * step
    s = np.clip((time - begin) / brake, 0.0, 1.0)
    tau = np.minimum(time, begin) + brake * (s - s**4 * (2.5 - 3.0 * s + s**2))
    rate = 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    slowing = np.where((s > 0.0) & (s < 1.0), -30.0 * s**2 * (1.0 - s) ** 2 / brake, 0.0)
    q, v = _between(rest.time, rest.q, rest.v, tau)
    a = np.stack([np.interp(tau, rest.time, column) for column in rest.a.T], axis=1)
    nearest = np.minimum(np.round(tau / step).astype(int), len(rest.time) - 1)
    return replace(
        rest,
        time=time,
        q=q,
        v=rate[:, None] * v,
        a=rate[:, None] ** 2 * a + slowing[:, None] * v,
        contact=rest.contact[nearest],
        foot_force=None,
        planned=False,
    )


def foreseen(
    time: Array, q: Array, v: Array, plan: RobotReference, at: Array
) -> tuple[Array, Array]:
    """Where a robot will be that stays beside its plan, as far as it is now.

    It comes to that at the speed at which it leaves its plan now, which fades away.

    Args:
        time: (S,) times of states that are known, the last one now [s].
        q, v: (S, 30), (S, 29) those states.
        plan: What it follows.
        at: (N,) times [s].

    Returns:
        (N, 30), (N, 29) its states, the known ones as they are.
    """
    now = time[-1]
    ahead = plan.time[plan.time > now + 1e-9]
    ahead = ahead[: np.searchsorted(ahead, at[-1]) + 1]
    rows = plan.rows_at(ahead)
    q_now, v_now = _between(plan.time, plan.q, plan.v, np.array([min(now, plan.duration)]))
    fading = np.exp(-(ahead - now) / _FADING)[:, None]
    away = v[-1] - v_now[0]
    gone = _FADING * (1.0 - fading) * away
    turn = product(q[-1:, :4], q_now[:, :4] * [1.0, -1.0, -1.0, -1.0]).repeat(len(rows), axis=0)
    turn = product(rotations.exp_quaternion(gone[:, :3]), turn)
    led = plan.q[rows] + np.concatenate([np.zeros(4), q[-1, 4:] - q_now[0, 4:]])
    led[:, 4:] += gone[:, 3:]
    led[:, :4] = product(turn, plan.q[rows, :4])
    every = np.concatenate([time, ahead])
    return _between(
        every,
        np.concatenate([q, led]),
        np.concatenate([v, plan.v[rows] + fading * away]),
        np.minimum(at, every[-1]),
    )


def _between(time: Array, q: Array, v: Array, at: Array) -> tuple[Array, Array]:
    """(N, 30), (N, 29) positions and velocities at times (N,) from those at times (S,)."""
    q = continuous(q)
    where = CubicHermiteSpline(time, q, chart_rate(q, v))(at)
    where[:, :4] /= np.linalg.norm(where[:, :4], axis=1, keepdims=True)
    return where, np.stack([np.interp(at, time, column) for column in v.T], axis=1)


def handed_over(
    robot: Robot,
    course: Course,
    frame: int,
    rest: RobotReference,
    options: PlanOptions | None = None,
    change: Change | None = None,
) -> Course:
    """A course with a new remainder from a sample on, planned from the state that it has there.

    Position, velocity and acceleration of the plan go on without a jump.

    Args:
        robot: The robot.
        course: What runs.
        frame: Sample at which the new remainder begins.
        rest: Kinematic; it ends at rest.
        options: Of the planning.
        change: By how much it is changed from the remainder that was there.

    Raises:
        PlanningError: See :func:`~robomirror_drake.optimization.planning.window.plan_window`.
    """
    old = course.plan
    state = State(old.q[frame], old.v[frame], old.a[frame])
    plan = plan_window(robot, rest, state, options, last=True).reference
    return Course(
        _spliced(course.commanded, _led(rest, plan), frame),
        _spliced(old, plan, frame),
        course.asked,
        (change or Change()).after(course.change),
    )


def _spliced(old: RobotReference, new: RobotReference, frame: int) -> RobotReference:
    """One reference before a sample, another one from it on; the residuals are the other one's."""
    time = np.concatenate([old.time, _step(old) * np.arange(len(old.time), frame + len(new.time))])

    def joined(name: str) -> Array:
        return np.concatenate([getattr(old, name)[:frame], getattr(new, name)])

    return replace(
        old,
        time=time[: frame + len(new.time)],
        q=joined("q"),
        v=joined("v"),
        a=joined("a"),
        contact=joined("contact").astype(np.bool_),
        foot_force=joined("foot_force"),
        residuals=dict(new.residuals),
    )
