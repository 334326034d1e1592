"""What is free in the adaptation of a reference, and what it costs to change it.

All variables z are without unit and zero for the command: σ, α − 1 and β − 1 (tempo, amplitude,
stride) and the control points of offsets δ in the path's own time, each by its scale. With the
coordinates y of :mod:`.path`, the deviation at a time τ is linear,

    y − y_command = (α − 1) E + (β − 1) S + δ,

and so the cost ½ zᵀ H z is quadratic: the mean over τ of the squared deviation, each coordinate
by the scale that the user gave it, the offsets' accelerations a little, and the tempo.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.adaptation.options import AdaptOptions, Variable
from robomirror_drake.optimization.adaptation.path import MotionPath

GLOBAL: tuple[Variable, ...] = ("tempo", "amplitude", "stride")
TWISTS = 18
"""Coordinates y: [turn, position] of pelvis, left and right foot, then the upper joints."""

_COLUMNS: Mapping[Variable, list[int]] = {
    "base": [3, 4, 5],
    "lean": [0, 1],
    "feet": [9, 10, 11, 15, 16, 17],
}
_UNIT = 0.25  # of amplitude and stride
_ARM = 0.3  # a foot's turn by its position [m/rad]
_GRID = 0.05  # of the times at which deviation is measured [s]
_EMPTY = 1e-3  # amplitudes and ways less than this change nothing [m, rad]


class Layout(NamedTuple):
    """The variables z (X,) of one path.

    Attributes:
        blocks: Which of them is what.
        columns: Coordinates y that the offsets of each block move.
        scale: (X,) unit of each.
        lower, upper: (X,) bounds.
        spacing: Of the offsets' knots [s].
        tie: (K, F) control points of an offset from its free ones: none at the start, one
            value at an end in rest.
        hessian: (X, X) H.
    """

    blocks: dict[Variable, slice]
    columns: dict[Variable, list[int]]
    scale: Array
    lower: Array
    upper: Array
    spacing: float
    tie: Array
    hessian: Array

    @property
    def size(self) -> int:
        """X."""
        return len(self.scale)

    def changes(self, z: Array) -> tuple[float, float, float]:
        """σ, α − 1, β − 1 of variables (X,); zero for what is not free."""
        x = z * self.scale
        sigma, alpha, beta = (
            float(x[self.blocks[name]][0]) if name in self.blocks else 0.0 for name in GLOBAL
        )
        return sigma, alpha, beta

    def basis(self, tau: Array) -> tuple[Array, Array, Array]:
        """(N, F) weights of the free control points at times (N,), and their derivatives."""
        made = spline.basis(tau, self.spacing, len(self.tie))
        value, rate, bend = (spline.evaluate(made, self.tie, order) for order in range(3))
        return value, rate, bend


def make_layout(path: MotionPath, options: AdaptOptions) -> Layout:
    """The variables that the options set free, of a path."""
    scales, bounds = options.scales, options.bounds
    intervals = min(round(path.duration / options.knot_spacing), options.most_knots)
    intervals = max(spline.ORDER - 1, intervals)
    points = intervals + spline.ORDER - 1
    last = spline.ORDER - 1 if path.resting[1] else 1
    free = points - (spline.ORDER - 1) - last + 1
    tie = np.zeros((points, free))
    tie[-free - last + 1 :, :] = np.eye(free + last - 1, free)
    tie[-last:, -1] = 1.0
    tau = np.linspace(0.0, path.duration, max(5, round(path.duration / _GRID) + 1))
    point = path.at(tau)
    columns = {**_COLUMNS, "upper": list(range(TWISTS, TWISTS + path.upper))}

    limits: dict[Variable, tuple[float, float]] = {
        "tempo": (1.0 / bounds.fastest - 1.0, 1.0 / bounds.slowest - 1.0),
        "amplitude": (bounds.amplitude - 1.0, 0.1),
        "stride": (bounds.stride - 1.0, 0.1),
    }
    directions = {
        "amplitude": stacked(point.turn[0], point.excursion[0], point.bend[0]),
        "stride": stacked(np.zeros_like(point.turn[0]), point.way[0], 0.0 * point.bend[0]),
    }
    units = {"tempo": scales.tempo, "amplitude": _UNIT, "stride": _UNIT}
    blocks: dict[Variable, slice] = {}
    used: dict[Variable, list[int]] = {}
    scale: list[float] = []
    lower: list[float] = []
    upper: list[float] = []
    for name in options.variables:
        start = len(scale)
        if name in GLOBAL:
            if name in directions and np.abs(directions[name]).max() < _EMPTY:
                continue
            scale.append(units[name])
            lower.append(limits[name][0] / units[name])
            upper.append(limits[name][1] / units[name])
        else:
            if name == "feet" and not point.swing[0].any():
                continue
            used[name] = columns[name]
            count = free * len(columns[name])
            unit, most = getattr(scales, name), getattr(bounds, name)
            scale += [unit] * count
            lower += [-most / unit] * count
            upper += [most / unit] * count
        blocks[name] = slice(start, len(scale))
    layout = Layout(
        blocks=blocks,
        columns=used,
        scale=np.array(scale),
        lower=np.array(lower),
        upper=np.array(upper),
        spacing=path.duration / intervals,
        tie=tie,
        hessian=np.empty((0, 0)),
    )
    return layout._replace(hessian=_hessian(layout, options, tau, point.swing[0], directions))


def stacked(turn: Array, position: Array, bend: Array) -> Array:
    """(P, Y) coordinates, or rates of them, of links (P, 3, 3), twice, and upper joints (P, U)."""
    return np.hstack([np.concatenate([turn, position], axis=2).reshape(len(turn), -1), bend])


def _hessian(
    layout: Layout,
    options: AdaptOptions,
    tau: Array,
    swing: Array,
    directions: dict[str, Array],
) -> Array:
    scales = options.scales
    weights, _, bends = layout.basis(tau)
    width = directions["amplitude"].shape[1]
    unit = np.full(width, scales.upper)
    unit[:3], unit[3:6], unit[6:TWISTS] = scales.lean, scales.base, scales.feet
    unit[[6, 7, 8, 12, 13, 14]] /= _ARM
    H = np.zeros((layout.size, layout.size))
    shared = [name for name in layout.blocks if name in directions]
    for name in shared:
        for other in shared:
            product = directions[name] * directions[other] / unit**2
            H[layout.blocks[name], layout.blocks[other]] = np.sum(product) / len(tau)
    for name, columns in layout.columns.items():
        # The coordinates of a block are independent of each other, and alike but for the swing.
        block, count = layout.blocks[name], len(columns)
        for i, y in enumerate(columns):
            own = slice(block.start + i, block.stop, count)
            shown = weights * swing[:, i // 3, None] if name == "feet" else weights
            bent = scales.smooth**2 * bends
            H[own, own] = (shown.T @ shown + bent.T @ bent) / unit[y] ** 2 / len(tau)
            for other in shared:
                cross = shown.T @ directions[other][:, y] / unit[y] ** 2 / len(tau)
                H[own, layout.blocks[other].start] = H[layout.blocks[other].start, own] = cross
    H *= layout.scale[:, None] * layout.scale
    for name in GLOBAL:
        if name in layout.blocks:
            i = layout.blocks[name].start
            H[i, i] += (layout.scale[i] / getattr(scales, name)) ** 2
    return H + 1e-4 * np.eye(layout.size)
