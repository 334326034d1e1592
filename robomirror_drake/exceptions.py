"""Every error this package raises on purpose, each carrying the evidence for it.

Errors of foreign libraries are wrapped where they enter, so that a caller who
catches :class:`RoboMirrorError` has caught all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path


class RoboMirrorError(Exception):
    """Base class of all errors raised by this package."""


class InputError(RoboMirrorError):
    """What the user gave cannot be used; the message says what, and what to do."""


class ConfigError(InputError):
    """A scenario or robot file has an unknown key or a bad value."""


class MotionFileError(InputError):
    """A motion file is malformed, empty, too short or of the wrong skeleton.

    Attributes:
        path: The file.
        fault: What is wrong with it, in words.
    """

    def __init__(self, path: Path | str, fault: str) -> None:
        super().__init__(f"{path}: {fault}")
        self.path = Path(path)
        self.fault = fault


class UnknownCommandError(InputError):
    """The text names no action that the motion generator knows.

    Attributes:
        text: The clause that was not understood.
        nearest: The nearest known actions, best first.
    """

    def __init__(self, text: str, nearest: Sequence[str]) -> None:
        super().__init__(f"no known action in {text!r}; the nearest are: {', '.join(nearest)}")
        self.text = text
        self.nearest = tuple(nearest)


class RobotModelError(RoboMirrorError):
    """The robot's description is missing, or Drake and Pinocchio disagree on it."""


class RetargetingError(RoboMirrorError):
    """No reference within the gate was found for a human motion.

    Attributes:
        motion: Name of the human motion.
        residuals: The figures that the gate looked at, by name, in their units.
        exceeded: The names of those over their limit.
    """

    def __init__(
        self, motion: str, residuals: Mapping[str, float], exceeded: Sequence[str]
    ) -> None:
        figures = ", ".join(f"{name} = {residuals[name]:.4g}" for name in exceeded)
        super().__init__(f"motion {motion!r} cannot be retargeted: {figures}")
        self.motion = motion
        self.residuals = dict(residuals)
        self.exceeded = tuple(exceeded)


class PlanningError(RoboMirrorError):
    """A reference cannot be used for a dynamic plan.

    Attributes:
        figures: What was measured, by name, in SI units.
    """

    def __init__(self, message: str, figures: Mapping[str, float]) -> None:
        measured = ", ".join(f"{name} = {value:.4g}" for name, value in figures.items())
        super().__init__(f"{message}: {measured}" if measured else message)
        self.figures = dict(figures)


class PortError(RoboMirrorError):
    """A system's input port carries a value of the wrong type.

    Attributes:
        port: Name of the port.
    """

    def __init__(self, port: str, given: str, wanted: str) -> None:
        super().__init__(f"port {port!r} carries {given}, expected {wanted}")
        self.port = port


class SimulationError(RoboMirrorError):
    """The physics diverged, mostly because a reference starts out absurd.

    Attributes:
        time: When [s].
    """

    def __init__(self, time: float, fault: str) -> None:
        super().__init__(f"the simulation diverged at {time:.3f} s: {fault}")
        self.time = time


class ResultError(InputError):
    """A result is missing, damaged or not one of ours, or its place cannot be written to."""


class BenchError(RoboMirrorError):
    """A peer to be measured beside is not there, or failed."""
