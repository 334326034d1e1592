"""Encoders and IMU between the plant and the controller."""

from __future__ import annotations

import math

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from robomirror_drake.disturbance import SensorNoise
from robomirror_drake.disturbance_draw import measured


class Sensors(LeafSystem):
    """Adds white noise to the state, drawn anew at every tick of the controller.

    Input port:
        ``state`` (59): positions and velocities of the plant, Drake order.

    Output port:
        ``measured_state`` (59): the same with noise.

    There is no state: noise is a function of seed and time.
    """

    def __init__(self, size: int, noise: SensorNoise, seed: int, period: float) -> None:
        """Sensors of a state of ``size`` elements that are read every ``period`` [s]."""
        super().__init__()
        self._noise = noise
        self._seed = seed
        self._period = period
        self._state = self.DeclareVectorInputPort("state", size)
        self.DeclareVectorOutputPort(
            "measured_state",
            size,
            self._calc_measured_state,
            {self._state.ticket(), self.time_ticket()},
        )

    def _calc_measured_state(self, context: Context, output: BasicVector) -> None:
        # A tick's time is a multiple of the period up to rounding.
        tick = math.floor(context.get_time() / self._period + 1e-6)
        output.SetFromVector(measured(self._state.Eval(context), self._noise, self._seed, tick))
