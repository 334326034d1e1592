"""The adaptation of a reference as an optimisation problem, and its value at a point.

    min_z  ½ zᵀ H z                      distance to the commanded reference
    s.t.   logit P(fall | r(z)) ≤ logit(1 − T_safe) − margin
           goals_i(r(z)) ≥ 0             what the command means
           lower ≤ rows(z) ≤ upper       joints, motors, floor (:mod:`.rows`)
           z_min ≤ z ≤ z_max             bounded deviation

r(z) is sampled at 20 Hz, which is what the judge looks at. The judge is whatever gives the
logit of a motion's fall and its gradient: the trained predictor, or a formula.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, floor
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization.adaptation.legs import Legs
from robomirror_drake.optimization.adaptation.motion import Samples, quaternion_gradient, sample
from robomirror_drake.optimization.adaptation.options import AdaptOptions
from robomirror_drake.optimization.adaptation.path import MotionPath, make_path
from robomirror_drake.optimization.adaptation.rows import Family, Limits, families, make_limits
from robomirror_drake.optimization.adaptation.variables import Layout, make_layout
from robomirror_drake.robot import Robot

STEP = 0.05
"""Time from one judged sample to the next [s]."""

REACH = 1e-6
"""How far a foot may be from where it should be [m, rad]."""


class Judged(Protocol):
    """``logit`` (n,) of the fall, and ``gradient`` (n, N, 30) of it by every number of q."""

    @property
    def logit(self) -> Array: ...

    @property
    def gradient(self) -> Array: ...


class Judge(Protocol):
    """Tells how likely whole motions are to end in a fall."""

    def judge(self, q: Array, contact: npt.NDArray[Any], history: Any) -> Judged:
        """Of motions q (n, N, 30) at 20 Hz with their schedules (n, N, 2, 4), and what it takes
        for the robot's past; None where it stands as they begin."""
        ...


class Goal(NamedTuple):
    """Something that the command means, to be kept: ``function(q) ≥ 0``.

    Attributes:
        name: In words, for the explanation.
        function: From a motion q (N, 30) at 20 Hz to a number and its partial derivatives
            (N, 30); about 1 should matter and 0.01 should not.
    """

    name: str
    function: Callable[[Array], tuple[float, Array]]


class Problem(NamedTuple):
    """The adaptation of one reference.

    Attributes:
        reference: The command.
        legs, path, layout, limits: What it was made into.
        goals: What must be kept beside.
        ceiling: Highest logit that is aimed at.
        seen: How many samples the judge is shown; None for all.
    """

    reference: RobotReference
    legs: Legs
    path: MotionPath
    layout: Layout
    limits: Limits
    goals: tuple[Goal, ...]
    ceiling: float
    seen: int | None

    def count(self, z: Array) -> int:
        """Number of samples that show the motion of variables z to its end."""
        sigma = self.layout.changes(z)[0]
        whole = self.path.duration + sigma * float(self.path.stretched(self.path.duration))
        # A motion that is cut off moves at its end, and does not stand still thereafter.
        return (ceil if self.path.resting[1] else floor)(whole / STEP - 1e-6) + 1


class Point(NamedTuple):
    """A problem at variables z.

    Attributes:
        z: (X,) variables.
        samples: The motion.
        cost: ½ zᵀ H z, and
        gradient: (X,) H z.
        logit: Of the fall, and
        by_logit: (X,) its gradient; NaN before it is judged.
        goals: (G,) values of the goals, and
        by_goals: (G, X) their gradients.
        rows: What the motion must keep.
    """

    z: Array
    samples: Samples
    cost: float
    gradient: Array
    logit: float
    by_logit: Array
    goals: Array
    by_goals: Array
    rows: list[Family]

    @property
    def reached(self) -> bool:
        """Whether the legs reach where the feet should be."""
        return self.samples.miss < REACH

    def violations(self, ceiling: float) -> Array:
        """(1 + G + 5,) how far the fall's logit, each goal and each family of rows is off."""
        over = [self.logit - ceiling, *-self.goals, *(family.violation for family in self.rows)]
        return np.maximum(over, 0.0)


def fall_ceiling(options: AdaptOptions) -> float:
    """The fall's logit that is still safe."""
    return float(np.log(1.0 - options.safe) - np.log(options.safe))


def fall_aim(options: AdaptOptions) -> float:
    """The fall's logit that is aimed at: the margin below what is still safe."""
    return fall_ceiling(options) - options.margin


def make_problem(
    robot: Robot,
    legs: Legs,
    reference: RobotReference,
    goals: Sequence[Goal] = (),
    options: AdaptOptions | None = None,
) -> Problem:
    """The adaptation of a reference.

    Args:
        robot: The robot.
        legs: Its legs.
        reference: The command, kinematic, at a constant rate.
        goals: What must be kept beside.
        options: See :class:`AdaptOptions`.

    Raises:
        InputError: The reference is too short, or nothing in it can change.
    """
    options = options or AdaptOptions()
    path = make_path(legs, reference, options)
    layout = make_layout(path, options)
    if layout.size == 0:
        raise InputError(
            f"nothing of {reference.text or reference.source!r} can be changed by "
            f"{list(options.variables)}: set more variables free"
        )
    command = sample(legs, path, layout, np.zeros(layout.size), path.time, derivatives=False)
    return Problem(
        reference,
        legs,
        path,
        layout,
        make_limits(robot, legs, command, options),
        tuple(goals),
        fall_aim(options),
        _seen(path, options),
    )


def _seen(path: MotionPath, options: AdaptOptions) -> int | None:
    """How many samples to judge: of a motion that is cut off what there is at any tempo."""
    horizon = options.horizon
    if not path.resting[1]:
        hasty = 1.0 / options.bounds.fastest - 1.0 if "tempo" in options.variables else 0.0
        most = path.duration + hasty * float(path.stretched(path.duration))
        horizon = most if horizon is None else min(most, horizon)
    return None if horizon is None else floor(horizon / STEP + 1e-6) + 1


def evaluate(
    problem: Problem,
    z: Array,
    count: int | None = None,
    derivatives: bool = True,
    near: float = 1.0,
) -> Point:
    """A problem at variables z (X,), not yet judged.

    Args:
        problem: The problem.
        z: Its variables.
        count: Number of samples; by default those that show it to its end.
        derivatives: Whether to work out any; without, they are NaN or empty.
        near: Of which rows, see :func:`families`.
    """
    time = np.arange(count or problem.count(z), dtype=np.float64) * STEP
    samples = sample(problem.legs, problem.path, problem.layout, z, time, derivatives)
    gradient = problem.layout.hessian @ z
    values = [goal.function(samples.q) for goal in problem.goals]
    by_goals = [pulled(samples, by_q) for _, by_q in values]
    return Point(
        z,
        samples,
        0.5 * float(z @ gradient),
        gradient,
        float("nan"),
        np.full_like(z, np.nan),
        np.array([value for value, _ in values]),
        np.array(by_goals).reshape(-1, len(z)),
        families(problem.limits, samples, near),
    )


def judged(
    judge: Judge, problems: Sequence[Problem], points: Sequence[Point], history: Any = None
) -> list[Point]:
    """Points with what the judge says, see :func:`asked`."""
    motions = [
        (point.samples.q[: problem.seen], point.samples.contact[: problem.seen])
        for problem, point in zip(problems, points, strict=True)
    ]
    made = []
    for point, (logit, gradient) in zip(points, asked(judge, motions, history), strict=True):
        by_q = np.zeros_like(point.samples.q)
        by_q[: len(gradient)] = gradient
        made.append(point._replace(logit=logit, by_logit=pulled(point.samples, by_q)))
    return made


def asked(
    judge: Judge, motions: Sequence[tuple[Array, BoolArray]], history: Any
) -> list[tuple[float, Array]]:
    """What the judge says of motions of any lengths, asked once for all.

    Args:
        judge: Is shown the shorter ones standing at their end.
        motions: q (N, 30) at 20 Hz and schedule (N, 2, 4) of each.
        history: What the judge takes for the robot's past.

    Returns:
        Of each motion the logit, and the gradient (N, 30) of it.

    Raises:
        InputError: The judge's answer is not finite.
    """
    longest = np.arange(max(len(q) for q, _ in motions))
    shown = [np.minimum(longest, len(q) - 1) for q, _ in motions]
    answer = judge.judge(
        np.stack([q[rows] for (q, _), rows in zip(motions, shown, strict=True)]),
        np.stack([contact[rows] for (_, contact), rows in zip(motions, shown, strict=True)]),
        history,
    )
    logit, gradient = np.asarray(answer.logit), np.asarray(answer.gradient)
    if not (np.isfinite(logit).all() and np.isfinite(gradient).all()):
        raise InputError("the judge's logit or gradient is not finite: check its weights")
    made = []
    for (q, _), rows, value, slope in zip(motions, shown, logit, gradient, strict=True):
        by_q = np.zeros_like(q)
        np.add.at(by_q, rows, slope)
        made.append((float(value), by_q))
    return made


def pulled(samples: Samples, by_q: Array) -> Array:
    """(X,) gradient by the variables from partial derivatives (N, 30) by the samples' q."""
    if samples.jacobian.shape[1] == 0:
        return np.full(samples.jacobian.shape[2], np.nan)
    by_v = quaternion_gradient(samples.q, np.asarray(by_q, dtype=np.float64))
    seen = np.flatnonzero(by_v.any(axis=1))
    stop = int(seen[-1]) + 1 if len(seen) else 0  # mostly far from all of a long motion
    part = samples.jacobian[:stop].reshape(-1, samples.jacobian.shape[2])
    return np.asarray(by_v[:stop].ravel() @ part)
