"""Angles of the arm that bring its wrist to a place."""

from __future__ import annotations

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.motion.body import FOREARM, UPPER_ARM, about

LONGEST = 0.995 * (UPPER_ARM + FOREARM)
SHORTEST = 0.13
"""Distances of the wrist from the shoulder in use [m]: the elbow neither locks nor folds flat."""


def arm_angles(hand: tuple[float, float, float], swivel: float) -> tuple[float, ...]:
    """Shoulder flexion, abduction, outward rotation and elbow flexion [rad].

    The arm has one freedom more than the wrist's place: the elbow's circle about the line from
    shoulder to wrist (D. Tolani, A. Goswami, N. Badler, Graphical Models 62(5), 2000).

    Args:
        hand: Wrist from the shoulder in the chest's frame: ahead, outward, up [m].
        swivel: Where on its circle the elbow is [rad]: 0 below, a quarter turn outward.
    """
    wrist = np.array(hand)
    distance = float(np.clip(np.linalg.norm(wrist), SHORTEST, LONGEST))
    axis = wrist / np.linalg.norm(wrist)
    below = np.array([-0.25, 0.0, -1.0])  # a hanging arm's elbow looks back
    below -= (below @ axis) * axis
    below /= np.linalg.norm(below)
    along = (UPPER_ARM**2 - FOREARM**2 + distance**2) / (2.0 * distance)
    circle = np.cos(swivel) * below + np.sin(swivel) * np.cross(axis, below)
    elbow = along * axis + np.sqrt(max(UPPER_ARM**2 - along**2, 0.0)) * circle
    return _angles(elbow / UPPER_ARM, (distance * axis - elbow) / FOREARM)


def _angles(upper: Array, lower: Array) -> tuple[float, ...]:
    """Of the directions of upper arm and forearm, outward to +y."""
    abduction = float(np.arcsin(np.clip(upper[1], -1.0, 1.0)))
    flexion = float(np.arctan2(upper[0], -upper[2]))
    if flexion < -2.0:  # straight up is reached by the front
        flexion += 2.0 * np.pi
    raised = (about(1, np.array([-flexion])) @ about(0, np.array([abduction])))[0]
    forearm = raised.T @ lower
    elbow = float(np.arccos(np.clip(-forearm[2], -1.0, 1.0)))
    turned = float(np.arctan2(forearm[1], forearm[0]))
    return flexion, abduction, turned, elbow
