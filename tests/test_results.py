"""Result folders: bit for bit, whole or not at all, never over another."""

from __future__ import annotations

import dataclasses
import json
import pickle
import signal
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from robomirror_drake import results
from robomirror_drake.exceptions import ResultError
from robomirror_drake.outcome import evaluate
from robomirror_drake.results import Result, load_result, save_result

FILES = {
    "outcome.json",
    "scenario.yaml",
    "candidates.parquet",
    "reference.parquet",
    "execution.parquet",
}


@pytest.fixture
def result(candidates, reference, noisy_execution) -> Result:
    return Result(
        command="a person sways",
        scenario="seed: 3  # µ\n",
        candidates=candidates,
        chosen=1,
        reference=reference,
        execution=noisy_execution,
        outcome=evaluate(noisy_execution, np.full(23, 100.0), 0.6),
        seeds={"generator": 3},
    )


def test_round_trip_is_bitwise(result, tmp_path):
    folder = save_result(tmp_path / "run", result, {"report.html": "<p>µ</p>"})
    assert folder == tmp_path / "run"
    assert {path.name for path in folder.iterdir()} == FILES | {"report.html"}
    loaded = load_result(folder)
    assert loaded == result
    for name in ("reference", "execution"):
        for f in dataclasses.fields(getattr(result, name)):
            was = getattr(getattr(result, name), f.name)
            now = getattr(getattr(loaded, name), f.name)
            if isinstance(was, np.ndarray):
                assert (was.dtype, was.shape, was.tobytes()) == (
                    now.dtype,
                    now.shape,
                    now.tobytes(),
                )


def test_same_result_same_bytes(result, tmp_path):
    one, two = save_result(tmp_path / "one", result), save_result(tmp_path / "two", result)
    for name in FILES:
        assert (one / name).read_bytes() == (two / name).read_bytes()


def test_never_overwrites(result, tmp_path):
    folders = [save_result(tmp_path / "run", result) for _ in range(3)]
    assert [folder.name for folder in folders] == ["run", "run-2", "run-3"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "run-2", "run-3"]


@pytest.mark.parametrize("fault", [RuntimeError, KeyboardInterrupt])
def test_interrupted_writing_leaves_nothing(result, tmp_path, monkeypatch, fault):
    def fail(*_args: object) -> None:
        raise fault

    monkeypatch.setattr(results, "write_candidates", fail)
    with pytest.raises(fault):
        save_result(tmp_path / "run", result)
    assert not list(tmp_path.iterdir())


def test_killed_run_leaves_nothing_that_looks_like_a_result(result, tmp_path):
    (tmp_path / "result.pickle").write_bytes(pickle.dumps(result))
    program = """
import os, pathlib, pickle, signal
from robomirror_drake import results
results.write_candidates = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
results.save_result(pathlib.Path("run"), pickle.loads(pathlib.Path("result.pickle").read_bytes()))
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path)
    assert done.returncode == -signal.SIGKILL
    assert not [path for path in tmp_path.iterdir() if path.is_dir() and path.name[0] != "."]
    (leftover,) = (path for path in tmp_path.iterdir() if path.is_dir())
    with pytest.raises(ResultError, match=r"candidates\.parquet"):
        load_result(leftover)


def test_unwritable_place_is_named(result, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ResultError, match="file/run"):
        save_result(tmp_path / "file" / "run", result)


def test_every_column_is_documented(result, tmp_path):
    folder = save_result(tmp_path / "run", result)
    for path in folder.glob("*.parquet"):
        for column in pq.read_schema(path):
            assert column.metadata[b"description"], f"{path.name}: {column.name}"
            assert b"unit" in column.metadata


def test_outcome_json_says_what_is_promised(result, tmp_path):
    data = json.loads((save_result(tmp_path / "run", result) / "outcome.json").read_text())
    assert data["fell"] is result.outcome.fell
    assert data["fall_time_s"] == result.outcome.fall_time_s
    assert {"A_q", "A_qd", "A_qdd", "A_p", "A_theta"} <= set(data)
    assert data["seeds"] == {"generator": 3}
    assert {"drake", "pin", "numpy", "robomirror_drake"} <= set(data["versions"])


@pytest.mark.parametrize("name", sorted(FILES))
def test_missing_file_is_named(result, tmp_path, name):
    folder = save_result(tmp_path / "run", result)
    (folder / name).unlink()
    with pytest.raises(ResultError, match=name):
        load_result(folder)


@pytest.mark.parametrize("name", sorted(FILES - {"scenario.yaml"}))
@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda _: b"", lambda _: b"[1]\xff"]
)
def test_damaged_file_is_named(result, tmp_path, name, damage):
    path = save_result(tmp_path / "run", result) / name
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ResultError, match=name):
        load_result(path.parent)


def test_parquet_of_something_else_is_named(result, tmp_path):
    folder = save_result(tmp_path / "run", result)
    (folder / "reference.parquet").write_bytes((folder / "candidates.parquet").read_bytes())
    with pytest.raises(ResultError, match=r"reference\.parquet"):
        load_result(folder)


@pytest.mark.parametrize(
    "change", [{"chosen": 3}, {"fell": "maybe"}, {"extra": 1}, {"A_q": None}, {"format": 2}]
)
def test_wrong_summary_is_named(result, tmp_path, change):
    path = save_result(tmp_path / "run", result) / "outcome.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ResultError, match=r"outcome\.json"):
        load_result(path.parent)


def test_no_folder_is_a_result_error(tmp_path):
    with pytest.raises(ResultError, match="nowhere"):
        load_result(tmp_path / "nowhere")
