"""Studies: which commands they take, what they record, that no kill changes it, what they say."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from typer.testing import CliRunner

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.cli import app
from robomirror_drake.config import Scenario
from robomirror_drake.dataset.prompts import Prompt, read_prompts
from robomirror_drake.exceptions import ConfigError, InputError
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.study import bench, run, unit
from robomirror_drake.study.causes import TRANSITION, cause
from robomirror_drake.study.choose import choose, order_of
from robomirror_drake.study.options import (
    Grid,
    StudyOptions,
    adaptation_of,
    physics,
    study_scenario,
    variants,
)
from robomirror_drake.study.page import labels, print_study, render_study
from robomirror_drake.study.records import (
    CAUSES,
    RESULTS,
    Job,
    Row,
    about,
    of_earlier,
    of_variant,
    pool_earlier,
)
from robomirror_drake.study.run import Study, Work, commands_of, run_study
from robomirror_drake.study.summary import share_interval, summarise
from robomirror_drake.yaml_file import load_yaml, validate

SHIPPED = (
    "table2", "table2_quick", "pool_size", "selection_against_optimisation", "closed_loop", "falls",
)  # fmt: skip
GROUPS = ("locomotion", "dynamic", "expressive")
PROMPTS = tuple(
    Prompt(text=f"a person does {group} {n}", split="test", group=group)
    for n in range(12)
    for group in GROUPS
)
OPTIONS = validate(
    StudyOptions,
    {
        "failing": 9,
        "succeeding": 3,
        "grid": {"methods": ["none", "random", "selection", "oracle"], "pool": [4]},
    },
    "test",
)


def luck(job: Job) -> float:
    """A number from 0 to 1 that depends on the command alone."""
    return int.from_bytes(job.prompt.text.encode()[-1:], "little") % 10 / 10.0


def pretend_screen(job: Job) -> Row:
    state = "stood" if luck(job) > 0.5 else "fell"
    return about(job) | {"state": state, "duration_s": 3.0}


def pretend_compare(job: Job) -> list[Row]:
    assert job.screened is not None
    failing = job.screened["state"] == "fell"
    rows = []
    for number, variant in enumerate(variants(job.options, job.scenario.adaptation)):
        if not failing and variant.method != "selection":
            continue
        saved = {"none": 0.0, "random": 0.25}.get(variant.method, float(luck(job) > 0.2))
        row = about(job) | of_variant(variant)
        row |= {"set": "failing" if failing else "succeeding", "how": "selected", "saved": saved}
        row |= {"done": 0.5 * saved, "deviation": 0.01 * number, "tempo": 1.0, "time_s": 0.1}
        row |= {"changed": failing, "survivor": True if variant.pool else None}
        if saved < 1.0:
            row["cause"] = cause(row)
        rows.append(row)
    return rows


PRETEND = Work(pretend_screen, pretend_compare)


def study(folder: Path, work: Work = PRETEND, **changes: Any) -> Study:
    settings = {"options": OPTIONS, "scenario": Scenario(), "prompts": PROMPTS, "workers": 0}
    return run_study(folder=folder, work=work, weights="none", **(settings | changes))


def counted(made: list[str]) -> Work:
    def screened(job: Job) -> Row:
        made.append("screen")
        return pretend_screen(job)

    def compared(job: Job) -> list[Row]:
        made.append("compare")
        return pretend_compare(job)

    return Work(screened, compared)


# Settings


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_studies_load_and_have_commands(name):
    options = load_yaml(StudyOptions, "scenarios", name)
    scenario = study_scenario(options)
    assert scenario.simulation.after_fall == 0.1
    assert scenario.simulation.disturbance.actuators.strength[1] < 1.0
    prompts = commands_of(options)
    assert {one.split for one in prompts} <= {"test", "held_out"}  # never learned from
    assert len(prompts) > options.failing
    assert {one.group for one in prompts} == set(GROUPS)
    assert options.failing == {"table2": 420, "table2_quick": 60}.get(name, options.failing)


def test_grid_has_each_variant_once():
    options = StudyOptions(
        grid=Grid(
            methods=("none", "random", "selection", "optimisation"),
            t_safe=(0.8, 0.9),
            pool=(1, 4),
            variables=(("tempo",), ("tempo", "stride")),
        )
    )
    made = variants(options, AdaptationOptions())
    methods = [one.method for one in made]
    assert len(set(made)) == len(made)
    # Nothing depends on what it does not have; a pool of one has no other candidate.
    assert {m: methods.count(m) for m in methods} == {
        "none": 1, "random": 1, "selection": 4, "optimisation": 4,
    }  # fmt: skip
    last = made[-1]
    told = adaptation_of(last, AdaptationOptions())
    assert (told.method, told.ranking.t_safe) == ("optimisation", 0.9)
    assert told.optimiser.variables == ("tempo", "stride")


def test_levels_replace_what_they_name():
    options = validate(
        StudyOptions,
        {"grid": {"levels": [{"name": "a"}, {"name": "b", "disturbance": {"friction": 0.3}}]}},
        "test",
    )
    scenario = study_scenario(options)
    worn = scenario.simulation.disturbance
    assert physics(options, scenario, "a").disturbance == worn
    slippery = physics(options, scenario, "b").disturbance
    assert slippery.friction == (0.3, 0.3)
    assert slippery.actuators == worn.actuators


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"simulated": "chosen", "grid": {"methods": ["oracle"]}}, "oracle need more"),
        ({"grid": {"levels": [{"name": "a"}, {"name": "a"}]}}, "twice"),
        ({"grid": {"methods": ["random"], "pool": [1]}}, "pool of 2"),
        ({"grid": {"methods": ["magic"]}}, "methods"),
        ({"changes": {"simulation": {"frixion": 1}}}, "frixion"),
    ],
)
def test_bad_settings_are_refused(wrong, words):
    with pytest.raises(ConfigError, match=words):
        study_scenario(validate(StudyOptions, wrong, "test"))


def test_commands_of_no_split_are_refused(tmp_path):
    file = tmp_path / "mine.txt"
    file.write_text("a person bows\n")
    with pytest.raises(InputError, match="no command in test"):
        commands_of(StudyOptions(prompts=str(file)))
    assert len(commands_of(StudyOptions(prompts=str(file), splits=()))) == 1


# Which commands


def test_groups_have_equal_shares_and_make_up_for_each_other():
    order = {"a": range(10), "b": range(10, 20), "c": range(20, 23)}
    states = dict.fromkeys(range(23), "fell")
    choice = choose(order, states, 12, 0, patience=5)
    assert not choice.more
    assert choice.failing[:6] == (0, 10, 20, 1, 11, 21)  # by turns
    assert [sum(n in own for n in choice.failing) for own in order.values()] == [5, 4, 3]
    # One more does not change those that were there.
    assert set(choose(order, states, 11, 0, patience=5).failing) < set(choice.failing)


def test_screening_ends_in_the_same_choice_whatever_was_known():
    order = order_of(PROMPTS, seed=3)
    truth = {n: "stood" if luck(Job(n, p, OPTIONS, Scenario())) > 0.5 else "fell"
             for n, p in enumerate(PROMPTS)}  # fmt: skip
    known: dict[int, str] = {}
    while (choice := choose(order, known, 9, 3, patience=9)).more:
        known |= {n: truth[n] for n in choice.more}
    assert len(known) < len(truth)
    assert choose(order, truth, 9, 3, patience=9) == choice
    assert all(truth[n] == "fell" for n in choice.failing)
    assert all(truth[n] == "stood" for n in choice.succeeding)


def test_a_group_that_never_falls_is_given_up():
    order = {"a": range(50), "b": range(50, 100)}
    truth = {n: "stood" if n < 50 else "fell" for n in range(100)}
    known: dict[int, str] = {}
    while (choice := choose(order, known, 10, 0, patience=4)).more:
        known |= {n: truth[n] for n in choice.more}
    assert len(choice.failing) == 10
    assert sum(n < 50 for n in known) <= 6  # not all 50
    # What is known beyond that is not looked at.
    known |= {20: "fell"} | dict.fromkeys(range(20), "stood")
    assert choose(order, known, 10, 0, patience=4).failing == choice.failing


def test_order_depends_on_the_command_and_the_seed_alone():
    names = [PROMPTS[n].text for n in order_of(PROMPTS, 0)["dynamic"]]
    some = [p for p in PROMPTS if p.text in names[:4] or p.group != "dynamic"]
    assert [some[n].text for n in order_of(some, 0)["dynamic"]] == names[:4]
    assert [PROMPTS[n].text for n in order_of(PROMPTS, 1)["dynamic"]] != names


# Causes


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ({"method": "none", "pool": None}, "not_adapted"),
        ({"method": "oracle", "pool": 8, "survivor": False}, "no_survivor"),
        ({"method": "selection", "pool": 8, "how": "unsafe", "survivor": False}, "no_survivor"),
        ({"method": "selection", "pool": 8, "how": "kept", "survivor": True}, "survivor_misranked"),
        ({"method": "selection", "pool": 8, "how": "selected", "survivor": None}, "unknown"),
        ({"method": "optimisation", "pool": None, "how": "kept"}, "fall_unforeseen"),
        ({"method": "optimisation", "pool": None, "how": "unsafe"}, "optimiser_failed"),
        ({"method": "optimisation", "pool": None, "how": "optimised"}, "optimiser_failed"),
        (
            {"method": "selection_optimisation", "pool": 8, "how": "unsafe", "survivor": False},
            "optimiser_failed",
        ),
        (
            {"method": "selection_optimisation", "pool": 8, "how": "optimised", "survivor": True},
            "survivor_misranked",
        ),
        (
            {"method": "selection_optimisation", "pool": 8, "how": "selected", "survivor": False},
            "no_survivor",
        ),
        ({"method": "closed_loop", "pool": 8, "stopped": True, "survivor": True}, "stopped"),
        (
            {"method": "closed_loop", "pool": 8, "since_s": 0.9 * TRANSITION, "survivor": False},
            "transition_failed",
        ),
        (
            {
                "method": "closed_loop",
                "pool": 8,
                "stopped": True,
                "fall_time_s": 3.0,
                "since_s": 0.5,
                "survivor": True,
            },
            "transition_failed",
        ),
        (
            {"method": "closed_loop_alone", "pool": None, "how": "kept", "since_s": None},
            "fall_unforeseen",
        ),
        ({"method": "selection", "pool": 8, "failure": "PlanningError: x"}, "failed"),
    ],
)
def test_why_a_command_was_not_saved(row, expected):
    assert cause(row) == expected
    assert expected in CAUSES


# Keeping


def test_files_hold_what_was_found(tmp_path):
    found = study(tmp_path / "s")
    results = pq.read_table(tmp_path / "s" / "results.parquet")
    assert results.to_pylist() == found.results
    for column in RESULTS:
        notes = results.schema.field(column.name).metadata
        assert notes[b"description"], column.name
    assert pq.read_table(tmp_path / "s" / "screened.parquet").to_pylist() == found.screened
    compared = {row["prompt"] for row in found.results}
    assert len(compared) == 12
    assert {one.text for one in read_prompts(tmp_path / "s" / "commands.csv")} == compared


def test_a_study_goes_on_where_it_ended(tmp_path):
    whole = study(tmp_path / "whole")
    made: list[str] = []

    def dies(job: Job) -> list[Row]:
        if made.count("compare") == 4:
            raise KeyboardInterrupt
        made.append("compare")
        return pretend_compare(job)

    with pytest.raises(KeyboardInterrupt):
        study(tmp_path / "s", Work(pretend_screen, dies))
    again: list[str] = []
    found = study(tmp_path / "s", counted(again))
    assert again == ["compare"] * 8  # 12 in all, and nothing is screened twice
    assert found == whole
    nothing: list[str] = []
    assert study(tmp_path / "s", counted(nothing)) == whole
    assert nothing == []


def test_a_larger_limit_goes_on_and_a_smaller_one_takes_the_first(tmp_path):
    few = study(tmp_path / "s", limit=2)
    made: list[str] = []
    many = study(tmp_path / "s", counted(made))
    assert len({row["command"] for row in few.results}) == 4
    assert made.count("compare") == 8
    assert {row["command"] for row in few.results} < {row["command"] for row in many.results}
    assert many.results == study(tmp_path / "whole").results


def test_damage_is_named_and_mended(tmp_path):
    whole = study(tmp_path / "s")
    for folder in ("screened", "results"):
        path = sorted((tmp_path / "s" / folder).glob("*.parquet"))[0]
        path.write_bytes(path.read_bytes()[:-30])
        (tmp_path / "s" / folder / ".x.partial").write_bytes(b"left by a kill")
    found = study(tmp_path / "s")
    assert found.results == whole.results
    assert all(row in found.screened for row in whole.screened)
    assert len(found.damaged) == 2
    assert not list((tmp_path / "s").rglob("*.partial"))


def test_another_study_is_not_mixed_in(tmp_path):
    study(tmp_path / "s")
    with pytest.raises(InputError, match=r"another study: options\.seed is 0 there and 1 here"):
        study(tmp_path / "s", options=OPTIONS.model_copy(update={"seed": 1}))
    with pytest.raises(InputError, match="weights"):
        run_study(
            OPTIONS, Scenario(), PROMPTS, tmp_path / "s", workers=0, work=PRETEND, weights="others"
        )


def test_what_falls_is_taken_over_from_another_study(tmp_path):
    whole = study(tmp_path / "s")
    grid = Grid(methods=("none", "selection"), pool=(4,))
    other = OPTIONS.model_copy(update={"grid": grid})
    made: list[str] = []
    found = study(tmp_path / "t", counted(made), options=other, screened_in=tmp_path / "s")
    assert set(made) == {"compare"}
    assert found.screened == whole.screened
    with pytest.raises(InputError, match=r"end otherwise.*longest"):
        study(
            tmp_path / "u",
            options=OPTIONS.model_copy(update={"longest": 5.0}),
            screened_in=tmp_path / "s",
        )
    with pytest.raises(InputError, match="holds no study"):
        study(tmp_path / "v", screened_in=tmp_path / "nowhere")


DRIVER = """
import sys, time
from pathlib import Path
import test_study
from robomirror_drake.study.run import Work

def slow(job):
    time.sleep(0.2)
    return test_study.pretend_compare(job)

test_study.study(Path(sys.argv[1]), Work(test_study.pretend_screen, slow))
"""


def test_kill_loses_and_doubles_nothing(tmp_path):
    folder = tmp_path / "s"
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    driver = subprocess.Popen(
        [sys.executable, "-c", DRIVER, str(folder)], env={**os.environ, "PYTHONPATH": path}
    )
    until = time.monotonic() + 60.0
    while len(list((folder / "results").glob("*.parquet"))) < 3 and time.monotonic() < until:
        time.sleep(0.02)
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    kept = len(list((folder / "results").glob("*.parquet")))
    assert 3 <= kept < 12
    made: list[str] = []
    found = study(folder, counted(made))
    assert made.count("compare") == 12 - kept
    assert found == study(tmp_path / "whole")


def test_failures_are_recorded(monkeypatch):
    def broken(*_: object, **__: object) -> None:
        raise ValueError("no such luck")

    monkeypatch.setattr(unit, "Bench", broken)
    job = Job(0, PROMPTS[0], OPTIONS, Scenario())
    row = unit.screen(job)
    assert (row["state"], row["failure"]) == ("failed", "ValueError: no such luck")
    rows = unit.compare(job._replace(screened={"state": "fell"}))
    assert [row["method"] for row in rows] == ["none", "random", "selection", "oracle"]
    assert all(row["cause"] == "failed" and "no such luck" in row["failure"] for row in rows)
    # Of a command that goes well by itself only what could break it.
    rows = unit.compare(job._replace(screened={"state": "stood"}))
    assert [row["method"] for row in rows] == ["selection"]


def test_how_pools_end_is_taken_over_from_another_study(tmp_path):
    whole = study(tmp_path / "s")
    told: list[Job] = []

    def compared(job: Job) -> list[Row]:
        told.append(job)
        return pretend_compare(job)

    work = Work(pretend_screen, compared)
    study(tmp_path / "t", work, screened_in=tmp_path / "s")
    assert [row for job in told for row in job.earlier] == [
        row for row in whole.results if row["method"] != "selection"
    ]
    falling = next(job for job in told if job.earlier)
    for variant in variants(OPTIONS, Scenario().adaptation):
        row = of_earlier(falling, variant)
        assert (row is None) == (variant.method == "selection")
        assert row is None or row["method"] == variant.method
        assert (pool_earlier(falling, variant) is None) == (variant.pool is None)
    # Pools that were not simulated as far as these are tell nothing.
    told.clear()
    enough = OPTIONS.model_copy(update={"simulated": "enough"})
    study(tmp_path / "u", work, options=enough, screened_in=tmp_path / "s")
    assert len(told) == 12
    assert not any(job.earlier for job in told)


# What it says


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> Study:
    return study(tmp_path_factory.mktemp("found") / "s")


def test_figures_are_those_of_the_rows(found):
    figures = summarise(found)
    methods = {one["method"]: one for one in figures["methods"]}
    assert list(methods) == ["none", "random", "selection", "oracle"]
    for name, one in methods.items():
        rows = [r for r in found.results if r["method"] == name and r["set"] == "failing"]
        assert one["commands"] == len(rows) == 9
        assert one["saved"] == pytest.approx(np.mean([row["saved"] for row in rows]))
        assert sum(one["causes"].values()) == pytest.approx(9 * (1.0 - one["saved"]))
        assert set(one["causes"]) <= set(CAUSES)
        low, high = one["saved_interval"]
        assert low <= one["saved"] <= high
        assert one["time_s"] == pytest.approx(0.1)
        assert {group: own["commands"] for group, own in one["groups"].items()} == dict.fromkeys(
            sorted(GROUPS), 3
        )
    assert methods["none"]["task_done"] is None
    assert methods["selection"]["task_done"] == pytest.approx(0.5)
    assert methods["selection"]["succeeding"]["commands"] == 3
    assert methods["selection"]["succeeding"]["changed"] == 0.0
    assert figures["best"]["times_random"] == pytest.approx(methods["selection"]["saved"] / 0.25)
    json.dumps(figures, allow_nan=False)


def test_splits_are_told_apart(found):
    def split(row: Row) -> str:
        return "held_out" if row["command"] % 2 else "test"

    rows = [row | {"split": split(row)} for row in found.results]
    figures = summarise(found._replace(results=rows))
    for one in figures["methods"]:
        own = [r for r in rows if r["method"] == one["method"] and r["set"] == "failing"]
        for name, part in one["splits"].items():
            there = [row["saved"] for row in own if row["split"] == name]
            assert (part["commands"], part["saved"]) == (len(there), pytest.approx(np.mean(there)))
    assert set(figures["methods"][0]["splits"]) == {"test", "held_out"}
    said = io.StringIO()
    print_study(figures, Console(file=said, width=160))
    assert "by split" in said.getvalue()
    assert "By split" in render_study(found, figures)
    assert "By split" not in render_study(found, summarise(found))


def test_intervals():
    # Newcombe 1998, table I: 81 of 263, Wilson without continuity correction.
    low, high = share_interval(np.repeat([1.0, 0.0], [81, 182]))
    assert (round(low, 4), round(high, 4)) == (0.2553, 0.3662)
    assert share_interval(np.zeros(0)) is None
    assert share_interval(np.zeros(5), np.zeros(5)) is None
    # Of shares there is no exact one: about the normal interval of the mean.
    values = np.random.default_rng(0).uniform(0.2, 0.6, 400)
    low, high = share_interval(values)
    half = 1.96 * values.std() / 20.0
    assert (low, high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.003)


def test_labels_tell_variants_apart():
    options = StudyOptions(grid=Grid(methods=("none", "selection"), pool=(2, 4)))
    made = [vars(one) for one in variants(options, AdaptationOptions())]
    assert labels(made) == ["none", "selection, pool 2", "selection, pool 4"]
    assert labels(made[:2]) == ["none", "selection"]


def test_page_and_table_say_it(found):
    figures = summarise(found)
    text = io.StringIO()
    print_study(figures, Console(file=text, width=200))
    assert "9 (3 dynamic, 3 expressive, 3 locomotion) whose own motion falls" in text.getvalue()
    assert "times as many as a random candidate" in text.getvalue()
    html = render_study(found, figures)
    page = re.sub(r"<script>/\*.*?</script>", "", html, count=1, flags=re.DOTALL)
    assert not re.search(r"https?://|src\s*=|<link|@import|url\(", page)
    assert "survivor misranked" in page
    assert page.count("(upright by itself)") == 3


def test_pool_sizes_are_drawn_as_a_line(tmp_path):
    grid = Grid(methods=("selection", "oracle"), pool=(1, 4))
    made = study(tmp_path / "s", options=OPTIONS.model_copy(update={"grid": grid}))
    assert "candidates in the pool" in render_study(made, summarise(made))


def test_command_writes_what_it_was_asked_for(tmp_path, monkeypatch):
    file = tmp_path / "mine.yaml"
    file.write_text("failing: 3\nsucceeding: 0\ngrid: {methods: [none, selection], pool: [2]}\n")
    monkeypatch.setattr(run, "fingerprint", lambda *_: "none")
    monkeypatch.setattr(run_study, "__kwdefaults__", run_study.__kwdefaults__ | {"work": PRETEND})
    wanted = [str(file), "--workers", "0", "--limit", "2", "--out", str(tmp_path / "s")]
    wanted += ["--json", str(tmp_path / "s.json"), "--html", str(tmp_path / "s.html")]
    done = CliRunner().invoke(app, ["study", *wanted], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    methods = json.loads((tmp_path / "s.json").read_text())["methods"]
    assert [one["method"] for one in methods] == ["none", "selection"]
    keys = {"saved", "saved_interval", "task_done", "task_done_interval", "deviation", "time_s"}
    assert all(keys | {"causes"} <= set(one) for one in methods)
    assert methods[0]["commands"] == 2
    assert "Adaptation, compared" in (tmp_path / "s.html").read_text()


# All of it


@pytest.fixture
def by_chance(monkeypatch, make_predictor) -> None:
    """Falls are foreseen by a small network with weights of chance."""
    predictor = make_predictor()
    monkeypatch.setattr(bench, "_predictor", lambda *_: predictor)
    monkeypatch.setattr(bench, "_ensemble", lambda *_: Ensemble([predictor]))


@pytest.mark.slow
@pytest.mark.usefixtures("by_chance")
def test_a_small_study_in_physics(tmp_path, monkeypatch):
    options = validate(
        StudyOptions,
        {
            "failing": 1,
            "succeeding": 1,
            "changes": {"simulation": {"after_fall": 0.1, "hold": 0.5}},
            "grid": {
                "methods": [
                    "none", "random", "selection", "optimisation", "selection_optimisation",
                    "closed_loop_alone", "oracle",
                ],
                "t_safe": [0.9],
                "pool": [2, 3],
            },
        },
        "test",
    )  # fmt: skip
    scenario = study_scenario(options)
    prompts = tuple(
        Prompt(text=text, group="dynamic") for text in ("a person nods", "a person sprints forward")
    )
    executed: list[bytes] = []
    rollout = bench.rollout

    def counts(robot: Any, plan: Any, *rest: Any) -> Any:
        executed.append(plan.q.tobytes())
        return rollout(robot, plan, *rest)

    monkeypatch.setattr(bench, "rollout", counts)
    made = study(tmp_path / "s", Work(), options=options, scenario=scenario, prompts=prompts)
    assert {row["prompt"]: row["state"] for row in made.screened} == {
        "a person nods": "stood",
        "a person sprints forward": "fell",
    }
    assert len(executed) == len(set(executed))  # no motion twice, whoever takes it
    failing = [row for row in made.results if row["set"] == "failing"]
    rows = {(row["method"], row["pool"]): row for row in failing}
    none = rows["none", None]
    assert (none["saved"], none["deviation"], none["tempo"]) == (0.0, 0.0, 1.0)
    assert none["fall_time_s"] is not None
    for pool in (2, 3):
        own, best = (rows[name, pool] for name in ("selection", "oracle"))
        assert own["saved"] <= best["saved"]
        assert own["survivor"] == best["survivor"] == bool(best["saved"])
        assert own["simulated"] == best["simulated"] == pool
        assert own["time_s"] == pytest.approx(
            own["generate_s"] + own["retarget_s"] + own["adapt_s"]
        )
        assert own["saved"] or own["cause"] in ("no_survivor", "survivor_misranked")
    assert not any(row["failure"] for row in made.results), made.results
    fine = [row for row in made.results if row["set"] == "succeeding"]
    assert {row["method"] for row in fine} == {
        "selection", "optimisation", "selection_optimisation", "closed_loop_alone",
    }  # fmt: skip
    for row in fine:
        assert row["changed"] or row["saved"]
    (screened,) = (row for row in made.screened if row["prompt"] == "a person nods")
    job = Job(0, prompts[0], options, scenario, screened)
    clocks = ("generate_s", "retarget_s", "adapt_s", "time_s", "look_s")
    for one, other in zip(fine, unit.compare(job), strict=True):
        here = {name: other.get(name) for name in one} | dict.fromkeys(clocks)
        assert one | dict.fromkeys(clocks) == here

    # With other weights the same pools need not be simulated again.
    count = len(executed)
    settings = {"options": options, "scenario": scenario, "prompts": prompts}
    again = study(tmp_path / "t", Work(), screened_in=tmp_path / "s", **settings)
    assert len(executed) - count < count - 2
    for one, other in zip(made.results, again.results, strict=True):
        assert one | dict.fromkeys(clocks) == other | dict.fromkeys(clocks)
