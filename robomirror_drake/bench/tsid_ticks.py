"""The ticks of a recorded walk, solved by TSID: run by ``robomirror bench controller``.

TSID's wheels were built for another Pinocchio than ours, so this file is run as a script by
the Python of an environment of its own (``make bench`` builds it) and imports nothing of this
package. States and references come from one ``.npz`` file, times go to another.

Source of the peer: A. Del Prete et al., "Implementing torque control with high-ratio gear
boxes and without joint-torque sensors", IJHR 13 (1), 2016; the package ``tsid``.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

FEET = ("left", "right")
FORCE_REGULARISATION = 1e-5


class Controller:
    """The whole-body controller's tasks, weights, gains and contacts, as TSID has them."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        self.tsid = tsid = importlib.import_module("tsid.tsid_pywrap")
        model = pin.buildModelFromUrdf(str(given["urdf"]), pin.JointModelFreeFlyer())
        self.frames = [str(name) for name in given["frames"]]
        for foot in range(2):
            link = model.getFrameId(self.frames[2 + foot])
            parent = model.frames[link]
            place = parent.placement * pin.SE3(np.eye(3), given["center"][foot])
            sole = pin.Frame(f"{FEET[foot]}_sole", parent.parentJoint, link, place, pin.OP_FRAME)
            model.addFrame(sole)
            self.frames[2 + foot] = sole.name
        model.armature = np.concatenate([np.zeros(6), given["armature"]])
        self.robot = tsid.RobotWrapper(model, tsid.FLOATING_BASE_SYSTEM, False)
        self.problem = tsid.InverseDynamicsFormulationAccForce("tsid", self.robot, False)
        self.solver = tsid.SolverHQuadProgFast("solver")
        self.gains = dict(zip(given["tasks"], given["gains"], strict=True))
        self._add_tasks(given)
        self._add_bounds(given)
        self.contacts = [self._contact(given, foot) for foot in range(2)]
        self.standing = [False, False]

    def _tuned(self, task: Any, name: str, size: int) -> Any:
        weight, stiffness, damping = self.gains[name]
        task.setKp(stiffness * np.ones(size))
        task.setKd(damping * np.ones(size))
        self.problem.addMotionTask(task, weight**2, 1, 0.0)
        return task

    def _add_tasks(self, given: Mapping[str, Any]) -> None:
        tsid, robot = self.tsid, self.robot
        self.com = self._tuned(tsid.TaskComEquality("com", robot), "com_horizontal", 3)
        self.momentum = self._tuned(tsid.TaskAMEquality("momentum", robot), "angular_momentum", 3)
        self.bodies = [tsid.TaskSE3Equality(name, robot, name) for name in self.frames]
        for task in self.bodies[:2]:
            task.setMask(np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]))
        for task, name in zip(self.bodies, ("pelvis", "trunk", "swing", "swing"), strict=True):
            task.useLocalFrame(False)
            self._tuned(task, name, 6)
        self.posture = tsid.TaskJointPosture("posture", robot)
        joints = len(given["armature"])
        self.posture.setKp(float(given["posture_stiffness"]) * np.ones(joints))
        self.posture.setKd(float(given["posture_damping"]) * np.ones(joints))
        self.problem.addMotionTask(self.posture, float(np.mean(given["posture"] ** 2)), 1, 0.0)

    def _add_bounds(self, given: Mapping[str, Any]) -> None:
        effort = given["effort"]
        torque = self.tsid.TaskActuationBounds("torque", self.robot)
        torque.setBounds(-effort, effort)
        self.problem.addActuationTask(torque, 1.0, 0, 0.0)
        joints = self.tsid.TaskJointBounds("joints", self.robot, float(given["horizon"]))
        most = float(given["acceleration_limit"]) * np.ones(len(effort))
        joints.setAccelerationBounds(-most, most)
        speed = given["speed"]
        joints.setVelocityBounds(-speed, speed)
        self.problem.addMotionTask(joints, 1.0, 0, 0.0)
        self.bounds = torque, joints  # the problem refers to its tasks, but does not own them

    def _contact(self, given: Mapping[str, Any], foot: int) -> Any:
        name, points = f"{FEET[foot]}_contact", np.asfortranarray(given["corners"][foot].T)
        up, friction, most = np.array([0.0, 0.0, 1.0]), float(given["friction"]), 4000.0
        made = self.tsid.Contact6d(
            name, self.robot, self.frames[2 + foot], points, up, friction, 0.0, most
        )
        made.setKp(np.zeros(6))
        made.setKd(self.gains["stance"][2] * np.ones(6))
        return made

    def tick(self, now: float, k: int, given: Mapping[str, Any]) -> tuple[float, float, Any]:
        """Assembly and solution times [s], and the torques, or None without a solution."""
        begin = time.perf_counter()
        self._refer(k, given)
        stands = given["load"][k].any(axis=1)
        for foot, contact in enumerate(self.contacts):
            if stands[foot] and not self.standing[foot]:
                self._stand(contact, foot)
            elif self.standing[foot] and not stands[foot]:
                self.problem.removeRigidContact(contact.name, 0.0)
            self.standing[foot] = bool(stands[foot])
        data = self.problem.computeProblemData(now, given["q"][k], given["v"][k])
        self.solver.resize(self.problem.nVar, self.problem.nEq, self.problem.nIn)
        middle = time.perf_counter()
        solution = self.solver.solve(data)
        end = time.perf_counter()
        found = solution.status == 0
        torque = self.problem.getActuatorForces(solution).ravel() if found else None
        return middle - begin, end - middle, torque

    def _stand(self, contact: Any, foot: int) -> None:
        frame = self.robot.model().getFrameId(self.frames[2 + foot])
        contact.setReference(self.robot.framePosition(self.problem.data(), frame))
        self.problem.addRigidContact(contact, FORCE_REGULARISATION)

    def _refer(self, k: int, given: Mapping[str, Any]) -> None:
        self.com.setReference(self._sample(*given["com"][k]))
        self.momentum.setReference(
            self._sample(given["angular"][k, 0], given["angular"][k, 1], np.zeros(3))
        )
        for row, task in enumerate(self.bodies):
            place = np.concatenate([given["p"][k, row], given["R"][k, row].T.ravel()])
            task.setReference(self._sample(place, given["rate"][k, row], given["surge"][k, row]))
        self.posture.setReference(self._sample(*(given[f"joint_{x}"][k] for x in "qva")))

    def _sample(self, value: Any, rate: Any, surge: Any) -> Any:
        made = self.tsid.TrajectorySample(len(value), len(rate))
        made.value(value)
        made.derivative(rate)
        made.second_derivative(surge)
        return made


def main(source: str, target: str) -> None:
    """Solves every tick of ``source`` as often as it says, and writes the least times."""
    with np.load(source) as file:
        given = {name: file[name] for name in file.files}
    ticks, repeats = len(given["q"]), int(given["repeats"])
    assembly, solve = np.empty((repeats, ticks)), np.empty((repeats, ticks))
    torque = np.full((ticks, len(given["effort"])), np.nan)
    for repeat in range(repeats):
        controller = Controller(given)
        # Frame placements are known from a first evaluation only.
        controller.problem.computeProblemData(0.0, given["q"][0], given["v"][0])
        for k, now in enumerate(given["time"]):
            assembly[repeat, k], solve[repeat, k], found = controller.tick(float(now), k, given)
            if found is not None:
                torque[k] = found
    np.savez(target, assembly=assembly.min(axis=0), solve=solve.min(axis=0), torque=torque)


if __name__ == "__main__":
    main(*sys.argv[1:])
