"""The low-level interface of the paper: joint torques as targets of a joint servo."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    LeafSystem,
)

from robomirror_drake.messages import Array
from robomirror_drake.robot_spec import JointGains


def joint_target(q: Array, v: Array, torque: Array, gains: JointGains) -> Array:
    """(n,) q_des for which the servo Kp (q_des − q) − Kd q̇ gives a torque at this state."""
    return np.asarray(q + (torque + gains.damping * v) / gains.stiffness)


class JointTarget(LeafSystem):
    """Turns each torque of the controller into the joint positions that ask a servo for it.

    The target is held while the robot moves on, which makes the servo a spring and damper
    about the controller's torque. Before the first tick it is what :meth:`start` has set.

    Input ports:
        ``state`` (59): what the controller sees.
        ``torque`` (23): of the controller, from its last tick.

    Output port:
        ``desired_state`` (46): joint positions, and velocities, which are zero.

    The discrete state holds joint positions and velocities at the controller's last tick.
    """

    def __init__(self, joints: int, gains: JointGains, period: float) -> None:
        """Targets for a controller that ticks every ``period`` [s]."""
        super().__init__()
        self._gains = gains
        self._joints = joints
        self._state = self.DeclareVectorInputPort("state", 2 * joints + 13)
        self._torque = self.DeclareVectorInputPort("torque", joints)
        index = self.DeclareDiscreteState(2 * joints)
        self.DeclareVectorOutputPort(
            "desired_state",
            2 * joints,
            self._calc_desired_state,
            {self._torque.ticket(), self.discrete_state_ticket(index)},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)

    def start(self, context: Context, state: Array) -> None:
        """Sets the targets to those of no torque at a state (59,)."""
        context.SetDiscreteState(self._of_joints(state))

    def torque_free(self, state: Array) -> Array:
        """(46,) the desired state of no torque at a state (59,)."""
        q, v = np.split(self._of_joints(state), 2)
        zero = np.zeros(self._joints)
        return np.concatenate([joint_target(q, v, zero, self._gains), zero])

    def _of_joints(self, state: Array) -> Array:
        n = self._joints
        return np.concatenate([state[7 : 7 + n], state[-n:]])

    def _sample(self, context: Context, discrete_state: DiscreteValues) -> EventStatus:
        discrete_state.set_value(self._of_joints(self._state.Eval(context)))
        return EventStatus.Succeeded()

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        q, v = np.split(context.get_discrete_state_vector().value(), 2)
        target = joint_target(q, v, self._torque.Eval(context), self._gains)
        output.SetFromVector(np.concatenate([target, np.zeros(self._joints)]))
