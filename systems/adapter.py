"""Changes the motion that the robot follows before it falls over it."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    State,
)

from robomirror_drake.adaptation.handover import Known, decide
from robomirror_drake.adaptation.handover_options import AdapterOptions
from robomirror_drake.messages import Handover, RobotReference
from robomirror_drake.optimization.adaptation.continuation import Course, begun
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.robot import Robot
from robomirror_drake.systems.history import RecentStates, check_measured
from robomirror_drake.systems.ports import expect

_TICK = 1e-6  # times that differ by less are the same [s]


class _Decided(NamedTuple):
    """What was decided, and the courses before and after the last hand-over.

    A course is None where that is still the given one.
    """

    log: tuple[Handover, ...] = ()
    before: Course | None = None
    after: Course | None = None

    @property
    def last(self) -> Handover | None:
        """The last hand-over that was, or will be."""
        return next((one for one in reversed(self.log) if one.done), None)

    def running(self, time: float) -> Course | None:
        """The course at a time that is not before the last decision [s]."""
        return self.after if self.last is None or time >= self.last.start - _TICK else self.before


class Adapter(LeafSystem):
    """Looks ahead while a motion runs, and where it is not safe gives a safer rest of it.

    At ``options.rate`` the predictor judges what comes next, from the robot's own recent
    states. Where P(fall) is more than 1 − T_safe, other ways to go on, and to come to a halt,
    are judged in one batch; the best is planned from the plan's state at the hand-over, which
    is ``options.latency`` later, so that the plan goes on without a jump in position, velocity
    or acceleration. Until then the old plan is followed; the robot always has one.

    What is on the input ports at the first hand-over is what runs; other motions there are not
    looked at afterwards.

    Input ports:
        ``state`` (59): of the robot, Drake order.
        ``commanded``: kinematic :class:`RobotReference` that the plan was made from, abstract.
        ``plan``: its dynamic plan, abstract; its time zero is the Context's.

    Output ports:
        ``reference``: the plan to be followed, abstract: always on one time base, with the same
            samples before a hand-over. It is the same object until the next one.
        ``commanded_now``: the kinematic reference of that, abstract.
        ``handovers``: tuple of :class:`Handover`, all that was decided so far, abstract.
        ``risk`` (2): time of the last look [s] and P(fall) that it gave; NaN before.

    State: abstract, what was decided; discrete, the robot's recent states.
    """

    def __init__(
        self,
        robot: Robot,
        predictor: Predictor,
        options: AdapterOptions | None = None,
        watch: Callable[[float], None] | None = None,
    ) -> None:
        """An adapter for ``robot``.

        Args:
            robot: The robot.
            predictor: What foresees falls.
            options: See :class:`AdapterOptions`.
            watch: Told how long each look took by the clock [s]; nothing depends on that.

        Raises:
            ConfigError: The predictor's network does not look at measured states.
        """
        super().__init__()
        check_measured(predictor.options)
        self._robot, self._predictor, self._watch = robot, predictor, watch
        self._options = options or AdapterOptions()
        size = robot.model.nq + robot.model.nv
        self._recent = RecentStates(predictor.options.back, size, predictor.options.rate)
        self._state_port = self.DeclareVectorInputPort("state", size)
        self._commanded = self.DeclareAbstractInputPort("commanded", Value[object]())
        self._plan = self.DeclareAbstractInputPort("plan", Value[object]())
        self._seen = self.DeclareDiscreteState(self._recent.unseen())
        self._looked = self.DeclareDiscreteState([np.nan, np.nan])
        self._decided = self.DeclareAbstractState(Value[object](_Decided()))
        decided = {self.abstract_state_ticket(self._decided)}
        for name, port, calc in (
            ("reference", self._plan, self._calc_reference),
            ("commanded_now", self._commanded, self._calc_commanded),
        ):
            self.DeclareAbstractOutputPort(
                name,
                Value[object],
                calc,
                prerequisites_of_calc=decided | {port.ticket(), self.time_ticket()},
            )
        self.DeclareAbstractOutputPort(
            "handovers", Value[object], self._calc_handovers, prerequisites_of_calc=decided
        )
        self.DeclareStateOutputPort("risk", self._looked)
        self.DeclarePeriodicDiscreteUpdateEvent(self._recent.period, 0.0, self._gather)
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / self._options.rate, 0.0, self._look)

    def _known(self, context: Context) -> Known:
        stored = context.get_discrete_state(self._seen).value()
        rows = self._recent.completed(stored, self._state_port.Eval(context))
        now, period = context.get_time(), self._recent.period
        # States are stored at whole periods, the last one before this moment.
        back = np.ceil(now / period - _TICK) - np.arange(self._recent.count - 1, 0, -1)
        positions = self._robot.model.nq
        history = History(rows[:, :positions], rows[:, positions:])
        return Known(np.append(back * period, now), history)

    def _given(self, context: Context) -> Course:
        """What runs as long as nothing was handed over."""
        commanded = expect(self._commanded.Eval(context), RobotReference, "commanded")
        return begun(commanded, expect(self._plan.Eval(context), RobotReference, "plan"))

    def _gather(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        stored = context.get_discrete_state(self._seen).value()
        state = self._state_port.Eval(context)
        discrete_state.set_value(self._seen, self._recent.pushed(stored, state))
        return EventStatus.Succeeded()

    def _look(self, context: Context, state: State) -> EventStatus:
        last: _Decided = context.get_abstract_state(self._decided).get_value()
        now, options, done = context.get_time(), self._options, last.last
        if done is not None and (done.stopped or now < done.start + options.interval - _TICK):
            return EventStatus.DidNothing()
        began = perf_counter()
        course = last.after or self._given(context)
        look = decide(self._robot, self._predictor, course, self._known(context), options)
        if look is None:
            return EventStatus.DidNothing()
        state.get_mutable_discrete_state().set_value(self._looked, [now, look.risk])
        if look.handover is not None:
            log = (*last.log, look.handover)
            given = look.handover.done
            made = _Decided(log, last.after, look.course) if given else last._replace(log=log)
            state.get_mutable_abstract_state(self._decided).set_value(made)
        if self._watch is not None:
            self._watch(perf_counter() - began)
        return EventStatus.Succeeded()

    def _running(self, context: Context) -> Course | None:
        decided: _Decided = context.get_abstract_state(self._decided).get_value()
        return decided.running(context.get_time())

    def _calc_reference(self, context: Context, output: AbstractValue) -> None:
        course = self._running(context)
        plan = self._plan.Eval(context) if course is None else course.plan
        output.set_value(expect(plan, RobotReference, "plan"))

    def _calc_commanded(self, context: Context, output: AbstractValue) -> None:
        output.set_value((self._running(context) or self._given(context)).commanded)

    def _calc_handovers(self, context: Context, output: AbstractValue) -> None:
        output.set_value(context.get_abstract_state(self._decided).get_value().log)
