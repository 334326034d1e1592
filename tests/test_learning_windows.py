"""Windows of a data set: what they see, what they are labelled with, what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from robomirror_drake.dataset.columns import episodes_table, frame_columns, frames_table
from robomirror_drake.dataset.shards import Store, encode, write_shard
from robomirror_drake.dataset.windows import label_windows
from robomirror_drake.exceptions import ResultError
from robomirror_drake.learning.train import predict
from robomirror_drake.learning.windows import load_windows, read_episodes_of
from robomirror_drake.messages import RobotReference
from robomirror_drake.ppn.mirror import Mirror
from robomirror_drake.ppn.model import PPN
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import History, Predictor
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
MIRROR = Mirror(ROBOT)
OPTIONS = PPNOptions(horizon=0.5, history=0.2, rate=20.0, stack=2)
COUNTS = {"train": 3, "test": 2}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, write_executions):
    return write_executions(tmp_path_factory.mktemp("windows") / "data", **COUNTS)


@pytest.fixture(scope="module")
def windows(folder):
    return load_windows(folder, ROBOT, OPTIONS, 0.1)


def inputs(windows, which=None):
    which = np.arange(len(windows)) if which is None else which
    return windows.inputs(which, OPTIONS)


def start_times(windows):
    """When each window begins in its execution [s]."""
    return (windows.now - windows.first) / OPTIONS.rate


def test_labels_are_those_of_the_episodes(folder, windows):
    for number, episode in enumerate(read_episodes_of(folder)):
        own = windows.episode == number
        fall_time = episode.about["fall_time_s"] if episode.about["fell"] else None
        labels = label_windows(episode.track, OPTIONS.horizon, fall_time, until=1.5)
        at = np.round(start_times(windows)[own] * 60).astype(int)
        np.testing.assert_array_equal(at, np.arange(0, len(labels.start), 6))
        np.testing.assert_array_equal(windows.fall[own], labels.fall[at])
        np.testing.assert_allclose(windows.time_to_fall[own], labels.time_to_fall[at])
        np.testing.assert_allclose(
            windows.errors[own], np.log(np.maximum(labels.errors[at], 1e-4)), rtol=1e-5
        )
        if fall_time is not None:
            assert windows.fall[own].any()
            assert float(start_times(windows)[own].max()) < fall_time
    assert sum(row["fell"] for row in windows.episodes) == 2


def test_inputs_have_the_shapes_that_the_options_say(windows):
    state, reference = inputs(windows)
    assert state.shape[:2] == (len(windows), OPTIONS.back)
    assert reference.shape[:2] == (len(windows), OPTIONS.ahead)
    assert torch.isfinite(state).all()
    assert torch.isfinite(reference).all()


def test_the_past_before_the_first_frame_is_the_first_frame(windows):
    first = np.flatnonzero(windows.now == windows.first)
    assert len(first) == 5
    state, _ = inputs(windows, first)
    torch.testing.assert_close(state, state[:, :1].expand_as(state))


@pytest.mark.parametrize("at", [0.4, 0.8])
def test_what_happens_later_is_not_seen(tmp_path, write_executions, windows, at):
    def later(_, arrays):
        after = arrays["time"] > at + 1e-9
        rng = np.random.default_rng(9)
        for name in ("q", "v", "q_raw", "v_raw"):
            arrays[name][after] += rng.normal(size=arrays[name][after].shape)

    changed = load_windows(write_executions(tmp_path, later, **COUNTS), ROBOT, OPTIONS, 0.1)
    before = start_times(windows) <= at + 1e-9
    assert before.any()
    assert not before.all()
    for old, new in zip(inputs(windows), inputs(changed), strict=True):
        assert torch.equal(old[before], new[before])
    assert not torch.equal(inputs(windows)[0][~before], inputs(changed)[0][~before])


def test_of_the_reference_the_horizon_is_seen_and_nothing_beyond(
    tmp_path, write_executions, windows
):
    at = 0.9

    def later(row, _):
        row["raw_q"][round(at * 60) :, 7:] += 0.2

    changed = load_windows(write_executions(tmp_path, later, **COUNTS), ROBOT, OPTIONS, 0.1)
    # The last frame seen is one before the horizon; two more give its acceleration.
    beyond = start_times(windows) + OPTIONS.horizon + 1.0 / OPTIONS.rate < at - 1e-9
    within = start_times(windows) + OPTIONS.horizon - 1.0 / OPTIONS.rate > at + 1e-9
    old, new = inputs(windows)[1], inputs(changed)[1]
    assert beyond.any()
    assert torch.equal(old[beyond], new[beyond])
    different = (old != new).flatten(1).any(1).numpy()
    assert different[within].all()


def test_mirrored_windows_are_those_of_mirrored_executions(tmp_path, write_executions, folder):
    def reflect(row, arrays):
        row["raw_q"] = MIRROR.positions(row["raw_q"])
        for name in ("q", "q_raw"):
            arrays[name] = MIRROR.positions(arrays[name])
        for name in ("v", "v_raw"):
            arrays[name] = MIRROR.rates(arrays[name])

    both = load_windows(folder, ROBOT, OPTIONS, 0.1, mirror=True)
    made = load_windows(write_executions(tmp_path, reflect, **COUNTS), ROBOT, OPTIONS, 0.1)
    own, plain = (both.of(lambda row, w=wanted: row["mirrored"] is w) for wanted in (True, False))
    assert len(own) == len(plain) == len(made)
    for a, b in zip(inputs(both, own), inputs(made), strict=True):
        torch.testing.assert_close(a, b, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(both.errors[own], both.errors[plain], atol=1e-4, rtol=1e-4)
    assert torch.equal(both.fall[own], both.fall[plain])
    assert not torch.allclose(inputs(both, own)[0], inputs(both, plain)[0], atol=1e-2)
    assert both.fingerprint == load_windows(folder, ROBOT, OPTIONS, 0.1).fingerprint
    assert both.fingerprint == load_windows(folder, ROBOT, OPTIONS, 0.3).fingerprint


def test_windows_into_which_a_push_falls_are_left_out(tmp_path, write_executions):
    def push(row, _):
        row["push_time_s"] = 0.5

    pushed = load_windows(write_executions(tmp_path, push, train=2), ROBOT, OPTIONS, 0.1)
    starts = np.unique(np.round(start_times(pushed), 3))
    assert not ((starts < 0.5 - 1e-6) & (starts > 1e-6)).any()
    assert (starts >= 0.5 - 1e-6).any()
    np.testing.assert_array_equal(pushed.pushed, start_times(pushed) >= 0.5 - 1e-6)


def test_a_folder_without_executions_is_refused(tmp_path, folder):
    with pytest.raises(ResultError, match="holds no execution"):
        load_windows(tmp_path, ROBOT, OPTIONS, 0.1)
    # Not even those with a fall: that there is a window must not tell of it.
    with pytest.raises(ResultError, match="holds no execution of 10 s"):
        load_windows(folder, ROBOT, PPNOptions(horizon=10.0, stack=2), 0.1)


def test_commands_that_were_refused_are_passed_over(tmp_path, write_executions):
    write_executions(tmp_path, train=2)
    row = {"episode": 7, "prompt_index": 7, "prompt": "?", "split": "train", "frames": 0}
    empty = {c.name: np.zeros((0, *c.shape)) for c in frame_columns()}
    shard = Store(tmp_path).group(7, 7)
    write_shard(shard, *encode(episodes_table([row]), frames_table(empty, 23)))
    assert len(list(read_episodes_of(tmp_path))) == 2


def test_a_predictor_at_work_sees_what_was_learned_from(folder, windows):
    """From messages it foresees what it is judged by on windows of the same execution."""
    torch.manual_seed(0)
    network = PPN(OPTIONS, windows.states.shape[1], windows.references.shape[1])
    which = np.flatnonzero(windows.episode == 3)
    state, reference = inputs(windows)
    network.fit_scales(state.flatten(0, 1), reference.flatten(0, 1), windows.errors)
    scores = predict(network, windows, which)
    predictor = Predictor(network, ROBOT)
    episode = list(read_episodes_of(folder))[3]
    count = len(episode.raw_q)
    rates = np.zeros((count, 29))
    asked = RobotReference(
        time=np.arange(count) / 60.0, q=episode.raw_q, v=rates, a=rates,
        contact=episode.raw_contact > 0.5, text="", source="", residuals={},
    )  # fmt: skip
    step = round(60 / OPTIONS.rate)
    for number, start in enumerate(start_times(windows)[which]):
        past = np.round(start * 60).astype(int) + step * np.arange(1 - OPTIONS.back, 1)
        rows = np.maximum(past, 0)
        history = History(episode.track.q[rows], episode.track.v[rows])
        told = predictor.predict([asked], float(start), history)
        expected = float(torch.sigmoid(scores.fall[number]))
        assert told.fall_probability[0] == pytest.approx(expected, abs=1e-5)
        assert told.A_p[0] == pytest.approx(float(scores.errors[number, 3].exp()), rel=1e-4)
    assert float(scores.fall.std()) > 0.01


def test_commanded_states_are_what_the_judge_of_whole_motions_sees(folder, windows):
    """They are the reference's, not the robot's; learned from as they are judged from later."""
    options = OPTIONS.model_copy(update={"states": "commanded"})
    which = np.flatnonzero(windows.episode == 3)
    past, future = windows.inputs(which, options)
    for name in ("states", "references"):
        changed = replace(windows, **{name: getattr(windows, name) + 0.1})
        assert torch.equal(changed.inputs(which, options)[0], past) == (name == "states")

    torch.manual_seed(0)
    network = PPN(options, windows.states.shape[1], windows.references.shape[1])
    network.fit_scales(past.flatten(0, 1), future.flatten(0, 1), windows.errors)
    scores = predict(network, windows, which).fall.double()
    episode = list(read_episodes_of(folder))[3]
    q, contact = (
        x[None, :: round(60 / OPTIONS.rate)] for x in (episode.raw_q, episode.raw_contact)
    )
    last = float(start_times(windows)[which][-1])
    told = Predictor(network, ROBOT).foresee(q, contact, ahead=last + 0.01, every=0.1)
    expected = torch.sigmoid(torch.logsumexp(4.0 * scores, 0) / 4.0)
    assert told.fall_probability[0] == pytest.approx(float(expected), abs=1e-5)
    assert float(scores.std()) > 0.01
