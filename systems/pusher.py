"""Pushes on the robot, at given times and at random ones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, LeafSystem

from robomirror_drake.disturbance import DisturbanceOptions, Push
from robomirror_drake.disturbance_draw import random_push
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.messages import Array
from robomirror_drake.robot import Robot


def full_force(push: Push, mass: float) -> Array:
    """(3,) force of a push while it lasts, in world [N]; see :func:`mean_force`."""
    if push.force is not None:
        return np.array(push.force)
    if push.impulse is not None:
        return np.array(push.impulse) / push.duration
    return np.asarray(mass * np.array(push.speed) / push.duration)


def mean_force(push: Push, mass: float, start: float, end: float) -> Array:
    """(3,) mean force of a push from ``start`` to ``end`` [s], in world [N].

    Args:
        push: The push.
        mass: Of the robot [kg], for pushes that are given by their speed.
    """
    overlap = min(end, push.time + push.duration) - max(start, push.time)
    share = max(overlap, 0.0) / (end - start)
    return share * full_force(push, mass)


class Pusher(LeafSystem):
    """Pushes links of the robot, each step of the plant with its share of the impulse.

    Output port:
        ``spatial_forces``: list of ``ExternallyAppliedSpatialForce``, for the plant's
            applied forces from the Context's time on for one step.

    There is no state: pushes are a function of seed and time.
    """

    def __init__(
        self,
        robot: Robot,
        plant: MultibodyPlant,
        instance: ModelInstanceIndex,
        options: DisturbanceOptions,
        seed: int,
    ) -> None:
        """A pusher of the robot in a finalized plant, at given times and at random ones.

        Raises:
            ConfigError: The robot has no link of a push's name.
        """
        super().__init__()
        self._bodies = {"": plant.GetBodyByName(robot.spec.base_link, instance).index()}
        for link in {push.body for push in options.pushes} - {""}:
            if not plant.HasBodyNamed(link, instance):
                raise ConfigError(f"no link {link!r} to push; see {robot.urdf}")
            self._bodies[link] = plant.GetBodyByName(link, instance).index()
        self._mass = robot.mass
        self._step = plant.time_step()
        self._pushes = options.pushes
        at_random = options.random_pushes
        self._interval = at_random.interval
        self._random = at_random.speed[1] > 0.0
        self._draw = lru_cache(maxsize=4)(lambda i: random_push(at_random, seed, i))
        self.DeclareAbstractOutputPort(
            "spatial_forces",
            Value[list[ExternallyAppliedSpatialForce]],
            self._calc_spatial_forces,
            {self.time_ticket()},
        )

    def _calc_spatial_forces(self, context: Context, output: AbstractValue) -> None:
        start = context.get_time()
        end = start + self._step
        forces = []
        for push in (*self._pushes, *self._drawn(start, end)):
            force = mean_force(push, self._mass, start, end)
            if force.any():
                applied = ExternallyAppliedSpatialForce()
                applied.body_index = self._bodies[push.body]
                applied.p_BoBq_B = np.array(push.point)
                applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=force)
                forces.append(applied)
        output.set_value(forces)

    def _drawn(self, start: float, end: float) -> tuple[Push, ...]:
        if not self._random:
            return ()
        # A step may begin in one interval and end in the next.
        return tuple(
            self._draw(i) for i in sorted({int(t // self._interval) for t in (start, end)})
        )
