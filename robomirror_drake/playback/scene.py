"""What a playback shows, apart from how it is shown: bodies, their meshes and their motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh

from robomirror_drake.messages import Array, Execution, Foresight, HumanMotion, Outcome
from robomirror_drake.motion.skeleton import INDEX, PARENTS
from robomirror_drake.results import Result
from robomirror_drake.robot import Robot, rotation_matrix

FRAMES_PER_SECOND = 30
BONE_RADIUS = 0.025
"""[m]"""

HEAD_RADIUS = 0.09
"""[m]"""

HUMAN_OFFSET = np.array([0.0, -2.2, 0.0])
REFERENCE_OFFSET = np.array([0.0, -1.1, 0.0])
"""Where the human and the reference are drawn, so that all three stand side by side [m]."""

NOWHERE = np.zeros(3)
"""No offset: where the robot itself is drawn [m]."""

ORIGINAL_COLOR = (0.86, 0.16, 0.18, 0.45)
"""Of the robot that does what was commanded, where it does something else instead."""

FALL_COLOR = (0.82, 0.14, 0.18, 1.0)
HANDOVER_COLOR = (0.51, 0.31, 0.87, 1.0)
GAUGE_COLOR = (0.55, 0.60, 0.66, 1.0)
ALLOWED_COLOR = (0.82, 0.14, 0.18, 1.0)
RISK_COLOR = (0.12, 0.44, 0.92, 1.0)
BELOW = -50.0
"""Height of what is not to be seen yet [m]."""

HUMAN_COLOR = (0.24, 0.47, 0.85, 1.0)
REFERENCE_COLOR = (0.66, 0.70, 0.74, 1.0)

Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class Mesh:
    """A mesh at a fixed place on a body.

    Attributes:
        obj: Contents of an OBJ file [m].
        color: Red, green, blue, opacity, each 0 to 1.
        pose: (4, 4) pose in the body's frame.
    """

    obj: str
    color: Color
    pose: Array


@dataclass(frozen=True)
class Body:
    """A rigid body that moves.

    Attributes:
        path: Its place in the scene tree, as ``human/left_knee``.
        meshes: What is drawn of it.
        position: (T, 3) in world [m].
        quaternion: (T, 4) orientation in world, wxyz.
    """

    path: str
    meshes: tuple[Mesh, ...]
    position: Array
    quaternion: Array


@dataclass(frozen=True)
class Scene:
    """Bodies moving together at :data:`FRAMES_PER_SECOND`, and where to look from.

    Attributes:
        bodies: The bodies.
        camera: (3,) where the camera is [m].
        target: (3,) what it looks at [m].
    """

    bodies: tuple[Body, ...]
    camera: Array
    target: Array


def build_scene(result: Result, robot: Robot) -> Scene:
    """From left to right: the human motion, the robot's reference, the robot executing it.

    Where the motion was adapted and the original was executed too, that robot stands in place
    of the reference, red and translucent. Where risks were foreseen, a ball on a pole of one
    metre beside each robot shows P(fall), a ring what is allowed; a red ring lies where a robot
    fell, from then on, a violet one where it was handed another motion.
    """
    execution, run = result.execution, result.adaptation
    original = None if run is None else run.original
    last = execution.time[-1]
    if original is not None:
        last = max(last, original.execution.time[-1])
    time = np.arange(0.0, last, 1.0 / FRAMES_PER_SECOND)
    done = execution.q[_samples(execution, time)]
    path = done[:, 4:7]
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    bodies = [
        *human_bodies(result.candidates[result.chosen], time),
        *robot_bodies(robot, done, "robot"),
        *fall_mark(result.outcome, execution, time, "robot"),
    ]
    if original is None:
        told = execution.q_ref[_samples(execution, time)]
        told[:, 4:7] += REFERENCE_OFFSET
        bodies += robot_bodies(robot, told, "reference", REFERENCE_COLOR)
    else:
        other = original.execution.q[_samples(original.execution, time)]
        other[:, 4:7] += REFERENCE_OFFSET
        bodies += robot_bodies(robot, other, "original", ORIGINAL_COLOR)
        bodies += fall_mark(
            original.outcome, original.execution, time, "original", REFERENCE_OFFSET
        )
    if run is not None:
        allowed = run.record.allowed
        bodies += gauge(run.foresight, allowed, time, "robot", middle, RISK_COLOR)
        for number, handover in enumerate(h for h in run.record.handovers if h.done):
            place = execution.q[_samples(execution, np.array([handover.start]))[0], 4:7]
            bodies.append(mark(f"handover_{number}", place, handover.start, time, HANDOVER_COLOR))
        if original is not None:
            beside = middle + REFERENCE_OFFSET
            bodies += gauge(original.foresight, allowed, time, "original", beside, ALLOWED_COLOR)
    height = 0.8 if run is None else 1.1  # room above for what lies over the page
    target = np.array([middle[0], middle[1] + REFERENCE_OFFSET[1], height])
    distance = 2.7 + 0.6 * float(np.linalg.norm(np.ptp(path[:, :2], axis=0)))
    return Scene(tuple(bodies), target + distance * np.array([0.93, 0.25, 0.27]), target)


def _samples(execution: Execution, time: Array) -> npt.NDArray[np.intp]:
    """The samples of an execution at some times; its last one is held."""
    return np.minimum(np.searchsorted(execution.time, time - 1e-9), len(execution.time) - 1)


def fall_mark(
    outcome: Outcome, execution: Execution, time: Array, path: str, offset: Array = NOWHERE
) -> tuple[Body, ...]:
    """A ring on the floor where the robot fell, once it has; nothing where it did not."""
    if outcome.fall_time_s is None:
        return ()
    place = execution.q[np.searchsorted(execution.time, outcome.fall_time_s), 4:7] + offset
    return (mark(f"{path}_fall", place, outcome.fall_time_s, time, FALL_COLOR),)


def mark(path: str, place: Array, start: float, time: Array, color: Color) -> Body:
    """A ring on the floor at a place, from a time on."""
    position = np.tile([place[0], place[1], 0.02], (len(time), 1))
    position[time < start, 2] = BELOW
    ring = trimesh.creation.torus(major_radius=0.35, minor_radius=0.02, major_sections=64)
    return _upright(path, (Mesh(_obj(ring), color, np.eye(4)),), position)


def gauge(
    foresight: Foresight, allowed: float, time: Array, path: str, place: Array, color: Color
) -> tuple[Body, ...]:
    """A pole of one metre to the left of a place, with P(fall) as a ball on it."""
    foot = np.array([place[0], place[1] + 0.5, 0.0])
    pole = trimesh.creation.cylinder(radius=0.012, height=1.0)
    ring = trimesh.creation.torus(major_radius=0.06, minor_radius=0.010)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    still = np.tile(foot, (len(time), 1))
    moving = still.copy()
    moving[:, 2] = np.interp(time, foresight.time, foresight.underway)
    scale = (
        Mesh(_obj(pole), GAUGE_COLOR, _lifted(0.5)),
        Mesh(_obj(ring), ALLOWED_COLOR, _lifted(allowed)),
    )
    return (
        _upright(f"{path}_gauge", scale, still),
        _upright(f"{path}_risk", (Mesh(_obj(ball), color, np.eye(4)),), moving),
    )


def _upright(path: str, meshes: tuple[Mesh, ...], position: Array) -> Body:
    """A body that never turns."""
    return Body(path, meshes, position, np.tile([1.0, 0.0, 0.0, 0.0], (len(position), 1)))


def _lifted(height: float) -> Array:
    pose = np.eye(4)
    pose[2, 3] = height
    return pose


def robot_bodies(robot: Robot, q: Array, path: str, color: Color | None = None) -> tuple[Body, ...]:
    """The links of a robot along a trajectory.

    Args:
        robot: The robot.
        q: (T, 30) positions, Drake order.
        path: Where they stand in the scene tree.
        color: One colour for all links; by default those of the description.
    """
    model = robot.model
    data = model.createData()
    poses = np.empty((len(q), model.njoints, 7))
    for frame, q_pin in enumerate(robot.to_pinocchio(q)):
        pin.forwardKinematics(model, data, pin.normalize(model, q_pin))
        poses[frame] = [pin.SE3ToXYZQUAT(placement) for placement in data.oMi]
    visuals = pin.buildGeomFromUrdf(
        model, str(robot.urdf), pin.GeometryType.VISUAL, package_dirs=[str(robot.urdf.parent)]
    )
    meshes: dict[int, list[Mesh]] = {}
    for visual in visuals.geometryObjects:
        r, g, b, a = (float(value) for value in visual.meshColor)
        obj = Path(visual.meshPath).read_text(encoding="utf-8")
        mesh = Mesh(obj, color or (r, g, b, a), visual.placement.homogeneous)
        meshes.setdefault(visual.parentJoint, []).append(mesh)
    return tuple(
        Body(
            path=f"{path}/{model.names[joint]}",
            meshes=tuple(meshes[joint]),
            position=poses[:, joint, :3],
            quaternion=poses[:, joint, [6, 3, 4, 5]],
        )
        for joint in sorted(meshes)
    )


def human_bodies(motion: HumanMotion, time: Array) -> tuple[Body, ...]:
    """A human motion as a figure of capsules with a ball for a head, off to the side.

    Args:
        motion: The motion; its last frame is held once it is over.
        time: (T,) when to look at it [s].
    """
    at = np.minimum(time * motion.fps, len(motion.positions) - 1)
    low = np.minimum(at.astype(np.int64), len(motion.positions) - 2)
    share = (at - low)[:, None, None]
    joints = (1 - share) * motion.positions[low] + share * motion.positions[low + 1] + HUMAN_OFFSET
    bodies = []
    for name, child in INDEX.items():
        parent = PARENTS[child]
        if parent < 0:
            continue
        bone = joints[:, child] - joints[:, parent]
        length = np.linalg.norm(bone, axis=1)
        if length.min() < 0.01:  # two joints in one place make no bone
            continue
        direction = bone / length[:, None]
        bodies.append(
            Body(
                path=f"human/{name}",
                meshes=(_capsule(float(length.mean()), direction[0]),),
                position=joints[:, parent],
                quaternion=_rotations(direction[0], direction),
            )
        )
    head = trimesh.creation.icosphere(subdivisions=3, radius=HEAD_RADIUS)
    ball = Mesh(_obj(head), HUMAN_COLOR, np.eye(4))
    bodies.append(_upright("human/skull", (ball,), joints[:, INDEX["head"]]))
    return tuple(bodies)


def _capsule(length: float, direction: Array) -> Mesh:
    """A capsule from the origin along a unit vector."""
    shape = trimesh.creation.capsule(height=length, radius=BONE_RADIUS, count=[16, 8])
    R = rotation_matrix(_rotations(np.array([0.0, 0.0, 1.0]), direction[None])[0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, 0.5 * length * direction
    return Mesh(_obj(shape), HUMAN_COLOR, pose)


def _obj(mesh: trimesh.Trimesh) -> str:
    return str(mesh.export(file_type="obj", include_normals=True, header=None, digits=5))


def _rotations(start: Array, directions: Array) -> Array:
    """(T, 4) quaternions wxyz of the shortest rotations from one unit vector to others."""
    w = 1.0 + directions @ start
    quaternion = np.column_stack([w, np.cross(start, directions)])
    opposite = w < 1e-9  # any axis across ``start`` turns it around
    across = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
    quaternion[opposite] = np.r_[0.0, across]
    return np.asarray(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
