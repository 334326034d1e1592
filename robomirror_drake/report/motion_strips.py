"""A motion as a strip of stick figures and the way it takes over the floor, in inline SVG."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.ground import FEET, face_forward
from robomirror_drake.motion.skeleton import INDEX
from robomirror_drake.report.stick_figures import Shape, chains, figure

MOMENTS = 7
"""Figures in a strip."""

_SCALE = 44.0  # of figures [px/m]
_SLOT, _TOP, _GROUND = 58.0, 6.0, 110.0  # width of a figure's place, and heights [px]
_MAP = 96.0  # size of the view from above [px]

_CHAINS = chains(
    ("pelvis", "spine1", "spine2", "spine3", "neck", "head"), ("hip", "knee", "ankle", "foot")
)
_AT_REST = 0.15  # slower than this, no joint is going anywhere [m/s]
_HEAD = 0.10  # radius, over the skull's base [m]


def strip(motion: HumanMotion, moments: int = MOMENTS) -> Markup:
    """The motion at evenly spaced moments between its rests, from the side, and from above.

    Left limbs have the class ``l``, right ones ``r``, the trunk ``t``; every figure stands in a
    place of its own on the floor, so how far it has come is told by the path alone. From above:
    the pelvis' way, up being ahead, and where each foot bears: a foot that slides leaves a streak.
    """
    motion = face_forward(motion)
    frames = _moments(motion, moments)
    parts = [f'<path class="floor" d="M0 {_GROUND:g}H{moments * _SLOT:g}"/>']
    for place, frame in enumerate(frames):
        middle = (place + 0.5) * _SLOT
        parts.append(_figure(motion.positions[frame], middle))
        label = f"{frame / motion.fps:.1f} s"
        parts.append(f'<text x="{middle:g}" y="{_GROUND + 13:g}">{label}</text>')
    parts.append(_way(motion, frames, moments * _SLOT + 8.0))
    width, height = moments * _SLOT + _MAP + 16.0, _GROUND + 18.0
    return Markup(
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img">' + "".join(parts) + "</svg>"
    )


def _moments(motion: HumanMotion, number: int) -> npt.NDArray[np.int64]:
    """(number,) frames, evenly spaced from where the body begins to move to where it rests."""
    speed = np.linalg.norm(np.diff(motion.positions, axis=0), axis=2).max(axis=1) * motion.fps
    moving = np.flatnonzero(speed > _AT_REST)
    first, last = (moving[0], moving[-1] + 1) if len(moving) else (0, len(speed))
    return np.linspace(first, last, number).round().astype(np.int64)


def _figure(positions: Array, middle: float) -> str:
    """One stick figure of positions (22, 3), its pelvis over the middle of its place."""
    local = positions - positions[0] * [1.0, 1.0, 0.0]
    shapes = [Shape(kind, local[[INDEX[name] for name in names]]) for kind, names in _CHAINS]
    up = local[INDEX["head"]] - local[INDEX["neck"]]
    crown = local[INDEX["head"]] + _HEAD * up / max(float(np.linalg.norm(up)), 1e-9)
    return figure(shapes, crown, _HEAD, (middle, _GROUND), _SCALE)


def _way(motion: HumanMotion, frames: npt.NDArray[np.int64], left: float) -> str:
    """The view from above in a square at ``left``: ahead is up, left is left."""
    pelvis = motion.positions[:, 0, :2]
    feet = motion.positions[:, FEET[:, 1], :2]
    every = np.concatenate([pelvis, feet.reshape(-1, 2)])
    centre = 0.5 * (every.min(axis=0) + every.max(axis=0))
    size = max(1.0, float(np.ptp(every, axis=0).max()))
    scale = (_MAP - 8.0) / size

    def on_map(points: Array) -> list[str]:
        u = left + 0.5 * _MAP - scale * (points[:, 1] - centre[1])
        v = _TOP + 0.5 * _MAP - scale * (points[:, 0] - centre[0])
        return [f"{a:.1f} {b:.1f}" for a, b in zip(u, v, strict=True)]

    step = max(1, round(motion.fps / 20.0))
    parts = [f'<rect class="map" x="{left:g}" y="{_TOP:g}" width="{_MAP:g}" height="{_MAP:g}"/>']
    bearing = foot_contacts(motion)[:, :, 1]
    for side, color in enumerate("lr"):
        stood = on_map(feet[::step, side][bearing[::step, side]])
        parts.append(f'<path class="{color} foot" d="{"".join(f"M{p}h0" for p in stood)}"/>')
    parts.append(f'<path class="way" d="M{"L".join(on_map(pelvis[::step]))}"/>')
    parts.append(f'<path class="at" d="{"".join(f"M{p}h0" for p in on_map(pelvis[frames]))}"/>')
    label = f"{size:.1f} m"
    return "".join(parts) + f'<text x="{left + 0.5 * _MAP:g}" y="{_GROUND + 13:g}">{label}</text>'
