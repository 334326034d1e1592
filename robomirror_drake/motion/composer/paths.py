"""Locomotion along paths: circles, figures of eight, zigzags, to and fro."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robomirror_drake.motion.composer.cue import Cue
from robomirror_drake.motion.composer.gait import turn, walk
from robomirror_drake.motion.composer.score import Footprint, Score
from robomirror_drake.motion.composer.steps import Manner, PathFunction, along_path, take_steps

RADIUS = 0.65
"""Radius of a circle in usual size [m]."""
SPEED = 0.42
"""Usual speed along a path [m/s]."""


def _arc(radius: float, sign: float) -> PathFunction:
    def at(way: float) -> Footprint:
        angle = way / radius
        return Footprint(
            radius * np.sin(angle), sign * radius * (1.0 - np.cos(angle)), sign * angle
        )

    return at


def _go(score: Score, cue: Cue, path: PathFunction, length: float) -> None:
    pace = cue.speed or SPEED * cue.tempo
    step = 0.32 * cue.style.step_length * np.sqrt(pace / SPEED)
    # The inner foot of a bend goes first: its steps are the shorter ones.
    steps = along_path(score, path, length, step, cue.side, cue.style.step_width)
    begin = score.now
    take_steps(score, steps, length / max(len(steps) - 1, 1) / pace, cue, Manner(roll=0.0))
    _look_ahead(score, path, length, begin)


def _look_ahead(score: Score, path: PathFunction, length: float, begin: float) -> None:
    """The head turns to where the path is going."""
    bend = path(0.1 * length).yaw
    if abs(bend) > 1e-6:
        look = float(np.clip(2.0 * bend, -0.35, 0.35))
        score.move("head_yaw", look, begin, begin + 0.8)
        score.move("head_yaw", -look, score.now - 1.0, score.now)


def circle(score: Score, cue: Cue) -> None:
    """Walk round a circle of 0.65 m to the side of the cue, once."""
    radius = RADIUS * np.clip(cue.amplitude, 0.7, 2.0)
    angle = (cue.angle or 2.0 * np.pi) * (cue.count or 1)
    if cue.distance is not None:
        radius = max(cue.distance / angle, 0.3)
    sign = 1.0 if cue.side == "left" else -1.0
    _go(score, cue, _arc(radius, sign), radius * angle)


def figure_eight(score: Score, cue: Cue) -> None:
    """Walk a figure of eight: a circle to one side and one to the other."""
    radius = 0.85 * RADIUS * np.clip(cue.amplitude, 0.8, 2.0)
    sign = 1.0 if cue.side == "left" else -1.0
    loop = 2.0 * np.pi * radius
    first, second = _arc(radius, sign), _arc(radius, -sign)

    def path(way: float) -> Footprint:
        if way <= loop:
            return first(way)
        back = second(way - loop)
        return replace(back, yaw=back.yaw + sign * 2.0 * np.pi)

    for _ in range(cue.count or 1):
        _go(score, cue, path, 2.0 * loop)


def zigzag(score: Score, cue: Cue) -> None:
    """Walk to and fro across the heading: 4 legs of 0.6 m, 40° to either side."""
    leg = 0.6 * np.clip(cue.amplitude, 0.7, 1.6)
    bend = np.deg2rad(40.0)
    sign = 1.0 if cue.side == "left" else -1.0
    legs = 4 if cue.count is None else max(2, round(cue.count / 2))
    length = leg * legs if cue.distance is None else cue.distance / np.cos(bend)

    def path(way: float) -> Footprint:
        # A sine across the way has slopes of up to the bend, and no corners.
        along = way * np.cos(0.6 * bend)
        wave = np.pi / (leg * np.cos(0.6 * bend))
        height = np.tan(bend) / wave
        yaw = np.arctan(np.tan(bend) * np.sin(wave * along))
        return Footprint(along, sign * height * (1.0 - np.cos(wave * along)), sign * yaw)

    _go(score, cue, path, length)


def pace(score: Score, cue: Cue) -> None:
    """Walk ahead, turn about and walk back, and turn about again."""
    for _ in range(2 * (cue.count or 1)):
        walk(score, replace(cue, count=None if cue.distance else 5))
        turn(score, replace(cue, angle=np.pi, count=1))
