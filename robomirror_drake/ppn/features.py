"""What the network sees of a robot: nothing that changes with where it stands and looks to.

Positions and directions are told in the frame of an observer who stands below the robot at
the present moment and looks where it looks. Of the reference there is also what it asks of
the robot: acceleration and zero-moment point, and the torques with which the legs would
have to carry the force that goes with them, were they without mass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from robomirror_drake.messages import Array
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.ppn.body import Body, Links, rotation

_LEAST_LIFT = 0.3  # of gravity, that a foot is thought to bear where the ZMP is worked out
_REACH = 0.12  # of the point of force from the middle of a sole [m]


class Frames(NamedTuple):
    """Features of frames before anyone looks at them.

    Attributes:
        place: (…, 3) where the base is, in world [m].
        vectors: (…, V, 3) directions, velocities and differences of places, in world.
        scalars: (…, S) what does not depend on where the robot stands and looks to.
    """

    place: Tensor
    vectors: Tensor
    scalars: Tensor

    def as_state(self, asked: int) -> Frames:
        """The frames of a reference as those of a robot that does just that.

        Args:
            asked: Scalars that only a reference has, at the end.
        """
        return Frames(self.place, self.vectors[..., :STATE_VECTORS, :], self.scalars[..., :-asked])

    def flat(self) -> Tensor:
        """(…, 3 + 3 V + S) all in a row, as :func:`unflat` takes it."""
        return torch.cat([self.place, self.vectors.flatten(-2), self.scalars], -1)


REFERENCE_VECTORS, STATE_VECTORS = 12, 9
"""How many vectors the frames of a reference and of a state have."""

RECORDED = 60
"""Rows of a reference, and of a recorded execution, in a second."""

PAD = 2
"""Samples before and after a reference that its velocities and accelerations need."""

FORWARD = 0
"""The vector that says where the base looks to."""


def unflat(row: Tensor, vectors: int) -> Frames:
    """Takes rows of :meth:`Frames.flat` apart."""
    place, turning, scalars = torch.split(
        row, [3, 3 * vectors, row.shape[-1] - 3 - 3 * vectors], -1
    )
    return Frames(place, turning.reshape(*row.shape[:-1], vectors, 3), scalars)


def state_frames(body: Body, q: Tensor, v: Tensor) -> Frames:
    """Of states (…, 30), (…, 29), Drake order."""
    links = body(q, v)
    soles = _soles(body, links)
    vectors = torch.cat(_moving(body, links, soles), -2)
    return Frames(q[..., 4:7], vectors, _scalars(soles, q, v))


def reference_frames(body: Body, q: Tensor, contact: Tensor, step: float) -> Frames:
    """Of a motion's samples; velocities and accelerations are central differences of them.

    Args:
        body: Of the robot.
        q: (…, T + 2 PAD, 30) positions, Drake order; the first and the last PAD of them are
            there for the differences alone.
        contact: (…, T, 2, 4) which sole corners are meant to bear load, 0 or 1.
        step: From one sample to the next [s].
    """
    v = velocities(q, step)
    q = q[..., 1:-1, :]
    links = body(q, v)
    a = _differences(links.com_velocity, step)
    time = q.dim() - 2
    q, v, links = _inner(q, time), _inner(v, time), Links(*(_inner(part, time) for part in links))
    soles = _soles(body, links)
    asked = _asked(body, links, soles, a, contact)
    vectors = torch.cat([*_moving(body, links, soles), a[..., None, :], asked.zmp], -2)
    halves = contact.reshape(*contact.shape[:-2], 4, 2).mean(-1)
    scalars = torch.cat([_scalars(soles, q, v), halves, asked.torque], -1)
    return Frames(q[..., 4:7], vectors, scalars)


def _inner(x: Tensor, axis: int) -> Tensor:
    """All but the first and the last along an axis."""
    return x.narrow(axis, 1, x.shape[axis] - 2)


def observed_from(frames: Frames, place: Tensor, heading: Tensor) -> Tensor:
    """(…, T, F) features of frames in the eyes of an observer.

    Args:
        frames: Of T frames.
        place: (…, 3) where the observer stands; its height does not matter.
        heading: (…, 2, 2) horizontal rotation from the observer's frame to the world's.
    """
    there = torch.cat([frames.place[..., :2] - place[..., None, :2], frames.place[..., 2:]], -1)
    seen = torch.cat([there[..., None, :], frames.vectors], -2)
    flat = seen[..., :2] @ heading[..., None, :, :]  # rows times R are Rᵀ times columns
    turned = torch.cat([flat, seen[..., 2:]], -1)
    return torch.cat([turned.flatten(-2), frames.scalars], -1)


def observer(frames: Frames) -> tuple[Tensor, Tensor]:
    """Place (…, 3) and heading (…, 2, 2) of who stands and looks as the robot in a frame."""
    x, y = nn.functional.normalize(frames.vectors[..., FORWARD, :2], dim=-1).unbind(-1)
    return frames.place, torch.stack([x, -y, y, x], -1).reshape(*x.shape, 2, 2)


def seen(states: Tensor, references: Tensor, from_state: bool) -> tuple[Tensor, Tensor]:
    """Flat frames (n, S, F), (n, T, F) in the eyes of who stands where the robot is now.

    Else, not ``from_state``, of who stands where the reference begins.
    """
    past, future = unflat(states, STATE_VECTORS), unflat(references, REFERENCE_VECTORS)
    place, heading = observer(past if from_state else future)
    at = -1 if from_state else 0
    place, heading = place[:, at], heading[:, at]
    return observed_from(past, place, heading), observed_from(future, place, heading)


def rows_at(time: Array, count: int) -> npt.NDArray[np.int64]:
    """Rows of a 60 Hz reference of ``count`` rows at times [s]; the ends are held."""
    return np.clip(np.floor(time * RECORDED + 0.5).astype(np.int64), 0, count - 1)


def velocities(q: Tensor, step: float) -> Tensor:
    """(…, T, 29) velocities of samples (…, T + 2, 30), Drake order, by central differences."""
    R = rotation(q[..., :4])
    turned = R[..., 2:, :, :] @ R[..., :-2, :, :].transpose(-1, -2)
    skew = 0.5 * (turned - turned.transpose(-1, -2))
    spin = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)
    return torch.cat([spin / (2.0 * step), _differences(q[..., 4:], step)], -1)


class _Asked(NamedTuple):
    zmp: Tensor  # (…, 2, 3) from the middle of each sole
    torque: Tensor  # (…, legs' joints) per body weight [m]


def _asked(body: Body, links: Links, soles: Tensor, a: Tensor, contact: Tensor) -> _Asked:
    """What the ground has to give for a motion, and what that asks of the legs' joints."""
    lift = a[..., 2] + GRAVITY
    fall = links.com[..., 2] / lift.clamp(min=_LEAST_LIFT * GRAVITY)
    zmp = links.com[..., :2] - fall[..., None] * a[..., :2]
    away = torch.cat(
        [zmp[..., None, :] - soles[..., :2], torch.zeros_like(soles[..., 2:])], -1
    )  # fmt: skip
    across = soles[..., 0, :2] - soles[..., 1, :2]
    along = ((zmp - soles[..., 1, :2]) * across).sum(-1) / across.square().sum(-1).clamp(min=1e-3)
    shares = torch.stack([along, 1.0 - along], -1).clamp(0.02, 1.0) * contact.mean(-1)
    shares = shares / shares.sum(-1, keepdim=True).clamp(min=1e-3)
    force = torch.cat([a[..., :2], lift[..., None]], -1) / GRAVITY
    at = soles + _within(away, _REACH)
    torques = []
    for foot, leg in enumerate(body.legs):
        arm = at[..., foot, None, :] - links.p[..., [joint + 1 for joint in leg], :]
        moment = torch.linalg.cross(arm, force[..., None, :].expand_as(arm))
        torques.append((links.axis[..., leg, :] * moment).sum(-1) * shares[..., foot, None])
    return _Asked(_within(away, 1.0), torch.cat(torques, -1))


def _within(x: Tensor, reach: float) -> Tensor:
    """Vectors (…, n), shortened to a length where they are longer: alike from all sides."""
    length = torch.linalg.vector_norm(x, dim=-1, keepdim=True)
    share: Tensor = reach / length.clamp(min=reach)
    return x * share


def _soles(body: Body, links: Links) -> Tensor:
    """(…, 2, 3) middles of the soles."""
    R, p = links.R[..., body.feet, :, :], links.p[..., body.feet, :]
    return p + (R @ body.soles[..., None])[..., 0]


def _moving(body: Body, links: Links, soles: Tensor) -> list[Tensor]:
    """Vectors (…, n, 3) that states and references have."""
    base = links.p[..., :1, :]
    return [
        links.R[..., 0, :, 0::2].transpose(-1, -2),  # forward and up
        links.linear[..., None, :],
        links.angular[..., None, :],
        links.com[..., None, :] - base,
        links.com_velocity[..., None, :],
        soles - base,
        links.R[..., body.feet, :, 2].sum(-2, keepdim=True),
    ]


def _scalars(soles: Tensor, q: Tensor, v: Tensor) -> Tensor:
    """Joint angles and velocities, and the heights of the soles."""
    return torch.cat([q[..., 7:], v[..., 6:], soles[..., 2]], -1)


def _differences(x: Tensor, step: float) -> Tensor:
    """(…, T, n) rates of samples (…, T + 2, n)."""
    return (x[..., 2:, :] - x[..., :-2, :]) / (2.0 * step)
