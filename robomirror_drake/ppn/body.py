"""A robot's tree of links in torch: poses, velocities and centre of mass, with gradients.

Pinocchio has all of this and is what it is tested against; here it is batched over windows
and frames, and differentiable, at a fraction of a millisecond for a pool.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor, nn

from robomirror_drake.robot import Robot


class Links(NamedTuple):
    """Poses and velocities of links, in world; "…" are any axes.

    Link 0 is the base, the others stand in the order of the joints.

    Attributes:
        R: (…, L, 3, 3) rotations.
        p: (…, L, 3) origins [m].
        axis: (…, L - 1, 3) axes of the joints.
        angular, linear: (…, 3) velocities of the base [rad/s], [m/s].
        com: (…, 3) centre of mass of the robot [m].
        com_velocity: (…, 3) [m/s].
    """

    R: Tensor
    p: Tensor
    axis: Tensor
    angular: Tensor
    linear: Tensor
    com: Tensor
    com_velocity: Tensor


class Body(nn.Module):
    """The constants of a robot's tree; nothing in it is learned."""

    mass: Tensor
    center: Tensor
    rotation: Tensor
    translation: Tensor
    axis: Tensor
    soles: Tensor
    visited: Tensor
    order: Tensor
    above: Tensor
    skew: Tensor
    square: Tensor

    def __init__(
        self, parents: list[int], legs: list[list[int]], feet: list[int], **constants: Tensor
    ) -> None:
        super().__init__()
        self.parents, self.legs, self.feet = parents, legs, feet
        levels = _levels(parents)
        # Joints are passed level by level, so that those of a level lie side by side.
        visited = [joint for level in levels for joint in level.links]
        constants["visited"] = torch.tensor(visited)
        constants["order"] = torch.tensor(np.argsort([0, *(1 + joint for joint in visited)]))
        ends = np.cumsum([0, *(len(level.links) for level in levels)]).tolist()
        self.levels = [slice(*pair) for pair in pairwise(ends)]
        for number, level in enumerate(levels):
            constants[f"above_{number}"] = torch.tensor(level.above)
        constants["skew"] = _skew(constants["axis"][visited])
        constants["square"] = constants["skew"] @ constants["skew"]
        for name in ("rotation", "translation"):
            constants[name] = constants[name][visited]
        chains = [_chain(parents, link) for link in range(1, len(parents) + 1)]
        above = [
            [float(joint in chain) for chain in [[], *chains]] for joint in range(len(parents))
        ]
        constants["above"] = torch.tensor(above, dtype=torch.float64)
        for name, value in constants.items():
            self.register_buffer(name, value, persistent=False)

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """The tree of a robot, in double precision; ``.float()`` makes it single."""
        model = robot.model
        joints = range(2, model.njoints)  # 0 is the world, 1 the base
        placements = [model.jointPlacements[j] for j in joints]
        axes = [np.ravel(model.joints[j].createData().S)[3:] for j in joints]
        feet = [model.frames[frame] for frame in robot.foot_frames]
        soles = [
            foot.placement.act(corners.mean(axis=0))
            for foot, corners in zip(feet, robot.sole_corners, strict=True)
        ]
        links = [int(foot.parentJoint) - 1 for foot in feet]
        parents = [int(model.parents[j]) - 1 for j in joints]
        inertias = list(model.inertias)[1:]
        constants = {
            "mass": [inertia.mass for inertia in inertias],
            "center": [inertia.lever for inertia in inertias],
            "rotation": [placement.rotation for placement in placements],
            "translation": [placement.translation for placement in placements],
            "axis": axes,
            "soles": soles,
        }
        return cls(
            parents,
            [_chain(parents, link) for link in links],
            links,
            **{name: torch.from_numpy(np.array(value)) for name, value in constants.items()},
        )

    def forward(self, q: Tensor, v: Tensor) -> Links:
        """Links of positions (…, 30) and velocities (…, 29), Drake order.

        The quaternion need not be a unit one: its direction counts.
        """
        turned = self.rotation @ self._about(q[..., 7:].index_select(-1, self.visited))
        R, p = [rotation(q[..., :4])[..., None, :, :]], [q[..., None, 4:7]]
        for number, level in enumerate(self.levels):
            parents = self.get_buffer(f"above_{number}")
            above = R[-1].index_select(-3, parents)
            arm = (above @ self.translation[level, :, None])[..., 0]
            R.append(above @ turned[..., level, :, :])
            p.append(p[-1].index_select(-2, parents) + arm)
        R_all = torch.cat(R, -3).index_select(-3, self.order)
        p_all = torch.cat(p, -2).index_select(-2, self.order)
        axis = (R_all[..., 1:, :, :] @ self.axis[..., None])[..., 0]
        share = self.mass / self.mass.sum()
        placed = share[:, None] * (p_all + (R_all @ self.center[..., None])[..., 0])
        com = placed.sum(-2)
        # A joint turns what is above it: it moves the centre of that mass about its axis.
        lever = self.above @ placed - (self.above @ share)[:, None] * p_all[..., 1:, :]
        turning = torch.linalg.cross(axis, lever) * v[..., 6:, None]
        spin, shift = v[..., :3], v[..., 3:6]
        speed = shift + torch.linalg.cross(spin, com - q[..., 4:7]) + turning.sum(-2)
        return Links(R_all, p_all, axis, spin, shift, com, speed)

    def _about(self, angle: Tensor) -> Tensor:
        """(…, J, 3, 3) rotations about the joints' axes by angles (…, J) (Rodrigues)."""
        sine, cosine = angle.sin()[..., None, None], angle.cos()[..., None, None]
        unit = torch.eye(3, dtype=angle.dtype, device=angle.device)
        return unit + sine * self.skew + (1.0 - cosine) * self.square


class _Level(NamedTuple):
    """Joints at the same distance from the base, and where their parents stand among the last."""

    links: list[int]
    above: list[int]


def _levels(parents: list[int]) -> list[_Level]:
    depth: list[int] = []
    for parent in parents:
        depth.append(1 if parent == 0 else depth[parent - 1] + 1)
    levels, last = [], [0]
    for number in range(1, max(depth) + 1):
        joints = [i for i, d in enumerate(depth) if d == number]
        levels.append(_Level(joints, [last.index(parents[i]) for i in joints]))
        last = [i + 1 for i in joints]
    return levels


def _chain(parents: list[int], link: int) -> list[int]:
    """The joints from the base to a link."""
    chain = []
    while link > 0:
        chain.append(link - 1)
        link = parents[link - 1]
    return chain[::-1]


def _skew(axis: Tensor) -> Tensor:
    """(J, 3, 3) matrices of cross products with axes (J, 3)."""
    zero = torch.zeros_like(axis[:, 0])
    x, y, z = axis.unbind(-1)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)


def rotation(quaternion: Tensor) -> Tensor:
    """(…, 3, 3) rotations of quaternions wxyz (…, 4) of any length but zero."""
    w, x, y, z = nn.functional.normalize(quaternion, dim=-1).unbind(-1)
    entries = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(entries, -1).reshape(*w.shape, 3, 3)
