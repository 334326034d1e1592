"""A robot's motion with left and right exchanged."""

from __future__ import annotations

import numpy as np

from robomirror_drake.exceptions import RobotModelError
from robomirror_drake.messages import Array
from robomirror_drake.robot import Robot

_BASE = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])  # quaternion wxyz, position
_BASE_RATES = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])  # an angular velocity is a pseudovector


class Mirror:
    """The exchange of left and right, in the plane y = 0 of the world.

    Joints come in pairs ``L_…`` and ``R_…`` or lie in the middle; those about x and z, whose
    names do not end in ``_P`` or ``KNEE``, change their sign.
    """

    def __init__(self, robot: Robot) -> None:
        """For a robot.

        Raises:
            RobotModelError: A joint has no counterpart.
        """
        names = list(robot.joint_names)
        partners = [{"L_": "R_", "R_": "L_"}.get(name[:2], name[:2]) + name[2:] for name in names]
        if missing := sorted(set(partners) - set(names)):
            raise RobotModelError(f"robot {robot.spec.name!r} has no joint {', '.join(missing)}")
        self._order = np.array([names.index(partner) for partner in partners])
        self._sign = np.array([1.0 if n.endswith(("_P", "KNEE")) else -1.0 for n in names])

    def positions(self, q: Array) -> Array:
        """(…, 30), Drake order."""
        return np.concatenate([q[..., :7] * _BASE, q[..., 7:][..., self._order] * self._sign], -1)

    def rates(self, v: Array) -> Array:
        """(…, 29), Drake order."""
        joints = v[..., 6:][..., self._order] * self._sign
        return np.concatenate([v[..., :6] * _BASE_RATES, joints], -1)

    @staticmethod
    def contacts(contact: Array) -> Array:
        """(…, 2, 4), in the order of all messages."""
        return contact[..., ::-1, :][..., [1, 0, 3, 2]]
