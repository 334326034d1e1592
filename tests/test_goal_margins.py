"""Margins of predicates: the same verdict as measuring, and derivatives by differences."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from robomirror_drake.goals import Goals, make_goals, margins, measure
from robomirror_drake.messages import Array
from robomirror_drake.motion.generate import generate
from robomirror_drake.motion.text import parse
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
TEXTS = (
    "a person waves and then walks forward four steps",
    "a person turns left and then squats twice",
    "a person stands on one leg",
    "a person jumps",
    "a person walks in a circle",
    "a person marches on the spot",
    "a person stands still",
    "a person dances",
)


@cache
def made(text: str) -> tuple[Goals, Array, tuple]:
    """The goals, the motion at 20 Hz, turned away from the axes, and the margins."""
    q = retarget(ROBOT, generate(text, 1)[0]).q
    goals = make_goals(ROBOT, parse(text), q)
    c, s = np.cos(0.4), np.sin(0.4)
    turned = q[::3].copy()
    turned[:, 4:6] = turned[:, 4:6] @ np.array([[c, s], [-s, c]]) + [1.0, -2.0]
    w, x, y, z = turned[:, :4].T
    c, s = np.cos(0.2), np.sin(0.2)
    turned[:, :4] = np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=1)
    return goals, turned, margins(ROBOT, goals)


@pytest.mark.parametrize("text", TEXTS)
def test_a_margin_is_not_negative_exactly_where_its_predicate_is_met(text):
    goals, q, functions = made(text)
    rng = np.random.default_rng(4)
    standing = np.tile(ROBOT.standing, (len(q), 1))
    half = q.copy()
    half[:, 4:] = standing[:, 4:] + 0.5 * (q - standing)[:, 4:]
    shaken = q + 0.02 * rng.standard_normal(q.shape)
    for motion in (q, q[: len(q) // 2], standing, half, shaken):
        measured = measure(ROBOT, goals, np.repeat(motion, 3, axis=0)).measured
        values = [function(motion)[0] for _, function in functions]
        assert [v >= 0.0 for v in values] == [m.met for m in measured]
    assert all(function(q)[0] > 0.05 for _, function in functions)


@pytest.mark.parametrize("text", TEXTS)
def test_derivatives_are_those_of_differences(text):
    _, q, functions = made(text)
    rng = np.random.default_rng(1)
    # Off the ties of a motion at rest, where the farthest sample is any of many.
    q = q + 1e-3 * rng.standard_normal(q.shape)
    for sentence, function in functions:
        value, gradient = function(q)
        assert gradient.shape == q.shape
        for _ in range(3):
            direction = rng.standard_normal(q.shape)
            direction[:, :4] *= 0.1
            step = 1e-7
            rise = function(q + step * direction)[0] - function(q - step * direction)[0]
            found = float(np.sum(gradient * direction))
            assert found == pytest.approx(rise / (2 * step), rel=2e-4, abs=2e-5), sentence
        assert np.isfinite(value)
        assert np.abs(gradient).max() > 1e-3, sentence


@pytest.mark.parametrize("text", ["a person steps sideways", "a person turns", "a person waves"])
def test_derivatives_are_right_where_the_other_side_does_it(text):
    _, _, functions = made(text)
    other = next(m for m in generate(text, 12) if m.style["mirrored"])
    rng = np.random.default_rng(3)
    q = retarget(ROBOT, other).q[::3]
    q = q + 1e-3 * rng.standard_normal(q.shape)
    for sentence, function in functions:
        value, gradient = function(q)
        assert value > 0.0
        direction, step = rng.standard_normal(q.shape), 1e-7
        rise = function(q + step * direction)[0] - function(q - step * direction)[0]
        found = float(np.sum(gradient * direction))
        assert found == pytest.approx(rise / (2 * step), rel=2e-4, abs=2e-5), sentence


def test_going_along_the_gradient_mends_what_is_missed():
    text = "a person squats"
    goals, q, functions = made(text)
    shallow = q.copy()
    shallow[:, 6] += 0.6 * (ROBOT.standing[6] - q[:, 6])
    (low,) = (function for sentence, function in functions if "lowers the pelvis" in sentence)
    value, gradient = low(shallow)
    assert value < 0.0
    assert not measure(ROBOT, goals, np.repeat(shallow, 3, axis=0)).done
    mended = shallow + 1.01 * (-value) * gradient / np.sum(gradient**2)
    assert low(mended)[0] > 0.0
    assert mended[:, 6].min() < shallow[:, 6].min()


def test_a_cushion_is_taken_off_and_an_odd_rate_is_refused():
    goals, q, functions = made("a person squats")
    padded = margins(ROBOT, goals, cushion=0.1)
    for (_, plain), (_, less) in zip(functions, padded, strict=True):
        assert less(q)[0] == pytest.approx(plain(q)[0] - 0.1)
    with pytest.raises(ValueError, match="divisor"):
        margins(ROBOT, goals, rate=25.0)
