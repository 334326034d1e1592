"""Commands in English: held-out sentences, known traps, quantities, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.exceptions import InputError, UnknownCommandError
from robomirror_drake.motion.library import library
from robomirror_drake.motion.text import MAX_CHARACTERS, parse


def actions(text: str) -> list[str]:
    return [clause.action for clause in parse(text)]


@pytest.mark.parametrize(
    ("text", "action"),
    [
        ("hops over a puddle", "hop"),
        ("a deep reverence", "bow"),
        ("boxes with the left hand", "punch"),
        ("karate kick", "karate_kick"),
        ("spin kick", "spin_kick"),
        ("dance", "dance"),
        ("run", "run"),
        ("raises a hand to wave", "wave"),
    ],
)
def test_traps(text: str, action: str) -> None:
    assert actions(text) == [action]


@pytest.mark.parametrize("name", list(library()))
def test_every_action_is_known_by_its_description(name: str) -> None:
    description = library()[name].description.split(" (")[0]
    assert actions(f"a person {description}")[-1] == name


@pytest.mark.parametrize(
    "text",
    [
        "the stock market fell",
        "asdf qwer",
        "open the window",
        "he plays the piano",
        "SELECT * FROM users",
        "walks forward, then the stock market fell",
    ],
)
def test_unknown_commands_are_refused_with_the_nearest_three(text: str) -> None:
    with pytest.raises(UnknownCommandError) as caught:
        parse(text)
    assert len(caught.value.nearest) == 3
    assert set(caught.value.nearest) <= library().keys()
    assert caught.value.text in text.lower()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("  \n\t ", "empty"),
        ("walk " * 2000, str(MAX_CHARACTERS)),
        ("人が前に歩く", "English"),
        ("человек идёт вперёд", "English"),
        ("1234", "English"),
        ("\x00\x01", "English"),
        ("jumps 1000 times", "out of range"),
        ("jumps zero times", "out of range"),
        ("walks forward 500 meters", "out of range"),
        ("walks at 30 km/h", "out of range"),
        ("turns 99999 degrees", "out of range"),
        ("stand for ten hours", "durations"),
        ("wave for 3 seconds, then bow", "durations"),
        ("walk one million steps", "million"),
        ("squat 2.5 times", "whole number"),
        ("jumps while squatting", "same time"),
        ("do not walk", "'do not' is not understood"),
        ("wave, but don't bow", '"don\'t" is not understood'),
        ("dances while clapping", "same time"),
        (" then ".join(["jump"] * 20), "actions in one command"),
    ],
)
def test_bad_input_is_refused_in_words(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse(text)


def test_a_command_that_is_no_text_is_refused() -> None:
    with pytest.raises(InputError, match="int"):
        parse(3)  # type: ignore[arg-type]


def test_quantities() -> None:
    walk, turn, kick = parse(
        "a person slowly walks forward four steps, turns 90 degrees to the left and then "
        "kicks high with the right leg twice"
    )
    assert (walk.action, walk.count, walk.side) == ("walk", 4, None)
    assert walk.tempo < 1.0
    assert (turn.action, turn.side) == ("turn", "left")
    assert turn.angle == pytest.approx(np.pi / 2)
    assert (kick.action, kick.side, kick.count) == ("front_kick", "right", 2)
    assert kick.amplitude > 1.0


@pytest.mark.parametrize(
    ("text", "field", "value"),
    [
        ("walks forward two meters", "distance", 2.0),
        ("walks forward 1.5 m", "distance", 1.5),
        ("walks forward 80 cm at 0.5 m/s", "distance", 0.8),
        ("walks forward 80 cm at 0.5 m/s", "speed", 0.5),
        ("walks at 1.8 km/h", "speed", 0.5),
        ("walks half a meter ahead", "distance", 0.5),
        ("a half turn to the right", "angle", np.pi),
        ("turns a quarter to the left", "angle", np.pi / 2),
        ("turns around", "angle", np.pi),
        ("a full turn", "angle", 2 * np.pi),
        ("turns by forty-five degrees", "angle", np.pi / 4),
        ("waves with both hands", "side", "both"),
        ("turns clockwise", "side", "right"),
        ("jumps three times", "count", 3),
        ("jumps twice", "count", 2),
        ("does five squats", "count", 5),
        ("takes 6 steps forward", "count", 6),
        ("claps several times", "count", 3),
        ("stands on one leg", "count", None),
        ("raises two arms", "count", None),
        ("turns 90 degrees", "count", None),
        ("walks forward", "side", None),
        ("a small jump", "amplitude", 0.7),
        ("quickly bows", "tempo", 1.35),
    ],
)
def test_quantity(text: str, field: str, value: float | str | None) -> None:
    (clause,) = parse(text)
    got = getattr(clause, field)
    assert got == (pytest.approx(value) if isinstance(value, float) else value)


def test_order_and_company() -> None:
    assert actions("claps after walking forward") == ["walk", "clap"]
    assert actions("bows before jumping") == ["bow", "jump"]
    walk, wave = parse("while walking forward, waves the left hand")
    assert (walk.action, wave.action, wave.accompanies) == ("walk", "wave", True)
    walk, wave = parse("waves the left hand while walking forward")
    assert (walk.action, walk.accompanies) == ("walk", False)
    assert (wave.action, wave.accompanies, wave.side) == ("wave", True, "left")


def test_a_way_back_is_no_clause_of_its_own() -> None:
    assert actions("squats down and stands up") == ["squat"]
    assert actions("does a lunge, returns, and claps") == ["lunge", "clap"]
