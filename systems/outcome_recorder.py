"""Records an execution and notices a fall while it runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
)

from robomirror_drake.messages import Array
from robomirror_drake.optimization.control.diagnostics import Diagnostics, names, unpack
from robomirror_drake.outcome import fallen
from robomirror_drake.robot import Robot

PERIOD = 1.0 / 60.0
"""Of the recording [s]."""


class Sample(NamedTuple):
    """One recorded instant, or many with time as the first axis; see ``Execution``."""

    q: Array
    v: Array
    q_ref: Array
    v_ref: Array
    torque: Array
    foot_force: Array
    other_force: Array
    diagnostics: Diagnostics


class OutcomeRecorder(LeafSystem):
    """Gathers everything that judges an execution into one vector, to be logged.

    Input ports:
        ``state``, ``reference_state`` (59 each), ``torque`` (23), ``diagnostics`` (59) as
        at the whole-body controller; ``foot_force`` (6), ``other_force`` (1) as at
        :class:`.ground_forces.GroundForces`.

    Output ports:
        ``sample``: one :class:`Sample` as a vector; :meth:`split` takes it apart.
        ``fall_time`` (1): when the robot fell [s], +inf until then. It is the
            definition of :mod:`robomirror_drake.outcome`, looked at 60 times a second.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        nq, nv = robot.model.nq, robot.model.nv
        sizes = {
            "state": nq + nv,
            "reference_state": nq + nv,
            "torque": nv - 6,
            "foot_force": 6,
            "other_force": 1,
            "diagnostics": len(names(robot.joint_names)),
        }
        self._splits = np.cumsum([nq, nv, nq, nv, nv - 6, 6, 1])
        self._inputs = [self.DeclareVectorInputPort(name, size) for name, size in sizes.items()]
        self._sample = self.DeclareVectorOutputPort(
            "sample", sum(sizes.values()), self._calc_sample, {self.all_sources_ticket()}
        )
        index = self.DeclareDiscreteState([np.inf])
        self.DeclareStateOutputPort("fall_time", index)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._look)

    def split(self, samples: Array) -> Sample:
        """Takes samples (…, size) apart."""
        q, v, q_ref, v_ref, torque, force, other, said = np.split(samples, self._splits, axis=-1)
        force = force.reshape(*samples.shape[:-1], 2, 3)
        return Sample(q, v, q_ref, v_ref, torque, force, other[..., 0], unpack(said))

    def _calc_sample(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate([port.Eval(context) for port in self._inputs]))

    def _look(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        if np.isinf(context.get_discrete_state_vector()[0]):
            sample = self.split(self._sample.Eval(context))
            if any(fallen(sample.q, sample.q_ref, sample.other_force).values()):
                discrete_state.set_value([context.get_time()])
        return EventStatus.Succeeded()
