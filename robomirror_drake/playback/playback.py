"""A result as a moving picture in meshcat: as a page that needs no network, or live."""

from __future__ import annotations

import asyncio
import functools
import queue
import threading
from typing import Any

import meshcat
import numpy as np
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from meshcat.geometry import MeshGeometry, MeshPhongMaterial
from meshcat.path import Path as TreePath
from meshcat.servers.zmqserver import ZMQWebSocketBridge
from pydrake.common import MemoryFile
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import (
    InMemoryMesh,
    Mesh,
    Meshcat,
    MeshcatAnimation,
    MeshcatParams,
    Rgba,
)
from pydrake.math import RigidTransform

from robomirror_drake.playback.overlay import render_overlay
from robomirror_drake.playback.scene import FRAMES_PER_SECOND, Body, Scene, build_scene
from robomirror_drake.results import Result
from robomirror_drake.robot import Robot

HOST = "localhost"
"""Playback is served to this machine only."""

BACKGROUND = {"top_color": [0.86, 0.90, 0.94], "bottom_color": [0.97, 0.98, 0.99]}


def render_playback(result: Result, robot: Robot) -> str:
    """The playback of a result as HTML, with the viewer, the meshes and the motion inside."""
    scene = build_scene(result, robot)
    viewer = Meshcat(MeshcatParams(host=HOST))
    animation = MeshcatAnimation(FRAMES_PER_SECOND)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(10_000)
    for body in scene.bodies:
        for number, mesh in enumerate(body.meshes):
            path = f"{body.path}/{number}"
            source = InMemoryMesh(mesh_file=MemoryFile(mesh.obj, ".obj", body.path))
            viewer.SetObject(path, Mesh(source), Rgba(*mesh.color))
            viewer.SetTransform(path, RigidTransform(mesh.pose))
        for frame, (p, q) in enumerate(zip(body.position, body.quaternion, strict=True)):
            X = RigidTransform(Quaternion(q), p)
            animation.SetTransform(frame, body.path, X)
            if frame == 0:
                viewer.SetTransform(body.path, X)
    viewer.SetAnimation(animation)
    for property, color in BACKGROUND.items():
        viewer.SetProperty("/Background", property, color)
    viewer.SetProperty("/Axes", "visible", False)
    viewer.SetCameraPose(scene.camera, scene.target)
    page, over = str(viewer.StaticHtml()), render_overlay(result)
    return page.replace("</body>", f"{over}</body>") if over else page


def play(result: Result, robot: Robot) -> meshcat.Visualizer:
    """Opens a result in a live viewer, on this machine only.

    Returns:
        The viewer; it is served, at its ``url()``, for as long as this process lives.
    """
    scene = build_scene(result, robot)
    viewer = meshcat.Visualizer(zmq_url=_serve())
    for body in scene.bodies:
        for number, mesh in enumerate(body.meshes):
            part = viewer[body.path][str(number)]
            *rgb, opacity = mesh.color
            red, green, blue = (round(255 * value) for value in rgb)
            material = MeshPhongMaterial(
                color=red << 16 | green << 8 | blue, opacity=opacity, transparent=opacity < 1.0
            )
            part.set_object(MeshGeometry(mesh.obj, "obj"), material)
            part.set_transform(mesh.pose)
    for property, color in BACKGROUND.items():
        viewer["/Background"].set_property(property, color)
    viewer["/Axes"].set_property("visible", False)
    # This viewer's camera always looks at the origin, so the world is moved there instead.
    moved = np.eye(4)
    moved[:3, 3] = -scene.target
    viewer.set_transform(moved)
    viewer["/Grid"].set_transform(moved)
    x, y, z = (float(value) for value in scene.camera - scene.target)
    viewer["/Cameras/default/rotated/<object>"].set_property("position", [x, z, -y])
    viewer.set_animation(_animation(scene), repetitions=10_000)
    return viewer


def _animation(scene: Scene) -> Animation:
    root = TreePath(("meshcat",))
    return Animation(
        {root.append(body.path): _clip(body) for body in scene.bodies}, FRAMES_PER_SECOND
    )


def _clip(body: Body) -> AnimationClip:
    frames = list(range(len(body.position)))
    xyzw = np.roll(body.quaternion, -1, axis=1).tolist()
    tracks = {
        "position": AnimationTrack("position", "vector3", frames, body.position.tolist()),
        "quaternion": AnimationTrack("quaternion", "quaternion", frames, xyzw),
    }
    return AnimationClip(tracks, fps=FRAMES_PER_SECOND)


class _LocalBridge(ZMQWebSocketBridge):
    """The viewer's server; by itself it would listen on every network interface."""

    def make_app(self) -> Any:
        app = super().make_app()
        app.listen = functools.partial(app.listen, address=self.host)
        return app


def _serve() -> str:
    """Starts the viewer's server in a background thread; the address to send the scene to."""
    address: queue.SimpleQueue[str] = queue.SimpleQueue()

    def run() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        bridge = _LocalBridge(host="127.0.0.1")
        address.put(bridge.zmq_url)
        bridge.run()

    threading.Thread(target=run, name="meshcat", daemon=True).start()
    return address.get()
