"""The commanded motion in the time of its execution.

A dynamic plan may add time before the kinematic reference that it is made from, to come
from rest, and after it. In added time the commanded motion is its first frame, or its last
one, at rest. Where the planner was allowed to slow a motion down, so is the commanded
motion, evenly: a flight, which keeps its tempo in the plan, is then out of step by up to
the time that slowing it would have taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array, BoolArray, RobotReference


class Commanded(NamedTuple):
    """A kinematic reference sampled at N instants of an execution.

    Attributes:
        q: (N, 30) positions, Drake order.
        v: (N, 29) velocities at the plan's tempo, Drake order; zero where a frame is held.
        contact: (N, 2, 4) which sole corners are meant to bear load.
    """

    q: Array
    v: Array
    contact: BoolArray


def commanded(raw: RobotReference, plan: RobotReference, time: Array) -> Commanded:
    """The kinematic reference at the times of an execution of the plan made from it.

    Args:
        raw: The kinematic reference.
        plan: The plan; its ``lead`` says when ``raw`` begins in it, and its residual
            ``time_scale`` at which tempo.
        time: (N,) of the execution [s].

    Raises:
        ValueError: The plan is too short to have been made from ``raw``.
    """
    tempo = plan.residuals.get("time_scale", 1.0) if plan.planned else 1.0
    half = 0.5 * raw.duration / (len(raw.time) - 1)
    if plan.duration < plan.lead + (raw.duration - half) / tempo:
        raise ValueError(
            f"a motion of {raw.duration / tempo:.3f} s from {plan.lead:.3f} s on does not fit "
            f"into its plan of {plan.duration:.3f} s"
        )
    own = (time - plan.lead) * tempo
    row = np.clip(np.searchsorted(raw.time, own + half, side="right") - 1, 0, len(raw.time) - 1)
    moving = (own > -half) & (own < raw.duration + half)
    return Commanded(
        raw.q[row], np.where(moving[:, None], tempo * raw.v[row], 0.0), raw.contact[row]
    )
