"""Stick figures in inline SVG, seen from their right side and a little from ahead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robomirror_drake.messages import Array

_AZIMUTH = np.deg2rad(25.0)  # the camera looks from the right side, this much from ahead
_ARM = ("shoulder", "elbow", "wrist")


class Shape(NamedTuple):
    """A line of a figure, or the outline of a sole.

    Attributes:
        kind: Class, which the page gives a colour.
        points: (n, 3) where it goes [m].
        ankle: (3,) what the middle of a sole hangs on [m]; None for a line.
    """

    kind: str
    points: Array
    ankle: Array | None = None


def chains(trunk: tuple[str, ...], leg: tuple[str, ...]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Class and joints of each line: ``t`` of the trunk, ``l`` and ``r`` of left and right limbs.

    Args:
        trunk: Joints of the spine.
        leg: Joints of a leg, without the side.
    """
    return (
        ("t", trunk),
        ("t", ("left_shoulder", "neck", "right_shoulder")),
        ("t", ("left_hip", "pelvis", "right_hip")),
        *(
            (side[0], tuple(f"{side}_{joint}" for joint in joints))
            for side in ("left", "right")
            for joints in (_ARM, leg)
        ),
    )


def figure(
    shapes: Sequence[Shape],
    head: Array,
    radius: float,
    place: tuple[float, float],
    scale: float,
    yaw: float = 0.0,
) -> str:
    """One figure; what is nearer to the camera is drawn over what is farther.

    Args:
        shapes: Its lines, over the place on the floor where it stands.
        head: (3,) middle of its head, likewise [m].
        radius: Of the head [m].
        place: Where in the picture that place on the floor is [px].
        scale: Of the picture [px/m].
        yaw: Where it faces [rad].
    """
    across = np.array([np.cos(yaw + _AZIMUTH), np.sin(yaw + _AZIMUTH), 0.0])
    into = np.array([-np.sin(yaw + _AZIMUTH), np.cos(yaw + _AZIMUTH), 0.0])

    def shown(point: Array) -> tuple[str, str]:
        x, y = place[0] + scale * (point @ across), place[1] - scale * point[2]
        return f"{x:.1f}", f"{y:.1f}"

    def at(point: Array) -> str:
        return " ".join(shown(point))

    drawn: list[tuple[float, str]] = []
    for kind, points, ankle in shapes:
        line = "L".join(at(point) for point in points)
        if ankle is not None:
            line += f"ZM{at(ankle)}L{at(points.mean(axis=0))}"
        drawn.append((float(np.mean(points @ into)), f'<path class="{kind}" d="M{line}"/>'))
    x, y = shown(head)
    circle = f'<circle class="t" cx="{x}" cy="{y}" r="{scale * radius:.1f}"/>'
    drawn.append((float(head @ into), circle))
    return "".join(shape for _, shape in sorted(drawn, key=lambda part: -part[0]))
