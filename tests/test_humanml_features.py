"""HumanML3D's features: exact both ways, and as published."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.motion import humanml_features as hml
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.generate import generate
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.recorded import neutral
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.skeleton import INDEX


def y_up(name: str) -> np.ndarray:
    """(T, 22, 3) a clip at 20 fps, y up, on bones of constant length."""
    positions = resample(load_clip(name), hml.FPS).positions[..., [1, 2, 0]]
    return hml.with_lengths(positions, bone_lengths(neutral(60.0)))


@pytest.mark.parametrize("name", ["walk", "spinkick", "dance_b", "turn_left0", "backflip"])
def test_positions_come_back_from_joints_and_from_rotations(name: str) -> None:
    positions = y_up(name)
    features = hml.to_features(positions)
    expected = hml.canonical(positions)[:-1]
    assert features.shape == (len(positions) - 1, 263)
    np.testing.assert_allclose(hml.recover_from_ric(features), expected, atol=1e-9)
    back = hml.recover_from_rotations(features, bone_lengths(expected[0]))
    np.testing.assert_allclose(back, expected, atol=1e-6)
    single = features.astype(np.float32).astype(float)
    np.testing.assert_allclose(hml.recover_from_ric(single), expected, atol=1e-5)


def test_whole_turns_come_back() -> None:
    """Past half a circle the heading's quaternion changes its sign, which must not show."""
    motion = generate("a person turns around to the left by 360 degrees", 1)[0]
    positions = resample(motion, hml.FPS).positions[..., [1, 2, 0]]
    features = hml.to_features(positions)
    np.testing.assert_allclose(
        hml.recover_from_ric(features), hml.canonical(positions)[:-1], atol=1e-9
    )
    assert abs(2.0 * features[:, 0].sum()) > 5.5


def test_start_is_canonical_wherever_it_was_recorded() -> None:
    positions = y_up("walk")
    moved = Rotation.from_euler("y", 2.3).apply(positions.reshape(-1, 3)).reshape(positions.shape)
    np.testing.assert_allclose(
        hml.to_features(moved + np.array([3.0, 1.0, -2.0])), hml.to_features(positions), atol=1e-9
    )
    start = hml.canonical(positions)
    assert start[..., 1].min() == pytest.approx(0.0)
    np.testing.assert_allclose(start[0, 0, [0, 2]], 0.0, atol=1e-12)
    across = start[0, INDEX["left_hip"]] - start[0, INDEX["right_hip"]]
    assert across[0] > 0.1  # facing +z, the left is at +x


def test_columns_are_in_the_published_order() -> None:
    """A forward walk: steps along the root's z, the left ankle's height in column 4 + 3·6 + 1."""
    positions = y_up("walk")
    features = hml.to_features(positions)
    canonical = hml.canonical(positions)
    assert features[:, 2].mean() > 0.02 > abs(features[:, 1].mean())
    np.testing.assert_allclose(features[:, 3], canonical[:-1, 0, 1])
    np.testing.assert_allclose(features[:, 4 + 3 * 6 + 1], canonical[:-1, 7, 1])
    step = np.linalg.norm(np.diff(canonical, axis=0), axis=-1)
    np.testing.assert_allclose(
        np.linalg.norm(features[:, hml.STEPS].reshape(-1, 22, 3), axis=-1), step
    )
    np.testing.assert_array_equal(features[:, 259:], step[:, [7, 10, 8, 11]] ** 2 < hml.STILL)


def test_recovery_takes_batches() -> None:
    features = hml.to_features(y_up("walk"))
    batch = np.stack([features, features * [0.5] + 0.0])
    lengths = bone_lengths(y_up("walk")[0])
    np.testing.assert_array_equal(hml.recover_from_ric(batch)[1], hml.recover_from_ric(batch[1]))
    np.testing.assert_allclose(
        hml.recover_from_rotations(batch, lengths)[0],
        hml.recover_from_rotations(features, lengths),
    )


def test_opposite_directions_turn_by_half_a_circle() -> None:
    """A bone that points against its rest direction has a rotation all the same."""
    up = np.eye(3)
    for start in np.concatenate([up, -up]):
        turned = hml._rotate(hml._between(start, -start), start)
        np.testing.assert_allclose(turned, -start, atol=1e-12)
