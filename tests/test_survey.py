"""The survey: what it does, that one broken row stops no other, and how it is shown."""

from __future__ import annotations

import dataclasses
import io
import os
import re
from typing import Any

import pytest
from rich.console import Console
from scipy.stats import fisher_exact

from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import ConfigError, InputError
from robomirror_drake.motion.composer.cue import Style
from robomirror_drake.motion.library import library
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS
from robomirror_drake.optimization.planning.tempo import slowed
from robomirror_drake.survey import survey
from robomirror_drake.survey.page import ending, lines, print_survey, render_survey
from robomirror_drake.survey.styles import splits, unexplained
from robomirror_drake.survey.survey import Row, _at_tempo, execute, survey_rows, survey_tasks


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os._exit, (1,)


def test_everything_is_surveyed_in_four_groups() -> None:
    tasks = survey_tasks(Scenario(), seeds=3, name="moderate")
    assert [task.action for task in tasks] == [
        *library(),
        *(f"clip:{clip}" for clip in FEET_ONLY_CLIPS),
    ]
    assert {task.group for task in tasks} == {"locomotion", "dynamic", "expressive", "mocap"}
    assert all(task.seeds == (0, 1, 2) and task.name == "moderate" for task in tasks)
    assert all(task.scenario.candidates == 1 for task in tasks)


def test_names_and_numbers_are_checked_first() -> None:
    with pytest.raises(InputError, match="fly"):
        survey_tasks(Scenario(), ["bow", "fly"])
    with pytest.raises(InputError, match="0 seeds"):
        survey_tasks(Scenario(), seeds=0)
    with pytest.raises(InputError, match="0 processes"):
        next(survey_rows(survey_tasks(Scenario(), ["bow"]), jobs=0))


def test_a_row_of_a_real_execution() -> None:
    scenario = Scenario.model_validate(
        {"simulation": {"hold": 0.2, "disturbance": {"friction": [0.5, 1.0]}}}
    )
    (task,) = survey_tasks(scenario, ["clip:walk"], seeds=2, name="floors")
    rows = execute(task)
    assert [row.seed for row in rows] == [0, 1]
    for row in rows:
        assert (row.action, row.group, row.scenario) == ("clip:walk", "mocap", "floors")
        assert row.error is None
        assert row.fell is False
        assert row.fall_time_s is row.cause is row.cause_evidence is None
        assert row.time_scale == 1.0
        # A plan is followed closely, and is itself some way from the raw reference.
        assert row.A_q < 0.02 < row.raw_A_q < 0.3
        assert row.A_p < 0.03 < row.raw_A_p < 0.2
    assert rows[0].A_q != rows[1].A_q  # another floor


def test_slowest_does_everything_twice() -> None:
    full, slow = survey_tasks(Scenario(), ["bow"], slowest=0.6)
    assert (full.slowest, full.scenario.planner.slowest) == (None, 1.0)
    assert (slow.slowest, slow.scenario.planner.slowest) == (0.6, 0.6)
    with pytest.raises(ConfigError, match="slowest"):
        survey_tasks(Scenario(), ["bow"], slowest=1.5)


@pytest.mark.parametrize(("fell", "tempi"), [(True, [1.0, 0.6]), (False, [1.0])])
def test_what_falls_though_its_plan_is_sound_is_slowed_all_the_way(
    monkeypatch, fell, tempi
) -> None:
    tried = []

    def executed(task, scenario):
        tried.append(scenario.planner.time_scale)
        return [task.row(0, fell=fell, time_scale=scenario.planner.time_scale)]

    monkeypatch.setattr(survey, "_executed", executed)
    full, slow = survey_tasks(Scenario(), ["bow"], slowest=0.6)
    (row,) = execute(slow)
    assert tried == tempi
    assert row.time_scale == tempi[-1]
    assert execute(full)[0].time_scale == 1.0


@pytest.mark.parametrize("flies", [False, True])
def test_raw_reference_at_the_tempo_of_its_plan(reference, flies) -> None:
    contact = reference.contact.copy()
    contact[50:80] = not flies
    raw = dataclasses.replace(reference, contact=contact)
    wanted = slowed(raw, 0.6)
    found = _at_tempo(raw, raw.duration / wanted.duration)
    assert found.duration == pytest.approx(wanted.duration, abs=1.5 / 60)
    assert found.contact.shape == wanted.contact.shape
    assert _at_tempo(raw, 1.0) == raw


def test_one_broken_task_stops_no_other() -> None:
    (task,) = survey_tasks(Scenario(), ["bow"], seeds=2)
    deadly = dataclasses.replace(task, action="deadly", name=Deadly())
    mute = dataclasses.replace(
        task, action="mute", scenario=task.scenario.model_copy(update={"command": ""})
    )
    rows = [row for rows in survey_rows([deadly, mute], jobs=1) for row in rows]
    assert sorted((row.action, row.seed) for row in rows) == [
        *(("deadly", 0), ("deadly", 1)),
        *(("mute", 0), ("mute", 1)),
    ]
    errors = {row.action: row.error for row in rows}
    assert "its process died" in errors["deadly"]
    assert "empty" in errors["mute"]


def row(action: str, seed: int = 0, **changes: Any) -> Row:
    upright = {"fell": False, "time_scale": 1.0, "A_q": 0.01, "A_p": 0.02, "raw_A_q": 0.1}
    return Row(action, "dynamic", f"a person {action}s", seed, "default", **(upright | changes))


FALL = {
    "fell": True,
    "fall_time_s": 1.92,
    "fall_cause": "tilt",
    "cause": "torque_saturated",
    "cause_evidence": "L_KNEE at its <200> N·m",
}
ROWS = [
    row("jump"),
    row("jump", 1, **FALL),
    row("jump", slowest=0.5, time_scale=0.75),
    row("jump", 1, slowest=0.5, time_scale=0.75),
    Row("clip:punch", "dynamic", "clip:punch", 0, "default", error="PlanningError: too short"),
]


def test_lines_gather_seeds_and_part_tempos() -> None:
    made = lines(ROWS)
    assert [(line.label, line.upright, len(line.rows)) for line in made] == [
        ("jump", 1, 2),
        ("jump, slowed", 2, 2),
        ("clip:punch", 0, 1),
    ]
    assert made[0].causes == "torque saturated"
    assert [ending(row) for row in ROWS[:2]] == ["upright", "torque_saturated"]
    assert ending(ROWS[-1]) == "not executed"


def test_table_says_what_fell_and_why() -> None:
    text = io.StringIO()
    print_survey(ROWS, Console(file=text, width=160))
    printed = text.getvalue()
    assert "L_KNEE at its <200> N·m" in printed
    assert "clip:punch: PlanningError: too short" in printed  # and no emoji
    assert "joints [rad]" in printed
    assert "dynamic: 1 of 3 upright" in printed
    assert "dynamic, slowed: 2 of 2 upright" in printed


def test_page_has_all_rows_and_needs_no_network() -> None:
    html = render_survey(ROWS)
    page = re.sub(r"<script>/\*.*?</script>", "", html, count=1, flags=re.DOTALL)
    assert not re.search(r"https?://|src\s*=|<link|@import|url\(", page)
    assert "L_KNEE at its &lt;200&gt; N·m" in page
    assert page.count("<td>jump, slowed</td>") == 2
    assert html == render_survey(ROWS)


def test_nothing_done_is_shown_too() -> None:
    assert "0 executions" in render_survey([])
    print_survey([], Console(file=io.StringIO()))


def drawn(action: str, candidate: int, tempo: float, **changes: Any) -> Row:
    style = vars(Style()) | {"tempo": tempo}
    return row(action, candidate=candidate, style=style, **changes)


SAMPLED = [
    row("jump"),
    row("hop", **FALL),
    *(drawn("jump", number, 1.2, **FALL) for number in range(1, 6)),
    *(drawn("jump", number, 0.9) for number in range(6, 11)),
    drawn("jump", 11, 0.8, **FALL),
    drawn("hop", 1, 0.8, **FALL),
]


def test_falls_of_sampled_candidates_are_split_by_their_style() -> None:
    found = {split.parameter: split for split in splits(SAMPLED)}
    assert (found["tempo"].below, found["tempo"].above) == ((5, 7), (0, 5))
    assert found["tempo"].p == pytest.approx(fisher_exact([[5, 2], [0, 5]]).pvalue)
    assert (found["arms"].below, found["arms"].above, found["arms"].p) == ((5, 12), (0, 0), 1.0)
    # Slower than the nominal motion, which stands, and fallen all the same: not for its style.
    assert [(row.action, row.candidate) for row in unexplained(SAMPLED)] == [("jump", 11)]


def test_sampled_candidates_are_told_apart_everywhere() -> None:
    assert [line.label for line in lines(SAMPLED)] == [
        "jump", "hop", "jump, sampled", "hop, sampled",
    ]  # fmt: skip
    text = io.StringIO()
    print_survey(SAMPLED, Console(file=text, width=160))
    assert "dynamic, sampled: 5 of 12 upright" in text.getvalue()
    assert "its nominal motion does not: jump, seed 0, candidate 11" in text.getvalue()
    assert "5 of 7 upright" in render_survey(SAMPLED)


def test_candidates_have_styles_of_their_own_in_each_action() -> None:
    tasks = survey_tasks(Scenario(), ["bow", "punch", "clip:walk"], candidates=2)
    assert [(task.action, task.candidate) for task in tasks] == [
        ("punch", 0), ("punch", 1), ("bow", 0), ("bow", 1), ("clip:walk", 0),
    ]  # fmt: skip
    assert tasks[1].scenario.seed != tasks[3].scenario.seed
    with pytest.raises(InputError, match="0 candidates"):
        survey_tasks(Scenario(), ["bow"], candidates=0)


@pytest.mark.slow
def test_a_sampled_candidate_is_executed_in_a_process_of_its_own() -> None:
    tasks = survey_tasks(Scenario(), ["shrug"], candidates=2)
    (sampled_row,) = next(survey_rows(tasks[1:], jobs=1))
    assert sampled_row.error is None
    assert sampled_row.style["tempo"] != 1.0
    assert sampled_row.candidate == 1
