"""The shipped motion capture clips are whole humans that go the right way."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.checks import stature
from robomirror_drake.motion.ground import clearance, heading
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS, list_clips, load_clip
from robomirror_drake.motion.skeleton import INDEX

WALKS = ("walk", "walk_forward", "turn_left0", "turn_left1", "turn_right0", "turn_right1")


def test_every_humanoid_clip_is_listed() -> None:
    clips = list_clips()
    assert len(clips) == 20
    assert set(FEET_ONLY_CLIPS) < set(clips)
    assert {"backflip", "cartwheel", "crawl", "roll", "getup_faceup"} <= set(clips)
    assert not any("laikago" in name for name in clips)


def test_unknown_clip_names_those_there_are() -> None:
    with pytest.raises(MotionFileError, match=r"moonwalk: no such clip; there are .*walk"):
        load_clip("moonwalk")


@pytest.mark.parametrize("name", list_clips())
def test_clip_is_a_human(name: str) -> None:
    motion = load_clip(name)
    assert motion.source == f"pybullet:{name}"
    assert 0.7 < motion.duration < 5.0
    assert 15.0 < motion.fps < 61.0
    lengths = bone_lengths(motion.positions)
    tolerance = 1e-3 if name == "roll" else 1e-9  # roll is resampled: one step is uneven
    assert lengths.std(axis=0).max() < tolerance
    assert lengths.min() > 0.03
    assert stature(motion.positions) == pytest.approx(1.70, abs=0.02)
    left = lengths[0, [INDEX[j] - 1 for j in ("left_knee", "left_ankle", "left_elbow")]]
    right = lengths[0, [INDEX[j] - 1 for j in ("right_knee", "right_ankle", "right_elbow")]]
    np.testing.assert_allclose(left, right, atol=1e-9)


@pytest.mark.parametrize("name", FEET_ONLY_CLIPS)
def test_feet_stand_on_the_floor(name: str) -> None:
    motion = load_clip(name)
    lowest = clearance(motion.positions).min(axis=(1, 2))
    assert abs(np.median(lowest[lowest < np.median(lowest) + 1e-9])) < 0.03
    assert lowest.min() > -0.07
    others = np.delete(motion.positions[..., 2], [7, 8, 10, 11], axis=1)
    assert others.min() > 0.2  # nothing but the feet is near the floor


@pytest.mark.parametrize("name", [*WALKS, "run"])
def test_goes_forward_with_left_on_the_left(name: str) -> None:
    motion = load_clip(name)
    pelvis = motion.positions[:, 0]
    yaw = heading(motion.positions)
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    speed = (np.diff(pelvis[:, :2], axis=0) * forward[:-1]).sum(axis=1) * motion.fps
    assert speed.mean() > (2.5 if name == "run" else 0.6)
    assert abs(yaw[0]) < 0.2  # the recordings start facing +x
    turned = yaw[-1] - yaw[0]
    if "left" in name:
        assert turned > 0.3
    if "right" in name:
        assert turned < -0.3
    # Left of the way it goes, not only of where it looks.
    aside = motion.positions[:, INDEX["left_hip"], :2] - motion.positions[:, INDEX["right_hip"], :2]
    way = pelvis[-1, :2] - pelvis[0, :2]
    assert (way[0] * aside[:, 1] - way[1] * aside[:, 0]).mean() > 0.0
    # Knees bend forwards: they are ahead of the line from hip to ankle.
    for side in ("left", "right"):
        hip, knee, ankle = (
            motion.positions[:, INDEX[f"{side}_{j}"], :2] for j in ("hip", "knee", "ankle")
        )
        assert ((knee - (hip + ankle) / 2.0) * forward).sum(axis=1).mean() > 0.0


def test_jump_rises() -> None:
    jump = load_clip("jump")
    height = jump.positions[:, 0, 2]
    assert 0.2 < height.max() - height[0] < 0.6
