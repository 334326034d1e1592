"""BVH: every dialect gives the same human, every damage a MotionFileError with its line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.motion.bvh import load_bvh
from robomirror_drake.motion.bvh_names import match_joints, split_name
from robomirror_drake.motion.bvh_parser import parse_bvh
from robomirror_drake.motion.ground import clearance
from robomirror_drake.motion.skeleton import INDEX, JOINTS, PARENTS

# A T-pose facing +z, y up [m]: joint -> (parent, offset). Feet and head first have none.
BODY: dict[str, tuple[str | None, tuple[float, float, float]]] = {
    "pelvis": (None, (0.0, 0.0, 0.0)),
    "spine": ("pelvis", (0.0, 0.12, -0.01)),
    "chest": ("spine", (0.0, 0.18, 0.0)),
    "neck": ("chest", (0.0, 0.2, -0.02)),
    "head": ("neck", (0.0, 0.1, 0.03)),
}
for _side, _x in (("left", 1.0), ("right", -1.0)):
    BODY |= {
        f"{_side}_collar": ("chest", (_x * 0.05, 0.14, 0.0)),
        f"{_side}_shoulder": (f"{_side}_collar", (_x * 0.13, 0.02, 0.0)),
        f"{_side}_elbow": (f"{_side}_shoulder", (_x * 0.28, 0.0, 0.0)),
        f"{_side}_wrist": (f"{_side}_elbow", (_x * 0.25, 0.0, 0.0)),
        f"{_side}_hip": ("pelvis", (_x * 0.09, -0.05, 0.0)),
        f"{_side}_knee": (f"{_side}_hip", (0.0, -0.41, 0.0)),
        f"{_side}_ankle": (f"{_side}_knee", (0.0, -0.41, 0.0)),
        f"{_side}_foot": (f"{_side}_ankle", (0.0, -0.06, 0.13)),
    }
# Written depth first, as the format has it.
ORDER = ["pelvis", "spine", "chest", "neck", "head"] + [
    f"{side}_{part}"
    for side in ("left", "right")
    for part in ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
]


def names(centre: str, sided: str, parts: str) -> dict[str, str]:
    """Joint names of a dialect: five central ones, then ``{side}`` patterns over eight parts."""
    table = dict(zip(("pelvis", "spine", "chest", "neck", "head"), centre.split(), strict=True))
    for side in ("left", "right"):
        for joint, part in zip(
            ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot"),
            parts.split(),
            strict=True,
        ):
            fill = {"side": side.title(), "s": side[0], "S": side[0].upper(), "part": part}
            table[f"{side}_{joint}"] = sided.format(**fill)
    return table


@dataclass(frozen=True)
class Dialect:
    names: dict[str, str]
    unit: float  # metres
    order: str = "ZXY"
    up: str = "y"
    all_positions: bool = False
    wrapper: str = ""  # a root joint above the hips, which carry the translation
    toes: bool = True
    brace: str = "\n{indent}{{"


MIXAMO = names(
    "Hips Spine Spine1 Neck Head", "{side}{part}",
    "Shoulder Arm ForeArm Hand UpLeg Leg Foot ToeBase",
)  # fmt: skip
DIALECTS = {
    "cmu": Dialect(MIXAMO, 0.0254 / 0.45),
    "mixamo": Dialect({k: f"mixamorig:{v}" for k, v in MIXAMO.items()}, 0.01, "XYZ"),
    "bandai": Dialect(
        names("Hips Spine Chest Neck Head", "{part}_{S}",
              "Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot Toes"),
        0.01, "ZXY", all_positions=True, wrapper="joint_Root",
    ),
    "threejs": Dialect(
        names("hip abdomen chest neck head", "{s}{part}",
              "Collar Shldr ForeArm Hand Thigh Shin Foot Toe"),
        0.0254, "YXZ", toes=False,
    ),
    "biovision": Dialect(
        names("Hips Chest Chest2 Neck Head", "{side}{part}",
              "Collar Shoulder Elbow Wrist Hip Knee Ankle Toe"),
        0.01, "ZYX", up="z",
    ),
    "biped": Dialect(
        {k: f"Bip01 {v}" for k, v in names("Pelvis Spine Spine1 Neck Head", "{S} {part}",
              "Clavicle UpperArm Forearm Hand Thigh Calf Foot Toe0").items()},
        0.0254, "XZY", up="z", brace=" {{",
    ),
    "smpl": Dialect(
        names("Pelvis Spine1 Spine2 Neck Head", "{S}_{part}",
              "Collar Shoulder Elbow Wrist Hip Knee Ankle Foot"),
        1.0, "ZYX",
    ),
    "unreal": Dialect(
        names("pelvis spine_01 spine_02 neck_01 head", "{part}_{s}",
              "clavicle upperarm lowerarm hand thigh calf foot ball"),
        0.001,
    ),
}  # fmt: skip


def motion(frames: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Smooth local rotations (T, J, 3, 3) and pelvis path (T, 3) [m], y up."""
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 1.0, frames)[:, None, None]
    phase, speed = rng.uniform(0.0, 6.0, (2, 1, len(ORDER), 3))
    rotvec = 0.25 * np.sin(speed * t + phase)
    turns = Rotation.from_rotvec(rotvec.reshape(-1, 3)).as_matrix().reshape(frames, -1, 3, 3)
    path = np.stack([0.3 * t[:, 0, 0] ** 2, 0.95 + 0.05 * np.sin(3 * t[:, 0, 0]), t[:, 0, 0]], 1)
    return turns, path


def reference(turns: np.ndarray, path: np.ndarray) -> np.ndarray:
    """(T, 22, 3) joints by homogeneous transforms, z up; NaN where BODY has no such joint."""
    world: dict[str, np.ndarray] = {}
    for j, joint in enumerate(ORDER):
        parent, offset = BODY[joint]
        local = np.tile(np.eye(4), (len(path), 1, 1))
        local[:, :3, :3] = turns[:, j]
        local[:, :3, 3] = path if parent is None else offset
        world[joint] = local if parent is None else world[parent] @ local
    out = np.full((len(path), 22, 3), np.nan)
    for i, joint in enumerate(JOINTS):
        if joint in world:
            out[:, i] = world[joint][:, [2, 0, 1], 3]
    return out


def write(dialect: Dialect, turns: np.ndarray, path: np.ndarray, rate: float = 30.0) -> str:
    """The motion as BVH text in a dialect."""
    base = np.eye(3) if dialect.up == "y" else np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    turns = base @ turns @ base.T
    rotations = [f"{axis}rotation" for axis in dialect.order]
    positions = ["Xposition", "Yposition", "Zposition"]
    lines = ["HIERARCHY"]
    columns: list[np.ndarray] = []

    def emit(joint: str, indent: str, is_root: bool) -> None:
        parent, offset = BODY[joint]
        offset = base @ np.array(offset) / dialect.unit
        opener = dialect.brace.format(indent=indent)
        lines.append(f"{indent}{'ROOT' if is_root else 'JOINT'} {dialect.names[joint]}{opener}")
        lines.append(f"{indent}  OFFSET " + " ".join(f"{x:.9g}" for x in offset))
        moves = parent is None or dialect.all_positions
        channels = (positions if moves else []) + rotations
        lines.append(f"{indent}  CHANNELS {len(channels)} {' '.join(channels)}")
        if moves:
            shift = (
                path @ base.T / dialect.unit if parent is None else np.tile(offset, (len(path), 1))
            )
            columns.append(shift)
        local = Rotation.from_matrix(turns[:, ORDER.index(joint)])
        columns.append(local.as_euler(dialect.order, degrees=True))
        children = [c for c in ORDER if BODY[c][0] == joint]
        for child in children:
            if child.endswith("foot") and not dialect.toes:
                end = base @ np.array(BODY[child][1]) / dialect.unit
                lines.extend([f"{indent}  End Site", f"{indent}  {{",
                              f"{indent}    OFFSET " + " ".join(f"{x:.9g}" for x in end),
                              f"{indent}  }}"])  # fmt: skip
            else:
                emit(child, indent + "  ", False)
        if not children:
            lines.extend([f"{indent}  End Site", f"{indent}  {{", f"{indent}    OFFSET 0 0 0.1",
                          f"{indent}  }}"])  # fmt: skip
        lines.append(f"{indent}}}")

    if dialect.wrapper:
        lines.extend([f"ROOT {dialect.wrapper}", "{", "  OFFSET 0 0 0",
                      "  CHANNELS 6 " + " ".join(positions + rotations)])  # fmt: skip
        columns.append(np.zeros((len(path), 6)))
    emit("pelvis", "  " if dialect.wrapper else "", not dialect.wrapper)
    lines.extend(["}"] if dialect.wrapper else [])
    values = np.concatenate(columns, axis=1)
    lines += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {1.0 / rate:.8f}"]
    lines += [" ".join(f"{x:.9g}" for x in row) for row in values]
    return "\n".join(lines) + "\n"


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "motion.bvh"
    file.write_text(text)
    return file


@pytest.mark.parametrize("name", DIALECTS)
def test_dialect_gives_the_same_human(name: str, tmp_path: Path) -> None:
    turns, path = motion()
    loaded = load_bvh(written(tmp_path, write(DIALECTS[name], turns, path)))
    expected = reference(turns, path)
    shift = loaded.positions[0, 0] - expected[0, 0]
    expected += np.array([0.0, 0.0, shift[2]])  # the floor is the loader's choice, x and y are not
    known = ~np.isnan(expected)
    assert known[..., 0].sum(axis=1).min() == 19  # all but spine1 to 3
    assert np.abs(loaded.positions[known] - expected[known]).max() < 1e-4
    assert loaded.fps == pytest.approx(30.0, rel=1e-4)
    assert abs(np.median(clearance(loaded.positions).min(axis=(1, 2)))) < 0.05


def test_spine_lies_between_pelvis_and_neck(tmp_path: Path) -> None:
    loaded = load_bvh(written(tmp_path, write(DIALECTS["cmu"], *motion())))
    chain = [INDEX[j] for j in ("pelvis", "spine1", "spine2", "spine3", "neck")]
    heights = loaded.positions[:, chain, 2]
    assert (np.diff(heights, axis=1) > 0.02).all()
    bones = np.linalg.norm(loaded.positions[:, 1:] - loaded.positions[:, PARENTS[1:]], axis=2)
    assert bones[:, [j - 1 for j in chain[1:]]].std(axis=0).max() < 0.01


def test_agrees_with_pymotion(tmp_path: Path) -> None:
    """An independent reader and forward kinematics, on a file both understand."""
    bvh = pytest.importorskip("pymotion.io.bvh")
    skeleton = pytest.importorskip("pymotion.ops.skeleton_np")
    text = write(DIALECTS["mixamo"], *motion())
    theirs = bvh.BVH()
    theirs.load(str(written(tmp_path, text)))
    turns, at, parents, offsets, _, _ = theirs.get_data()
    expected, _ = skeleton.fk_quat(turns, at[:, 0], offsets, parents)
    ours, _ = parse_bvh("m.bvh", text).forward_kinematics()
    np.testing.assert_allclose(ours, expected, atol=1e-3)  # centimetres


def test_calibration_frame_is_dropped(tmp_path: Path) -> None:
    turns, path = motion()
    turns = np.concatenate([np.tile(np.eye(3), (1, len(ORDER), 1, 1)), turns])
    path = np.concatenate([path[:1] + np.array([1.0, 0.0, -2.0]), path])
    loaded = load_bvh(written(tmp_path, write(DIALECTS["cmu"], turns, path)))
    assert len(loaded.positions) == len(path) - 1


def test_unit_and_axis_can_be_told(tmp_path: Path) -> None:
    turns, path = motion()
    giant = Dialect(MIXAMO, 0.2)  # 8.5 units tall: no unit that we know makes that a human
    file = written(tmp_path, write(giant, turns, path))
    with pytest.raises(MotionFileError, match=r"units tall.*metres_per_unit"):
        load_bvh(file)
    loaded = load_bvh(file, metres_per_unit=0.2, up="y")
    assert loaded.positions[0, INDEX["head"], 2] > 1.2
    with pytest.raises(MotionFileError, match=r"person is .* m tall"):
        load_bvh(file, metres_per_unit=2.0)


def test_extra_channels_and_orders() -> None:
    """Rotations before positions, and joints with no or one channel."""
    text = """HIERARCHY
    ROOT a { OFFSET 1 2 3
      CHANNELS 4 Zrotation Zposition Xposition Yposition
      JOINT b { OFFSET 1 0 0 CHANNELS 0
      } }
    MOTION
    Frames: 1
    Frame Time: 0.1
    90 3 1 2
    """.replace("OFFSET 1 0 0 CHANNELS 0", "OFFSET 1 0 0\n CHANNELS 0")
    at, _ = parse_bvh("m.bvh", text).forward_kinematics()
    np.testing.assert_allclose(at[0], [[1, 2, 3], [1, 3, 3]], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("mixamorig:LeftUpLeg", ("left", "upleg")), ("Bip01 R Thigh", ("right", "thigh")),
        ("lShldr", ("left", "shldr")), ("upper_arm.L", ("left", "upperarm")),
        ("LowerBack", ("", "lowerback")), ("rshldr", ("right", "shldr")), ("root", ("", "root")),
        ("leg", ("", "leg")), ("J_Bip_L_Hand", ("left", "hand")), ("ball_r", ("right", "ball")),
    ],
)  # fmt: skip
def test_split_name(name: str, expected: tuple[str, str]) -> None:
    assert split_name(name) == expected


def test_shoulder_is_collar_only_beside_an_arm() -> None:
    assert "left_collar" not in match_joints(["LeftShoulder", "LeftElbow"])
    found = match_joints(["LeftShoulder", "LeftArm", "LeftForeArm"])
    assert found == {"left_collar": 0, "left_shoulder": 1, "left_elbow": 2}


GOOD = write(DIALECTS["cmu"], *motion())


def line_of(text: str) -> int:
    return next(i for i, line in enumerate(GOOD.splitlines(), 1) if text in line)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("HIERARCHY", "HIERARCH", "line 1: not a BVH"),
        ("JOINT LeftUpLeg", "JOINT LeftFin", "left_hip.*LeftFin"),
        ("OFFSET 0", "OFFSET zero", r"line \d+: OFFSET needs three numbers"),
        ("OFFSET 0", "OFFSET nan", r"line \d+: OFFSET needs three numbers"),
        ("CHANNELS 3", "CHANNELS 4", r"line \d+: cannot read CHANNELS"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Zspin", r"line \d+: cannot read CHANNELS"),
        ("  End Site", "  Ent Site", r"line \d+: cannot read 'Ent Site'"),
        ("MOTION", "}\nMOTION", r"line \d+: a brace closes nothing"),
        ("Frames: 40", "Frames: 41", r"line \d+: the file has 40 frames, its header says 41"),
        ("Frames: 40", "Frames: 99999999999999999999", "header says"),
        ("Frames: 40", "Frames: many", rf"line {line_of('Frames:')}: expected 'Frames:'"),
        ("Frame Time: 0.03333333", "Frame Time: 0", r"frame time is 0 s"),
        ("Frame Time: 0.03333333", "Frame Time: 33.3", r"frame time is 33.3 s"),
        ("Frame Time: 0.03333333", "Frame Time: nan", r"frame time is nan s"),
        ("Frame Time: 0.03333333", "Frame Time: 0.001", "last 0.04 s"),
    ],
)
def test_fault_is_named(old: str, new: str, fault: str, tmp_path: Path) -> None:
    assert old in GOOD
    file = written(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(MotionFileError, match=fault) as caught:
        load_bvh(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("value", "fault"),
    [("nan", "NaN"), ("1e300", "absurdly"), ("x", "not a number"), ("1 2", "numbers, the channels"),
     ("1e7", "joint moves")],
)  # fmt: skip
def test_bad_number_in_a_frame(value: str, fault: str, tmp_path: Path) -> None:
    lines = GOOD.splitlines()
    row = len(lines) - 7
    lines[row] = " ".join([value, *lines[row].split()[1:]])
    with pytest.raises(MotionFileError, match=fault) as caught:
        load_bvh(written(tmp_path, "\n".join(lines)))
    assert fault == "joint moves" or f"line {row + 1}:" in str(caught.value)


def test_swapped_sides_are_noticed(tmp_path: Path) -> None:
    swap = {"Left": "Right", "Right": "Left"}
    mirrored = {k: next((v.replace(a, b) for a, b in swap.items() if a in v), v)
                for k, v in MIXAMO.items()}  # fmt: skip
    text = write(Dialect(mirrored, 0.01), *motion())
    with pytest.raises(MotionFileError, match="feet point backwards"):
        load_bvh(written(tmp_path, text))


def test_damaged_files_raise_nothing_else(tmp_path: Path) -> None:
    """Truncation anywhere, and random edits, load or raise MotionFileError."""
    rng = np.random.default_rng(0)
    refused = 0
    for trial in range(150):
        text = GOOD
        if trial % 2:
            text = text[: rng.integers(len(text))]
        else:
            for _ in range(rng.integers(1, 6)):
                at = rng.integers(len(text))
                junk = rng.choice(["{", "}", "nan", "1e308", "\0", "é", " ", "\n", "-", "JOINT x"])
                text = text[:at] + str(junk) + text[at + rng.integers(0, 4) :]
        try:
            load_bvh(written(tmp_path, text))
        except MotionFileError:
            refused += 1
    assert refused > 75
