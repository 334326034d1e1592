"""What would become of each candidate, as a system."""

from __future__ import annotations

from pydrake.common.value import Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    InputPort,
    LeafSystem,
)

from robomirror_drake.messages import RobotReference
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.systems.history import RecentStates, check_measured
from robomirror_drake.systems.ports import expect_some


class PerformancePredictor(LeafSystem):
    """Predicts fall and tracking errors of every candidate (the paper's PPN, equation 3).

    The robot's recent states are gathered here, at the network's rate; until there are enough
    of them, the robot is taken to have stood as it was first seen.

    Input ports:
        ``references``: tuple of :class:`RobotReference` in the world of the robot, a
            ``Value[object]``; each of them would begin now.
        ``state`` (59): of the robot, Drake order.

    Output ports:
        ``predictions``: :class:`QualityPrediction`, of all candidates in one batch.
        ``history`` (S x 59): the states that the network looks back on, the last one now.

    State: discrete, the states of the last moments but the present one; +inf in the first
    place of those that were not yet seen.
    """

    def __init__(self, predictor: Predictor) -> None:
        """A system around a predictor.

        Raises:
            ConfigError: Its network does not look at measured states.
        """
        super().__init__()
        check_measured(predictor.options)
        self._predictor = predictor
        options = predictor.options
        size = 2 * predictor.joints + 13
        self._recent = RecentStates(options.back, size, options.rate)
        self._references = self.DeclareAbstractInputPort("references", Value(object()))
        self._state: InputPort = self.DeclareVectorInputPort("state", size)
        self._seen = self.DeclareDiscreteState(self._recent.unseen())
        self.DeclarePeriodicDiscreteUpdateEvent(self._recent.period, 0.0, self._gather)
        self._history = self.DeclareVectorOutputPort(
            "history",
            options.back * size,
            self._calc_history,
            {self._state.ticket(), self.discrete_state_ticket(self._seen)},
        )
        self.DeclareAbstractOutputPort(
            "predictions",
            alloc=lambda: Value(object()),
            calc=self._calc_predictions,
            prerequisites_of_calc={
                self._references.ticket(),
                self._state.ticket(),
                self.discrete_state_ticket(self._seen),
            },
        )

    def history(self, context: Context) -> History:
        """The recent states of the robot in a context."""
        recent = self._recent
        rows = self._history.Eval(context).reshape(recent.count, recent.size)
        positions = (recent.size + 1) // 2
        return History(rows[:, :positions], rows[:, positions:])

    def _gather(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        stored = context.get_discrete_state(self._seen).value()
        discrete_state.set_value(self._seen, self._recent.pushed(stored, self._state.Eval(context)))
        return EventStatus.Succeeded()

    def _calc_history(self, context: Context, output: BasicVector) -> None:
        stored = context.get_discrete_state(self._seen).value()
        rows = self._recent.completed(stored, self._state.Eval(context))
        output.SetFromVector(rows.ravel())

    def _calc_predictions(self, context: Context, output: Value[object]) -> None:
        references = expect_some(self._references.Eval(context), RobotReference, "references")
        output.set_value(self._predictor.predict(references, 0.0, self.history(context)))
