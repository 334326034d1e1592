"""Chooses the reference that the robot will execute."""

from __future__ import annotations

from pydrake.common.value import Value
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from robomirror_drake.exceptions import ControllerError
from robomirror_drake.messages import RobotReference


class ReferenceSelector(LeafSystem):
    """Latches one of the retargeted candidates when the simulation starts.

    Candidates come in the generator's order, the nominal one first, and this takes
    the first: nothing in the diagram judges yet whether the robot can execute it.

    The choice is state, made by an unrestricted update at initialization, so that
    it holds while the command's port changes and is restored with the Context.

    Input port:
        references: ``tuple[RobotReference, ...]``, abstract.

    Output port:
        reference: the chosen ``RobotReference``, abstract.
    """

    def __init__(self) -> None:
        super().__init__()
        self._references = self.DeclareAbstractInputPort("references", Value[object]())
        chosen = self.DeclareAbstractState(Value[object](None))
        self.DeclareInitializationUnrestrictedUpdateEvent(self._select)
        self.DeclareStateOutputPort("reference", chosen)

    def _select(self, context: Context, state: State) -> EventStatus:
        references = self._references.Eval(context)
        if not isinstance(references, tuple) or not references:
            raise ControllerError(
                "port 'references' of ReferenceSelector needs a non-empty tuple of "
                f"RobotReference, not {references!r:.80}"
            )
        if not isinstance(references[0], RobotReference):
            kind = type(references[0]).__name__
            raise ControllerError(f"port 'references' carries a {kind}, not a RobotReference")
        state.get_mutable_abstract_state(0).set_value(references[0])
        return EventStatus.Succeeded()
