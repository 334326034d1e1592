"""Chooses the reference that the robot will execute."""

from __future__ import annotations

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem

from robomirror_drake.messages import RobotReference
from robomirror_drake.systems.ports import expect_some


class ReferenceSelector(LeafSystem):
    """Passes on one of the retargeted candidates.

    Candidates come in the generator's order, the nominal one first, and this takes
    the first: nothing in the diagram judges yet whether the robot can execute it.

    Input port:
        references: ``tuple[RobotReference, ...]``, abstract.

    Output port:
        reference: the chosen ``RobotReference``, abstract, cached until the input changes.

    The system has no state.
    """

    def __init__(self) -> None:
        super().__init__()
        self._references = self.DeclareAbstractInputPort("references", Value[object]())
        self.DeclareAbstractOutputPort(
            "reference",
            alloc=Value[object],
            calc=self._select,
            prerequisites_of_calc={self._references.ticket()},
        )

    def _select(self, context: Context, output: AbstractValue) -> None:
        references = self._references.Eval(context)
        output.set_value(expect_some(references, RobotReference, "references")[0])
