"""What a textbook looks at to tell a fall: tilt, and where mass and capture point are."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from robomirror_drake.messages import Array
from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import Frames
from robomirror_drake.robot import Robot

_NEAR = 0.03  # height above the lowest corner up to which a corner is thought to support [m]
_SHORT = 1e-6  # of a line that has no direction [m]

_UP, _LINEAR, _ANGULAR = 1, 2, 3  # among the vectors of Frames


def balance(robot: Robot, states: Frames) -> Array:
    """(n, 3) tilt of the base [rad]; margins of centre of mass and capture point [m].

    A margin is by how far the point is inside the hull of the sole corners that are down,
    negative outside. The capture point is ξ = c + ċ √(h/g) (Pratt et al. 2006), with h the
    height above the lowest corner.

    Args:
        robot: Whose states they are.
        states: Of n states, as :func:`.features.state_frames` makes them.
    """
    q, v = _configuration(states, len(robot.joint_names))
    body = Body.of(robot).to(q.dtype)
    links = body(q, v)
    corners = torch.cat(
        [
            links.p[:, None, link] + _in_link(robot, foot).to(q.dtype) @ links.R[:, link].mT
            for foot, link in enumerate(body.feet)
        ],
        1,
    )
    low = corners[..., 2].amin(1)
    height = (links.com[:, 2] - low).clamp(min=0.0)
    capture = links.com[:, :2] + links.com_velocity[:, :2] * (height / GRAVITY).sqrt()[:, None]
    down = corners[..., 2] < low[:, None] + _NEAR
    tilt = torch.arccos(states.vectors[:, _UP, 2].clamp(-1.0, 1.0))
    inside = [_inside(point, corners[..., :2], down) for point in (links.com[:, :2], capture)]
    return np.asarray(torch.stack([tilt, *inside], 1).double().numpy())


def _inside(point: Tensor, corners: Tensor, down: Tensor) -> Tensor:
    """(n,) by how far points (n, 2) are inside the hull of the corners (n, 8, 2) that are down.

    It is the least over unit vectors d of max_i c_i·d - x·d: the distance to the nearest edge
    inside, and minus that to the hull outside. The least one is normal to an edge, or points
    from a corner to the point.
    """
    first, second = torch.triu_indices(corners.shape[1], corners.shape[1], 1)
    along = corners[:, first] - corners[:, second]
    normal = torch.stack([-along[..., 1], along[..., 0]], -1)
    directions = torch.cat([normal, -normal, point[:, None] - corners], 1)
    length = directions.norm(dim=-1, keepdim=True)
    reach = (corners - point[:, None]) @ (directions / length.clamp(min=_SHORT)).mT
    reach = torch.where(down[..., None], reach, torch.full_like(reach, -torch.inf)).amax(1)
    return torch.where(length[..., 0] > _SHORT, reach, torch.full_like(reach, torch.inf)).amin(1)


def _in_link(robot: Robot, foot: int) -> Tensor:
    """(4, 3) corners of a sole in the frame of the link that bears it."""
    placement = robot.model.frames[robot.foot_frames[foot]].placement
    corners = [placement.act(corner) for corner in robot.sole_corners[foot]]
    return torch.from_numpy(np.array(corners))


def _configuration(states: Frames, joints: int) -> tuple[Tensor, Tensor]:
    """q (n, 30) and v (n, 29), Drake order, that frames of states are of."""
    x, z = states.vectors[:, 0], states.vectors[:, _UP]
    R = torch.stack([x, torch.linalg.cross(z, x), z], -1)
    quaternion = Rotation.from_matrix(R.double().numpy()).as_quat(scalar_first=True)
    moving = torch.cat([states.vectors[:, _ANGULAR], states.vectors[:, _LINEAR]], -1)
    turned = torch.from_numpy(quaternion).to(x.dtype)
    return (
        torch.cat([turned, states.place, states.scalars[:, :joints]], -1),
        torch.cat([moving, states.scalars[:, joints : 2 * joints]], -1),
    )
