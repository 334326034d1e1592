"""Data sets: what they hold, and that no kill loses or doubles anything of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas
import polars
import pyarrow.parquet as pq
import pytest

from robomirror_drake.config import Scenario
from robomirror_drake.dataset import scaling
from robomirror_drake.dataset.columns import (
    EPISODE_COLUMNS,
    episodes_table,
    frame_columns,
    frames_table,
)
from robomirror_drake.dataset.generate import Progress, generate_dataset
from robomirror_drake.dataset.options import DatasetOptions, draw_disturbance, stream
from robomirror_drake.dataset.pool import here
from robomirror_drake.dataset.prompts import Prompt
from robomirror_drake.dataset.records import Job
from robomirror_drake.dataset.shards import Store, check, encode, read_frames, read_shards
from robomirror_drake.dataset.summary import summarise
from robomirror_drake.dataset.unit import Made
from robomirror_drake.exceptions import InputError, ResultError
from robomirror_drake.tables import rows_in_shape

PROMPTS = tuple(
    Prompt(text=f"a person waves {n} times", group="expressive", actions=("wave",))
    for n in range(2, 12)
)
OPTIONS = DatasetOptions(per_prompt=2, executions=3, group=4)


def pretend(job: Job) -> Made:
    """Files of the right form, of random numbers that depend on the job alone."""
    options, text = job.options, job.prompt.text
    rows, frames = [], []
    for candidate in range(options.per_prompt):
        for number in range(options.executions):
            rng = stream(options, text, candidate, number)
            episode = job.number * 6 + candidate * 3 + number
            fell = bool(rng.random() < 0.5)
            rows.append(
                {
                    "episode": episode,
                    "prompt_index": job.number,
                    "prompt": text,
                    "actions": ["wave"],
                    "group": "expressive",
                    "split": "train",
                    "candidate": candidate,
                    "execution": number,
                    "kind": draw_disturbance(options, number, 1.0, rng)[0],
                    "frames": 7,
                    "duration_s": 0.1,
                    "fell": fell,
                    "fall_cause": "tilt" if fell else None,
                }
            )
            random = {c.name: rng.random((7, *c.shape)) for c in frame_columns()}
            frames.append(random | {"episode": np.full(7, episode), "frame": np.arange(7)})
    arrays = {name: np.concatenate([part[name] for part in frames]) for name in frames[0]}
    files = encode(episodes_table(rows), frames_table(arrays, 23))
    timing = {
        "prompt_index": job.number,
        "wall_s": 2.0,
        "cpu_s": {"plan": 0.5, "simulate": 1.0},
        "simulated_s": 0.6,
        "episodes": 6,
        "fell": sum(row["fell"] for row in rows),
        "failed": 0,
    }
    return Made(*files, timing)


def make_all(folder: Path, work=pretend, **changes) -> Progress:
    settings = {"workers": 0, "options": OPTIONS, "prompts": PROMPTS, "scenario": Scenario()}
    return generate_dataset(folder=folder, work=work, **(settings | changes))


def contents(folder: Path) -> tuple[list[dict], dict[str, np.ndarray]]:
    """All rows in the order of the episodes, as plain Parquet readers see them."""
    episodes = pq.read_table(folder / "episodes").sort_by("episode")
    frames = pq.read_table(folder / "frames").sort_by(
        [("episode", "ascending"), ("frame", "ascending")]
    )
    names = [column.name for column in frame_columns()]
    return episodes.to_pylist(), {name: rows_in_shape(frames, name) for name in names}


def assert_same(a: Path, b: Path) -> None:
    (rows_a, frames_a), (rows_b, frames_b) = contents(a), contents(b)
    assert rows_a == rows_b
    for name, values in frames_a.items():
        np.testing.assert_array_equal(values, frames_b[name], err_msg=name)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "data"
    progress = make_all(folder)
    assert (progress.done, progress.episodes) == (10, 60)
    return folder


def test_files_are_few_and_say_what_they_hold(whole):
    names = ["000000-000003", "000004-000007", "000008-000009"]
    for kind in ("episodes", "frames"):
        assert sorted(path.stem for path in (whole / kind).iterdir()) == names
    assert not list((whole / "parts").rglob("*.parquet"))
    rows, frames = contents(whole)
    assert [row["episode"] for row in rows] == list(range(60))
    assert {row["kind"] for row in rows} == {"nominal", "pushed", "start", "dynamics"}
    np.testing.assert_array_equal(frames["episode"], np.repeat(np.arange(60), 7))
    shard = Store(whole).groups()[0]
    for file, columns in ((shard.frames, frame_columns()), (shard.episodes, EPISODE_COLUMNS)):
        schema = pq.read_schema(file)
        assert schema.names == [column.name for column in columns]
        for column in columns:
            field = schema.field(column.name)
            assert field.metadata[b"unit"].decode() == column.unit
            assert field.metadata[b"description"]
            assert "double" not in str(field.type)
    assert pq.ParquetFile(shard.frames).num_row_groups == 4  # a command each


def test_other_readers_read_it(whole):
    rows, frames = contents(whole)
    read = pandas.read_parquet(whole / "frames").sort_values(["episode", "frame"])
    np.testing.assert_array_equal(np.stack(read["q"].to_list()), frames["q"])
    assert list(pandas.read_parquet(whole / "episodes")["prompt"]) == [r["prompt"] for r in rows]
    table = polars.read_parquet(whole / "frames" / "*.parquet").sort("episode", "frame")
    np.testing.assert_array_equal(table["q"].to_numpy(), frames["q"])
    assert table["contact_raw"].dtype == polars.Array(polars.Boolean, 8)


def test_datasets_reads_it(whole, tmp_path):
    import datasets  # slow to import

    files = sorted(str(path) for path in (whole / "frames").glob("*.parquet"))
    loaded = datasets.load_dataset("parquet", data_files=files, cache_dir=str(tmp_path))["train"]
    assert len(loaded) == 420
    assert loaded.features["q"].length == 30
    np.testing.assert_array_equal(np.array(loaded[:7]["torque"]), contents(whole)[1]["torque"][:7])


def test_info_counts_everything(whole):
    summary = summarise(whole)
    rows, _ = contents(whole)
    fell = sum(row["fell"] for row in rows)
    assert (summary.prompts, summary.total.episodes, summary.total.fell) == (10, 60, fell)
    assert summary.total.seconds == pytest.approx(6.0)
    assert summary.by["action"]["wave"].causes == {"tilt": fell}
    assert summary.cost.rate() == pytest.approx(6.0 / 15.0)
    assert summary.cost.rate("plan") == pytest.approx(6.0 / 5.0)
    assert summary.cost.paper_hours(10) == pytest.approx(255_000 * 0.25 / 36_000)


def test_a_run_goes_on_and_makes_the_same(whole, tmp_path):
    folder = tmp_path / "data"
    assert make_all(folder, limit=3).done == 3
    assert {path.stem for path in (folder / "frames").iterdir()} == {"000000-000002"}
    progress = make_all(folder)
    assert (progress.done, progress.done_here) == (10, 7)
    assert_same(folder, whole)
    assert make_all(folder).done_here == 0


class Killed(BaseException):
    """Nothing in the package catches it."""


@pytest.mark.parametrize("after", [0, 1, 2, 3, 4, 9, 10, 11, 12, 13, 14, 23, 30])
def test_a_death_at_any_step_of_the_files_loses_and_doubles_nothing(
    whole, tmp_path, monkeypatch, after
):
    """Dies instead of, or right after, the n-th rename or removal; then goes on."""
    folder, steps = tmp_path / "data", iter(range(10_000))
    with monkeypatch.context() as patch:
        for name in ("rename", "unlink"):
            true = getattr(Path, name)

            def step(path, *arguments, true=true, **named):
                if next(steps) == after:
                    if after % 2:
                        true(path, *arguments, **named)
                    raise Killed
                return true(path, *arguments, **named)

            patch.setattr(Path, name, step)
        with pytest.raises(Killed):
            make_all(folder)
    make_all(folder)
    assert_same(folder, whole)
    assert not list(folder.rglob("*.partial"))
    assert summarise(folder).cost.prompts == 10


DRIVER = """
import os, time
from pathlib import Path
from test_dataset import make_all, pretend

def slow(job):
    Path({pids!r}, str(os.getpid())).touch()
    time.sleep(0.3)
    return pretend(job)

if __name__ == "__main__":
    make_all(Path({folder!r}), slow, workers=2)
"""


@pytest.mark.slow
def test_real_kills_of_a_worker_and_of_the_driver(whole, tmp_path):
    folder, pids = tmp_path / "data", tmp_path / "pids"
    pids.mkdir()
    log = folder / "timing.jsonl"
    script = tmp_path / "driver.py"
    # Workers have to find this module, too.
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    script.write_text(DRIVER.format(folder=str(folder), pids=str(pids)))
    driver = subprocess.Popen([sys.executable, str(script)], env={**os.environ, "PYTHONPATH": path})

    def wait(met) -> None:
        until = time.monotonic() + 400.0
        while not met():
            assert time.monotonic() < until
            time.sleep(0.02)

    def done() -> int:
        return len(log.read_text().splitlines()) if log.exists() else 0

    try:
        wait(lambda: done() >= 1)
        victim = max(int(path.name) for path in pids.iterdir())
        os.kill(victim, signal.SIGKILL)
        wait(lambda: done() >= 5)
    finally:
        os.kill(driver.pid, signal.SIGKILL)
        driver.wait()
    before = done()
    assert before < 10
    wait(lambda: not any(Path("/proc", path.name).exists() for path in pids.iterdir()))
    progress = make_all(folder)
    assert 0 < progress.done_here <= 10 - before + 1
    assert_same(folder, whole)


def test_scaling_is_measured_on_the_same_work(monkeypatch):
    at_once = []

    class Serial:
        def __init__(self, workers: int) -> None:
            assert workers == 2

        def __enter__(self) -> Serial:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def map(self, jobs, work, **named):
            at_once.append(named.get("at_once"))
            return here(jobs, work)

    monkeypatch.setattr(scaling, "Pool", Serial)
    jobs = [Job(n, prompt, OPTIONS, Scenario()) for n, prompt in enumerate(PROMPTS[:3])]
    rows = scaling.measure_scaling(jobs, (1, 2), pretend)
    assert at_once == [None, 1, 2]  # None warms up
    for row in rows:
        assert row.simulated_s == pytest.approx(3 * 0.6)
        assert row.cpu_s == pytest.approx(3 * 1.5)


def test_damage_is_named_skipped_and_mended(whole, tmp_path):
    folder = tmp_path / "data"
    make_all(folder)
    groups = Store(folder).groups()
    content = bytearray(groups[1].frames.read_bytes())
    content[len(content) // 2] ^= 1
    groups[1].frames.write_bytes(content)
    groups[2].episodes.write_bytes(groups[2].episodes.read_bytes()[:-9])
    assert str(groups[1].frames) in check(groups[1])
    with pytest.raises(ResultError, match="000004-000007"):
        read_frames(groups[1])
    summary = summarise(folder)
    assert summary.total.episodes == 24
    assert [str(groups[1].frames) in summary.damaged[0], len(summary.damaged)] == [True, 2]
    assert str(groups[2].episodes) in summary.damaged[1]
    assert len(list(read_shards(folder))) == 1
    progress = make_all(folder)
    assert (progress.done_here, len(progress.damaged)) == (6, 2)
    assert_same(folder, whole)


def test_another_data_set_is_refused(whole):
    for changes, named in (
        ({"options": OPTIONS.model_copy(update={"seed": 1})}, "options.seed is 0 there and 1 here"),
        ({"prompts": PROMPTS[:5]}, "prompts.count is 10"),
    ):
        with pytest.raises(InputError, match=named):
            make_all(whole, **changes)
    with pytest.raises(ResultError, match="no data set"):
        summarise(whole.parent)


def test_two_runs_do_not_write_to_one_folder(tmp_path):
    folder = tmp_path / "data"

    def intruding(job: Job) -> Made:
        with pytest.raises(InputError, match="another run"):
            make_all(folder)
        return pretend(job)

    make_all(folder, intruding, limit=1)


def test_a_cut_line_of_the_log_counts_for_nothing(whole, tmp_path):
    folder = tmp_path / "data"
    make_all(folder, limit=2)
    with (folder / "timing.jsonl").open("a") as log:
        log.write(json.dumps({"prompt_index": 0})[:-3])
    make_all(folder)
    assert summarise(folder).cost.prompts >= 9
    assert_same(folder, whole)


def test_draws_depend_on_the_command_and_the_numbers_alone():
    kinds = [draw_disturbance(OPTIONS, n, 4.0, stream(OPTIONS, "a", 0, n))[0] for n in range(4)]
    assert kinds[:2] == ["nominal", "pushed"]
    assert kinds[2] in ("start", "dynamics")
    assert kinds[3] == "pushed"
    drawn = [stream(OPTIONS, *which).random() for which in (("a", 0, 1), ("a", 1, 0), ("b", 0, 1))]
    assert len(set(drawn)) == 3
    _, pushed = draw_disturbance(OPTIONS, 1, 4.0, stream(OPTIONS, "a", 0, 1))
    (push,) = pushed.pushes
    assert 0.0 <= push.time <= 4.0
    assert 0.1 <= np.linalg.norm(push.speed) <= 1.2
