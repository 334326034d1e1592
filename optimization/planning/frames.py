"""Which points and links of the robot a dynamic plan looks at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization import centroidal
from robomirror_drake.optimization.planning.collision import CapsulePairs
from robomirror_drake.robot import Robot


@dataclass(frozen=True)
class Frames:
    """Which points of the robot the problem looks at.

    Attributes:
        links: Pinocchio ids of the links' frames.
        owner: (P,) row of ``links`` that carries each point: 8 corners, then the keypoints.
        local: (P, 3) points in their links' frames [m].
        trunk: Rows of ``links`` whose orientation is tracked.
        support: (L, 29) which velocities move each link.
        capsules: What to keep apart.
    """

    links: list[int]
    owner: list[int]
    local: Array
    trunk: list[int]
    support: BoolArray
    capsules: CapsulePairs

    @staticmethod
    @lru_cache(maxsize=8)
    def of(robot: Robot) -> Frames:
        """The sole corners, keypoints and trunk links of a robot."""
        keypoints = robot.spec.keypoints.values()
        trunk = [robot.frame_id(robot.spec.base_link)]
        trunk.append(robot.frame_id(robot.spec.keypoints["neck"].link))
        carriers = [frame for frame in robot.foot_frames for _ in range(4)]
        carriers += [robot.frame_id(keypoint.link) for keypoint in keypoints]
        bulky = {robot.frame_id(capsule.link) for capsule in robot.spec.collision.values()}
        links = sorted({*carriers, *trunk, *bulky})
        return Frames(
            links=links,
            owner=[links.index(frame) for frame in carriers],
            local=np.concatenate(
                [robot.sole_corners.reshape(8, 3), [keypoint.point for keypoint in keypoints]]
            ),
            trunk=[links.index(frame) for frame in trunk],
            support=centroidal.frame_support(robot.model, links),
            capsules=CapsulePairs.of(robot, links),
        )

    def points(self, links: Array) -> Array:
        """(T, P, 3) the points in world, from link poses (T, L, 4, 4)."""
        carried = links[:, self.owner]
        turned = np.einsum("tpij,pj->tpi", carried[..., :3, :3], self.local)
        return np.asarray(turned + carried[..., :3, 3])

    def points_of(self, robot: Robot, x: Array) -> Array:
        """(T, P, 3) the points in world, of configurations x (T, 30)."""
        return self.points(centroidal.link_poses(robot, self.links, x))


def soles(points: Array) -> Array:
    """(T, 2, 4, 3) the sole corners among (T, P, 3) points of :class:`Frames`."""
    return points[:, :8].reshape(-1, 2, 4, 3)
