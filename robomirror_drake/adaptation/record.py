"""What was made of a command and why, for a result folder: plain figures, and messages.

=============================  =======================================================
``adaptation.json``            what was done and why, the ranking, how the original ended
``commanded.parquet``          the kinematic reference that was taken
``own.parquet``                that of the command's own motion, the first candidate
``foresight.parquet``          P(fall) over time, as foreseen
``original_reference.parquet`` what the robot was told without adaptation
``original_execution.parquet`` what it did then
``original_foresight.parquet`` P(fall) over time, then
=============================  =======================================================

The last three are there where both motions were executed.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from robomirror_drake.exceptions import ResultError
from robomirror_drake.messages import Execution, Foresight, Outcome, RobotReference
from robomirror_drake.optimization.adaptation.explain import Explanation
from robomirror_drake.tables import read_message, write_message

FILE = "adaptation.json"


@dataclass(frozen=True)
class RankedCandidate:
    """A candidate that was looked at.

    Attributes:
        number: Among the human motions that were generated.
        place: Among the candidates, 1 for the best.
        scores: In :data:`.messages.DIMENSIONS`, each from 0 to 1.
        quality: Weighted mean of the scores.
        fall_probability: As foreseen.
        safe: Whether that is safe enough.
        reason: Why it stands where it does.
    """

    number: int
    place: int
    scores: tuple[float, ...]
    quality: float
    fall_probability: float
    safe: bool
    reason: str


@dataclass(frozen=True)
class Task:
    """One thing that the command means: in its own motion, in what was taken, in what was done.

    Attributes:
        sentence: What has to be.
        unit: Of the figures.
        own: In the command's own motion.
        taken: In the motion that was taken.
        met: Whether that does.
        executed: In the execution; None where the robot fell.
        done: Whether that does; None where the robot fell.
    """

    sentence: str
    unit: str
    own: float
    taken: float
    met: bool
    executed: float | None = None
    done: bool | None = None


@dataclass(frozen=True)
class HandoverRecord:
    """What was decided while the motion ran; see :class:`.messages.Handover`."""

    time: float
    start: float
    done: bool
    stopped: bool
    risk_before: float
    risk_after: float
    reason: str


@dataclass(frozen=True)
class AdaptationRecord:
    """What was done with a command, and why; see :class:`.adaptation.Adaptation`.

    Attributes:
        method: What might be done.
        weights: By which it was foreseen before the robot moved: a name or a path.
        how: ``kept``, ``selected``, ``optimised`` or ``unsafe``.
        number: Of the human motion that what was taken comes from.
        changed: Whether the robot was told something else than the command's own motion.
        risk_before, risk: P(fall) of the command's own motion and of what was taken.
        allowed: P(fall) up to which a motion is safe.
        reason: A sentence.
        candidates: All that were looked at, in their order.
        tasks: What the command means; empty where that is not known.
        explanation: Of an optimised motion: what was moved how far, and what held it there.
        handovers: What was decided while it ran, in a closed loop.
        warnings: What speaks against the predictions.
        not_compared: Why the command's own motion was not executed as well; empty where it was.
        underway: The weights by which it was foreseen on the way.
    """

    method: str
    weights: str
    how: str
    number: int
    changed: bool
    risk_before: float
    risk: float
    allowed: float
    reason: str
    candidates: tuple[RankedCandidate, ...]
    tasks: tuple[Task, ...]
    explanation: Explanation | None
    handovers: tuple[HandoverRecord, ...] = ()
    warnings: tuple[str, ...] = ()
    not_compared: str = ""
    underway: str = ""

    @property
    def stopped(self) -> bool:
        """Whether the robot came to a halt instead of going on."""
        return any(handover.done and handover.stopped for handover in self.handovers)

    @property
    def done(self) -> bool | None:
        """Whether the execution did what the command means; None where that is not known."""
        known = [task.done for task in self.tasks if task.done is not None]
        return all(known) if known else None


@dataclass(frozen=True)
class Original:
    """The command's own motion in the same physics, with the same seed.

    Attributes:
        reference: Its dynamic plan.
        execution: What the robot did with it.
        outcome: How that went.
        foresight: P(fall) over time.
    """

    reference: RobotReference
    execution: Execution
    outcome: Outcome
    foresight: Foresight


@dataclass(frozen=True)
class AdaptedRun:
    """The part of a result that adaptation has.

    Attributes:
        record: What was done and why.
        own: Kinematic reference of the command's own motion.
        commanded: That of what was taken; before hand-overs, if there were some.
        foresight: P(fall) over time of what was executed.
        original: What would have happened; None where that was not tried.
    """

    record: AdaptationRecord
    own: RobotReference
    commanded: RobotReference
    foresight: Foresight
    original: Original | None = None


def write_adaptation(folder: Path, run: AdaptedRun) -> None:
    """Writes the files of this module."""
    original = run.original
    data = {
        "record": asdict(run.record),
        "original_outcome": None if original is None else asdict(original.outcome),
    }
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / FILE).write_text(text, encoding="utf-8")
    write_message(folder / "own.parquet", run.own)
    write_message(folder / "commanded.parquet", run.commanded)
    write_message(folder / "foresight.parquet", run.foresight)
    if original is not None:
        write_message(folder / "original_reference.parquet", original.reference)
        write_message(folder / "original_execution.parquet", original.execution)
        write_message(folder / "original_foresight.parquet", original.foresight)


def read_adaptation(folder: Path) -> AdaptedRun | None:
    """Reads what :func:`write_adaptation` wrote; None where nothing was.

    Raises:
        ResultError: A file is missing or damaged; the message names it.
    """
    path = folder / FILE
    if not path.exists():
        return None
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
        record = TypeAdapter(AdaptationRecord).validate_python(data["record"])
        outcome = TypeAdapter(Outcome | None).validate_python(data["original_outcome"])
    except (OSError, ValueError, TypeError, KeyError, ValidationError) as error:
        raise ResultError(f"{path}: {error}") from error
    original = None
    if outcome is not None:
        original = Original(
            read_message(folder / "original_reference.parquet", RobotReference),
            read_message(folder / "original_execution.parquet", Execution),
            outcome,
            read_message(folder / "original_foresight.parquet", Foresight),
        )
    return AdaptedRun(
        record,
        read_message(folder / "own.parquet", RobotReference),
        read_message(folder / "commanded.parquet", RobotReference),
        read_message(folder / "foresight.parquet", Foresight),
        original,
    )
