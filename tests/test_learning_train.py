"""A predictor's training: it learns, goes on to the same bytes, refuses what does not fit."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError, ResultError
from robomirror_drake.learning.train import CHECKPOINT, LOG, WEIGHTS, predict, train
from robomirror_drake.learning.windows import load_windows
from robomirror_drake.ppn.options import PPNOptions, TrainOptions
from robomirror_drake.ppn.predictor import load_predictor
from robomirror_drake.robot import load_robot
from robomirror_drake.yaml_file import load_yaml, validate

NETWORK = {
    "horizon": 0.5, "history": 0.1, "width": 16, "heads": 2, "self_layers": 1, "cross_layers": 1,
    "dropout": 0.1,
}  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory, write_executions):
    folder = tmp_path_factory.mktemp("train") / "data"
    return write_executions(folder, train=16, validation=8, test=8)


def tiny(data, out, **changes) -> TrainOptions:
    settings = {"data": data, "out": out, "network": NETWORK, "epochs": 8, "batch": 32}
    quick = {"average": 0.9, "learning_rate": 6e-3}
    return validate(TrainOptions, settings | quick | changes, "test")


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory):
    """A whole training, and what it told of its epochs."""
    out = tmp_path_factory.mktemp("whole")
    epochs, steps = [], []
    path = train(tiny(data, out), epochs.append, stepped=lambda *done: steps.append(done))
    assert steps[-1][0] == steps[-1][1]
    return path, epochs


def test_it_learns_to_tell_falls_of_commands_it_has_not_seen(data, trained):
    path, epochs = trained
    assert epochs[-1].loss < 0.5 * epochs[0].loss
    robot = load_robot()
    predictor = load_predictor(path, robot)
    windows = load_windows(data, robot, predictor.options, 0.1)
    unseen = windows.of(lambda row: row["split"] == "test")
    scores, fall = predict(predictor.network, windows, unseen), windows.fall[unseen]
    assert float((scores.fall > 0.0)[fall].float().mean()) > 0.85
    assert float((scores.fall < 0.0)[~fall].float().mean()) > 0.85
    lines = (path.parent / LOG).read_text().splitlines()
    assert [json.loads(line)["epoch"] for line in lines] == list(range(1, 9))


def test_weights_say_what_they_learned_from(data, trained):
    _, header = checkpoint.load(trained[0], checkpoint.PREDICTOR)
    windows = load_windows(data, load_robot(), PPNOptions.model_validate(NETWORK), 0.1)
    learned = windows.of(lambda row: row["split"] == "train")
    told = header["data"]
    assert told["fingerprint"] == windows.fingerprint
    assert (told["executions"], told["executions_learned"]) == (32, 16)
    assert told["commands_learned"] == 16
    assert told["windows_learned"] == 2 * len(learned)
    judged = windows.of(lambda row: row["split"] == "validation")
    assert told["falls_validation"] == pytest.approx(float(windows.fall[judged].float().mean()))
    assert header["options"]["network"]["horizon"] == 0.5


def test_an_interrupted_training_goes_on_to_the_same_bytes(data, trained, tmp_path):
    def fail(epoch):
        if epoch.epoch in (1, 3):
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(tiny(data, tmp_path), fail)
    path = train(tiny(data, tmp_path), fail)
    whole, parts = load_file(trained[0]), load_file(path)
    assert whole.keys() == parts.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name
    assert train(tiny(data, tmp_path)) == path  # there is nothing left to do
    assert all(torch.equal(t, load_file(path)[name]) for name, t in parts.items())


def test_the_seed_decides(data, trained, tmp_path):
    path = train(tiny(data, tmp_path, seed=1))
    other, own = load_file(path), load_file(trained[0])
    assert any(not torch.equal(own[name], other[name]) for name in own if "weight" in name)


def test_it_stops_early(data, tmp_path):
    epochs = []
    train(tiny(data, tmp_path, epochs=30, patience=1, learning_rate=0.3), epochs.append)
    assert len(epochs) < 30
    assert [epoch.best for epoch in epochs[-1:]] == [False]
    assert (tmp_path / CHECKPOINT).exists()


def test_a_share_of_the_commands_is_learned_from(data, tmp_path):
    path = train(tiny(data, tmp_path, share=0.5, epochs=1))
    assert checkpoint.load(path, checkpoint.PREDICTOR)[1]["data"]["commands_learned"] == 8


def test_other_settings_or_data_do_not_continue_a_checkpoint(
    data, trained, tmp_path, write_executions
):
    out = trained[0].parent
    with pytest.raises(ConfigError, match=r"begun with other options \(network.history, batch\)"):
        train(tiny(data, out, batch=16, network=NETWORK | {"history": 0.2}))
    other = write_executions(tmp_path, train=6, validation=4)
    with pytest.raises(ConfigError, match=r"begun with other data \(.*fingerprint"):
        train(tiny(other, out))


def test_what_cannot_be_learned_from_is_refused(tmp_path, write_executions):
    with pytest.raises(ResultError, match="holds no execution"):
        train(tiny(tmp_path / "nothing", tmp_path / "out"))
    calm = write_executions(tmp_path / "calm", falls=0.0, train=4, validation=4)
    with pytest.raises(ResultError, match="windows for train, 0 have a fall"):
        train(tiny(calm, tmp_path / "out"))
    alone = write_executions(tmp_path / "alone", train=4)
    with pytest.raises(ResultError, match="of 0 windows for validation"):
        train(tiny(alone, tmp_path / "out"))
    if not torch.cuda.is_available():
        with pytest.raises(ConfigError, match="there is none here"):
            train(tiny(calm, tmp_path / "out", device="cuda"))


@pytest.mark.parametrize(
    ("name", "horizon", "lacks"),
    [
        ("ppn_1s", 1.0, set()),
        ("ppn_1s_commanded", 1.0, set()),
        ("ppn_3s", 3.0, set()),
        ("ppn_1s_without_reference", 1.0, {"use_reference"}),
        ("ppn_1s_without_state", 1.0, {"use_state"}),
        ("ppn_1s_without_cross_attention", 1.0, {"use_cross_attention"}),
    ],
)
def test_packaged_trainings_are_what_their_names_say(name, horizon, lacks):
    options = load_yaml(TrainOptions, "training", name)
    assert options.network.horizon == horizon
    assert options.out.name == name
    own = options.network.model_dump()
    assert {key for key, value in own.items() if key.startswith("use_") and not value} == lacks


@pytest.mark.slow
def test_two_processes_learn_together(data, tmp_path):
    """As one does: they share batches and gradients, so only dropout tells them apart."""
    settings = tmp_path / "two.yaml"
    network = NETWORK | {"dropout": 0.0}
    same = {"epochs": 2, "batch": 32, "average": 0.9, "learning_rate": 6e-3}
    settings.write_text(json.dumps({"network": network} | same))
    command = ["-m", "robomirror_drake", "train", settings, "--data", data, "--out", tmp_path / "2"]
    started = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2"]
    port = str(29_000 + os.getpid() % 1000)
    run = subprocess.run(
        [*started, "--master-port", port, *map(str, command)],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("learned from") == 1
    alone = train(tiny(data, tmp_path / "1", network=network, epochs=2))
    one, two = load_file(alone), load_file(tmp_path / "2" / WEIGHTS)
    for name in one:
        np.testing.assert_allclose(one[name].float(), two[name].float(), atol=2e-3, err_msg=name)
