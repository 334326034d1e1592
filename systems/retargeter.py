"""From candidate human motions to references for the robot, as a system."""

from __future__ import annotations

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, ValueProducer

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import HumanMotion
from robomirror_drake.optimization.retargeting.retarget import (
    Retargeted,
    RetargetOptions,
    retarget_batch,
)
from robomirror_drake.robot import Robot
from robomirror_drake.systems.ports import expect_some


class Retargeter(LeafSystem):
    """Retargets every candidate by trajectory optimisation (the paper's g_h2r).

    A candidate that the robot cannot follow within the gate is dropped and reported.

    Input port:
        candidates: ``tuple[HumanMotion, ...]``, a ``Value[object]``.

    Output ports:
        references: ``tuple[RobotReference, ...]`` of those that passed, in their order.
        failures: ``tuple[RetargetingError, ...]`` of the others.

    The system has no state; both outputs come from one cached solve.
    """

    def __init__(self, robot: Robot, options: RetargetOptions | None = None) -> None:
        """A retargeter to ``robot``."""
        super().__init__()
        self._robot = robot
        self._options = options or RetargetOptions()
        self._candidates = self.DeclareAbstractInputPort("candidates", Value[object]())
        self._results = self.DeclareCacheEntry(
            "results",
            ValueProducer(allocate=Value[object], calc=self._calc_results),
            prerequisites_of_calc={self._candidates.ticket()},
        )
        ticket = {self._results.ticket()}
        self.DeclareAbstractOutputPort(
            "references", Value[object], self._calc_references, prerequisites_of_calc=ticket
        )
        self.DeclareAbstractOutputPort(
            "failures", Value[object], self._calc_failures, prerequisites_of_calc=ticket
        )

    def _calc_results(self, context: Context, output: AbstractValue) -> None:
        candidates = expect_some(self._candidates.Eval(context), HumanMotion, "candidates")
        output.set_value(retarget_batch(self._robot, candidates, options=self._options))

    def _calc_references(self, context: Context, output: AbstractValue) -> None:
        results = self._results.Eval(context)
        passed = tuple(r.reference for r in results if isinstance(r, Retargeted))
        if not passed:
            raise results[0]
        output.set_value(passed)

    def _calc_failures(self, context: Context, output: AbstractValue) -> None:
        results = self._results.Eval(context)
        output.set_value(tuple(r for r in results if isinstance(r, RetargetingError)))
