"""The report: self-contained, says what happened, escapes what the user typed."""

from __future__ import annotations

import re

import numpy as np
import pytest

from robomirror_drake.outcome import evaluate
from robomirror_drake.report.figures import limbs
from robomirror_drake.report.report import render_report
from robomirror_drake.results import Result
from robomirror_drake.robot import load_robot


def make_result(candidates, reference, execution) -> Result:
    robot = load_robot()
    return Result(
        command=execution.text or "stand still",
        scenario="seed: 3\n",
        candidates=candidates,
        chosen=1,
        reference=reference,
        execution=execution,
        outcome=evaluate(execution, robot.effort_limits, robot.spec.contact.friction),
        seeds={"generator": 3},
    )


@pytest.fixture(scope="module")
def html(candidates, reference, noisy_execution) -> str:
    return render_report(make_result(candidates, reference, noisy_execution), load_robot())


def without_libraries(html: str) -> str:
    """The page without plotly.js, which holds addresses that it never calls for these plots."""
    return re.sub(r"<script>/\*.*?</script>", "", html, count=1, flags=re.DOTALL)


def test_nothing_is_loaded_from_elsewhere(html):
    page = without_libraries(html)
    assert len(page) < len(html) - 1_000_000
    assert not re.search(r"https?://|src\s*=|<link|@import|url\(", page)
    assert html.count("<html") == 1


def test_command_is_escaped(html):
    page = without_libraries(html)
    assert "a person sways &lt;b&gt;&amp; more&lt;/b&gt;" in page
    assert "<b>& more" not in page


def test_says_that_it_did_not_fall(html):
    assert "carried out the motion (1.5 s), then stood for 0.5 s, and did not fall." in html


@pytest.mark.parametrize(
    ("cause", "words"),
    [("height", "the pelvis sank more than 0.30 m"), ("contact", "a link other than the feet")],
)
def test_says_when_and_why_it_fell(candidates, reference, make_execution, cause, words):
    q, other = make_execution().q.copy(), np.zeros(61)
    if cause == "height":
        q[30:, 6] = 0.1
    else:
        other[30:] = 50.0
    execution = make_execution(q=q, other_force=other)
    page = render_report(make_result(candidates, reference, execution), load_robot())
    assert f"The robot fell after 0.50 s: {words}" in page


def test_every_joint_is_in_one_limb():
    robot = load_robot()
    found = limbs(robot.model)
    assert sorted(name for limb in found for name in limb) == sorted(robot.joint_names)
    assert sorted(len(limb) for limb in found) == [3, 4, 4, 6, 6]


def test_same_result_same_page(html, candidates, reference, noisy_execution):
    again = render_report(make_result(candidates, reference, noisy_execution), load_robot())
    assert again == html


def test_candidates_and_provenance_are_listed(html):
    for text in ("test/41", "test/35", "test/9", "amplitude", "generator 3", "drake 1."):
        assert text in html
