"""Chooses the reference that the robot will execute."""

from __future__ import annotations

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, ValueProducer

from robomirror_drake.adaptation.ranking import RankingOptions, rank
from robomirror_drake.exceptions import PortError, UnknownCommandError
from robomirror_drake.goals import Satisfaction, make_goals, measure
from robomirror_drake.messages import QualityPrediction, RobotReference
from robomirror_drake.motion.text import parse
from robomirror_drake.robot import Robot
from robomirror_drake.systems.ports import expect, expect_some


class ReferenceSelector(LeafSystem):
    """Ranks the retargeted candidates and passes on the best (the paper's selection).

    Without predictions nothing tells which one the robot can execute, and it passes on the
    first: candidates come in the generator's order, the nominal one first.

    Input ports, of which only the first has to be connected:
        references: ``tuple[RobotReference, ...]``, abstract; the first is the command's own
            motion, from which is read what the command means.
        predictions: ``QualityPrediction`` of all of them, abstract.
        command: the text, abstract ``str``; without it, or where only a learned generator
            understands it, no candidate is preferred for what it means.

    Output ports:
        ranking: ``Ranking`` of all candidates; needs predictions.
        reference: the chosen ``RobotReference``.

    The system has no state; both outputs come from one cached ranking.
    """

    def __init__(self, robot: Robot, options: RankingOptions | None = None) -> None:
        """A selector among references for ``robot``."""
        super().__init__()
        self._robot = robot
        self._options = options or RankingOptions()
        self._references = self.DeclareAbstractInputPort("references", Value[object]())
        self._predictions = self.DeclareAbstractInputPort("predictions", Value[object]())
        self._command = self.DeclareAbstractInputPort("command", Value[object]())
        named = {self._references.ticket(), self._command.ticket()}
        self._satisfactions = self.DeclareCacheEntry(
            "satisfactions",
            ValueProducer(allocate=Value[object], calc=self._calc_satisfactions),
            prerequisites_of_calc=named,
        )
        self._ranked = self.DeclareCacheEntry(
            "ranked",
            ValueProducer(allocate=Value[object], calc=self._calc_ranked),
            prerequisites_of_calc=named | {self._predictions.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "ranking",
            Value[object],
            self._calc_ranking,
            prerequisites_of_calc={self._ranked.ticket()},
        )
        self.DeclareAbstractOutputPort(
            "reference",
            Value[object],
            self._calc_reference,
            prerequisites_of_calc={self._references.ticket(), self._ranked.ticket()},
        )

    def _candidates(self, context: Context) -> tuple[RobotReference, ...]:
        return expect_some(self._references.Eval(context), RobotReference, "references")

    def _calc_satisfactions(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._judged(context))

    def _judged(self, context: Context) -> tuple[Satisfaction, ...] | None:
        """How well each candidate does what the command means; None where that is not known."""
        if not self._command.HasValue(context):
            return None
        try:
            clauses = parse(expect(self._command.Eval(context), str, "command"))
        except UnknownCommandError:
            return None
        candidates = self._candidates(context)
        goals = make_goals(self._robot, clauses, candidates[0].q)
        return tuple(measure(self._robot, goals, candidate.q) for candidate in candidates)

    def _calc_ranked(self, context: Context, output: AbstractValue) -> None:
        if not self._predictions.HasValue(context):
            output.set_value(None)
            return
        candidates = self._candidates(context)
        prediction = expect(self._predictions.Eval(context), QualityPrediction, "predictions")
        count = len(prediction.fall_probability)
        if count != len(candidates):
            raise PortError(
                "predictions", f"{count} of them", f"{len(candidates)}, one a reference"
            )
        output.set_value(
            rank(
                [candidate.residuals for candidate in candidates],
                prediction,
                self._satisfactions.Eval(context),
                self._options,
            )
        )

    def _calc_ranking(self, context: Context, output: AbstractValue) -> None:
        ranking = self._ranked.Eval(context)
        if ranking is None:
            raise PortError("predictions", "nothing", "a QualityPrediction, to rank by")
        output.set_value(ranking)

    def _calc_reference(self, context: Context, output: AbstractValue) -> None:
        ranking = self._ranked.Eval(context)
        candidates = self._candidates(context)
        output.set_value(candidates[0 if ranking is None else ranking.best])
