"""What Pinocchio wrote, without asking it for each part: views that are made once."""

from __future__ import annotations

from typing import Any, NamedTuple

import pinocchio as pin

from robomirror_drake.messages import Array

Four = tuple[Array, Array, Array, Array]


class MotionViews(NamedTuple):
    """Motion of the four task frames and of the whole, as Pinocchio has it.

    Attributes:
        R, p: (3, 3), (3,) pose of each frame in world.
        joint_R: (3, 3) rotation of the joint that carries each frame.
        joint_v, joint_a: (6,) that joint's spatial velocity and acceleration in its own axes at
            its origin, linear first.
        com: (3,) centre of mass [m].
        momentum, force: (6,) centroidal momentum and its rate, linear first.
    """

    R: Four
    p: Four
    joint_R: Four
    joint_v: Four
    joint_a: Four
    com: Array
    momentum: Array
    force: Array


class DynamicsViews(NamedTuple):
    """Dynamics of the whole robot, as Pinocchio has them.

    Attributes:
        M: (29, 29) mass matrix.
        h: (29,) Coriolis, centrifugal and gravity terms.
        momentum: (6, 29) centroidal momentum matrix, linear first.
        J: (6, 29) joint axes in world about its origin, linear first.
    """

    M: Array
    h: Array
    momentum: Array
    J: Array


class Memory(NamedTuple):
    """Memory that Pinocchio works in; every use overwrites what the last one left there.

    To look up a part of it from Python takes about as long as to work it out. The views show
    what was written last, and are good for as long as ``data`` lives.

    Attributes:
        model, frames, carriers: What it was made for, see :func:`memory_of`.
        data: Pinocchio's own.
        motion: Views of the motion.
        dynamics: Views of the dynamics.
        links: (3, 3) rotations and (3,) origins of the links that carry capsules.
    """

    model: pin.Model
    frames: tuple[int, ...]
    carriers: tuple[int, ...]
    data: pin.Data
    motion: MotionViews
    dynamics: DynamicsViews
    links: tuple[tuple[Array, ...], tuple[Array, ...]]

    def __deepcopy__(self, _: dict[int, Any]) -> Memory:
        """New memory, as Drake wants for every Context; copied views would show nothing."""
        return memory_of(self.model, self.frames, self.carriers)


def memory_of(model: pin.Model, frames: tuple[int, ...], carriers: tuple[int, ...]) -> Memory:
    """Memory for a model.

    Args:
        model: Pinocchio model.
        frames: Ids of the four task frames.
        carriers: Ids of the frames of the links that carry capsules.
    """
    data = model.createData()
    joints = [model.frames[frame].parentJoint for frame in frames]
    motion = MotionViews(
        R=tuple(data.oMf[frame].rotation for frame in frames),
        p=tuple(data.oMf[frame].translation for frame in frames),
        joint_R=tuple(data.oMi[joint].rotation for joint in joints),
        joint_v=tuple(data.v[joint].vector for joint in joints),
        joint_a=tuple(data.a[joint].vector for joint in joints),
        com=data.com[0],
        momentum=data.hg.vector,
        force=data.dhg.vector,
    )
    poses = [data.oMf[link] for link in carriers]
    return Memory(
        model=model,
        frames=frames,
        carriers=carriers,
        data=data,
        motion=motion,
        dynamics=DynamicsViews(data.M, data.nle, data.Ag, data.J),
        links=(tuple(x.rotation for x in poses), tuple(x.translation for x in poses)),
    )
