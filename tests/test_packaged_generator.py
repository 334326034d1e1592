"""The weights that come with the package do what they are told, on feet that stand."""

from __future__ import annotations

from importlib import resources

import numpy as np
import pytest

from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.generate import GeneratorOptions, generate
from robomirror_drake.motion.ground import clearance
from robomirror_drake.motion.learned.metrics import foot_skate
from robomirror_drake.motion.skeleton import INDEX
from robomirror_drake.motion.sources import SourceOptions

LEARNED = GeneratorOptions(source=SourceOptions(kind="learned"))


def rise(motion: HumanMotion, joint: str) -> float:
    """How far a joint comes above where it started [m]."""
    height = motion.positions[:, INDEX[joint], 2]
    return float(height.max() - height[0])


def test_weights_are_small() -> None:
    folder = resources.files("robomirror_drake.assets") / "generator"
    sizes = [len(f.read_bytes()) for f in folder.iterdir() if f.name.endswith(".safetensors")]
    assert len(sizes) == 2
    assert sum(sizes) < 8e6


def test_walking_gets_ahead_and_bowing_does_not() -> None:
    walked = [m.positions[-1, 0, 0] for m in generate("a person walks forward", 8, 0, LEARNED)]
    bowed = [m.positions[-1, 0, 0] for m in generate("a person bows", 8, 0, LEARNED)]
    assert np.median(walked) > 0.7
    assert np.abs(np.median(bowed)) < 0.3


@pytest.mark.parametrize(
    "command", ["someone waves with the right hand", "a person raises both arms"]
)
def test_arms_go_up_where_they_shall(command: str) -> None:
    motions = generate(command, 8, 0, LEARNED)
    up = [max(rise(m, "left_wrist"), rise(m, "right_wrist")) > 0.35 for m in motions]
    assert sum(up) >= 6


def test_feet_stand_on_the_floor() -> None:
    commands = ("a person walks forward", "a person squats", "a person turns to the left")
    motions = [m for command in commands for m in generate(command, 4, 1, LEARNED)]
    heights = [np.median(np.abs(clearance(m.positions).min(axis=(1, 2)))) for m in motions]
    skating = [foot_skate(m.positions[:, :, [1, 2, 0]], m.fps) for m in motions]
    assert max(heights) < 0.02
    assert np.mean(skating) < 0.05
