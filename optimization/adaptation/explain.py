"""Why a motion was changed, and what of it: in figures and in a sentence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from robomirror_drake.messages import Array
from robomirror_drake.optimization import rotations
from robomirror_drake.optimization.adaptation.motion import sample
from robomirror_drake.optimization.adaptation.problem import STEP, Problem
from robomirror_drake.optimization.adaptation.sqp import Solution
from robomirror_drake.optimization.adaptation.step import Multipliers
from robomirror_drake.robot import FEET, Robot, rotation_matrix

_WORTH = {"m": 0.005, "rad": 0.02}  # of telling
_PRICE = 1e-4  # of the largest: less is not active
_TOLD = 3  # changes in a sentence


@dataclass(frozen=True)
class Change:
    """How far a part of the body was moved from where the command has it.

    Attributes:
        part: In words, or a joint's name.
        most: The largest change, with its sign where it has one, in ``unit``.
        unit: ``m`` or ``rad``.
        time_s: When, in the command's own time [s].
    """

    part: str
    most: float
    unit: str
    time_s: float


@dataclass(frozen=True)
class Active:
    """A constraint that holds the motion where it is.

    Attributes:
        name: In words.
        price: Its multiplier: cost saved if it were one unit looser.
        time_s: When it matters most [s]; None where it has no time.
    """

    name: str
    price: float
    time_s: float | None


@dataclass(frozen=True)
class Explanation:
    """Why a motion was changed and what of it.

    Attributes:
        risk_before: P(fall) of the command, as the judge has it.
        risk_after: Likewise of the adapted motion.
        risk_limit: What was aimed at.
        tempo: Speed by the command's, 1 for the same.
        amplitude: Excursions by the command's.
        stride: Way over the floor by the command's.
        deviation: Cost of the change.
        changes: Parts of the body, those moved farthest by the user's scales first.
        active: Constraints with a price, dearest first.
    """

    risk_before: float
    risk_after: float
    risk_limit: float
    tempo: float
    amplitude: float
    stride: float
    deviation: float
    changes: tuple[Change, ...]
    active: tuple[Active, ...]

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        done = [
            words
            for share, words in (
                (self.tempo, f"{_percent(self.tempo)} of the tempo"),
                (self.amplitude, f"{_percent(self.amplitude)} of the amplitude"),
                (self.stride, f"{_percent(self.stride)} of the way"),
            )
            if abs(share - 1.0) > 0.01
        ]
        done += [_told(change) for change in self.changes[:_TOLD]]
        risk = f"{_percent(self.risk_before)} to {_percent(self.risk_after)}"
        if not done:
            after = _percent(self.risk_after)
            return f"Nothing was changed; the predicted risk of a fall is {after}."
        held = [active.name for active in self.active if active.name != "risk of a fall"][:2]
        limits = f"; what holds it there: {', '.join(held)}" if held else ""
        return (
            f"Done with {', '.join(done)}: the predicted risk of a fall goes from {risk}{limits}."
        )


def explain(robot: Robot, solution: Solution) -> Explanation:
    """Why and what of a solution; its command and its point are judged."""
    problem, point = solution.problem, solution.point
    sigma, alpha, beta = problem.layout.changes(point.z)
    return Explanation(
        risk_before=float(expit(solution.first.logit)),
        risk_after=float(expit(point.logit)),
        risk_limit=float(expit(problem.ceiling)),
        tempo=1.0 / (1.0 + sigma),
        amplitude=1.0 + alpha,
        stride=1.0 + beta,
        deviation=point.cost,
        changes=_changes(robot, problem, point.z),
        active=()
        if solution.multipliers is None
        else _active(robot, problem, [row.columns for row in point.rows], solution.multipliers),
    )


def _changes(robot: Robot, problem: Problem, z: Array) -> tuple[Change, ...]:
    """What differs at the same points of the motion."""
    layout, legs = problem.layout, problem.legs
    tau = np.arange(0.0, problem.path.duration, STEP)
    still = z.copy()
    if "tempo" in layout.blocks:
        still[layout.blocks["tempo"]] = 0.0
    now, was = (
        sample(legs, problem.path, layout, v, tau, derivatives=False) for v in (still, 0.0 * z)
    )
    made = []

    def add(part: str, unit: str, value: Array) -> None:
        row = int(np.abs(value).argmax())
        if abs(value[row]) > _WORTH[unit]:
            made.append(Change(part, float(value[row]), unit, float(tau[row])))

    base = now.q[:, 4:7] - was.q[:, 4:7]
    add("height of the pelvis", "m", base[:, 2])
    add("place of the pelvis", "m", np.linalg.norm(base[:, :2], axis=1))
    turn = rotation_matrix(now.q[:, :4]) @ rotation_matrix(was.q[:, :4]).swapaxes(1, 2)
    add("lean of the pelvis", "rad", np.linalg.norm(rotations.log(turn), axis=1))
    feet = (now.origin - was.origin)[:, legs.chain[:, -1]]
    for foot, name in enumerate(FEET):
        add(f"height of the {name} foot", "m", feet[:, foot, 2])
        add(f"place of the {name} foot", "m", np.linalg.norm(feet[:, foot, :2], axis=1))
    bent = now.q[:, 7:] - was.q[:, 7:]
    for joint in legs.upper:
        add(robot.joint_names[joint], "rad", bent[:, joint])
    scale = {"m": 0.05, "rad": 0.2}
    return tuple(sorted(made, key=lambda change: -abs(change.most) / scale[change.unit]))


def _active(
    robot: Robot, problem: Problem, columns: list[int], prices: Multipliers
) -> tuple[Active, ...]:
    made = [Active("risk of a fall", prices.fall, None)]
    for goal, price in zip(problem.goals, prices.goals, strict=True):
        made.append(Active(goal.name, float(price), None))
    corner = [f"{name} sole" for name in FEET for _ in range(4)]
    words: dict[str, Callable[[int], str]] = {
        "position": lambda j: f"limit of {robot.joint_names[j]}",
        "stretch": lambda leg: f"stretched {FEET[leg]} knee",
        "speed": lambda j: f"speed of {robot.joint_names[j]}",
        "torque": lambda j: f"torque of {robot.joint_names[j]}",
        "ground": lambda k: f"floor under the {corner[k]}",
    }
    for name, rows, width in zip(words, prices.rows, columns, strict=True):
        size = np.abs(rows.reshape(-1, width))
        for j in np.flatnonzero(size.any(axis=0)):
            at = float(size[:, j].argmax() * STEP)
            made.append(Active(words[name](int(j)), float(size[:, j].sum()), at))
    for block, where in problem.layout.blocks.items():
        made.append(Active(f"bound of {block}", float(np.abs(prices.box[where]).sum()), None))
    least = _PRICE * max((active.price for active in made), default=0.0)
    kept = [active for active in made if active.price > max(least, 1e-9)]
    return tuple(sorted(kept, key=lambda active: -active.price))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _told(change: Change) -> str:
    amount = (
        f"{100.0 * change.most:+.1f} cm"
        if change.unit == "m"
        else f"{np.degrees(change.most):+.0f}°"
    )
    return f"{change.part} {amount} at {change.time_s:.1f} s"
