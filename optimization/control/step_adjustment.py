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

# mypy: disable-error-code="no-untyped-def, untyped-decorator"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.optimization.centroidal import GRAVITY


class StepLimits(NamedTuple):
    """The fields of :class:`StepOptions`, as compiled code wants them."""

    room: float
    longest: float
    least_width: float
    speed: float
    last: float


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

    def limits(self) -> StepLimits:
        """The same for compiled code."""
        return StepLimits(**self.model_dump())


@njit(cache=True)
def divergence_rate(height):
    """ω of a pendulum whose mass is at a height [m], 0.1 m at least [1/s]."""
    return np.sqrt(GRAVITY / max(height, 0.1))


@njit(cache=True)
def divergent_component(motion):
    """(2,) ξ = c + ċ/ω, horizontally, of a TaskMotion [m]."""
    omega = divergence_rate(motion.com[0, 2])
    return motion.com[0, :2] + motion.com[1, :2] / omega


@njit(cache=True)
def captured(error, height, remaining, limits):
    """(2,) shift of a step that leaves to the centre of pressure what that can take care of.

    Args:
        error: (2,) of the divergent component [m].
        height: Of the centre of mass [m].
        remaining: Time until touchdown [s].
        limits: What may be done.
    """
    size = np.hypot(error[0], error[1])
    if size <= limits.room:
        return np.zeros(2)
    growth = np.exp(divergence_rate(height) * remaining)
    shift = min((size - limits.room) * growth, limits.longest)
    return error * (shift / size)


@njit(cache=True)
def without_crossing(target, planned, support, lateral, side, width):
    """(2,) the target moved sideways until the feet are far enough apart.

    Args:
        target, planned: (2,) where the foot shall go, and would without adjustment [m].
        support: (2,) where the other foot stands [m].
        lateral: (2,) unit vector to the left of that foot.
        side: 1 for a left foot that steps, -1 for a right one.
        width: Least distance sideways; a plan that is narrower is left so [m].
    """
    least = min(width, side * np.sum(lateral * (planned - support)))
    lacking = least - side * np.sum(lateral * (target - support))
    return target + max(lacking, 0.0) * side * lateral


@njit(cache=True)
def adjusted_steps(last, load, motion, reference, sample, limits, period):
    """(2, 2) how far each foot's target is moved from the reference, one tick later.

    A foot on the ground is where it is; from there its target moves to where it shall step.

    Args:
        last: (2, 2) one tick before [m].
        load: (2, 4) share of its full force that each corner bears.
        motion: The robot's, a TaskMotion.
        reference: The reference's, moved along with the feet that stand.
        sample: The reference now, a ReferenceSample.
        limits: What may be done, :class:`StepLimits`.
        period: Time since the last tick [s].
    """
    steps = last.copy()
    error = divergent_component(motion) - divergent_component(reference)
    for foot in range(2):
        planned, support = reference.p[2 + foot, :2], motion.p[3 - foot, :2]
        if np.any(load[foot] != 0.0):
            steps[foot] = motion.p[2 + foot, :2] - planned
            continue
        remaining = sample.wait[foot].min()
        if not np.any(load[1 - foot] != 0.0) or not limits.last < remaining < np.inf:
            continue
        shift = captured(error, motion.com[0, 2], remaining, limits)
        axis = motion.R[3 - foot, :2, 1].copy()
        lateral = axis / max(np.hypot(axis[0], axis[1]), 1e-6)
        side = 1.0 if foot == 0 else -1.0
        width = limits.least_width
        target = without_crossing(planned + shift, planned, support, lateral, side, width)
        change = target - planned - steps[foot]
        size = np.hypot(change[0], change[1])
        steps[foot] += change * min(1.0, limits.speed * period / max(size, 1e-9))
    return steps
