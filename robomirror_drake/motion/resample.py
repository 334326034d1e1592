"""Change the rate or the tempo of a motion, C²-smooth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from robomirror_drake.messages import Array, HumanMotion


def spline(time: Array, positions: Array) -> CubicSpline:
    """Not-a-knot cubic spline through positions (T, …) at increasing times (T,) [s]."""
    return CubicSpline(time, positions, axis=0)


def resample(motion: HumanMotion, fps: float) -> HumanMotion:
    """The same motion at ``fps`` frames per second.

    Samples a cubic spline through the frames, so velocity and acceleration are
    continuous. Starts at the first frame and ends at most one new frame before the last.

    Raises:
        ValueError: ``fps`` is not positive, or leaves fewer than two frames.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps is {fps}, expected a positive number")
    time = np.arange(int(np.floor(motion.duration * fps + 1e-6)) + 1) / fps
    positions = spline(motion.time, motion.positions)(np.minimum(time, motion.duration))
    return replace(motion, positions=positions, fps=float(fps))


def time_scale(motion: HumanMotion, factor: float) -> HumanMotion:
    """The same path in ``factor`` times the duration, at the same fps: 2 is half as fast.

    Raises:
        ValueError: ``factor`` is not positive, or leaves fewer than two frames.
    """
    if not (np.isfinite(factor) and factor > 0):
        raise ValueError(f"factor is {factor}, expected a positive number")
    return resample(replace(motion, fps=motion.fps / factor), motion.fps)
