"""Whole-body controller: the reference and the robot's state in, joint torques out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    ValueProducer,
)

from robomirror_drake.exceptions import PortError
from robomirror_drake.messages import Array, RobotReference
from robomirror_drake.optimization.centroidal import unit_quaternions
from robomirror_drake.optimization.control.diagnostics import (
    names,
    nothing,
    packed_diagnosis,
    unpack,
)
from robomirror_drake.optimization.control.dynamics_terms import control_model
from robomirror_drake.optimization.control.preview import Preview, PreviewOptions, preview_gains
from robomirror_drake.optimization.control.qp import (
    WholeBodyOptions,
    acceleration_from,
    torque_from,
    tuning,
)
from robomirror_drake.optimization.control.reference_trajectory import (
    ReferenceTrajectory,
    reference_trajectory,
    sample_reference,
)
from robomirror_drake.optimization.control.stance import Stance, initial_stance
from robomirror_drake.optimization.control.tick import (
    Tick,
    control_problem,
    predicted,
    scratch,
    solve_with_retry,
)
from robomirror_drake.robot import Robot
from robomirror_drake.systems.ports import expect

ABSURD = 1e6
"""Size from which on no element of a state is believed, in its own unit."""


class ControllerOptions(BaseModel):
    """Options of the controller."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    period: float = Field(0.004, gt=0.0, description="of the control loop [s]")
    start: float = Field(0.0, description="time at which the reference begins [s]")
    delay: float = Field(
        0.004,
        ge=0.0,
        le=0.1,
        description="from a measurement to the torque's effect, as far as it is known: control is"
        " for the state predicted over it [s]",
    )
    qp: WholeBodyOptions = WholeBodyOptions()
    preview: Literal["lqr", "none"] = Field(
        "lqr",
        description="what moves centre of mass and angular momentum: a regulator that knows the"
        " contacts to come, or the fixed gains of their tasks",
    )
    lqr: PreviewOptions = PreviewOptions()
    patience: int = Field(
        5, ge=0, description="ticks without a solution for which the last torque is held"
    )
    failure_damping: float = Field(10.0, ge=0.0, description="joint damping after that [N·m·s/rad]")


class _State(NamedTuple):
    """The discrete state, unpacked; the diagnostics are still in one vector."""

    torque: Array
    diagnostics: Array
    acceleration: Array
    stance: Stance


class WholeBodyController(LeafSystem):
    """Follows a reference with an inverse-dynamics QP at a fixed rate.

    Input ports:
        ``state`` (59): positions and velocities of the plant, Drake order.
        ``reference`` (abstract): a :class:`RobotReference`, which may be replaced at any
            time; its time zero is ``options.start``. After its end it is held.
        ``foot_force`` (6): force of the ground on left and right foot, in world [N]. It
            may be left open: contact is then judged by the height of the soles.

    Output ports:
        ``torque`` (23): joint torques of the last control tick [N·m].
        ``diagnostics`` (59): see :class:`.control.diagnostics.Diagnostics`; the
            elements' names are in the attribute ``diagnostics_names``.
        ``reference_state`` (59): the reference at the Context's time, Drake order.

    All state is discrete state of the Context: torque, diagnostics, accelerations that the
    last solution meant, stance. Where the QP has no solution, it is tried again without joint
    limits and without keeping links apart; if that fails too, the last torque is held for
    ``patience`` ticks, then joints are damped. A state that is not finite, or absurd, counts
    as a failure, with no torque after that. The first tick is at time 0 and reaches the plant
    one of its steps later.
    """

    def __init__(self, robot: Robot, options: ControllerOptions | None = None) -> None:
        super().__init__()
        self._robot = robot
        self._options = options or ControllerOptions()
        self._model = control_model(robot)
        self._tuning = tuning(self._model, self._options.qp)

        nq, nv = robot.model.nq, robot.model.nv
        joints = nv - 6
        self._state_port = self.DeclareVectorInputPort("state", nq + nv)
        self._reference_port = self.DeclareAbstractInputPort("reference", Value[object]())
        self._force_port = self.DeclareVectorInputPort("foot_force", 6)
        self._trajectory = self._made_once("reference trajectory", self._make_trajectory)
        self._preview = self._made_once("preview", self._make_preview)
        # In the Context, since a system written in Python outlives its diagram: Drake's
        # bindings never let go of it.
        self._scratch = self.DeclareCacheEntry(
            description="scratch",
            value_producer=ValueProducer(
                allocate=lambda: Value[object](scratch(self._model)),
                calc=ValueProducer.NoopCalc,
            ),
            prerequisites_of_calc={self.nothing_ticket()},
        )
        self.diagnostics_names = names(robot.joint_names)
        size = len(self.diagnostics_names)
        self._split = (joints, joints + size, joints + size + nv)
        nothing_yet = np.zeros(self._split[-1])
        state = self.DeclareDiscreteState(np.append(nothing_yet, initial_stance().pack()))
        prerequisites = {self.discrete_state_ticket(state)}
        self.DeclareVectorOutputPort("torque", joints, self._calc_torque, prerequisites)
        self.DeclareVectorOutputPort("diagnostics", size, self._calc_diagnostics, prerequisites)
        self.DeclareVectorOutputPort(
            "reference_state",
            nq + nv,
            self._calc_reference_state,
            {self._reference_port.ticket(), self.time_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(self._options.period, 0.0, self._update)

    def _reference_of(self, context: Context) -> RobotReference:
        reference = expect(self._reference_port.Eval(context), RobotReference, "reference")
        positions, wanted = reference.q.shape[1], self._robot.model.nq
        if positions != wanted:
            robot = f"{wanted}, as robot {self._robot.spec.name!r} has"
            raise PortError("reference", f"a reference with {positions} positions", robot)
        return reference

    def _made_once(self, description: str, make: Callable[[RobotReference], object]) -> CacheEntry:
        """A cache entry with a reference and what is made from it.

        A source whose output counts as changed at every tick gives the same object again; what
        is made from it is too dear to be made again.
        """

        def calc(context: Context, value: AbstractValue) -> None:
            reference, held = self._reference_of(context), value.get_value()
            if not (isinstance(held, tuple) and held[0] is reference):
                value.set_value((reference, make(reference)))

        return self.DeclareCacheEntry(
            description=description,
            value_producer=ValueProducer(allocate=Value[object], calc=calc),
            prerequisites_of_calc={self._reference_port.ticket()},
        )

    def _make_trajectory(self, reference: RobotReference) -> ReferenceTrajectory:
        return reference_trajectory(self._robot, reference)

    def _make_preview(self, reference: RobotReference) -> Preview | None:
        options = self._options
        if options.preview == "none":
            return None
        return preview_gains(self._robot, reference, options.qp.friction, options.lqr)

    def _state(self, context: Context) -> _State:
        # A copy, since to compiled code arrays that cannot be written to are of another type.
        vector = context.get_discrete_state_vector().value().copy()
        a, b, c = self._split
        return _State(vector[:a], vector[a:b], vector[b:c], Stance.unpack(vector[c:]))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        self._tick(context, self._state(context), discrete_state)
        return EventStatus.Succeeded()

    def _tick(self, context: Context, last: _State, discrete_state: DiscreteValues) -> None:
        state = self._state_port.Eval(context)
        rates = state[-self._model.effort.size :]
        if np.abs(state).max() < ABSURD:  # not so for NaN either
            tick = self._problem(context, state, last)
            stance = tick.stance
            solution = solve_with_retry(tick.qp, self._options.qp.solver)
        else:
            solution, stance, rates = None, last.stance, np.zeros_like(rates)
        if solution is not None and solution.found:
            torque, acceleration = torque_from(solution), acceleration_from(solution)
            diagnostics = packed_diagnosis(
                tick.qp, solution, tick.scheduled, stance, self._model, self._options.qp.friction
            )
        else:
            failures = float(unpack(last.diagnostics).qp_failures) + 1.0
            diagnostics = nothing(rates.size, failures).pack()
            hold = failures <= self._options.patience
            torque = last.torque if hold else -self._options.failure_damping * rates
            acceleration = np.zeros_like(last.acceleration)
        torque = np.minimum(np.maximum(torque, -self._model.effort), self._model.effort)
        discrete_state.get_mutable_vector().SetFromVector(
            np.concatenate([torque, diagnostics, acceleration, stance.pack()])
        )

    def _problem(self, context: Context, state: Array, last: _State) -> Tick:
        options, nq, port = self._options, self._robot.model.nq, self._force_port
        force = port.Eval(context).reshape(2, 3) if port.HasValue(context) else None
        # Drake's discrete plant lets the norm drift, by a hundredth within seconds, and Pinocchio
        # takes what it is given.
        state = unit_quaternions(state)
        q, v = predicted(
            self._model,
            self._robot.to_pinocchio(state[:nq]),
            self._robot.v_to_pinocchio(state[:nq], state[nq:]),
            last.acceleration,
            options.delay,
        )
        return control_problem(
            self._model,
            self._scratch.Eval(context),
            self._tuning,
            q,
            v,
            self._trajectory.Eval(context)[1],
            context.get_time() - options.start + options.delay,
            last.stance,
            options.period,
            force,
            self._preview.Eval(context)[1],
        )

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._state(context).torque)

    def _calc_diagnostics(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._state(context).diagnostics)

    def _calc_reference_state(self, context: Context, output: BasicVector) -> None:
        now = context.get_time() - self._options.start
        trajectory = self._trajectory.Eval(context)[1]
        wanted = sample_reference(trajectory, now, self._options.qp.contact_ramp)
        q = self._robot.to_drake(wanted.q)
        output.SetFromVector(np.concatenate([q, self._robot.v_to_drake(q, wanted.v)]))
