"""``robomirror train`` and ``robomirror evaluate`` at the prompt."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest
import yaml

from robomirror_drake import cli
from robomirror_drake.dataset.printing import plain
from robomirror_drake.learning.evaluate import EvaluateOptions, evaluate
from robomirror_drake.learning.judge import UNITS
from robomirror_drake.learning.page import render_card, render_evaluation

NETWORK = {
    "horizon": 0.5, "history": 0.1, "width": 16, "heads": 2, "self_layers": 1, "cross_layers": 1,
}  # fmt: skip
EACH = {"epochs": 6, "batch": 32, "average": 0.9, "learning_rate": 6e-3}
MODELS = ["PPN", "PPN without state", "PPN, 50 % of the commands"]
BASELINES = ["logistic regression", "boosted trees"]


def robomirror(monkeypatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["robomirror", *map(str, arguments)])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    return int(stopped.value.code or 0)


def said(capsys) -> str:
    """All that was printed, without the breaks of lines."""
    printed = capsys.readouterr()
    return " ".join((printed.out + printed.err).split())


@pytest.fixture(scope="module")
def data(tmp_path_factory, write_executions):
    folder = tmp_path_factory.mktemp("commands") / "data"
    return write_executions(folder, train=16, validation=8, test=10, held_out=8)


@pytest.fixture(scope="module")
def weights(data, tmp_path_factory):
    """Trained by the command: a network, one with half of the data, and an ablation."""
    place = tmp_path_factory.mktemp("weights")
    with pytest.MonkeyPatch.context() as patch:
        for name, changes, more in (
            ("full", {}, ["--shares", "0.5,1"]),
            ("blind", {"use_state": False}, []),
        ):
            file = place / f"{name}.yaml"
            file.write_text(yaml.safe_dump(EACH | {"network": NETWORK | changes}))
            out = ["--data", data, "--out", place / name]
            assert robomirror(patch, "train", file, *out, *more) == 0
    return place


def test_training_tells_how_it_goes_and_where_the_weights_are(
    monkeypatch, capsys, data, weights, tmp_path
):
    arguments = ("train", weights / "full.yaml", "--data", data, "--out", tmp_path / "w")
    assert robomirror(monkeypatch, *arguments, "--epochs", 2) == 0
    printed = said(capsys)
    for words in ("epoch 1/2: loss", "epoch 2/2", "accuracy", "ppn.safetensors", "16 executions"):
        assert words in printed
    assert robomirror(monkeypatch, *arguments, "--epochs", 3) == 2
    assert "begun with other options (epochs)" in said(capsys)


def test_the_table_has_all_rows_and_their_figures(monkeypatch, capsys, data, weights, tmp_path):
    files = {name: tmp_path / f"e.{name}" for name in ("json", "html", "md")}
    command = ("evaluate", "--data", data, "--weights", weights, "--draws", 200)
    places = ("--json", files["json"], "--html", files["html"], "--card", files["md"])
    assert robomirror(monkeypatch, *command, *places) == 0
    printed = said(capsys)
    figures = json.loads(files["json"].read_text())
    assert [row["model"] for row in figures["rows"]] == MODELS + BASELINES
    full, blind, half, *_, trees = figures["rows"]
    for row in figures["rows"]:
        low, high = row["fall_accuracy_interval"]
        assert 0.0 <= low <= row["fall_accuracy"] <= high <= 1.0
        assert row["horizon_s"] == 0.5
        both = row["true_positive_rate"], 1.0 - row["false_positive_rate"]
        assert row["fall_accuracy"] == pytest.approx(np.mean(both))
        assert list(row["errors"]) == list(UNITS)
        assert all(error["mse"] >= 0.0 for error in row["errors"].values())
        assert (row["test"]["commands"], row["held_out"]["commands"]) == (10, 8)
        assert set(row["held_out"]["families"]) == {"lunges", "sideways"}
        assert row["lead_time"]["falls"] == 5
    # Who leans falls: that is to be seen in the state, and is not in the reference.
    assert min(full["fall_accuracy"], trees["fall_accuracy"]) > 0.85
    assert blind["fall_accuracy"] < 0.75
    assert blind["behind_ppn"]["interval"][0] > 0.0
    assert (full["share"], half["share"], half["trained_on"]["commands_learned"]) == (1.0, 0.5, 8)
    assert full["same_data"]
    assert full["trained_on"]["fingerprint"] == figures["parts"]["0.5"]["fingerprint"] in printed
    whole = {row["model"]: row["motions"]["test"] for row in figures["whole_motions"]}
    assert set(MODELS) < set(whole)
    assert all(0.0 <= told["auroc"] <= 1.0 and told["motions"] == 10 for told in whole.values())
    page, card = files["html"].read_text(), files["md"].read_text()
    assert "NaN" not in files["json"].read_text()
    for words in ("What more data brings", "roc_0_5", "reliability_0_5", "errors_0_5", *MODELS):
        assert words in page
    assert f"{100 * full['fall_accuracy']:.2f}" in card
    assert "no model learned from a command it is judged on" in card
    tables = [block.splitlines() for block in card.split("\n\n") if block.startswith("| ")]
    assert len(tables) == 6
    assert all(len({line.count("|") for line in table}) == 1 for table in tables)


def test_the_same_call_gives_the_same_figures(data, weights):
    options = EvaluateOptions(data=data, draws=50, baselines=False)
    first, _ = evaluate([weights / "full"], options)
    assert plain(first) == plain(evaluate([weights / "full"], options)[0])
    row = json.dumps(first["rows"][0])
    assert "behind_ppn" not in row
    more = EvaluateOptions(data=data, draws=50, baselines=True)
    with_baselines = evaluate([weights / "full"], more)[0]["rows"][0]
    assert plain(with_baselines) == plain(first["rows"][0])


def test_weights_of_other_data_are_told_apart(
    weights, tmp_path, write_executions, capsys, monkeypatch
):
    other = write_executions(tmp_path / "data", validation=2, test=6)
    command = ("evaluate", "--no-baselines", "--draws", 20, "--data", other, "--weights")
    card = tmp_path / "CARD.md"
    assert robomirror(monkeypatch, *command, weights / "full", "--card", card) == 0
    assert "learned from other data than these" in said(capsys)
    assert "whether they know these commands cannot be told" in card.read_text()


def test_several_weights_may_follow_one_option(monkeypatch, capsys, data, weights):
    files = [weights / name / "ppn.safetensors" for name in ("full", "blind")]
    command = ("evaluate", "--data", data, "--no-baselines", "--draws", 20, "--weights", *files)
    assert robomirror(monkeypatch, *command) == 0
    printed = said(capsys)
    assert all(str(file) in printed for file in files)


def test_a_network_on_torques_is_trained_and_judged(monkeypatch, capsys, data, weights, tmp_path):
    place = tmp_path / "strain"
    command = ("train-torques", "--data", data, "--out", place)
    assert robomirror(monkeypatch, *command) == 0
    assert "learned from 16 motions (50.0 % with a fall) of 16 commands" in said(capsys)
    file = tmp_path / "e.json"
    judged = ("--data", data, "--no-baselines", "--draws", 20, "--json", file)
    assert robomirror(monkeypatch, "evaluate", weights / "full", place, *judged) == 0
    rows = {row["model"]: row for row in json.loads(file.read_text())["whole_motions"]}
    assert rows["network on the largest torques, strain"]["motions"]["test"]["motions"] == 10
    assert robomirror(monkeypatch, "train", "leg_torques", "--data", data) == 2
    assert "members" in said(capsys)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("train", "nothing"), "no training/nothing; known: leg_torques, ppn_1s"),
        (("train", "ppn_1s", "--data", "/nowhere", "--out", "{tmp}/o"), "/nowhere holds no exec"),
        (("train", "ppn_1s", "--epochs", 0), "epochs: Input should be greater"),
        (("train", "ppn_1s", "--device", "tpu"), "device: Input should be 'cpu' or 'cuda'"),
        (("train", "ppn_1s", "--shares", "half"), "'half' is not a number"),
        (("train", "ppn_1s", "--shares", "1.5"), "share: Input should be less than or equal"),
        (("train", "{tmp}/bad.yaml"), "network.depth: there is no such key"),
        (("evaluate", "--weights", "{tmp}"), "no weights of a performance predictor"),
        (("evaluate", "--weights", "{tmp}/none"), "no such file or folder of weights"),
        (("evaluate", "--weights", "{tmp}/bad.yaml"), "no weights of a performance predictor"),
        (("evaluate", "--weights", "{weights}", "--data", "/nowhere"), "/nowhere holds no exec"),
        (("evaluate", "--weights", "{weights}", "--data", "{few}"), "split 'test', 0 have a fall"),
        (("evaluate", "--draws", 1), "draws: Input should be greater"),
        (("evaluate", "--json", "{tmp}"), "is a folder; name a file"),
    ],
)
def test_bad_input_is_named(
    monkeypatch, capsys, tmp_path, weights, write_executions, arguments, words
):
    (tmp_path / "bad.yaml").write_text("network:\n  depth: 3\n")
    few = tmp_path / "few"
    if "{few}" in arguments:
        write_executions(few, train=2)
    places = {"tmp": tmp_path, "weights": weights / "full", "few": few}
    given = [str(part).format(**places) for part in arguments]
    assert robomirror(monkeypatch, *given) == 2
    assert words in said(capsys)


def test_no_figure_is_lost_where_a_family_has_no_fall(tmp_path, weights, write_executions):
    def calm(row, _):
        if row["split"] == "held_out":
            row.update(fell=False, fall_time_s=None)

    data = write_executions(tmp_path, calm, validation=2, test=4, held_out=2)
    options = EvaluateOptions(data=data, draws=20, baselines=False)
    figures, judged = evaluate([weights / "full"], options)
    held = figures["rows"][0]["held_out"]
    assert "lunges" in render_evaluation(figures, judged)
    assert "PPN" in render_card(figures)
    told = json.loads(json.dumps(plain(figures), allow_nan=False))
    assert told["rows"][0]["held_out"]["fall_accuracy"] is None
    assert math.isnan(held["fall_accuracy"])
    assert 0.0 <= held["false_positive_rate"] <= 1.0
