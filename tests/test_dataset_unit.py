"""One command executed for real: what is recorded, the same each time, failures included."""

from __future__ import annotations

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from robomirror_drake.config import Scenario
from robomirror_drake.dataset import unit
from robomirror_drake.dataset.options import DatasetOptions
from robomirror_drake.dataset.prompts import Prompt
from robomirror_drake.dataset.records import Job
from robomirror_drake.dataset.unit import failed, make
from robomirror_drake.dataset.windows import ERRORS, Track, label_windows
from robomirror_drake.disturbance import DisturbanceOptions
from robomirror_drake.exceptions import PlanningError
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.rollout import rollout
from robomirror_drake.tables import rows_in_shape

SCENARIO = Scenario.model_validate({"simulation": {"hold": 0.2}})


def job(text: str, **options) -> Job:
    prompt = Prompt(text=text, group="locomotion", actions=("walk",), split="test")
    return Job(7, prompt, DatasetOptions(**options), SCENARIO)


def tables(made: unit.Made) -> tuple[list[dict], pa.Table]:
    episodes, frames = (pq.read_table(io.BytesIO(file)) for file in (made.episodes, made.frames))
    return episodes.to_pylist(), frames


@pytest.fixture(scope="module")
def step() -> Job:
    return job("a person takes one step forward", per_prompt=2, executions=3)


@pytest.fixture(scope="module")
def made(step) -> unit.Made:
    """Two motions of a step: the first one executed three times, the other's plan refused."""
    calls = []

    def plan(robot, raw, options):
        calls.append(raw)
        if len(calls) == 2:
            raise PlanningError("not this one", {})
        return plan_dynamics(robot, raw, options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unit, "plan_dynamics", plan)
        return make(step)


def test_episodes_say_what_was_done(made):
    rows, _ = tables(made)
    assert [row["episode"] for row in rows] == list(range(42, 48))
    assert [(row["candidate"], row["execution"]) for row in rows] == [
        (candidate, execution) for candidate in range(2) for execution in range(3)
    ]
    nominal, pushed, disturbed = rows[:3]
    assert (nominal["kind"], pushed["kind"]) == ("nominal", "pushed")
    assert disturbed["kind"] in ("start", "dynamics")
    assert nominal["fell"] is False
    assert nominal["push_time_s"] is None
    assert 0.1 <= pushed["push_speed"] <= 1.2
    assert len({row["seed"] for row in rows[:3]}) == 3
    assert {row["source"] for row in rows[:3]} == {nominal["source"]}
    for row in rows[3:]:
        assert (row["failed_stage"], row["frames"], row["fell"]) == ("plan", 0, None)
        assert row["failure"] == "PlanningError: not this one"
        assert row["style"] != nominal["style"]
    timing = made.timing
    assert (timing["episodes"], timing["failed"]) == (6, 3)
    assert timing["simulated_s"] == pytest.approx(sum(r["duration_s"] or 0.0 for r in rows))
    assert all(spent > 0.0 for spent in timing["cpu_s"].values())


def test_frames_hold_the_command_the_plan_and_what_was_done(made):
    rows, frames = tables(made)
    episode = rows_in_shape(frames, "episode")
    for row in rows[:3]:
        mine = {n: rows_in_shape(frames, n)[episode == row["episode"]] for n in frames.column_names}
        np.testing.assert_array_equal(mine["frame"], np.arange(row["frames"]))
        np.testing.assert_allclose(mine["time"], mine["frame"] / 60.0, atol=1e-5)
        if not row["fell"]:
            track = Track(*(mine[name] for name in Track._fields))
            whole = label_windows(track, float(track.time[-1]))
            assert len(whole.start) == 1
            means = [row[name] for name in ERRORS]
            np.testing.assert_allclose(whole.errors[0], means, rtol=0.05, atol=1e-3)
        # The command runs in the plan's time: it is near the plan, and still before and after.
        moving = (mine["time"] > row["lead_s"] + 0.1) & (
            mine["time"] < row["lead_s"] + row["raw_duration_s"] - 0.1
        )
        speed = np.abs(mine["v_raw"]).max(axis=1)
        assert (speed[moving] > 0.0).all()
        late = mine["time"] > row["lead_s"] + row["raw_duration_s"] + 0.02
        assert not speed[late].any()
        away = np.linalg.norm(mine["q_raw"][:, 4:7] - mine["q_ref"][:, 4:7], axis=1)
        assert away.max() < 0.1


def test_an_execution_is_the_same_whatever_else_is_executed(step, made):
    rows, frames = tables(made)
    alone = make(job(step.prompt.text, per_prompt=1, executions=2))
    again, same = tables(alone)
    assert len(again) == 2
    for old, new in zip(rows, again, strict=False):
        differing = {name for name in old if old[name] != new[name]}
        assert differing <= {"episode"}
    count = len(same)
    for name in ("q", "q_raw", "torque"):
        np.testing.assert_array_equal(
            rows_in_shape(frames, name)[:count], rows_in_shape(same, name)
        )


def test_failures_of_every_stage_are_recorded(monkeypatch, step):
    unknown, frames = tables(make(job("the stock market fell", per_prompt=2, executions=2)))
    assert {(row["failed_stage"], row["source"]) for row in unknown} == {("generate", None)}
    assert len(unknown) == 4
    assert len(frames) == 0
    assert "UnknownCommandError" in unknown[0]["failure"]

    def diverge(robot, plan, options, seed, **given):
        if options.disturbance.pushes:
            raise MemoryError("no more")
        return rollout(robot, plan, options, seed, **given)

    monkeypatch.setattr(unit, "rollout", diverge)
    rows, _ = tables(make(job(step.prompt.text, per_prompt=1, executions=2)))
    assert [row["failed_stage"] for row in rows] == [None, "simulate"]
    assert rows[1]["failure"] == "MemoryError: no more"
    dead, _ = tables(failed(step, RuntimeError("killed")))
    assert {(row["failed_stage"], row["failure"]) for row in dead} == {
        ("worker", "RuntimeError: killed")
    }
    assert len(dead) == 6


def test_what_disturbs_all_executions_stays_and_none_is_longer_than_allowed(step):
    options = DatasetOptions(per_prompt=1, executions=3, longest=1.5, push_speed=(0.1, 0.1))
    always = DisturbanceOptions.model_validate({"actuators": {"strength": 0.9}, "friction": 0.5})
    simulation = step.scenario.simulation.model_copy(update={"disturbance": always})
    scenario = step.scenario.model_copy(update={"simulation": simulation})
    rows, _ = tables(make(step._replace(options=options, scenario=scenario)))
    assert [row["strength"] for row in rows][:2] == pytest.approx([0.9, 0.9])
    assert rows[0]["friction"] == pytest.approx(0.5)
    assert [row["duration_s"] for row in rows] == pytest.approx([1.5] * 3, abs=0.02)
    assert rows[1]["push_time_s"] < 1.5
