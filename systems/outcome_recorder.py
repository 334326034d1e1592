"""Records an execution and notices a fall while it runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
)

from robomirror_drake.messages import Array
from robomirror_drake.outcome import fallen
from robomirror_drake.robot import FEET, Robot
from robomirror_drake.systems.whole_body_controller import DIAGNOSTICS

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
    qp_failures: Array


class OutcomeRecorder(LeafSystem):
    """Gathers everything that judges an execution into one vector, to be logged.

    Input ports:
        ``state``, ``reference_state`` (59 each), ``torque`` (23), ``diagnostics`` (4) as
        at the whole-body controller; ``contact_results`` (abstract) of the plant.

    Output ports:
        ``sample``: one :class:`Sample` as a vector; :meth:`split` takes it apart.
        ``fall_time`` (1): when the robot fell [s], +inf until then. It is the
            definition of :mod:`robomirror_drake.outcome`, looked at 60 times a second.
    """

    def __init__(self, robot: Robot, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        super().__init__()
        nq, nv = robot.model.nq, robot.model.nv
        self._splits = np.cumsum([nq, nv, nq, nv, nv - 6, 6, 1])
        self._ground = int(plant.world_body().index())
        self._links = {int(body) for body in plant.GetBodyIndices(instance)}
        self._feet = {
            int(plant.GetBodyByName(robot.spec.feet[foot].link, instance).index()): row
            for row, foot in enumerate(FEET)
        }
        self._state = self.DeclareVectorInputPort("state", nq + nv)
        self._reference = self.DeclareVectorInputPort("reference_state", nq + nv)
        self._torque = self.DeclareVectorInputPort("torque", nv - 6)
        self._diagnostics = self.DeclareVectorInputPort("diagnostics", len(DIAGNOSTICS))
        self._contact = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self._sample = self.DeclareVectorOutputPort(
            "sample", int(self._splits[-1]) + 1, self._calc_sample, {self.all_sources_ticket()}
        )
        index = self.DeclareDiscreteState([np.inf])
        self.DeclareStateOutputPort("fall_time", index)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._look)

    def split(self, samples: Array) -> Sample:
        """Takes samples (…, size) apart."""
        q, v, q_ref, v_ref, torque, force, other, failures = np.split(
            samples, self._splits, axis=-1
        )
        force = force.reshape(*samples.shape[:-1], 2, 3)
        return Sample(q, v, q_ref, v_ref, torque, force, other[..., 0], failures[..., 0])

    def _calc_sample(self, context: Context, output: BasicVector) -> None:
        foot_force, other = self._ground_forces(self._contact.Eval(context))
        output.SetFromVector(
            np.concatenate(
                [
                    self._state.Eval(context),
                    self._reference.Eval(context),
                    self._torque.Eval(context),
                    foot_force.ravel(),
                    [other, self._diagnostics.Eval(context)[0]],
                ]
            )
        )

    def _ground_forces(self, contacts: ContactResults) -> tuple[Array, float]:
        """(2, 3) force of the ground on each foot in world [N], and the norm on the rest."""
        foot_force, other = np.zeros((2, 3)), np.zeros(3)
        for index in range(contacts.num_point_pair_contacts()):
            contact = contacts.point_pair_contact_info(index)
            a, b = int(contact.bodyA_index()), int(contact.bodyB_index())
            if self._ground not in (a, b):
                continue
            # The force is the one on body B.
            force = contact.contact_force() if a == self._ground else -contact.contact_force()
            link = b if a == self._ground else a
            if link in self._feet:
                foot_force[self._feet[link]] += force
            elif link in self._links:
                other += force
        return foot_force, float(np.linalg.norm(other))

    def _look(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        if np.isinf(context.get_discrete_state_vector()[0]):
            sample = self.split(self._sample.Eval(context))
            if any(fallen(sample.q, sample.q_ref, sample.other_force).values()):
                discrete_state.set_value([context.get_time()])
        return EventStatus.Succeeded()
