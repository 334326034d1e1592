"""What a human motion asks of a robot's links: scaled keypoints, headings, footholds.

The human's bone directions are kept and the robot's bone lengths put in their
place, starting from a pelvis whose path is scaled by the ratio of leg lengths.
What then still slides or floats of the feet in contact is taken out of the
pelvis' path where it can be, by least squares, and the rest is left to the
solver, which holds the soles at the footholds found here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import Array, BoolArray, HumanMotion
from robomirror_drake.motion.ground import ANKLE_HEIGHT, TOE_HEIGHT
from robomirror_drake.motion.skeleton import INDEX
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.kinematics import body_point, body_poses, make_tree
from robomirror_drake.optimization.retargeting.footholds import footholds, unit
from robomirror_drake.robot import FEET, Robot

RATE = 60.0
"""Samples per second of a reference."""

DIRECTIONS = ("pelvis up", "pelvis left", "chest up", "chest left", "left foot", "right foot")
"""Directions that are asked for beside the keypoints; of the feet, their left."""

SHORTEST_LEG = 0.05
"""Of a human, from hip to ankle, that there is any sense in scaling [m]."""


_TURN_MARGIN = 0.1  # kept from the limits of the hips' yaw [rad]


class Proportions(NamedTuple):
    """The robot's measures that stand in for the human's.

    Attributes:
        keypoints: Names, in the order of the arrays.
        trunk: (P, 3) keypoints of pelvis and chest in the frame of their body [m].
        waist: (3,) origin of the chest's body in the pelvis' frame, joints at zero [m].
        thigh, shin, upper_arm, forearm: Bone lengths [m].
        ankle: Height of the ankle above a flat sole [m].
        toe: (3,) toe keypoint in the ankle's frame [m].
        corners: (2, 4, 3) sole corners from the ankle keypoints, in the frame of the foot [m].
        turnable: (2, 2) how far the hips turn the feet from the pelvis' heading, the other
            joints at zero, rightwards and leftwards [rad].
    """

    keypoints: tuple[str, ...]
    trunk: dict[str, Array]
    waist: Array
    thigh: float
    shin: float
    upper_arm: float
    forearm: float
    ankle: float
    toe: Array
    corners: Array
    turnable: Array


class Targets(NamedTuple):
    """A human motion in the robot's proportions, T samples at 60 Hz.

    Attributes:
        time: (T,) [s].
        keypoints: (T, P, 3) where the keypoints should be [m].
        directions: (T, D, 3) where the :data:`DIRECTIONS` should point.
        pelvis: (T, 3, 3) orientation of the human pelvis.
        contact: (T, 2, 4) which sole corners stand.
        anchor: (T, 2, 4, 3) where they stand; in each phase of contact fixed, but for a pivot [m].
    """

    time: Array
    keypoints: Array
    directions: Array
    pelvis: Array
    contact: BoolArray
    anchor: Array


def proportions(robot: Robot) -> Proportions:
    """Measures the robot with all joints at zero."""
    spec, tree = robot.spec, make_tree(robot)
    R, p = body_poses(tree, np.eye(3)[None], np.zeros((1, robot.model.nv)))
    bodies = {name: body_point(robot, key.link, key.point) for name, key in spec.keypoints.items()}
    at = {name: p[0, b] + R[0, b] @ local for name, (b, local) in bodies.items()}
    chest = bodies["neck"][0]

    def bone(a: str, b: str) -> float:
        return float(np.linalg.norm(at[f"left_{a}"] - at[f"left_{b}"]))

    trunk = ("pelvis", "left_hip", "right_hip", "neck", "left_shoulder", "right_shoulder")
    feet = [spec.feet[foot] for foot in FEET]
    soles = [[body_point(robot, foot.link, c)[1] for c in foot.corners] for foot in feet]
    ankles = [bodies[f"{foot}_ankle"][1] for foot in FEET]
    corners = np.array(soles) - np.array(ankles)[:, None]
    return Proportions(
        keypoints=tuple(spec.keypoints),
        trunk={name: bodies[name][1] for name in trunk},
        waist=p[0, chest] - p[0, 0],
        thigh=bone("hip", "knee"),
        shin=bone("knee", "ankle"),
        upper_arm=bone("shoulder", "elbow"),
        forearm=bone("elbow", "wrist"),
        ankle=-float(corners[0, 0, 2]),
        toe=bodies["left_foot"][1] - bodies["left_ankle"][1],
        corners=corners,
        turnable=_turnable(robot),
    )


def _turnable(robot: Robot) -> Array:
    hips = [robot.joint_names.index(f"{side}_HIP_Y") for side in ("L", "R")]
    least, most = robot.position_limits
    return np.stack([least[hips] + _TURN_MARGIN, most[hips] - _TURN_MARGIN], axis=1)


def make_targets(body: Proportions, motion: HumanMotion, contacts: BoolArray) -> Targets:
    """Scales a human motion to a robot.

    Args:
        body: The robot's measures.
        motion: The human motion.
        contacts: (T_h, 2, 2) contact of (left, right) × (heel, toe) in the motion's frames.

    Raises:
        RetargetingError: The human has no legs to be scaled by.
    """
    samples = int(np.floor(motion.duration * RATE + 1e-6)) + 1
    time = np.arange(samples) / RATE
    degree = min(3, len(motion.positions) - 1)
    human = make_interp_spline(motion.time, motion.positions, k=degree)(time)
    frame = np.minimum(np.rint(time * motion.fps).astype(int), len(contacts) - 1)
    ends = contacts[frame][:, :, [1, 1, 0, 0]]  # toe corners come first

    def at(name: str) -> Array:
        return np.asarray(human[:, INDEX[name]])

    pelvis = _frame(at("spine1") - at("pelvis"), at("left_hip") - at("right_hip"))
    across = at("left_shoulder") - at("right_shoulder")
    chest = _frame(at("neck") - at("spine2"), across)
    legs = [
        np.linalg.norm(at(f"{side}_{a}") - at(f"{side}_{b}"), axis=1)
        for side in FEET
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    length = sum(float(np.median(leg)) for leg in legs) / 2.0
    if length < SHORTEST_LEG:
        name = motion.source or motion.text
        raise RetargetingError(name, {"leg_length": length}, ["leg_length"])
    scale = (body.thigh + body.shin) / length

    key = {"pelvis": at("pelvis") * scale}
    key["pelvis"][:, 2] += body.ankle - scale * ANKLE_HEIGHT
    waist = key["pelvis"] + pelvis @ body.waist
    for name, local in body.trunk.items():
        on_pelvis = name in ("pelvis", "left_hip", "right_hip")
        origin, turn = (key["pelvis"], pelvis) if on_pelvis else (waist, chest)
        key[name] = origin + turn @ local
    foot: list[Array] = []
    for side in FEET:
        for start, end, length in (
            ("hip", "knee", body.thigh),
            ("knee", "ankle", body.shin),
            ("shoulder", "elbow", body.upper_arm),
            ("elbow", "wrist", body.forearm),
        ):
            bone = unit(at(f"{side}_{end}") - at(f"{side}_{start}"))
            key[f"{side}_{end}"] = key[f"{side}_{start}"] + length * bone
        turn = _foot_frame(at(f"{side}_knee"), at(f"{side}_ankle"), at(f"{side}_foot"), pelvis)
        key[f"{side}_foot"] = key[f"{side}_ankle"] + turn @ body.toe
        foot.append(turn)

    soles = np.stack(
        [
            key[f"{side}_ankle"][:, None] + np.einsum("tij,cj->tci", foot[f], body.corners[f])
            for f, side in enumerate(FEET)
        ],
        axis=1,
    )
    shift = _root_correction(time, soles, ends)
    keypoints = np.stack([key[name] for name in body.keypoints], axis=1) + shift[:, None]
    facing = np.unwrap(np.arctan2(-pelvis[:, 0, 1], pelvis[:, 1, 1]))
    contact, anchor = footholds(
        soles + shift[:, None, None], ends, body.corners, facing, body.turnable
    )
    return Targets(
        time=time,
        keypoints=keypoints,
        directions=np.stack(
            [
                *(pelvis[:, :, 2], pelvis[:, :, 1], chest[:, :, 2], chest[:, :, 1]),
                *(turn[:, :, 1] for turn in foot),
            ],
            axis=1,
        ),
        pelvis=pelvis,
        contact=contact,
        anchor=anchor,
    )


def _frame(up: Array, left: Array) -> Array:
    """(T, 3, 3) rotations whose y is ``left`` and whose z is nearest to ``up``."""
    y = unit(left)
    x = unit(np.cross(y, up))
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _foot_frame(knee: Array, ankle: Array, toe: Array, pelvis: Array) -> Array:
    """(T, 3, 3) orientation of a foot: z up and x forward where it stands flat.

    Its left is square to shank and foot, and leans to the pelvis' where the foot is
    stretched in line with the shank. The sole follows from the toe's height in flat stance.
    """
    forward = toe - ankle
    left = np.cross(knee - ankle, forward) / np.linalg.norm(knee - ankle, axis=1, keepdims=True)
    left += 0.1 * np.linalg.norm(forward, axis=1, keepdims=True) * pelvis[:, :, 1]
    f = unit(forward)
    y = unit(left - f * np.sum(left * f, axis=1, keepdims=True))
    length = float(np.median(np.linalg.norm(forward, axis=1)))
    droop = np.arcsin(np.clip((ANKLE_HEIGHT - TOE_HEIGHT) / length, -0.9, 0.9))
    x = np.cos(droop) * f + np.sin(droop) * np.cross(f, y)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _root_correction(time: Array, soles: Array, ends: BoolArray) -> Array:
    """(T, 3) smooth shift of the whole body that keeps feet in contact still, at floor height.

    Args:
        time: (T,) [s].
        soles: (T, 2, 4, 3) corners of the soles as the human's feet have them [m].
        ends: (T, 2, 4) which of them stand.
    """
    basis = spline.basis(time, 0.2)
    velocity = np.gradient(soles, time, axis=0)
    weight = ends / 4.0

    def solve(pull: Array, derivative: int) -> Array:
        band = spline.zero_band(basis.points, 1)
        ones = np.ones((len(time), 1))
        spline.add_diagonal(band, basis, weight.sum(axis=(1, 2))[:, None], derivative)
        spline.add_diagonal(band, basis, 1e-2 * ones)
        spline.add_diagonal(band, basis, 1e-4 * ones, 2)
        right = spline.spread_gradient(basis, pull, derivative)
        return spline.evaluate(basis, spline.substitute(spline.factorize(band), right))

    along = -np.einsum("tfc,tfci->ti", weight, velocity[..., :2])
    up = -np.einsum("tfc,tfc->t", weight, soles[..., 2])[:, None]
    return np.hstack([solve(along, 1), solve(up, 0)])
