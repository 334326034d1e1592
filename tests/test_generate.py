"""From a command to candidates: determinism, styles, sequences, the system."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.common.value import Value

from robomirror_drake.exceptions import InputError, PortError, UnknownCommandError
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.generate import GeneratorOptions, draw_style, generate
from robomirror_drake.motion.ground import FEET
from robomirror_drake.motion.skeleton import INDEX
from robomirror_drake.systems.motion_generator import MotionGenerator

COMMAND = "a person walks forward four steps, then waves with the right hand"


def test_same_seed_same_bytes_however_many_are_asked_for() -> None:
    three, five = generate(COMMAND, 3, seed=4), generate(COMMAND, 5, seed=4)
    assert [m.positions.tobytes() for m in three] == [m.positions.tobytes() for m in five[:3]]
    assert [m.style for m in three] == [m.style for m in five[:3]]
    other = generate(COMMAND, 3, seed=5)
    assert np.array_equal(three[0].positions, other[0].positions)  # nominal
    assert three[1].positions.tobytes() != other[1].positions.tobytes()


def test_candidates_say_where_they_come_from() -> None:
    nominal, drawn = generate(COMMAND, 2, seed=9)
    assert nominal.text == drawn.text == COMMAND
    assert nominal.source == "generator:walk+wave seed 9 candidate 0"
    assert drawn.source.endswith("candidate 1")
    assert nominal.style["tempo"] == 1.0
    assert drawn.style != nominal.style
    assert nominal.fps == 60.0


def test_recordings_are_named_in_the_provenance() -> None:
    (motion,) = generate("does a karate kick, then walks forward two steps", 1)
    assert "karate_kick(pybullet:kick)+walk" in motion.source
    steps = np.linalg.norm(np.diff(motion.positions, axis=0), axis=-1).max(axis=1)
    assert 60.0 * steps.max() < 14.0  # no jump where the two meet
    assert steps[-3:].max() < 1e-4


def test_without_diversity_all_candidates_are_alike() -> None:
    a, b = generate("bow", 2, options=GeneratorOptions(diversity=0.0, fps=30.0))
    assert np.array_equal(a.positions, b.positions)
    assert a.fps == 30.0


def test_styles_stay_in_range() -> None:
    styles = [draw_style(1, k) for k in range(1, 200)]
    assert min(s.step_width for s in styles) >= 0.18
    assert min(s.step_height for s in styles) >= 0.065
    assert {s.mirrored for s in styles} == {0.0, 1.0}
    tempos = np.array([s.tempo for s in styles])
    assert 0.6 < tempos.min() < 0.7 < 1.15 < tempos.max() < 1.25


@pytest.mark.parametrize(
    "text",
    ["a man turns around", "he limps slowly forward", "she walks slowly backward", "step left"],
)
def test_feet_that_step_are_seen_to_leave_the_floor(text: str) -> None:
    """In no style does a step look like standing: the robot would be told to stand there."""
    for motion in generate(text, 12, seed=0):
        contact = foot_contacts(motion)
        for side in range(2):
            toe = motion.positions[:, FEET[side, 1], :2]
            going = np.linalg.norm(np.diff(toe, axis=0), axis=1) * motion.fps > 0.1
            change = np.flatnonzero(np.diff(going, prepend=False, append=False))
            swings = [(a, b) for a, b in zip(change[::2], change[1::2], strict=True)
                      if np.linalg.norm(toe[b] - toe[a]) > 0.05]  # fmt: skip
            assert swings
            assert all((~contact[a:b, side]).any(axis=0).all() for a, b in swings)


def test_a_sequence_is_done_in_order() -> None:
    (motion,) = generate("turns left 90 degrees and walks forward one meter, then waves", 1)
    positions = motion.positions
    assert positions[-1, 0, :2] == pytest.approx([0.0, 1.0], abs=0.05)
    highest = positions[:, INDEX["right_wrist"], 2].argmax()
    assert positions[highest, 0, :2] == pytest.approx([0.0, 1.0], abs=0.05)
    assert np.ptp(bone_lengths(positions), axis=0).max() < 1e-9


def test_a_gesture_goes_along_with_the_walk() -> None:
    (plain,) = generate("walks forward six steps", 1)
    (motion,) = generate("walks forward six steps while waving the left hand", 1)
    wrist, neck = motion.positions[:, INDEX["left_wrist"]], motion.positions[:, INDEX["neck"]]
    up = wrist[:, 2] > neck[:, 2]
    walked = motion.positions[up, 0, 0]
    assert np.ptp(walked) > 0.3
    assert motion.positions[-1, 0, 0] == pytest.approx(plain.positions[-1, 0, 0], abs=1e-3)


@pytest.mark.parametrize(
    "text", ["walks while clapping while waving", "waves the right hand while clapping"]
)
def test_two_gestures_cannot_share_an_arm(text: str) -> None:
    with pytest.raises(InputError, match="already in use"):
        generate(text, 1)


def test_two_gestures_of_different_arms_go_together() -> None:
    (motion,) = generate("points with the right hand while waving the left hand", 1)
    wrists = motion.positions[:, [INDEX["left_wrist"], INDEX["right_wrist"]]]
    shoulders = motion.positions[:, [INDEX["left_shoulder"], INDEX["right_shoulder"]], 2]
    left_up, right_out = wrists[:, 0, 2] > shoulders[:, 0], wrists[:, 1, 0] > 0.45
    assert (left_up & right_out).any()


@pytest.mark.parametrize(
    ("n", "seed", "says"), [(0, 0, "candidates"), (1000, 0, "candidates"), (1, -1, "seed")]
)
def test_bad_numbers_are_refused(n: int, seed: int, says: str) -> None:
    with pytest.raises(InputError, match=says):
        generate("bow", n, seed)


def test_a_motion_without_end_is_refused() -> None:
    with pytest.raises(InputError, match="at most"):
        generate(" then ".join(["walks forward 20 meters at 0.2 m/s"] * 3), 1)


def test_system_outputs_the_candidates_of_its_command() -> None:
    generator = MotionGenerator(n=2, seed=3)
    context = generator.CreateDefaultContext()
    command, port = generator.GetInputPort("command"), generator.GetOutputPort("candidates")
    command.FixValue(context, Value[object]("a person bows"))
    candidates = port.Eval(context)
    assert candidates == generate("a person bows", 2, 3)
    context.SetTime(1.0)
    assert port.Eval(context)[0] is candidates[0]  # cached: time is no prerequisite
    command.FixValue(context, Value[object]("a person waves"))
    assert port.Eval(context)[0].text == "a person waves"
    assert context.num_total_states() == 0


@pytest.mark.parametrize(
    ("command", "error"), [(3, PortError), ("the stock market fell", UnknownCommandError)]
)
def test_system_raises_errors_that_say_why(command: object, error: type[Exception]) -> None:
    generator = MotionGenerator()
    context = generator.CreateDefaultContext()
    generator.GetInputPort("command").FixValue(context, Value[object](command))
    with pytest.raises(error):
        generator.GetOutputPort("candidates").Eval(context)


def test_vigour_makes_all_candidates_quicker_and_larger() -> None:
    calm = generate("a person squats", 3, seed=2)
    wild = generate("a person squats", 3, seed=2, options=GeneratorOptions(vigour=1.5))
    for a, b in zip(calm, wild, strict=True):
        assert b.duration < a.duration
        assert b.style["tempo"] == pytest.approx(1.5 * a.style["tempo"])
        assert b.style["amplitude"] == pytest.approx(1.5 * a.style["amplitude"])
        assert b.style["mirrored"] == a.style["mirrored"]
