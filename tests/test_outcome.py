"""The definition of a fall, and the errors against values worked out by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from robomirror_drake.outcome import (
    errors_to_raw,
    evaluate,
    find_fall,
    friction_margin,
    lean_angle,
    rotation_angle,
    tracking_errors,
    until_fall,
)

LIMIT = np.full(23, 200.0)
KNEE = np.eye(30)[10]


def about(axis: str, degrees: float) -> np.ndarray:
    quaternion = np.zeros(4)
    quaternion[0] = np.cos(np.deg2rad(degrees) / 2)
    quaternion["_xyz".index(axis)] = np.sin(np.deg2rad(degrees) / 2)
    return quaternion


def with_base(execution, start, orientation=None, height=None):
    q = execution.q.copy()
    if orientation is not None:
        q[start:, :4] = orientation
    if height is not None:
        q[start:, 6] = height
    return q


def test_perfect_execution_has_no_error(make_execution):
    outcome = evaluate(make_execution(), LIMIT, 0.6)
    assert not outcome.fell
    assert outcome.fall_time_s is None
    assert outcome.fall_cause is None
    errors = (outcome.A_q, outcome.A_qd, outcome.A_qdd, outcome.A_p, outcome.A_theta)
    assert errors == (0, 0, 0, 0, 0)
    assert outcome.torque_saturation == 0
    assert outcome.energy_j == 0
    assert outcome.friction_margin == 0.6
    assert outcome.duration_s == pytest.approx(1.0)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 0.1, 30.0, 90.0, 179.0])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_rotation_angle(axis, degrees):
    a, b = about(axis, 20.0), about(axis, 20.0 + degrees)
    expected = np.deg2rad(degrees)
    assert rotation_angle(a, b) == pytest.approx(expected, rel=1e-6, abs=1e-15)
    assert rotation_angle(a, -3.0 * b) == pytest.approx(expected, rel=1e-6, abs=1e-15)


def test_lean_ignores_heading():
    assert lean_angle(about("z", 170.0), about("z", 0.0)) == pytest.approx(0.0, abs=1e-12)
    assert lean_angle(about("x", 59.0), about("z", 40.0)) == pytest.approx(np.deg2rad(59.0))
    assert lean_angle(about("y", -61.0), about("z", 0.0)) == pytest.approx(np.deg2rad(61.0))


@pytest.mark.parametrize(("degrees", "falls"), [(59.9, False), (60.1, True)])
def test_fall_by_tilt(make_execution, degrees, falls):
    standing = make_execution()
    fall = find_fall(make_execution(q=with_base(standing, 30, about("y", degrees))))
    assert (fall is not None) == falls
    if fall:
        assert fall == (30, 0.5, "tilt")


def test_lean_of_the_reference_is_no_fall(make_execution):
    bowed = with_base(make_execution(), 0, about("y", 80.0))
    assert find_fall(make_execution(q=bowed, q_ref=bowed)) is None


@pytest.mark.parametrize(("height", "falls"), [(0.501, False), (0.499, True), (1.4, False)])
def test_fall_by_height(make_execution, height, falls):
    fall = find_fall(make_execution(q=with_base(make_execution(), 12, height=height)))
    assert (fall is not None) == falls
    if fall:
        assert fall == (12, 0.2, "height")


@pytest.mark.parametrize(("force", "falls"), [(0.9, False), (1.1, True)])
def test_fall_by_contact(make_execution, force, falls):
    other = np.zeros(61)
    other[18] = force
    fall = find_fall(make_execution(other_force=other))
    assert (fall is not None) == falls
    if fall:
        assert fall == (18, 0.3, "contact")


def test_first_condition_decides(make_execution):
    other = np.zeros(61)
    other[40:] = 100.0
    execution = make_execution(other_force=other, q=with_base(make_execution(), 30, height=0.1))
    assert find_fall(execution) == (30, 0.5, "height")


def test_errors_by_hand(make_execution):
    n = 61
    q, v = make_execution().q.copy(), np.zeros((n, 29))
    q[:, 7] = 0.23  # one joint of 23 is 0.23 rad off: 0.01 on average
    q[:, 4:6] += [0.03, -0.04]
    q[:, :4] = about("z", 10.0)
    v[:, 6] = np.where(np.arange(n) % 2, 2.3, -2.3)
    outcome = evaluate(make_execution(q=q, v=v), LIMIT, 0.6)
    assert outcome.A_q == pytest.approx(0.01)
    assert outcome.A_qd == pytest.approx(0.1)
    assert outcome.A_qdd == pytest.approx(4.6 * 60.0 / 23)
    assert outcome.A_p == pytest.approx(0.05)
    assert outcome.A_theta == pytest.approx(np.deg2rad(10.0))


def test_errors_stop_at_the_fall(make_execution):
    q = with_base(make_execution(), 30, height=0.1)
    q[30:, 7:] = 1.0
    errors = tracking_errors(make_execution(q=q))
    outcome = evaluate(make_execution(q=q), LIMIT, 0.6)
    assert outcome.fall_time_s == 0.5
    assert outcome.A_q == pytest.approx(1.0 / 31)
    assert outcome.A_q < errors.q.mean()
    assert outcome.duration_s == pytest.approx(1.0)


def test_fall_at_the_very_start_has_finite_errors(make_execution):
    outcome = evaluate(make_execution(q=with_base(make_execution(), 0, height=0.1)), LIMIT, 0.6)
    assert outcome.fall_time_s == 0.0
    assert outcome.A_p == pytest.approx(0.7)
    assert outcome.A_qdd == 0.0


def test_torque_saturation_and_energy(make_execution):
    torque, v = np.zeros((61, 23)), np.zeros((61, 29))
    torque[:, 3], v[:, 9] = 200.0, 0.5  # 100 W for one second
    torque[:, 4], v[:, 10] = -50.0, 0.5  # braking takes nothing off
    outcome = evaluate(make_execution(torque=torque, v=v), LIMIT, 0.6)
    assert outcome.torque_saturation == pytest.approx(1 / 23)
    assert outcome.energy_j == pytest.approx(100.0)


def test_friction_margin_counts_loaded_feet_only():
    force = np.array([[[30.0, 40.0, 100.0], [20.0, 0.0, 10.0]]])
    assert friction_margin(force, 0.6) == pytest.approx(0.1)
    assert friction_margin(np.zeros((5, 2, 3)), 0.6) == 0.6


def test_one_sample_is_refused(make_execution):
    with pytest.raises(ValueError, match="2 samples"):
        evaluate(make_execution(1), LIMIT, 0.6)


def test_until_fall_ends_with_the_fall(make_execution) -> None:
    force = np.zeros(61)
    force[30:] = 50.0
    execution = make_execution(other_force=force)
    cut = until_fall(execution)
    assert len(cut.time) == len(cut.q) == len(cut.contact_ref) == 31
    assert find_fall(cut) == find_fall(execution)
    whole = make_execution()
    assert until_fall(whole) is whole


def test_errors_to_the_raw_reference_heed_the_lead(make_execution, reference) -> None:
    ramp = np.linspace(0.0, 1.0, 121)[:, None] * KNEE
    raw = dataclasses.replace(reference, q=reference.q + ramp)
    q = make_execution(91).q.copy()
    q[30:] += ramp[:61]
    execution = make_execution(91, q=q)  # it begins half a second later
    assert errors_to_raw(execution, raw, 0.5) == pytest.approx((0.0, 0.0), abs=1e-12)
    joints, root = errors_to_raw(execution, raw, 0.0)
    assert joints > 0.1 / 23
    assert root == 0.0
    assert errors_to_raw(execution, raw, 5.0) is None
