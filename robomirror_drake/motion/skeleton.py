"""The 22 joints of HumanML3D (SMPL without hands): names, order and parents.

Source: C. Guo et al., "Generating Diverse and Natural 3D Human Motions from
Text", CVPR 2022.
"""

from __future__ import annotations

JOINTS: tuple[str, ...] = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
)
"""Joint names in the order of :attr:`HumanMotion.positions`."""

PARENTS: tuple[int, ...] = (
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19,
)  # fmt: skip
"""Index of each joint's parent; -1 for the pelvis."""

INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINTS)}
"""Joint index by name."""
