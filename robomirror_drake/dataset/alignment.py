"""The commanded motion in the time of its execution.

A dynamic plan keeps the tempo of the kinematic reference that it is made from, but may
add time before it, to come from rest, and after it. In added time the commanded motion
is its first frame, or its last one, at rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray, RobotReference


class Commanded(NamedTuple):
    """A kinematic reference sampled at N instants of an execution.

    Attributes:
        q: (N, 30) positions, Drake order.
        v: (N, 29) velocities, Drake order; zero where a frame is held.
        contact: (N, 2, 4) which sole corners are meant to bear load.
    """

    q: Array
    v: Array
    contact: BoolArray


def commanded(raw: RobotReference, plan: RobotReference, time: Array) -> Commanded:
    """The kinematic reference at the times of an execution of the plan made from it.

    Args:
        raw: The kinematic reference.
        plan: The plan; its ``lead`` says when ``raw`` begins in it.
        time: (N,) of the execution [s].

    Raises:
        ValueError: The plan is shorter than what it was made from, so that its tempo differs.
    """
    half = 0.5 * raw.duration / (len(raw.time) - 1)
    if plan.duration < plan.lead + raw.duration - half:
        raise ValueError(
            f"a motion of {raw.duration:.3f} s from {plan.lead:.3f} s on does not fit into its "
            f"plan of {plan.duration:.3f} s"
        )
    own = time - plan.lead
    row = np.clip(np.searchsorted(raw.time, own + half, side="right") - 1, 0, len(raw.time) - 1)
    moving = (own > -half) & (own < raw.duration + half)
    return Commanded(raw.q[row], np.where(moving[:, None], raw.v[row], 0.0), raw.contact[row])
