"""HumanML3D arrays, DeepMimic files and the dispatch: what loads, what is refused and how."""

from __future__ import annotations

import json
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.ground import clearance, face_forward, ground, heading, z_up
from robomirror_drake.motion.humanml_features import recover_from_ric
from robomirror_drake.motion.load import load_motion
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.results_files import load_results
from robomirror_drake.motion.skeleton import INDEX
from robomirror_drake.motion.smpl import MODELS, pose_joints


def y_up_walk() -> np.ndarray:
    """(T, 22, 3) a real walk as HumanML3D has it: 20 fps, y up, facing +z, lowest joint at 0."""
    positions = resample(face_forward(load_clip("walk")), 20.0).positions
    y_up = positions[..., [1, 2, 0]]
    return y_up - np.array([0.0, y_up[..., 1].min(), 0.0])


def features_of(y_up: np.ndarray) -> np.ndarray:
    """(T − 1, 263) features whose root turns and drifts, by the definition of their recovery.

    Row by row: the yaw rate is half the turn to the next frame, the velocity is the step
    to the next frame as seen by the next frame's root, joints are seen by their own.
    """
    frames = len(y_up)
    yaw = heading(z_up(y_up, "y")) - heading(z_up(y_up, "y"))[0]
    # From z up to y up the heading turns about the same axis, so it is a yaw about y.
    to_root = [Rotation.from_euler("y", -a) for a in yaw]
    out = np.zeros((frames - 1, 263))
    for t in range(frames - 1):
        out[t, 0] = -0.5 * (yaw[t + 1] - yaw[t])
        out[t, 1:3] = to_root[t + 1].apply(y_up[t + 1, 0] - y_up[t, 0])[[0, 2]]
        out[t, 3] = y_up[t, 0, 1]
        local = y_up[t, 1:] - y_up[t, 0] * [1.0, 0.0, 1.0]
        out[t, 4:67] = to_root[t].apply(local).ravel()
    return out


def save(tmp_path: Path, array: np.ndarray, name: str = "m.npy") -> Path:
    np.save(tmp_path / name, array)
    return tmp_path / name


def test_features_recover_the_positions() -> None:
    y_up = y_up_walk()
    turn = Rotation.from_euler("y", np.linspace(0.0, 1.2, len(y_up))[:, None]).as_matrix()
    bent = y_up @ turn.swapaxes(1, 2)  # a curved path
    bent -= bent[0, 0] * [1.0, 0.0, 1.0]
    np.testing.assert_allclose(recover_from_ric(features_of(bent)), bent[:-1], atol=1e-12)


@pytest.mark.parametrize("kind", ["positions", "features"])
def test_humanml_is_the_walk_it_came_from(kind: str, tmp_path: Path) -> None:
    y_up = y_up_walk()
    loaded = load_motion(save(tmp_path, y_up if kind == "positions" else features_of(y_up)))
    expected = resample(face_forward(load_clip("walk")), 20.0).positions
    n = len(loaded.positions)
    assert loaded.fps == 20.0
    assert n >= len(expected) - 1
    assert np.abs(loaded.positions - expected[:n]).max() < 0.01  # the floor is found anew
    assert loaded.positions[-1, 0, 0] - loaded.positions[0, 0, 0] > 0.8  # +z became +x
    assert loaded.positions[:, INDEX["left_hip"], 1].mean() > 0.05


def test_normalised_features_are_refused(tmp_path: Path) -> None:
    features = features_of(y_up_walk())
    features = (features - features.mean(axis=0)) / (features.std(axis=0) + 1e-3) - 0.1
    with pytest.raises(MotionFileError, match=r"normalised.*Std.*Mean"):
        load_motion(save(tmp_path, features))


def test_z_up_positions_are_refused_and_a_crawl_is_not(tmp_path: Path) -> None:
    x, y, z = np.moveaxis(y_up_walk(), -1, 0)
    with pytest.raises(MotionFileError, match="y must be up"):
        load_motion(save(tmp_path, np.stack([z, x, y], axis=-1)))
    crawl = np.stack(
        np.moveaxis(resample(load_clip("crawl"), 20.0).positions, -1, 0)[[1, 2, 0]], -1
    )
    assert len(load_motion(save(tmp_path, crawl)).positions) == len(crawl)


def broken(**change: object) -> np.ndarray:
    walk = y_up_walk()
    for key, value in change.items():
        walk[int(key[1:])] = value
    return walk


def teleported() -> np.ndarray:
    walk = y_up_walk()
    walk[7:] += [5.0, 0.0, 0.0]
    return walk


@pytest.mark.parametrize(
    ("array", "fault"),
    [
        (y_up_walk()[:, :21], r"shape \(26, 21, 3\)"),
        (y_up_walk()[:5], "at least 0.5 s"),
        (y_up_walk()[:0], "at least 0.5 s"),
        (np.zeros((0, 263)), "at least 0.5 s"),
        (np.zeros((30, 22, 3)), "person is 0 m tall"),
        (y_up_walk() * 12.0, "person is 20.* m tall"),
        (y_up_walk() * 100.0, "m tall; are the positions in metres"),
        (broken(f3=np.nan), "frame 3 holds NaN"),
        (broken(f7=np.inf), "frame 7 holds NaN"),
        (broken(f7=1e12), "numbers reach 1e"),
        (teleported(), "m/s after frame 6"),
        (np.random.default_rng(0).normal(size=(30, 22, 3)) * 0.2, "bones of the limbs"),
        (y_up_walk() * np.array([-1.0, 1.0, 1.0]), "feet point backwards"),
        (y_up_walk().astype("U8"), "expected numbers"),
        (y_up_walk().astype(complex), "expected numbers"),
        (np.array(1.0), r"shape \(\)"),
        (np.random.default_rng(0).normal(size=(60, 263)) + 1.0, "m tall"),
    ],
)
def test_array_that_is_no_motion(array: np.ndarray, fault: str, tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match=fault) as caught:
        load_motion(save(tmp_path, array))
    assert "m.npy" in str(caught.value)


class Trap:
    """A pickle that opens a file when it is loaded."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str, str]]:
        return open, (str(self.path), "w")


def test_pickles_never_run(tmp_path: Path) -> None:
    trap = Trap(tmp_path / "sprung")
    np.save(tmp_path / "object.npy", np.array([trap], dtype=object), allow_pickle=True)
    (tmp_path / "motion.pkl").write_bytes(pickle.dumps({"joints": trap}))
    for name in ("object.npy", "motion.pkl"):
        with pytest.raises(MotionFileError, match=r"may run code \(it calls _?io\.open\)"):
            load_motion(tmp_path / name)
    (tmp_path / "pickle.npy").write_bytes(pickle.dumps(trap))
    with pytest.raises(MotionFileError, match=r"not a \.npy array"):
        load_motion(tmp_path / "pickle.npy")
    assert not (tmp_path / "sprung").exists()


def results_of_mdm(path: Path, **change: object) -> Path:
    """MDM's results: the walk twice, the second time cut to 15 frames."""
    motion = np.stack([y_up_walk().transpose(1, 2, 0)] * 2).astype(np.float32)
    content = {
        "motion": motion,
        "text": ["a person walks", "a man walks"],
        "lengths": np.array([motion.shape[3], 15]),
        "num_samples": 2,
        "num_repetitions": 1,
    }
    np.save(path, np.array(content | change, dtype=object), allow_pickle=True)
    return path


def test_results_of_motionlcm_and_mdm(tmp_path: Path) -> None:
    expected = load_motion(save(tmp_path, y_up_walk())).positions
    content = {"joints": y_up_walk(), "text": "a person walks", "length": 26, "hint": None}
    (tmp_path / "lcm.pkl").write_bytes(pickle.dumps(content))
    single = load_motion(tmp_path / "lcm.pkl")
    assert single.text == "a person walks"
    np.testing.assert_allclose(single.positions, expected)
    path = results_of_mdm(tmp_path / "results.npy")
    first, second = load_results(path)
    np.testing.assert_allclose(first.positions, expected, atol=1e-6)
    assert (len(second.positions), second.text) == (15, "a man walks")
    assert second.source.endswith("results.npy#1")
    with pytest.raises(MotionFileError, match="holds 2 motions; use it as a pool"):
        load_motion(path)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"motion": np.zeros((2, 21, 3, 40))}, "motion has shape"),
        ({"motion": "none"}, "no array of numbers"),
        ({"text": ["one"]}, "differ in number"),
        ({"text": 5}, "not iterable"),
        ({"lengths": ["a", "b"]}, "invalid literal"),
        ({"motion": np.zeros((2, 22, 3, 40))}, "0 m tall"),
    ],
)
def test_results_that_are_none(change: dict[str, object], fault: str, tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match=fault):
        load_results(results_of_mdm(tmp_path / "results.npy", **change))


def amass(folder: Path, **change: object) -> Path:
    """A small AMASS file: half a turn of the body to the left, one arm bent."""
    poses = np.zeros((60, 156))
    poses[:, 2] = np.linspace(0.0, np.pi, 60)
    poses[:, 18 * 3 + 1] = -1.2
    content = {
        "poses": poses,
        "trans": np.tile([1.0, 2.0, 0.9], (60, 1)),
        "betas": np.array([1.0] + [0.0] * 15),
        "gender": "male",
        "mocap_framerate": 60.0,
    }
    np.savez(folder / "amass.npz", **(content | change))  # type: ignore[arg-type]
    return folder / "amass.npz"


def body_model(folder: Path) -> None:
    """A body model whose vertices are its joints, 1.5 % taller for each unit of shape."""
    rest = y_up_walk()[0, :, [2, 0, 1]].T - y_up_walk()[0, 0, [2, 0, 1]]
    joints = np.concatenate([rest, np.zeros((30, 3))])
    shape = np.zeros((52, 3, 16))
    shape[:, :, 0] = 0.015 * joints
    place = folder / "smplh" / "male"
    place.mkdir(parents=True)
    np.savez(place / "model.npz", v_template=joints, shapedirs=shape, J_regressor=np.eye(52))


def test_amass_by_the_body_model_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = amass(tmp_path)
    monkeypatch.delenv(MODELS, raising=False)
    with pytest.raises(MotionFileError, match=rf"body model.*none is at hand.*{MODELS}.*\.npy"):
        load_motion(path)
    monkeypatch.setenv(MODELS, str(tmp_path))
    with pytest.raises(MotionFileError, match="none for 'male' is in"):
        load_motion(path)
    body_model(tmp_path)
    motion = load_motion(path)
    assert (len(motion.positions), motion.fps) == (60, 60.0)
    turned = np.unwrap(heading(motion.positions))
    assert turned[-1] - turned[0] == pytest.approx(np.pi)
    np.testing.assert_allclose(motion.positions[:, 0, :2], [[1.0, 2.0]] * 60)
    was = np.linalg.norm(y_up_walk()[0, 4] - y_up_walk()[0, 1])
    is_now = np.linalg.norm(motion.positions[:, 4] - motion.positions[:, 1], axis=1)
    np.testing.assert_allclose(is_now, 1.015 * was)


def test_joints_turn_as_the_rotations_say() -> None:
    """Against scipy's composition of rotations along the chain to the left wrist."""
    rng = np.random.default_rng(4)
    rest, poses = rng.normal(size=(22, 3)), rng.normal(size=(3, 22, 3))
    joints = pose_joints(rest, poses)
    chain = [0, 3, 6, 9, 13, 16, 18, 20]
    for t in range(3):
        turn, at = Rotation.from_rotvec(poses[t, 0]), rest[0]
        for parent, joint in pairwise(chain):
            at = at + turn.apply(rest[joint] - rest[parent])
            turn = turn * Rotation.from_rotvec(poses[t, joint])
        np.testing.assert_allclose(joints[t, 20], at)


def test_archives_that_are_no_motion(tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match=r"do not fit"):
        load_motion(amass(tmp_path, poses=np.zeros((60, 12))))
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(MotionFileError, match="not a motion of AMASS; it has x"):
        load_motion(tmp_path / "other.npz")
    (tmp_path / "damaged.npz").write_bytes(b"PK nonsense")
    with pytest.raises(MotionFileError, match=r"not a \.npz archive"):
        load_motion(tmp_path / "damaged.npz")
    amass(tmp_path).rename(tmp_path / "renamed.npy")
    with pytest.raises(MotionFileError, match="an archive of arrays"):
        load_motion(tmp_path / "renamed.npy")


def test_paths_that_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "empty.bvh").touch()
    (tmp_path / "walk.fbx").write_text("x")
    (tmp_path / "folder.npy").mkdir()
    for path, fault in {
        tmp_path / "none.bvh": "no such file",
        tmp_path / "empty.bvh": "the file is empty",
        tmp_path / "folder.npy": "not a file",
        tmp_path / "walk.fbx": "no loader for .fbx; known are .bvh, .npy",
        tmp_path / ("n" * 5000): "cannot be read",
        "nul\0.bvh": "nul",
    }.items():
        with pytest.raises(MotionFileError, match=fault):
            load_motion(path)


def deepmimic(tmp_path: Path, **change: object) -> Path:
    """A small valid DeepMimic file, a body at rest, with some of its content replaced."""
    ball, hinge = [1.0, 0.0, 0.0, 0.0], [0.0]
    leg = arm = [*ball, *hinge]
    frame = [0.05, 0.0, 0.9, 0.0, *ball, *ball, *ball, *leg, *ball, *arm, *leg, *ball, *arm]
    data = {"Loop": "none", "Frames": [list(frame) for _ in range(20)]} | change
    file = tmp_path / "m.json"
    file.write_text(json.dumps(data, indent=1))
    return file


def test_deepmimic_rest_pose(tmp_path: Path) -> None:
    loaded = load_motion(deepmimic(tmp_path))
    positions = loaded.positions[0]
    assert loaded.fps == pytest.approx(20.0)
    assert positions[INDEX["left_hip"], 1] == pytest.approx(0.0849, abs=1e-3)
    assert positions[INDEX["left_ankle"], 2] == pytest.approx(0.08, abs=1e-9)
    assert positions[INDEX["left_foot"]] - positions[INDEX["left_ankle"]] == pytest.approx(
        [0.13, 0.0, -0.06], abs=1e-9
    )
    assert positions[INDEX["left_wrist"], 2] < positions[INDEX["left_elbow"], 2] - 0.2


def test_deepmimic_uneven_steps_are_evened(tmp_path: Path) -> None:
    data = json.loads(deepmimic(tmp_path).read_text())
    data["Frames"][4][0] = 0.1
    for i, frame in enumerate(data["Frames"]):
        frame[1] = 0.05 * i + (0.05 if i > 4 else 0.0)  # at 1 m/s
    loaded = load_motion(deepmimic(tmp_path, **data))
    assert len(loaded.positions) == 21
    np.testing.assert_allclose(np.diff(loaded.positions[:, 0, 0]), 0.05, atol=1e-9)


@pytest.mark.parametrize(
    ("frames", "fault"),
    [
        ([], "Frames is not a list, or is empty"),
        (None, "Frames is not a list"),
        ([[0.05] * 20] * 20, "frame 0 has 20 numbers, a humanoid's has 44"),
        ([[0.05] * 44] * 20, "quaternion"),
        ([[0.0] * 44] * 20, "positive time steps"),
        ([["x"] * 44] * 20, "no sensible number"),
        ([[float("nan")] * 44] * 20, "no sensible number"),
        ([[1e400] * 44] * 20, "no sensible number"),
        ([[True] * 44] * 20, "no sensible number"),
    ],
)
def test_deepmimic_faults(frames: object, fault: str, tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match=fault):
        load_motion(deepmimic(tmp_path, Frames=frames))


def test_json_fault_names_its_line(tmp_path: Path) -> None:
    file = deepmimic(tmp_path)
    lines = file.read_text().splitlines()
    lines[40] = "oops"
    file.write_text("\n".join(lines))
    with pytest.raises(MotionFileError, match=r"line 4[01]: not JSON"):
        load_motion(file)
    file.write_text("[" * 200_000)
    with pytest.raises(MotionFileError, match="not JSON"):
        load_motion(file)
    file.write_text("[1, 2]")
    with pytest.raises(MotionFileError, match="no list of Frames"):
        load_motion(file)


@pytest.mark.parametrize(
    ("suffix", "kind"),
    [(".npy", "positions"), (".npy", "results"), (".pkl", "joints"), (".npz", "amass"),
     (".bvh", ""), (".json", ""), (".txt", "")],
)  # fmt: skip
def test_damaged_files_raise_nothing_else(
    suffix: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Random bytes, truncations and flipped bytes load or raise MotionFileError."""
    rng = np.random.default_rng(1)
    good = b""
    if kind == "positions":
        good = save(tmp_path, y_up_walk()).read_bytes()
    elif kind == "results":
        one = {"motion": y_up_walk().transpose(1, 2, 0)[None], "text": ["a"], "lengths": [26]}
        good = results_of_mdm(tmp_path / "results.npy", **one).read_bytes()
    elif kind == "joints":
        good = pickle.dumps({"joints": y_up_walk(), "text": "a person walks", "length": 26})
    elif kind == "amass":
        body_model(tmp_path)
        monkeypatch.setenv(MODELS, str(tmp_path))
        good = amass(tmp_path).read_bytes()
    elif suffix != ".bvh":
        good = deepmimic(tmp_path).read_bytes()
    file = tmp_path / f"damaged{suffix}"
    for trial in range(120):
        data = bytearray(good or rng.bytes(400))
        if trial % 3 == 0:
            data = data[: rng.integers(len(data))]
        elif trial % 3 == 1:
            limit = min(len(data), 200 if trial % 2 else len(data))  # often in the header
            for at in rng.integers(limit, size=rng.integers(1, 10)):
                data[at] = rng.integers(256)
        else:
            data = bytearray(good[: rng.integers(20)] + rng.bytes(rng.integers(1, 3000)))
        file.write_bytes(data)
        try:
            loaded = load_motion(file)
        except MotionFileError:
            continue
        assert np.isfinite(loaded.positions).all()


def test_face_forward_starts_at_the_origin() -> None:
    clip = load_clip("turn_left0")
    turn = Rotation.from_euler("z", 2.0).as_matrix()
    turned = HumanMotion(clip.positions @ turn.T + np.array([3.0, -1.0, 0.0]), clip.fps)
    for motion in (clip, turned):
        forward = face_forward(motion)
        assert heading(forward.positions)[0] == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_allclose(forward.positions[0, 0, :2], 0.0, atol=1e-12)
        np.testing.assert_allclose(forward.positions[..., 2], motion.positions[..., 2])
    np.testing.assert_allclose(
        face_forward(clip).positions, face_forward(turned).positions, atol=1e-12
    )


def test_ground_is_where_the_feet_stand() -> None:
    """Neither the height it comes at, nor flight, nor one bad frame moves the floor."""
    for name in ("walk", "jump", "kick"):
        clip = load_clip(name)
        raised = clip.positions + np.array([0.0, 0.0, 5.0])
        np.testing.assert_allclose(ground(raised), clip.positions, atol=1e-9)
        glitched = raised.copy()
        glitched[5, :, 2] -= 0.3
        assert np.abs(ground(glitched)[6:] - clip.positions[6:]).max() < 0.01
        assert abs(np.percentile(clearance(clip.positions).min(axis=(1, 2)), 25)) < 0.02
