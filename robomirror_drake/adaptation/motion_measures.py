"""Figures that tell two motions of the robot apart: duration, steps, speed, reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robomirror_drake.goals.trace import RATE, Trace, make_trace
from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.contact_schedule import runs
from robomirror_drake.robot import Robot

_WORTH = 0.1  # of the larger figure: less is no change to speak of
_TOLD = 3  # changes in a sentence


@dataclass(frozen=True)
class Measure:
    """One figure of two motions.

    Attributes:
        name: In words.
        unit: Of the figures.
        before, after: Of the one motion and of the other.
        least: Figures below this, both of them, are nothing.
    """

    name: str
    unit: str
    before: float
    after: float
    least: float

    @property
    def share(self) -> float:
        """After by before; NaN where before is nothing."""
        return self.after / self.before if abs(self.before) >= self.least else float("nan")

    @property
    def different(self) -> bool:
        """Whether the change is worth telling."""
        large = max(abs(self.before), abs(self.after))
        return large >= self.least and abs(self.after - self.before) > _WORTH * large

    def __str__(self) -> str:
        return f"{self.name} {self.before:.3g} → {self.after:.3g} {self.unit}".rstrip()


def compare(robot: Robot, before: RobotReference, after: RobotReference) -> list[Measure]:
    """The figures of two kinematic references at 60 Hz, those left out that are nothing in both."""
    was, now = _figures(robot, before), _figures(robot, after)
    made = [
        Measure(name, unit, was[name], now[name], least)
        for name, unit, least in _KINDS
        if name in was and name in now
    ]
    return [m for m in made if max(abs(m.before), abs(m.after)) >= m.least]


def told(measures: list[Measure]) -> str:
    """The largest changes, in words; empty where there are none."""
    worth = sorted((m for m in measures if m.different), key=lambda m: -abs(_log(m)))
    return ", ".join(str(measure) for measure in worth[:_TOLD])


def courses(robot: Robot, reference: RobotReference) -> dict[str, Array]:
    """What a motion does over time, by name; (T,) each, in the units of the names."""
    trace = make_trace(robot, reference.q)
    return {
        "speed of the pelvis [m/s]": _speed(trace),
        "pelvis, from standing [m]": trace.height[:, 0],
        "higher foot [m]": trace.feet[:, :, 2].max(axis=1),
        "higher hand, from hanging [m]": trace.hands[:, :, 2].max(axis=1),
    }


_KINDS = (
    ("duration", "s", 0.1),
    ("time of a step", "s", 0.05),
    ("length of a step", "m", 0.03),
    ("number of steps", "", 0.5),
    ("way over the floor", "m", 0.05),
    ("top speed of the pelvis", "m/s", 0.05),
    ("height of a foot", "m", 0.02),
    ("height of a hand", "m", 0.05),
    ("depth of the pelvis", "m", 0.02),
    ("lean of the trunk", "rad", 0.05),
    ("turn", "rad", 0.1),
    ("top speed of a joint", "rad/s", 0.2),
)
"""Name, unit and least figure of what is measured."""


def _figures(robot: Robot, reference: RobotReference) -> dict[str, float]:
    trace, step = make_trace(robot, reference.q), np.diff(reference.q[:, 4:6], axis=0)
    return {
        "duration": reference.duration,
        "way over the floor": float(np.linalg.norm(step, axis=1).sum()),
        "top speed of the pelvis": float(_speed(trace).max()),
        "height of a foot": float(trace.feet[:, :, 2].max()),
        "height of a hand": float(trace.hands[:, :, 2].max()),
        "depth of the pelvis": -float(trace.height.min()),
        "lean of the trunk": float(np.linalg.norm(trace.trunk[:, :2], axis=1).max()),
        "turn": float(np.ptp(trace.heading)),
        "top speed of a joint": float(np.abs(reference.v[:, 6:]).max()),
        **_steps(trace, reference),
    }


def _steps(trace: Trace, reference: RobotReference) -> dict[str, float]:
    """Touch-downs of a foot, how far from the other one and how long after the last; medians."""
    stands = np.asarray(reference.contact.any(axis=2))
    downs = sorted(
        (start, foot) for foot in (0, 1) for start, _ in runs(stands[:, foot]) if start > 0
    )
    if not downs:
        return {"number of steps": 0.0}
    ahead = trace.feet[..., 0]  # of where each foot stands, seen from the pelvis [m]
    lengths = [abs(ahead[at, foot] - ahead[at, 1 - foot]) for at, foot in downs]
    figures = {"number of steps": float(len(downs)), "length of a step": float(np.median(lengths))}
    if len(downs) > 1:
        figures["time of a step"] = float(np.median(np.diff([at for at, _ in downs]))) / RATE
    return figures


def _speed(trace: Trace) -> Array:
    """(T,) of the pelvis over the floor [m/s]."""
    return np.asarray(np.linalg.norm(np.gradient(trace.place, axis=0), axis=1) * RATE)


def _log(measure: Measure) -> float:
    least = measure.least
    return float(np.log(max(abs(measure.after), least) / max(abs(measure.before), least)))
