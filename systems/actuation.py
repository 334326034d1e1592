"""Between the controller's torque and the plant's joints."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import DiscreteTimeDelay, LinearSystem, PassThrough, Saturation

from robomirror_drake.messages import Array
from robomirror_drake.systems.joint_target import JointTarget


class Actuation(Diagram):
    """Turns torques into joint targets if asked to, limits, delays and smooths them.

    Input ports:
        ``torque`` (23): of the controller [N·m].
        ``state`` (59): what the controller sees; only with a ``joint_target``.

    Output port:
        ``command``: torques (23), or with a ``joint_target`` desired positions and
            velocities (46) for the servo in the plant.

    Latency is whole steps of the plant, and nothing is commanded until it is over. Lag is
    y_n = a y_{n−1} + (1 − a) u_n with a = exp(−step / lag): what a first-order filter gives
    at the end of a step, so that it goes over into no lag.
    """

    def __init__(
        self,
        joints: int,
        step: float,
        *,
        latency: float = 0.0,
        lag: float = 0.0,
        torque_limits: Array | None = None,
        joint_target: JointTarget | None = None,
    ) -> None:
        """What is asked for of joint target, limits, latency [s] and lag [s], in this order.

        Args:
            joints: How many.
            step: Of the plant [s].
            latency: Rounded to steps.
            lag: Time constant.
            torque_limits: (joints,) limits of torque commands [N·m].
            joint_target: Makes targets of torques.
        """
        super().__init__()
        builder = DiagramBuilder()
        self._target = joint_target
        if joint_target is not None:
            builder.AddNamedSystem("joint_target", joint_target)
            builder.ExportInput(joint_target.GetInputPort("torque"), "torque")
            builder.ExportInput(joint_target.GetInputPort("state"), "state")
            port = joint_target.GetOutputPort("desired_state")
        else:
            entry = builder.AddNamedSystem("torque", PassThrough(joints))
            builder.ExportInput(entry.get_input_port(), "torque")
            port = entry.get_output_port()
        size = port.size()
        self._filters = []
        if torque_limits is not None:
            limits = builder.AddNamedSystem("limits", Saturation(-torque_limits, torque_limits))
            builder.Connect(port, limits.get_input_port())
            port = limits.get_output_port()
        if steps := round(latency / step):
            # Its output is a state, which the plant reads one step later: hence one less.
            self._filters.append(
                builder.AddNamedSystem("latency", DiscreteTimeDelay(step, steps - 1, size))
            )
        if lag > 0.0:
            old = math.exp(-step / lag) * np.eye(size)
            new = np.eye(size) - old
            self._filters.append(
                builder.AddNamedSystem("lag", LinearSystem(old, new, old, new, step))
            )
        for system in self._filters:
            builder.Connect(port, system.get_input_port())
            port = system.get_output_port()
        builder.ExportOutput(port, "command")
        builder.BuildInto(self)

    def start(self, context: Context, state: Array) -> None:
        """Sets what is commanded before the first tick: no torque at a state (59,).

        For torques that is what a Context begins with anyway.
        """
        if self._target is None:
            return
        own = self._target.GetMyMutableContextFromRoot(context)
        self._target.start(own, state)
        torque_free = self._target.torque_free(state)
        for system in self._filters:
            held = system.GetMyMutableContextFromRoot(context).get_mutable_discrete_state_vector()
            held.SetFromVector(np.tile(torque_free, held.size() // len(torque_free)))
