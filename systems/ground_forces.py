"""What the ground does to the robot."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem, ValueProducer

from robomirror_drake.messages import Array
from robomirror_drake.robot import FEET, Robot


class GroundForces(LeafSystem):
    """Sums up the contacts between ground and robot, by foot and for all other links.

    The first is what force sensors in the ankles measure, but for the feet's own inertia.

    Input port:
        ``contact_results`` (abstract) of the plant.

    Output ports:
        ``foot_force`` (6): on left and right foot, in world [N].
        ``other_force`` (1): norm of the force on all links but the feet [N].
    """

    def __init__(self, robot: Robot, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        super().__init__()
        self._ground = int(plant.world_body().index())
        self._links = {int(body) for body in plant.GetBodyIndices(instance)}
        self._feet = {
            int(plant.GetBodyByName(robot.spec.feet[foot].link, instance).index()): row
            for row, foot in enumerate(FEET)
        }
        self._contact = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        forces = self.DeclareCacheEntry(
            description="ground forces",
            value_producer=ValueProducer(allocate=Value[object], calc=self._calc_forces),
            prerequisites_of_calc={self._contact.ticket()},
        )
        self._forces = forces
        self.DeclareVectorOutputPort("foot_force", 6, self._calc_foot_force, {forces.ticket()})
        self.DeclareVectorOutputPort("other_force", 1, self._calc_other_force, {forces.ticket()})

    def _calc_forces(self, context: Context, value: AbstractValue) -> None:
        contacts: ContactResults = self._contact.Eval(context)
        force = np.zeros((3, 3))
        for index in range(contacts.num_point_pair_contacts()):
            contact = contacts.point_pair_contact_info(index)
            a, b = int(contact.bodyA_index()), int(contact.bodyB_index())
            if self._ground not in (a, b):
                continue
            # The force is the one on body B.
            on_link = contact.contact_force() if a == self._ground else -contact.contact_force()
            link = b if a == self._ground else a
            if link in self._links:
                force[self._feet.get(link, 2)] += on_link
        value.set_value(force)

    def _force(self, context: Context) -> Array:
        force: Array = self._forces.Eval(context)
        return force

    def _calc_foot_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._force(context)[:2].ravel())

    def _calc_other_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([np.linalg.norm(self._force(context)[2])])
