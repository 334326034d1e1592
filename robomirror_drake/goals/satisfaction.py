"""Whether a motion of the robot does what a command means: a reference, a plan, or a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robomirror_drake.goals.predicates import Goals, Predicate
from robomirror_drake.goals.trace import Trace, make_trace
from robomirror_drake.goals.turns import find_turns
from robomirror_drake.messages import Array
from robomirror_drake.robot import Robot


@dataclass(frozen=True)
class Measured:
    """A predicate and what a motion makes of it.

    Attributes:
        predicate: The predicate.
        value: Its figure in the motion, in the predicate's unit.
        score: How near that is to the command's own motion, from 0 to 1.
        met: Whether it does.
    """

    predicate: Predicate
    value: float
    score: float
    met: bool

    def __str__(self) -> str:
        unit = f" {self.predicate.unit}" if self.predicate.unit else ""
        return f"{self.predicate.sentence}; it is {self.value:.2f}{unit}"


@dataclass(frozen=True)
class Satisfaction:
    """How well a motion does what a command means.

    Attributes:
        measured: Every predicate, in the order of the clauses.
        score: Mean over the clauses of the lowest score of their predicates, from 0 to 1.
        done: Whether all predicates are met.
    """

    measured: tuple[Measured, ...]
    score: float
    done: bool

    @property
    def missed(self) -> tuple[Measured, ...]:
        """The predicates that are not met."""
        return tuple(m for m in self.measured if not m.met)


class Judged(NamedTuple):
    """One clause in its turn.

    Attributes:
        measured: Its predicates.
        start, stop: First sample of the turn and the one after the last.
        mirrored: Whether it is judged with left and right exchanged.
    """

    measured: list[Measured]
    start: int
    stop: int
    mirrored: bool


def measure(robot: Robot, goals: Goals, q: Array) -> Satisfaction:
    """Evaluates the predicates of a command on a motion (T, 30) at 60 Hz, Drake order.

    A clause whose side the words leave open is judged as it is and with left and right
    exchanged, whichever is nearer to what is meant. Each clause is judged in its own turn, so
    that what is done in another order is not done. Of a run that ended with a fall, this says
    nothing but how far it got.

    Raises:
        ValueError: ``q`` is no motion of the robot.
    """
    judged = judge(goals, make_trace(robot, q))
    measured = tuple(m for clause in judged for m in clause.measured)
    score = float(np.mean([min(m.score for m in clause.measured) for clause in judged]))
    return Satisfaction(measured, score, all(m.met for m in measured))


def judge(goals: Goals, trace: Trace) -> list[Judged]:
    """The clauses of a command, each in its turn in a motion."""
    return [
        _judge_clause(
            [p for p in goals.predicates if p.clause == number], trace, int(start), int(stop)
        )
        for number, (start, stop) in enumerate(find_turns(goals.turns, trace))
    ]


def _judge_clause(asked: list[Predicate], trace: Trace, start: int, stop: int) -> Judged:
    as_is = _judge(asked, trace.window(start, stop))
    if all(p.mirrored for p in asked):
        exchanged = _judge(asked, trace.mirrored().window(start, stop))
        if _rank(exchanged) > _rank(as_is):
            return Judged(exchanged, start, stop, True)
    return Judged(as_is, start, stop, False)


def _judge(asked: list[Predicate], trace: Trace) -> list[Measured]:
    values = [p.probe.read(trace) for p in asked]
    return [Measured(p, v, p.score(v), p.met(v)) for p, v in zip(asked, values, strict=True)]


def _rank(judged: list[Measured]) -> tuple[bool, float, float]:
    scores = [m.score for m in judged]
    return all(m.met for m in judged), min(scores), float(np.mean(scores))
