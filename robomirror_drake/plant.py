"""The plant with the robot as it really is, which need not be what its controller believes."""

from __future__ import annotations

import dataclasses
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder

from robomirror_drake.disturbance_draw import Drawn
from robomirror_drake.robot import Robot, add_ground


class Physics(NamedTuple):
    """A finalized plant on a floor, and which of its model instances the robot is."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex


def add_plant(
    builder: DiagramBuilder,
    robot: Robot,
    drawn: Drawn,
    *,
    time_step: float,
    friction: float,
    servo: bool = False,
) -> Physics:
    """Adds plant and scene graph to a diagram.

    Args:
        builder: The diagram to add to.
        robot: The robot as it is believed to be.
        drawn: What is otherwise: masses and the strength of servos.
        time_step: Of the plant [s].
        friction: Coefficient between soles and ground.
        servo: Whether joints have the servos of the robot's ``joint_gains``, which are to be
            given desired states and keep to the torque limits. Without them it is the
            controller that keeps to the limits.
    """
    config = MultibodyPlantConfig(
        time_step=time_step,
        discrete_contact_approximation="sap",
        contact_model="point",
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    robot = with_friction(robot, friction)
    with tempfile.TemporaryDirectory() as folder:
        if drawn.mass != 1.0 or drawn.center_of_mass.any():
            robot = with_mass_error(robot, drawn, Path(folder))
        instance = robot.add_to_plant(plant)
    add_ground(plant, friction)
    if servo:
        gains = robot.spec.joint_gains
        # Those of one model instance are listed after Finalize() only, which is too late.
        for index in plant.GetJointActuatorIndices():
            actuator = plant.get_mutable_joint_actuator(index)
            actuator.set_controller_gains(PdControllerGains(p=gains.stiffness, d=gains.damping))
            actuator.set_effort_limit(drawn.strength * actuator.effort_limit())
    plant.Finalize()
    robot.filter_self_collision(plant, scene_graph, instance)
    return Physics(plant, scene_graph, instance)


def with_friction(robot: Robot, friction: float) -> Robot:
    """The same robot on other soles."""
    contact = robot.spec.contact.model_copy(update={"friction": friction})
    return dataclasses.replace(robot, spec=robot.spec.model_copy(update={"contact": contact}))


def with_mass_error(robot: Robot, drawn: Drawn, folder: Path) -> Robot:
    """The same robot with other masses; only its ``urdf`` is another.

    A link's rotational inertia about its centre of mass is scaled as its mass is.

    Args:
        robot: The robot as it is believed to be.
        drawn: Factor of the masses, and shifts of the centres of mass.
        folder: Where to write the URDF; it can go once a plant has been made.
    """
    tree = ET.parse(robot.urdf)
    inertials = list(tree.getroot().iter("inertial"))
    for inertial, shift in zip(inertials, drawn.center_of_mass, strict=True):
        part = {element.tag: element for element in inertial}
        center = np.array([float(x) for x in part["origin"].attrib["xyz"].split()])
        part["origin"].set("xyz", " ".join(repr(float(x)) for x in center + shift))
        for element in (part["mass"], part["inertia"]):
            for name, value in element.attrib.items():
                element.set(name, repr(float(value) * drawn.mass))
    for mesh in tree.getroot().iter("mesh"):
        mesh.set("filename", str(robot.urdf.parent / mesh.attrib["filename"]))
    ET.register_namespace("drake", "http://drake.mit.edu")  # or the rotors lose their prefix
    file = folder / robot.urdf.name
    tree.write(file, encoding="utf-8", xml_declaration=True)
    return dataclasses.replace(robot, urdf=file)
