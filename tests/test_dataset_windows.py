"""Labels of windows, and the commanded motion in the time of its execution."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from robomirror_drake.dataset.alignment import commanded
from robomirror_drake.dataset.windows import ERRORS, Track, label_windows
from robomirror_drake.messages import Execution
from robomirror_drake.outcome import evaluate

RATE = 60.0


def track_of(execution: Execution) -> Track:
    return Track(execution.time, execution.q, execution.v, execution.q_ref, execution.v_ref)


def part_of(execution: Execution, start: int, end: int) -> Execution:
    values = {f.name: getattr(execution, f.name) for f in dataclasses.fields(execution)}
    arrays = {n: v[start:end] for n, v in values.items() if isinstance(v, np.ndarray)}
    return Execution(**(values | arrays))


@pytest.mark.parametrize("horizon", [1.0, 0.5, 1 / 60])
def test_errors_are_those_of_the_outcome_of_the_frames_ahead(noisy_execution, horizon):
    labels = label_windows(track_of(noisy_execution), horizon)
    ahead = round(horizon * RATE)
    assert len(labels.start) == len(noisy_execution.time) - ahead
    for start in (0, 7, len(labels.start) - 1):
        assert (labels.start[start], labels.end[start]) == (start, start + ahead)
        after = evaluate(
            part_of(noisy_execution, start + 1, start + ahead + 1)
            if ahead > 1
            else part_of(noisy_execution, start, start + 2),
            np.full(23, 100.0),
            0.6,
        )
        both = evaluate(part_of(noisy_execution, start, start + ahead + 1), np.ones(23), 0.6)
        expected = [getattr(after, name) for name in ERRORS]
        expected[2] = both.A_qdd  # differences of frames, the first one's from the frame before
        if ahead > 1:
            np.testing.assert_allclose(labels.errors[start], expected, rtol=1e-9)
        else:
            assert labels.errors[start, 2] == pytest.approx(both.A_qdd)
    assert not labels.fall.any()
    assert np.isinf(labels.time_to_fall).all()


def test_a_fall_ends_windows_and_is_seen_from_one_horizon_before(noisy_execution):
    fallen = 90
    labels = label_windows(track_of(noisy_execution), 1.0, fall_time=fallen / RATE)
    np.testing.assert_array_equal(labels.start, np.arange(fallen))
    np.testing.assert_array_equal(labels.fall, labels.start + 60 >= fallen)
    np.testing.assert_array_equal(labels.end, np.minimum(labels.start + 60, fallen))
    np.testing.assert_allclose(labels.time_to_fall, (fallen - labels.start) / RATE)
    root = np.linalg.norm(noisy_execution.q[:, 4:7] - noisy_execution.q_ref[:, 4:7], axis=1)
    assert labels.errors[80, 3] == pytest.approx(root[81:91].mean())
    # What comes after the fall changes nothing.
    q = noisy_execution.q.copy()
    q[fallen + 1 :] += 100.0
    changed = track_of(noisy_execution)._replace(q=q)
    np.testing.assert_array_equal(
        label_windows(changed, 1.0, fall_time=fallen / RATE).errors, labels.errors
    )


@pytest.mark.parametrize("fall_time", [None, 1.5])
def test_what_an_execution_would_not_have_lasted_for_has_no_label(noisy_execution, fall_time):
    labels = label_windows(track_of(noisy_execution), 1.0, fall_time=fall_time, until=1.75)
    np.testing.assert_array_equal(labels.start, np.arange(46))
    long = label_windows(track_of(noisy_execution), 1.0, fall_time=fall_time, until=99.0)
    np.testing.assert_array_equal(labels.errors, long.errors[:46])


def test_pushes_make_windows_unforeseeable(noisy_execution):
    labels = label_windows(track_of(noisy_execution), 0.5, pushes=[1.0])
    np.testing.assert_array_equal(labels.foreseeable, (labels.start >= 60) | (labels.end < 60))


def test_too_short_an_episode_has_no_windows(noisy_execution):
    short = track_of(part_of(noisy_execution, 0, 40))
    labels = label_windows(short, 1.0)
    assert labels.errors.shape == (0, 5)
    assert len(label_windows(short, 1.0, fall_time=20 / RATE).start) == 20
    assert len(label_windows(short, 1.0, fall_time=0.0).start) == 0


def test_single_precision_gives_the_same_labels(noisy_execution):
    double = track_of(noisy_execution)
    single = Track(*(part.astype(np.float32) for part in double))
    for a, b in zip(label_windows(double, 1.0), label_windows(single, 1.0), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4)


def test_the_commanded_motion_is_held_in_added_time(reference):
    rng = np.random.default_rng(0)
    q = reference.q + 0.1 * rng.standard_normal(reference.q.shape)
    v = rng.standard_normal(reference.v.shape)
    contact = rng.random(reference.contact.shape) > 0.5
    raw = dataclasses.replace(reference, q=q, v=v, contact=contact, planned=False, residuals={})
    lead = 48
    time = np.arange(len(raw.time) + 2 * lead) / RATE
    longer = np.zeros((len(time), 30))
    longer[:, 0] = 1.0
    plan = dataclasses.replace(
        raw, time=time, q=longer, v=longer[:, 1:], a=longer[:, 1:], lead=lead / RATE,
        contact=np.ones((len(time), 2, 4), np.bool_), foot_force=None, planned=True, residuals={},
    )  # fmt: skip
    said = commanded(raw, plan, np.arange(len(time) + 30) / RATE)
    own = slice(lead, lead + len(raw.time))
    np.testing.assert_array_equal(said.q[own], q)
    np.testing.assert_array_equal(said.v[own], v)
    np.testing.assert_array_equal(said.contact[own], contact)
    for held, frame in ((slice(0, lead), 0), (slice(lead + len(raw.time), None), -1)):
        np.testing.assert_array_equal(said.q[held], np.broadcast_to(q[frame], said.q[held].shape))
        assert not said.v[held].any()
    slow = dataclasses.replace(
        plan, residuals={"time_scale": 0.8}, time=plan.time / 0.8, lead=lead / RATE / 0.8
    )
    slowed = commanded(raw, slow, slow.time)
    np.testing.assert_array_equal(slowed.q, said.q[: len(time)])
    np.testing.assert_allclose(slowed.v, 0.8 * said.v[: len(time)])
    with pytest.raises(ValueError, match="does not fit"):
        commanded(plan, dataclasses.replace(raw, lead=0.5), time)
