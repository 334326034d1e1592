"""Takes the reference that the robot can do, and changes one where it can do none."""

from __future__ import annotations

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, ValueProducer

from robomirror_drake.adaptation.command import Adaptation, adapt_command
from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.messages import RobotReference
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.ppn.predictor import Predictor
from robomirror_drake.robot import Robot
from robomirror_drake.systems.ports import expect, expect_some


class ReferenceAdapter(LeafSystem):
    """Keeps, chooses or optimises by what is foreseen; see :func:`.adaptation.adapt_command`.

    Input ports:
        references: ``tuple[RobotReference, ...]``, abstract; the first is the command's own
            motion.
        command: the text, abstract ``str``. It may be left open: nothing then tells what the
            command means.

    Output ports:
        adaptation: ``Adaptation``, what was done and why.
        reference: its ``RobotReference``.

    The system has no state; both outputs come from one cached adaptation.
    """

    def __init__(
        self,
        robot: Robot,
        predictor: Predictor | Ensemble,
        options: AdaptationOptions | None = None,
    ) -> None:
        """An adapter of references for ``robot``."""
        super().__init__()
        self._robot, self._predictor = robot, predictor
        self._options = options or AdaptationOptions()
        self._references = self.DeclareAbstractInputPort("references", Value[object]())
        self._command = self.DeclareAbstractInputPort("command", Value[object]())
        adapted = self.DeclareCacheEntry(
            "adapted",
            ValueProducer(allocate=Value[object], calc=self._calc_adapted),
            prerequisites_of_calc={self._references.ticket(), self._command.ticket()},
        )
        self._adapted = adapted
        for name, calc in (
            ("adaptation", self._calc_adaptation),
            ("reference", self._calc_reference),
        ):
            self.DeclareAbstractOutputPort(
                name, Value[object], calc, prerequisites_of_calc={adapted.ticket()}
            )

    def _calc_adapted(self, context: Context, output: AbstractValue) -> None:
        references = expect_some(self._references.Eval(context), RobotReference, "references")
        command = ""
        if self._command.HasValue(context):
            command = expect(self._command.Eval(context), str, "command")
        made = adapt_command(self._robot, command, references, self._predictor, self._options)
        output.set_value(made)

    def _calc_adaptation(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._of(context))

    def _calc_reference(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._of(context).reference)

    def _of(self, context: Context) -> Adaptation:
        made: Adaptation = self._adapted.Eval(context)
        return made
