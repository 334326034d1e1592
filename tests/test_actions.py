"""What every parametric action promises, measured from the motion in several styles."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from robomirror_drake.messages import Array
from robomirror_drake.motion.body import (
    LEG,
    MASS_WEIGHTS,
    Pose,
    center_of_mass,
    joint_positions,
    move_pelvis,
)
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.composer.balance import GRAVITY, angular_moment, center_of_mass_path
from robomirror_drake.motion.composer.compose import compose
from robomirror_drake.motion.composer.cue import Style, other
from robomirror_drake.motion.composer.score import Score
from robomirror_drake.motion.generate import draw_style
from robomirror_drake.motion.ground import ANKLE_HEIGHT, TOE_HEIGHT
from robomirror_drake.motion.library import library
from robomirror_drake.motion.plausibility import arm_in_body
from robomirror_drake.motion.skeleton import INDEX
from robomirror_drake.motion.text import Clause

FPS = 60.0
PARAMETRIC = [name for name, action in library().items() if not action.clip]
ANKLES = [INDEX["left_ankle"], INDEX["right_ankle"]]
TOES = [INDEX["left_foot"], INDEX["right_foot"]]
HIPS = [INDEX["left_hip"], INDEX["right_hip"]]
FLYING = frozenset({"jump", "hop", "leap", "skip", "run", "jumping_jack"})
"""Actions that leave the floor."""
QUICK = FLYING | {"jog", "back_kick", "side_kick", "throw"}
"""Actions whose balance is that of the moment only."""
STYLES = [(name, k) for name in PARAMETRIC for k in (0, 1 + len(name) % 3)]


@cache
def _motion(name: str, candidate: int) -> Array:
    return make(name, style=draw_style(5, candidate))


def make(name: str, style: Style | None = None, **parameters: object) -> Array:
    """(T, 22, 3) positions of one action."""
    clause = Clause(text=name, action=name, group=library()[name].group, **parameters)
    return compose((clause,), style or Style(), FPS)


def heading(positions: Array) -> Array:
    """(T,) unwrapped yaw of the hips."""
    across = positions[:, HIPS[0]] - positions[:, HIPS[1]]
    return np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))


def planted(positions: Array) -> Array:
    """(T, 2) whether each foot stands flat on the floor."""
    return (positions[:, ANKLES, 2] < ANKLE_HEIGHT + 1e-4) & (
        positions[:, TOES, 2] < TOE_HEIGHT + 1e-4
    )


def footfalls(positions: Array) -> int:
    """How often a foot comes down."""
    down = planted(positions).astype(int)
    return int((np.diff(down, axis=0) == 1).sum())


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_bones_keep_their_length_and_nothing_is_below_the_floor(name: str, candidate: int) -> None:
    positions = _motion(name, candidate)
    assert np.ptp(bone_lengths(positions), axis=0).max() < 1e-9
    assert positions[..., 2].min() > TOE_HEIGHT - 1e-9
    assert positions[:, ANKLES, 2].min() > ANKLE_HEIGHT - 1e-9


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_planted_feet_do_not_move(name: str, candidate: int) -> None:
    positions = _motion(name, candidate)
    down = planted(positions)
    both = down[1:] & down[:-1]
    for joints in (ANKLES, TOES):
        speed = FPS * np.linalg.norm(np.diff(positions[:, joints], axis=0), axis=-1)
        assert speed[both].max(initial=0.0) < 0.02  # the first hairs' breadth of a lift-off
        still = both[1:] & both[:-1]
        assert np.median(speed[1:][still]) < 1e-9
    if name not in FLYING:
        assert down.any(axis=1).all(), "both feet in the air"


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_starts_and_ends_at_rest_in_the_neutral_stance(name: str, candidate: int) -> None:
    positions = _motion(name, candidate)
    assert np.allclose(positions[0, 0, :2], 0.0, atol=1e-12)
    assert heading(positions)[0] == pytest.approx(0.0, abs=1e-9)
    turned = heading(positions)[-1]
    c, s = np.cos(turned), np.sin(turned)
    back = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    end = (positions[-1] - positions[-1, 0]) @ back
    assert np.allclose(end, positions[0] - positions[0, 0], atol=1e-3)
    for ends in (positions[:4], positions[-4:]):
        assert FPS * np.abs(np.diff(ends, axis=0)).max() < 5e-3


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_velocity_and_acceleration_are_bounded_and_continuous(name: str, candidate: int) -> None:
    positions = _motion(name, candidate)
    velocity = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * FPS
    acceleration = np.diff(positions, 2, axis=0) * FPS**2
    assert velocity.max() < 12.0
    assert np.linalg.norm(acceleration, axis=-1).max() < (500.0 if name in QUICK else 160.0)
    # A step in velocity of 0.5 m/s would be 30 m/s² in one frame; C² motion has no lone spikes.
    spike = np.abs(acceleration[1:-1] - 0.5 * (acceleration[2:] + acceleration[:-2]))
    assert spike.max() < (90.0 if name in QUICK else 25.0)


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_knees_bend_and_never_lock(name: str, candidate: int) -> None:
    positions = _motion(name, candidate)
    leg = np.linalg.norm(positions[:, ANKLES] - positions[:, HIPS], axis=-1) / LEG
    assert leg.max() < 0.99
    assert leg.min() > 0.35
    bearing = planted(positions)
    assert leg[bearing].max() < 0.972


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_the_zero_moment_point_stays_inside_the_soles(name: str, candidate: int) -> None:
    """Of all body masses, limbs included, by 1 cm wherever the floor bears half the weight."""
    if name in QUICK:
        pytest.skip("goes on from step to step")
    positions = _motion(name, candidate)
    com, limbs = center_of_mass(positions), angular_moment(positions, MASS_WEIGHTS, 1.0 / FPS)
    acceleration = np.diff(com, 2, axis=0) * FPS**2
    weight = 1.0 + acceleration[:, 2:] / GRAVITY
    shift = limbs[1:-1] - com[1:-1, 2:] * acceleration[:, :2] / GRAVITY
    zmp = com[1:-1, :2] + shift / np.where(weight > 0.7, weight, 1.0)
    down = planted(positions)[1:-1]
    for k in np.flatnonzero((weight[:, 0] > 0.7) & down.any(axis=1)):
        corners = np.concatenate([sole(positions[k + 1], i) for i in np.flatnonzero(down[k])])
        edges = ConvexHull(corners).equations
        assert (edges[:, :2] @ zmp[k] + edges[:, 2]).max() < -0.01, f"frame {k}"


def sole(frame: Array, foot: int) -> Array:
    """(4, 2) corners of a sole on the floor."""
    ankle = frame[ANKLES[foot], :2]
    ahead = frame[TOES[foot], :2] - ankle
    ahead /= np.linalg.norm(ahead)
    left = np.array([-ahead[1], ahead[0]])
    return np.array([ankle + x * ahead + y * left for x in (-0.06, 0.13) for y in (-0.04, 0.04)])


@pytest.mark.parametrize("count", [2, 4, 7])
@pytest.mark.parametrize("name", ["walk", "walk_backward", "march"])
def test_steps_are_counted(name: str, count: int) -> None:
    assert footfalls(make(name, count=count)) == count


@pytest.mark.parametrize("candidate", range(3))
def test_swing_feet_are_lifted(candidate: int) -> None:
    for name in ("walk", "walk_backward", "side_step", "turn", "march", "lunge"):
        positions = _motion(name, candidate)
        assert positions[:, ANKLES, 2].max(axis=0).min() > ANKLE_HEIGHT + (
            0.049 if name != "lunge" else -1.0
        )


@pytest.mark.parametrize("candidate", range(3))
def test_feet_keep_apart(candidate: int) -> None:
    for name in ("walk", "walk_backward", "march", "turn", "side_step", "lunge"):
        positions = _motion(name, candidate)
        gap = positions[:, ANKLES[0]] - positions[:, ANKLES[1]]
        left = np.stack([-np.sin(heading(positions)), np.cos(heading(positions))], axis=1)
        assert np.sum(gap[:, :2] * left, axis=1).min() > 0.17


@pytest.mark.parametrize(
    ("name", "axis", "sign", "side"),
    [
        ("walk", 0, 1.0, None),
        ("walk_backward", 0, -1.0, None),
        ("side_step", 1, 1.0, "left"),
        ("side_step", 1, -1.0, "right"),
        ("jump", 0, 1.0, None),
    ],
)
@pytest.mark.parametrize("distance", [0.4, 1.5])
def test_distance(name: str, axis: int, sign: float, side: str | None, distance: float) -> None:
    distance = min(distance, 0.5) if name == "jump" else distance
    positions = make(name, side=side, distance=distance)
    assert sign * positions[-1, 0, axis] == pytest.approx(distance, abs=2e-3)
    assert positions[-1, 0, 1 - axis] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("speed", [0.2, 0.4, 0.8])
def test_walking_speed(speed: float) -> None:
    """Between the middle of the walk's steps the pelvis goes at the speed asked for."""
    positions = make("walk", speed=speed, count=10)
    x = positions[:, 0, 0]
    middle = (x > 0.3 * x[-1]) & (x < 0.7 * x[-1])
    assert np.polyfit(np.flatnonzero(middle) / FPS, x[middle], 1)[0] == pytest.approx(
        speed, rel=0.1
    )


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("degrees", [30.0, 90.0, 180.0, 360.0])
def test_turning_angle(side: str, degrees: float) -> None:
    turned = np.rad2deg(heading(make("turn", side=side, angle=np.deg2rad(degrees)))[-1])
    assert turned == pytest.approx(degrees if side == "left" else -degrees, abs=0.1)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", ["wave", "raise_arms", "point", "front_kick", "lunge"])
def test_the_side_that_was_named_does_it(name: str, side: str) -> None:
    positions = make(name, side=side)
    limb = "ankle" if name in ("front_kick", "lunge") else "wrist"
    path = {s: np.ptp(positions[:, INDEX[f"{s}_{limb}"]] - positions[:, 0], axis=0).max()
            for s in ("left", "right")}  # fmt: skip
    named, unnamed = path[side], path["right" if side == "left" else "left"]
    assert named > 1.4 * unnamed


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_fist_that_was_named_reaches_farther(side: str) -> None:
    ahead = make("punch", side=side)[:, [INDEX["left_wrist"], INDEX["right_wrist"]], 0].max(axis=0)
    named, unnamed = ahead if side == "left" else ahead[::-1]
    assert named > unnamed + 0.2


@pytest.mark.parametrize("side", ["left", "right"])
def test_kneeling_is_on_the_knee_that_was_named(side: str) -> None:
    positions = make("kneel", side=side)
    knees = positions[:, [INDEX[f"{side}_knee"], INDEX[f"{other(side)}_knee"]], 2].min(axis=0)
    assert knees[1] > knees[0] + 0.1


@pytest.mark.parametrize(("name", "candidate"), STYLES)
def test_arms_keep_out_of_the_body(name: str, candidate: int) -> None:
    """A hand that hangs by the thigh may brush it in a side lunge."""
    depth = arm_in_body(_motion(name, candidate)[::3]).max()
    assert depth < (0.06 if name == "side_lunge" else 0.02)


def test_mirrored_style_exchanges_sides_only_where_the_words_leave_it_open() -> None:
    mirrored = Style(mirrored=1.0)
    swap = [INDEX[n.replace("left", "?").replace("right", "left").replace("?", "right")]
            for n in INDEX]  # fmt: skip
    plain, exchanged = make("wave"), make("wave", style=mirrored)
    assert np.allclose(exchanged, plain[:, swap] * [1.0, -1.0, 1.0], atol=1e-6)
    assert np.array_equal(make("wave", side="left"), make("wave", side="left", style=mirrored))


def test_waves_are_counted() -> None:
    for count in (2, 5):
        positions = make("wave", side="right", count=count)
        elbow, wrist = INDEX["right_elbow"], INDEX["right_wrist"]
        up = positions[:, wrist, 2] > positions[:, elbow, 2] + 0.15
        y = (positions[:, wrist, 1] - positions[:, elbow, 1])[up]
        outward = (y[1:-1] < y[:-2]) & (y[1:-1] < y[2:]) & (y[1:-1] < y.mean())
        assert outward.sum() == count


def test_claps_are_counted_and_the_hands_meet() -> None:
    for count in (3, 5):
        positions = make("clap", count=count)
        gap = np.linalg.norm(
            positions[:, INDEX["left_wrist"]] - positions[:, INDEX["right_wrist"]], axis=1
        )
        meets = (gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:]) & (gap[1:-1] < 0.12)
        assert meets.sum() == count
        assert gap.min() > 0.05


def test_bow_is_measured_at_the_trunk() -> None:
    def pitch(amplitude: float) -> float:
        positions = make("bow", amplitude=amplitude)
        trunk = positions[:, INDEX["neck"]] - positions[:, 0]
        return float(np.rad2deg(np.arctan2(trunk[:, 0], trunk[:, 2]).max()))

    assert 25.0 < pitch(1.0) < 50.0
    assert pitch(1.3) > pitch(1.0) + 5.0 > pitch(0.7) + 10.0


def test_deep_squat_is_deeper_than_squat() -> None:
    lowest = {name: make(name)[:, 0, 2].min() for name in ("stand", "squat", "deep_squat")}
    assert lowest["stand"] - lowest["squat"] == pytest.approx(0.18, abs=0.01)
    assert lowest["stand"] - lowest["deep_squat"] == pytest.approx(0.34, abs=0.01)


@pytest.mark.parametrize("candidate", range(3))
def test_jump_flies_ballistically(candidate: int) -> None:
    positions = _motion("jump", candidate)
    airborne = ~planted(positions).any(axis=1)
    inner = airborne[:-4] & airborne[1:-3] & airborne[2:-2] & airborne[3:-1] & airborne[4:]
    acceleration = np.diff(center_of_mass(positions), 2, axis=0)[1:-1] * FPS**2
    assert 0.2 < airborne.sum() / FPS < 0.5
    assert np.abs(acceleration[inner] - [0.0, 0.0, -GRAVITY]).max() < 0.25


@pytest.mark.parametrize("name", ["hop", "run", "skip", "leap"])
def test_less_spring_bounces_less(name: str) -> None:
    """The pelvis goes up and down less, and the feet are where they would be."""
    stiff, springy = (make(name, style=Style(spring=spring)) for spring in (0.3, 1.0))
    pelvis = INDEX["pelvis"]
    assert np.ptp(stiff[:, pelvis, 2]) < 0.9 * np.ptp(springy[:, pelvis, 2])
    if name != "run":  # whose steps are as long as the time for them
        assert np.allclose(stiff[-1, ANKLES], springy[-1, ANKLES], atol=1e-6)


def test_jumps_are_counted() -> None:
    airborne = ~planted(make("jump", count=3)).any(axis=1)
    assert (np.diff(airborne.astype(int)) == 1).sum() == 3


@pytest.mark.parametrize("mirrored", [0.0, 1.0])
@pytest.mark.parametrize("name", [name for name, action in library().items() if action.clip])
def test_recorded_motions_fit_in(name: str, mirrored: float) -> None:
    """Our bones, nothing below the floor, at rest in neutral stance at both ends, no jerks."""
    positions = make(name, style=Style(mirrored=mirrored))
    stand = make("stand")[0]
    assert np.allclose(bone_lengths(positions), bone_lengths(stand), atol=1e-9)
    assert positions[:, TOES, 2].min() > TOE_HEIGHT - 1e-9
    assert positions[:, ANKLES, 2].min() > ANKLE_HEIGHT - 1e-9
    turned = heading(positions)[-1]
    c, s = np.cos(turned), np.sin(turned)
    back = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(positions[0], stand, atol=1e-6)
    assert np.allclose((positions[-1] - positions[-1, 0]) @ back, stand - stand[0], atol=1e-6)
    for ends in (positions[:6], positions[-6:]):
        assert FPS * np.abs(np.diff(ends, axis=0)).max() < 1e-3
    acceleration = np.diff(positions, 2, axis=0) * FPS**2
    middle = 0.5 * (acceleration[2:] + acceleration[:-2])
    assert np.abs(acceleration[1:-1] - middle).max() < 400.0  # as jerky as the recordings are


def test_a_body_whose_pelvis_moves_is_as_if_posed_anew() -> None:
    rng, n = np.random.default_rng(0), 20
    foot = np.tile([[0.0, 0.1, ANKLE_HEIGHT], [0.0, -0.1, ANKLE_HEIGHT]], (n, 1, 1))
    pose = Pose(
        pelvis=np.array([0.0, 0.0, 0.85]) + 0.05 * rng.normal(size=(n, 3)),
        pelvis_euler=0.2 * rng.normal(size=(n, 3)),
        chest_euler=0.2 * rng.normal(size=(n, 3)),
        head_euler=0.2 * rng.normal(size=(n, 3)),
        foot=foot + 0.05 * rng.normal(size=(n, 2, 3)),
        foot_yaw=0.3 * rng.normal(size=(n, 2)),
        heel_rise=0.2 * rng.normal(size=(n, 2)),
        arm=rng.normal(size=(n, 2, 4)),
    )
    posed, step = joint_positions(pose), 0.05 * rng.normal(size=(n, 3))
    pose.pelvis[:] += step
    move_pelvis(posed, pose, step)
    np.testing.assert_allclose(posed, joint_positions(pose), atol=1e-12)


def test_mass_fractions_are_whole() -> None:
    assert MASS_WEIGHTS.sum() == pytest.approx(1.0)


def test_angular_moment_of_a_rigid_translation_is_nothing() -> None:
    t = np.linspace(0.0, 1.0, 61)
    offsets = np.random.default_rng(0).normal(size=(5, 3))
    shift = np.stack([t**2, np.sin(t), 0.0 * t], axis=1)
    moment = angular_moment(offsets + shift[:, None], np.full(5, 0.2), t[1])
    assert np.abs(moment).max() < 1e-12
    turning = (
        offsets * np.array([1.0, 1.0, 1.0 + t[30]])
        + np.outer(t**3, [1, 0, 0])[:, None] * (offsets[:, 2:])
    )
    assert np.abs(angular_moment(turning, np.full(5, 0.2), t[1])).max() > 1e-3


def test_center_of_mass_path_keeps_the_reference_zmp() -> None:
    """Of a sway that the pendulum can follow, the zero-moment point comes back."""
    dt, n = 1.0 / FPS, 400
    t = np.arange(n) * dt
    score = Score()
    score.shift_load(1.0, 1.0, 2.5)
    score.shift_load(0.5, 3.5, 5.0)
    zmp = np.column_stack([0.1 * score.sample(t)["load"], np.zeros(n)])
    height = np.full(n, 0.9)
    path = center_of_mass_path(zmp, height, np.zeros((n, 2)), dt)
    acceleration = np.diff(path, 2, axis=0) / dt**2
    back = path[1:-1] - acceleration * (0.9 / GRAVITY)
    assert np.abs(back - zmp[1:-1]).max() < 2e-3
    assert np.abs(path[:3] - zmp[0]).max() < 1e-6
