"""How human a motion moves, on motions whose faults are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion import plausibility
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.recorded import neutral
from robomirror_drake.motion.skeleton import INDEX

FPS = 60.0


def standing(frames: int = 121) -> Array:
    """(frames, 22, 3) the neutral stance."""
    return np.tile(neutral(FPS), (frames, 1, 1))


def moved(joints: list[str], by: list[float]) -> Array:
    """The neutral stance with some joints elsewhere."""
    positions = standing()
    positions[:, [INDEX[joint] for joint in joints]] += by
    return positions


def test_standing_is_without_fault() -> None:
    found = plausibility.figures(HumanMotion(standing(), FPS))
    assert set(found.values()) == {0.0} or max(found.values()) < 1e-6


def test_a_recorded_walk_is_within_reason() -> None:
    found = plausibility.figures(load_clip("walk"))
    assert found["beyond_range_deg"] == 0.0
    assert found["arm_in_body_mm"] == 0.0
    assert 0.0 < found["stance_drift_mm"] < 30.0
    assert 50.0 < found["jerk_m_s3"] < 1000.0


def test_drift_of_a_standing_body_that_slides() -> None:
    slide = np.linspace(-0.05, 0.05, 121)[:, None, None] * [1.0, 0.0, 0.0]
    drift = plausibility.stance_drift(HumanMotion(standing() + slide, FPS))
    # Both ends of both feet bear throughout; 50 ms at either end are left out.
    assert drift == pytest.approx(0.05 * (1.0 - 2.0 * 3.0 / 120.0), rel=0.03)


def test_penetration_is_of_soles_and_of_all_joints() -> None:
    assert plausibility.penetration(standing()) == pytest.approx(0.0, abs=1e-9)
    assert plausibility.penetration(standing() - [0.0, 0.0, 0.03]) == pytest.approx(0.03)
    depth = neutral(FPS)[INDEX["left_wrist"], 2] + 0.2
    sunk = moved(["left_wrist"], [0.0, 0.0, -depth])
    assert plausibility.penetration(sunk) == pytest.approx(0.2)


def test_bone_drift_sees_a_stretching_shin() -> None:
    positions = standing(200)
    assert plausibility.bone_drift(positions) < 1e-12
    positions[100:, [INDEX["left_ankle"], INDEX["left_foot"]]] += [0.0, 0.0, -0.0418]
    # Half the frames 4.18 cm longer, of 41.8 cm: deviation 2.09 cm over a mean of 43.9 cm.
    assert plausibility.bone_drift(positions) == pytest.approx(0.0209 / 0.439, rel=0.05)


def test_jerk_and_acceleration_of_polynomials() -> None:
    t = np.arange(40) / 20.0
    falling = standing(40)
    falling[..., 2] += (0.5 * -9.81 * t**2)[:, None]
    assert plausibility.peak_acceleration(falling, 20.0) == pytest.approx(9.81)
    assert plausibility.jerk(falling, 20.0) == pytest.approx(0.0, abs=1e-6)
    cubic = standing(40)
    cubic[..., 0] += (t**3)[:, None]
    assert plausibility.jerk(cubic, 20.0) == pytest.approx(6.0)


def test_a_pop_is_seen() -> None:
    positions = standing()
    positions[60:, :, 0] += 0.3
    assert plausibility.figures(HumanMotion(positions, FPS))["peak_acceleration_m_s2"] > 50.0


def test_a_knee_that_bends_backward_is_beyond_its_range() -> None:
    lifted = standing(2)
    for name, by in {
        "knee": [0.15, 0.0, 0.05],
        "ankle": [0.0, 0.0, 0.2],
        "foot": [0.0, 0.0, 0.2],
    }.items():
        lifted[:, INDEX[f"left_{name}"]] += by
    angles = plausibility.joint_angles(lifted)["knee flexion"]
    assert angles[0, 0] > 45.0
    knee = list(plausibility.RANGES).index("knee flexion")
    assert plausibility.beyond_ranges(lifted)[:, knee].max() == 0.0
    backward = lifted.copy()
    hip, ankle = INDEX["left_hip"], INDEX["left_ankle"]
    middle = 0.5 * (lifted[:, hip] + lifted[:, ankle])
    backward[:, INDEX["left_knee"]] = 2.0 * middle - lifted[:, INDEX["left_knee"]]
    assert plausibility.joint_angles(backward)["knee flexion"][0, 0] < -45.0
    assert plausibility.beyond_ranges(backward)[:, knee].min() > 20.0


@pytest.mark.parametrize(
    ("joints", "by", "angle", "sign"),
    [
        (["left_wrist"], [0.248, 0.0, 0.248], "elbow flexion", 1.0),
        (["left_elbow", "left_wrist"], [-0.3, 0.0, 0.2], "shoulder extension", 1.0),
        (["left_elbow", "left_wrist"], [0.1, -0.3, 0.2], "shoulder adduction", 1.0),
        (["left_foot"], [0.0, 0.0, 0.1], "ankle dorsiflexion", 1.0),
        (["left_foot"], [0.0, 0.0, -0.1], "ankle dorsiflexion", -1.0),
        (["left_knee"], [0.3, 0.0, 0.2], "hip flexion", 1.0),
        (["left_knee"], [-0.3, 0.0, 0.1], "hip flexion", -1.0),
        (["left_knee"], [0.0, -0.2, 0.1], "hip adduction", 1.0),
    ],
)
def test_angles_of_the_left_side(
    joints: list[str], by: list[float], angle: str, sign: float
) -> None:
    before = plausibility.joint_angles(standing(2))[angle]
    after = plausibility.joint_angles(moved(joints, by)[:2])[angle]
    assert sign * (after[0, 0] - before[0, 0]) > 20.0
    assert after[0, 1] == pytest.approx(before[0, 1], abs=1e-6)  # the right side stays


def test_angles_of_the_trunk() -> None:
    upper = ["spine3", "neck", "head", "left_shoulder", "right_shoulder", "left_collar"]
    assert plausibility.joint_angles(moved(upper, [0.3, 0.0, 0.0])[:2])["trunk flexion"][0] > 30.0
    assert plausibility.joint_angles(moved(upper, [0.0, 0.3, 0.0])[:2])["trunk side bend"][0] > 30.0
    twisted = moved(["left_shoulder"], [-0.3, 0.0, 0.0])[:2]
    assert plausibility.joint_angles(twisted)["trunk twist"][0] > 30.0


def test_angles_do_not_depend_on_the_heading() -> None:
    motion = load_clip("kick")
    c, s = np.cos(2.0), np.sin(2.0)
    turned = motion.positions @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    before = plausibility.joint_angles(motion.positions)
    for name, angle in plausibility.joint_angles(turned).items():
        np.testing.assert_allclose(angle, before[name], atol=1e-6)


def test_an_arm_in_the_body_is_seen() -> None:
    assert plausibility.arm_in_body(standing(2)).max() == 0.0
    neutral_pose = neutral(FPS)
    into = neutral_pose[INDEX["spine3"]] - neutral_pose[INDEX["left_wrist"]]
    inside = moved(["left_wrist"], list(into))[:2]
    assert plausibility.arm_in_body(inside)[0] > 0.1


def test_figures_are_those_of_the_motion_not_of_its_place() -> None:
    motion = load_clip("punch")
    aside = replace(motion, positions=motion.positions + np.array([3.0, -2.0, 0.0]))
    for name, value in plausibility.figures(aside).items():
        assert value == pytest.approx(plausibility.figures(motion)[name], rel=1e-6, abs=1e-6)
