"""What commands mean, measured on motions of the robot."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robomirror_drake.goals import Goals, Satisfaction, make_goals, measure
from robomirror_drake.goals.probes import Probe, along, beats, channel
from robomirror_drake.goals.quantities import quantities_of
from robomirror_drake.goals.trace import RATE, Trace, make_trace
from robomirror_drake.goals.turns import aligned
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.composer.compose import compose
from robomirror_drake.motion.composer.cue import Style
from robomirror_drake.motion.generate import generate
from robomirror_drake.motion.library import library
from robomirror_drake.motion.text import Clause, parse
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
STANDING = np.tile(ROBOT.standing, (180, 1))
X, Y, Z = 4, 5, 6


@cache
def motion(text: str, candidate: int = 0) -> Array:
    """(T, 30) a candidate of a command on the robot."""
    return retarget(ROBOT, generate(text, candidate + 1, seed=1)[candidate]).q


@cache
def goals(text: str) -> Goals:
    return make_goals(ROBOT, parse(text), motion(text))


def judged(text: str, q: Array) -> Satisfaction:
    return measure(ROBOT, goals(text), q)


def value(satisfaction: Satisfaction, name: str) -> float:
    (found,) = (m.value for m in satisfaction.measured if m.predicate.name == name)
    return found


def mirrored(q: Array) -> Array:
    """(T, 30) left and right exchanged: roll and yaw change sign, the sides their places."""
    w, x, y, z = q[:, :4].T
    names = list(ROBOT.joint_names)
    other = [names.index({"L_": "R_", "R_": "L_"}.get(n[:2], n[:2]) + n[2:]) for n in names]
    sign = np.array([1.0 if n.endswith("_P") or "KNEE" in n else -1.0 for n in names])
    place = q[:, 4:7] * [1.0, -1.0, 1.0]
    return np.hstack([np.stack([w, -x, y, -z], axis=1), place, q[:, 7:][:, other] * sign])


@cache
def sized(action: str, amplitude: float) -> Array:
    """(T, 30) an action on the robot, so many times as large as usual."""
    clause = Clause(action, action, library()[action].group, amplitude=amplitude)
    return retarget(ROBOT, HumanMotion(compose((clause,), Style(), RATE), RATE)).q


# ----- every action ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", library())
def test_an_action_satisfies_its_own_goals_and_standing_still_does_not(name):
    clause = Clause(text=name, action=name, group=library()[name].group)
    description = library()[name].description.split(" (")[0]
    q = motion(f"a person {description}")
    made = make_goals(ROBOT, (clause,), q)
    own = measure(ROBOT, made, q)
    assert own.done, [str(m) for m in own.missed]
    assert own.score == pytest.approx(1.0)
    for still in (STANDING, np.tile(q[0], (180, 1))):
        assert measure(ROBOT, made, still).done == (name == "stand")
    swaying = STANDING.copy()
    swaying[:, X] += 0.01 * np.sin(np.arange(180) / 20)
    assert measure(ROBOT, made, swaying).done == (name == "stand")


def test_every_action_is_recognised_by_something():
    assert quantities_of().keys() == library().keys()
    assert all(quantities_of().values())


# ----- what the words say ------------------------------------------------------------------------


@pytest.mark.parametrize("action", ["squat", "bow", "lunge", "side_bend", "raise_arms"])
def test_a_gentler_version_is_the_same_task_and_a_faint_one_is_not(action):
    made = make_goals(ROBOT, (Clause(action, action, "dynamic"),), sized(action, 1.0))
    usual, gentler, faint = (measure(ROBOT, made, sized(action, a)) for a in (1.0, 0.8, 0.3))
    assert usual.done
    assert gentler.done
    assert not faint.done
    assert usual.score > gentler.score > faint.score


def test_what_the_commands_own_motion_hardly_does_is_not_asked_for():
    made = {a: make_goals(ROBOT, (Clause("jump", "jump", "dynamic"),), sized("jump", a)) for a in
            (1.0, 0.4)}  # fmt: skip
    named = {a: {p.name for p in goals_.predicates} for a, goals_ in made.items()}
    assert "flight" in named[1.0]
    assert named[0.4] == named[1.0] - {"flight"}
    assert not measure(ROBOT, made[0.4], STANDING).done


@pytest.mark.parametrize("said", ["left", "right"])
def test_the_side_that_is_said_has_to_do_it(said):
    text, other = f"a person kicks with the {said} leg", {"left": "right", "right": "left"}[said]
    against = motion(f"a person kicks with the {other} leg")
    assert judged(text, motion(text)).done
    assert not judged(text, against).done
    assert judged("a person kicks", motion(text)).done
    assert judged("a person kicks", against).done


def test_a_mirrored_motion_is_done_where_the_side_is_left_open():
    for open_, said in (
        ("a person waves", "a person waves with the right hand"),
        ("a person turns", "a person turns to the left"),
    ):
        q = mirrored(motion(open_))
        assert judged(open_, q).done
        assert not judged(said, mirrored(motion(said))).done


@pytest.mark.parametrize(("said", "done"), [("two", 2), ("three", 3)])
def test_repetitions_that_are_said_have_to_be_as_many(said, done):
    def text(word):
        return f"a person squats {word} times"

    right, wrong = (judged(text(said), motion(text(w))) for w in (said, "four"))
    assert right.done
    assert value(right, "count") == done
    assert not wrong.done
    assert value(wrong, "count") == 4


@pytest.mark.parametrize("number", ["three", "five"])
def test_steps_are_counted(number):
    text = f"a person walks forward {number} steps"
    assert judged(text, motion(text, 1)).done
    assert not judged(text, motion("a person walks forward four steps")).done


def test_far_too_far_and_the_wrong_way_are_not_what_was_said():
    text = "a person walks forward two metres"
    farther = judged(text, motion("a person walks forward four metres"))
    assert [m.predicate.name for m in farther.missed] == ["travel"]
    back = judged(text, motion("a person walks backward two metres"))
    assert {m.predicate.name for m in back.missed} == {"travel", "direction"}
    assert value(back, "travel") < 0.0
    assert value(back, "direction") == pytest.approx(np.pi, abs=0.1)


def test_turning_is_signed_and_in_radians():
    text = "a person turns left by 90 degrees"
    assert value(judged(text, motion(text)), "turn") == pytest.approx(np.pi / 2, abs=0.05)
    right = judged(text, motion("a person turns right by 90 degrees"))
    assert value(right, "turn") == pytest.approx(-np.pi / 2, abs=0.05)
    assert not right.done


# ----- clauses in their order --------------------------------------------------------------------

FIRST = "a person waves with the right hand and then walks forward four steps"
SECOND = "a person walks forward four steps and then waves with the right hand"


def test_clauses_have_to_be_done_in_their_order():
    assert judged(FIRST, motion(FIRST, 2)).done
    assert judged(SECOND, motion(SECOND, 2)).done
    assert not judged(FIRST, motion(SECOND)).done
    assert not judged(SECOND, motion(FIRST)).done


def test_a_clause_that_is_left_out_is_the_one_that_is_missed():
    missing = judged(SECOND, motion("a person walks forward four steps"))
    assert not missing.done
    assert {m.predicate.clause for m in missing.missed} == {1}


def test_slowness_and_rest_before_and_after_change_nothing():
    q = motion(SECOND)
    slow = q[np.arange(0, len(q), 0.7).astype(int)]
    rest = np.concatenate([np.tile(q[0], (90, 1)), slow, np.tile(q[-1], (150, 1))])
    assert judged(SECOND, rest).done


def test_what_goes_along_is_measured_beside_what_it_goes_along_with():
    text = "a person walks forward while waving"
    assert judged(text, motion(text, 1)).done
    alone = judged(text, motion("a person walks forward"))
    assert {m.predicate.clause for m in alone.missed} == {1}


# ----- invariance and units ----------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(
    yaw=st.floats(-3.1, 3.1),
    x=st.floats(-5.0, 5.0),
    y=st.floats(-5.0, 5.0),
)
def test_where_it_begins_and_faces_does_not_matter(yaw, x, y):
    q = motion(SECOND)
    moved = q.copy()
    c, s = np.cos(yaw), np.sin(yaw)
    moved[:, X:Z] = q[:, X:Z] @ np.array([[c, s], [-s, c]]) + [x, y]
    cz, sz = np.cos(yaw / 2), np.sin(yaw / 2)
    w, a, b, d = q[:, :4].T
    moved[:, :4] = np.stack(
        [cz * w - sz * d, cz * a - sz * b, cz * b + sz * a, cz * d + sz * w], axis=1
    )
    here, there = judged(SECOND, q), judged(SECOND, moved)
    assert there.done
    np.testing.assert_allclose(
        [m.value for m in there.measured], [m.value for m in here.measured], atol=1e-9
    )


def test_the_trace_is_in_metres_and_radians_with_the_left_positive():
    q = np.tile(ROBOT.standing, (2, 1))
    q[1, X:Z] += [0.3, 0.2]
    q[1, Z] -= 0.1
    q[1, 7 + ROBOT.joint_names.index("WAIST_P")] = 0.4
    trace = make_trace(ROBOT, q)
    np.testing.assert_allclose(trace.place[1], [0.3, 0.2], atol=1e-12)
    np.testing.assert_allclose(trace.height[:, 0], [0.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(trace.trunk[1], [0.0, 0.4, 0.0], atol=1e-9)
    np.testing.assert_allclose(trace.feet[1, :, 2], -0.1, atol=1e-12)
    np.testing.assert_allclose(trace.clearance[0], 0.0, atol=1e-9)
    q[1, :4] = [np.cos(0.1), 0.0, 0.0, np.sin(0.1)]
    q[1, 7 + ROBOT.joint_names.index("WAIST_P")] = 0.0
    turned = make_trace(ROBOT, q)
    assert turned.heading[1, 0] == pytest.approx(0.2)
    np.testing.assert_allclose(turned.trunk[1], 0.0, atol=1e-9)


def test_mirroring_a_trace_is_the_trace_of_the_mirrored_motion():
    q = motion("a person kicks with the left leg")
    for there, here in zip(
        make_trace(ROBOT, mirrored(q)), make_trace(ROBOT, q).mirrored(), strict=True
    ):
        np.testing.assert_allclose(there, here, atol=2e-3)  # the robot's sides differ by so much


def test_nominal_figures_have_score_one_and_scores_stay_between_nought_and_one():
    for text in (FIRST, "a person squats three times", "a person jumps"):
        for q in (motion(text), STANDING, motion("a person runs forward")):
            for measured in judged(text, q).measured:
                assert 0.0 <= measured.score <= 1.0
                if measured.met and measured.predicate.least > 0.0:
                    assert measured.score > 0.3
        assert all(m.score == 1.0 for m in judged(text, motion(text)).measured)


@pytest.mark.parametrize("q", [np.zeros((0, 30)), np.zeros((5, 29)), np.zeros(30)])
def test_what_is_no_motion_of_the_robot_is_refused(q):
    with pytest.raises(ValueError, match="expected"):
        make_trace(ROBOT, q)
    with pytest.raises(ValueError, match="clause"):
        make_goals(ROBOT, (), STANDING)


# ----- probes and alignment ----------------------------------------------------------------------


def _trace(**parts: Array) -> Trace:
    length = len(next(iter(parts.values())))
    empty = Trace(
        place=np.zeros((length, 2)),
        heading=np.zeros((length, 1)),
        height=np.zeros((length, 1)),
        trunk=np.zeros((length, 3)),
        hands=np.zeros((length, 2, 3)),
        feet=np.zeros((length, 2, 3)),
        clearance=np.zeros((length, 2)),
    )
    return empty._replace(**parts)


@settings(max_examples=50, deadline=None)
@given(number=st.integers(1, 7), size=st.floats(0.05, 0.5), share=st.floats(0.65, 1.4))
def test_beats_are_counted_whatever_their_size(number, size, share):
    phase = np.linspace(0.0, 2 * np.pi * number, 60 * number + 1)
    bumps = 0.5 * size * (1.0 - np.cos(phase))[:, None]
    nominal = _trace(height=-bumps)
    probe = beats(nominal, ("height",), number)
    assert probe is not None
    assert probe.read(nominal) == number
    assert probe.read(_trace(height=-share * bumps)) == number
    assert probe.read(_trace(height=0.1 * bumps)) == 0.0
    assert beats(nominal, ("height",), number + 1) is None


@settings(max_examples=50, deadline=None)
@given(share=st.floats(0.0, 1.0), angle=st.floats(-3.1, 3.1))
def test_reach_net_and_nearness_grow_with_the_share_of_the_way(share, angle):
    way = np.linspace(0.0, 1.0, 30)[:, None] * [np.cos(angle), np.sin(angle)]
    whole, part = _trace(place=2.0 * way), _trace(place=2.0 * share * way)
    for kind in ("near", "reach", "net"):
        probe = along(kind, "place", whole)
        assert probe.read(whole) == pytest.approx(2.0)
        assert probe.read(part) == pytest.approx(2.0 * share, abs=1e-9)
    assert along("net", "place", whole).read(_trace(place=-way)) == pytest.approx(-1.0)


def test_time_and_path_are_in_seconds_and_metres():
    up = np.zeros((120, 2, 3))
    up[30:90, 0, 2] = 0.2
    trace = _trace(feet=up)
    assert along("time", "left_lift", trace).read(trace) == pytest.approx(60 / RATE)
    line = _trace(place=np.linspace(0.0, 1.5, 600)[:, None] * [0.6, 0.8])
    probe = Probe("total", "place", np.array([1.0, 0.0]))
    assert probe.read(line) == pytest.approx(1.5, rel=0.03)
    assert channel(line, "place").shape == (600, 2)


def test_alignment_is_monotone_and_finds_a_shift():
    rng = np.random.default_rng(2)
    a = np.cumsum(rng.standard_normal((40, 3)), axis=0)
    b = np.concatenate([np.repeat(a[:1], 10, axis=0), a, np.repeat(a[-1:], 5, axis=0)])
    first, last = aligned(a, b)
    assert (np.diff(first) >= 0).all()
    assert (first <= last).all()
    np.testing.assert_array_equal(first[1:-1], np.arange(11, 49))
    np.testing.assert_array_equal(last[1:-1], np.arange(11, 49))
    assert last[0] == 10
    assert last[-1] == len(b) - 1
