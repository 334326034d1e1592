"""Where to step when the robot is not where it should be: towards where it is about to fall.

With the divergent component of motion ξ = c + ċ/ω, ω² = g/z, of a linear inverted pendulum,
an error e of ξ grows as ė = ω (e − b), where b is how far the centre of pressure moves under
the foot. So at touchdown, after a time T, it is

    e_T = b + (e − b) exp(ω T)    where |e| > b,

and the foot is moved by e_T − b; the rest is left to the centre of pressure.

See J. Pratt et al., "Capture point: a step toward humanoid push recovery", Humanoids 2006; J.
Englsberger et al., "Three-dimensional bipedal walking control based on divergent component of
motion", IEEE T-RO 2015.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.messages import Array
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.dynamics_terms import TaskMotion
from robomirror_drake.optimization.reference_trajectory import ReferenceSample


class StepOptions(BaseModel):
    """Where a foot in swing may be moved to."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    room: float = Field(
        0.03, ge=0.0, description="error that the centre of pressure can take care of [m]"
    )
    longest: float = Field(0.3, ge=0.0, description="shift of a step at most; 0 for none [m]")
    least_width: float = Field(
        0.17, ge=0.0, description="from foot to foot sideways, so that legs do not cross [m]"
    )
    speed: float = Field(1.5, gt=0.0, description="at which the target moves at most [m/s]")
    last: float = Field(0.05, ge=0.0, description="before touchdown the target stays [s]")


def divergence_rate(height: float) -> float:
    """ω of a pendulum whose mass is at a height [m], 0.1 m at least [1/s]."""
    return float(np.sqrt(GRAVITY / max(height, 0.1)))


def divergent_component(motion: TaskMotion) -> Array:
    """(2,) ξ = c + ċ/ω, horizontally [m]."""
    omega = divergence_rate(motion.com[0, 2])
    return np.asarray(motion.com[0, :2] + motion.com[1, :2] / omega)


def captured(error: Array, height: float, remaining: float, options: StepOptions) -> Array:
    """(2,) shift of a step that leaves to the centre of pressure what that can take care of.

    Args:
        error: (2,) of the divergent component [m].
        height: Of the centre of mass [m].
        remaining: Time until touchdown [s].
        options: What may be done.
    """
    size = float(np.linalg.norm(error))
    if size <= options.room:
        return np.zeros(2)
    growth = np.exp(divergence_rate(height) * remaining)
    shift = min((size - options.room) * growth, options.longest)
    return np.asarray(error * (shift / size))


def without_crossing(
    target: Array, planned: Array, support: Array, lateral: Array, side: float, width: float
) -> Array:
    """(2,) the target moved sideways until the feet are far enough apart.

    Args:
        target, planned: (2,) where the foot shall go, and would without adjustment [m].
        support: (2,) where the other foot stands [m].
        lateral: (2,) unit vector to the left of that foot.
        side: 1 for a left foot that steps, -1 for a right one.
        width: Least distance sideways; a plan that is narrower is left so [m].
    """
    least = min(width, side * float(lateral @ (planned - support)))
    lacking = least - side * float(lateral @ (target - support))
    return target + max(lacking, 0.0) * side * lateral


def adjusted_steps(
    last: Array,
    load: Array,
    motion: TaskMotion,
    reference: TaskMotion,
    sample: ReferenceSample,
    options: StepOptions,
    period: float,
) -> Array:
    """(2, 2) how far each foot's target is moved from the reference, one tick later.

    A foot on the ground is where it is; from there its target moves to where it shall step.

    Args:
        last: (2, 2) one tick before [m].
        load: (2, 4) share of its full force that each corner bears.
        motion: The robot's.
        reference: The reference's, moved along with the feet that stand.
        sample: The reference now.
        options: What may be done.
        period: Time since the last tick [s].
    """
    steps, on = last.copy(), np.asarray(load.any(axis=1))
    error = divergent_component(motion) - divergent_component(reference)
    for foot in range(2):
        if on[foot]:
            steps[foot] = motion.p[2 + foot, :2] - reference.p[2 + foot, :2]
            continue
        remaining = float(sample.wait[foot].min())
        if not on[1 - foot] or not options.last < remaining < np.inf:
            continue
        planned, support = reference.p[2 + foot, :2], motion.p[3 - foot, :2]
        shift = captured(error, float(motion.com[0, 2]), remaining, options)
        axis = motion.R[3 - foot][:2, 1]
        lateral = axis / max(float(np.linalg.norm(axis)), 1e-6)
        side = 1.0 if foot == 0 else -1.0
        target = without_crossing(
            planned + shift, planned, support, lateral, side, options.least_width
        )
        change = target - planned - steps[foot]
        size = float(np.linalg.norm(change))
        steps[foot] += change * min(1.0, options.speed * period / max(size, 1e-9))
    return steps
