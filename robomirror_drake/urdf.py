"""A URDF that Drake and Pinocchio both read, made from a robot's own description.

The description as shipped does not load in Drake (Collada meshes, no
transmissions) and has joints that no reference moves. Here it is reduced to the
joints of the spec, with the inertia of whatever is welded merged into its parent,
the meshes converted to OBJ, and armature, damping and limits filled in. The
result is cached per content, outside the package.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import platformdirs
import trimesh

from robomirror_drake.exceptions import RobotModelError
from robomirror_drake.messages import Array
from robomirror_drake.robot_spec import RobotSpec


def cached_urdf(spec: RobotSpec) -> Path:
    """Path of the reduced URDF of ``spec``, built if this content was never built before.

    Two processes may race: each builds in a folder of its own and the first rename
    wins, so a reader never sees half a model.

    Raises:
        RobotModelError: The description's package or file is missing or unusable.
    """
    source = _description(spec)
    digest = hashlib.sha256()
    for part in (spec.model_dump_json().encode(), source.read_bytes(), Path(__file__).read_bytes()):
        digest.update(part)
    folder = platformdirs.user_cache_path("robomirror_drake") / "robots"
    folder = folder / f"{spec.name}-{digest.hexdigest()[:16]}"
    urdf = folder / f"{spec.name}.urdf"
    if urdf.exists():
        return urdf
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{spec.name}-", dir=folder.parent))
    try:
        _write(spec, source, scratch / urdf.name)
        try:
            os.rename(scratch, folder)
        except OSError:
            if not urdf.exists():  # anything but having lost the race
                raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return urdf


def _description(spec: RobotSpec) -> Path:
    found = importlib.util.find_spec(spec.description.package)
    if found is None or not found.submodule_search_locations:
        raise RobotModelError(
            f"robot {spec.name!r} needs the Python package {spec.description.package!r}"
        )
    path = Path(found.submodule_search_locations[0]) / spec.description.urdf
    if not path.is_file():
        raise RobotModelError(f"robot {spec.name!r}: {path} does not exist")
    return path


def reduced_model(spec: RobotSpec, source: Path) -> pin.Model:
    """The description in Pinocchio with a free-flyer base and only the joints of ``spec``.

    Raises:
        RobotModelError: A joint of the spec is not in the description.
    """
    full = pin.buildModelFromUrdf(str(source), pin.JointModelFreeFlyer())
    names = list(full.names)
    if missing := [name for name in spec.joints if name not in names]:
        raise RobotModelError(f"{source} has no joints {', '.join(missing)}")
    welded = [i for i in range(2, full.njoints) if names[i] not in spec.joints]
    return pin.buildReducedModel(full, welded, pin.neutral(full))


def _write(spec: RobotSpec, source: Path, target: Path) -> None:
    model = reduced_model(spec, source)
    description = ET.parse(source).getroot()
    links = {i: _link_name(model, spec, i) for i in range(1, model.njoints)}
    robot = ET.Element("robot", name=spec.name)
    robot.set("xmlns:drake", "http://drake.mit.edu")
    elements = {i: _link(robot, links[i], model.inertias[i]) for i in links}
    _add_visuals(model, description, source, target.parent, elements)
    for name, joint in spec.joints.items():
        i = model.getJointId(name)
        placement, axis = model.jointPlacements[i], _axis(model, i)
        element = ET.SubElement(robot, "joint", name=name, type="revolute")
        ET.SubElement(element, "parent", link=links[model.parents[i]])
        ET.SubElement(element, "child", link=links[i])
        _origin(element, placement)
        ET.SubElement(element, "axis", xyz=_text(axis))
        ET.SubElement(element, "dynamics", damping=repr(joint.damping))
        ET.SubElement(
            element,
            "limit",
            lower=repr(float(model.lowerPositionLimit[model.idx_qs[i]])),
            upper=repr(float(model.upperPositionLimit[model.idx_qs[i]])),
            velocity=repr(joint.velocity),
            effort=repr(joint.effort),
        )
    for name, joint in spec.joints.items():
        transmission = ET.SubElement(robot, "transmission", name=f"{name}_transmission")
        ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(transmission, "joint", name=name)
        actuator = ET.SubElement(transmission, "actuator", name=name)
        ET.SubElement(actuator, "drake:rotor_inertia", value=repr(joint.armature))
        ET.SubElement(actuator, "drake:gear_ratio", value="1")
    ET.indent(robot)
    ET.ElementTree(robot).write(target, encoding="utf-8", xml_declaration=True)


def _link_name(model: pin.Model, spec: RobotSpec, joint: int) -> str:
    if joint == 1:
        return spec.base_link
    # The body that the joint itself moves: the first BODY frame on it with identity placement.
    for frame in model.frames:
        at_joint = frame.parentJoint == joint and frame.type == pin.FrameType.BODY
        if at_joint and frame.placement.isIdentity(1e-12):
            return str(frame.name)
    raise RobotModelError(f"joint {model.names[joint]} moves no link")


def _link(robot: ET.Element, name: str, inertia: pin.Inertia) -> ET.Element:
    link = ET.SubElement(robot, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=repr(float(inertia.mass)))
    ET.SubElement(inertial, "origin", xyz=_text(inertia.lever), rpy="0 0 0")
    moments = {
        f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertia.inertia[i, j]))
        for i in range(3)
        for j in range(i, 3)
    }
    ET.SubElement(inertial, "inertia", moments)
    return link


def _add_visuals(
    model: pin.Model,
    description: ET.Element,
    source: Path,
    folder: Path,
    elements: dict[int, ET.Element],
) -> None:
    colors = {m.get("name"): m.find("color") for m in description.findall("material")}
    (folder / "meshes").mkdir()
    for link in description.findall("link"):
        frame = model.frames[model.getFrameId(link.get("name"), pin.FrameType.BODY)]
        for number, visual in enumerate(link.findall("visual")):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            relative = f"meshes/{link.get('name')}_{number}.obj"
            scale = [float(s) for s in mesh.get("scale", "1 1 1").split()]
            _convert(_resolve(mesh.get("filename", ""), source), scale, folder / relative)
            element = ET.SubElement(elements[frame.parentJoint], "visual")
            _origin(element, frame.placement * _placement(visual.find("origin")))
            geometry = ET.SubElement(element, "geometry")
            ET.SubElement(geometry, "mesh", filename=relative)
            named = visual.find("material")
            color = None if named is None else named.find("color")
            if color is None and named is not None:
                color = colors.get(named.get("name"))
            if color is not None:
                material = ET.SubElement(element, "material", name=f"{link.get('name')}_{number}")
                ET.SubElement(material, "color", color.attrib)


def _resolve(filename: str, source: Path) -> Path:
    """A mesh's path: ``package://`` means the package that the URDF itself is in."""
    if filename.startswith("package://"):
        package, _, rest = filename.removeprefix("package://").partition("/")
        root = next((p for p in source.parents if p.name == package), source.parent)
        return root / rest
    return source.parent / filename


def _convert(mesh: Path, scale: list[float], target: Path) -> None:
    """Writes a mesh of any format as an OBJ without materials."""
    try:
        geometry = trimesh.load_scene(mesh).to_mesh()
    except Exception as error:
        raise RobotModelError(f"mesh {mesh} cannot be read: {error}") from error
    geometry.apply_scale(scale)
    geometry.visual = trimesh.visual.ColorVisuals()
    geometry.export(target, include_normals=True, header=None)


def _axis(model: pin.Model, joint: int) -> Array:
    """(3,) rotation axis of a revolute joint in its own frame."""
    return np.reshape(model.joints[joint].createData().S, 6)[3:]


def _placement(origin: ET.Element | None) -> pin.SE3:
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (
        np.array([float(x) for x in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _origin(parent: ET.Element, placement: pin.SE3) -> None:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    ET.SubElement(parent, "origin", xyz=_text(placement.translation), rpy=_text(rpy))


def _text(vector: Array) -> str:
    return " ".join(repr(float(x)) for x in vector)
