"""The compiled rows of the tasks give what the same formulas give in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.messages import Array
from robomirror_drake.optimization.control.dynamics_terms import TaskMotion, control_model
from robomirror_drake.optimization.control.kernels import FORCE_UNIT, contact_generators
from robomirror_drake.optimization.control.qp import WholeBodyOptions, tuning
from robomirror_drake.optimization.control.task_kernels import (
    FLOOR,
    PIVOT_STIFFNESS,
    PIVOTING,
    task_rows,
)
from robomirror_drake.robot import load_robot

MODEL, OPTIONS = control_model(load_robot()), WholeBodyOptions()
GAINS = tuning(MODEL, OPTIONS).gains
MASS, CORNERS, LIMIT = MODEL.mass, MODEL.corners, OPTIONS.swing_feedback


def _motion(rng: np.random.Generator) -> TaskMotion:
    R = Rotation.from_rotvec(rng.normal(size=(4, 3))).as_matrix()
    shapes = (3, 3), (2, 3), (4, 3), (4, 6), (4, 6)
    com, angular, p, v, a = (rng.normal(size=shape) for shape in shapes)
    p[2:, 2] = rng.choice([0.0, 0.2], 2)
    return TaskMotion(com, angular, R, 0.1 * p, v, a)


def _load(rng: np.random.Generator) -> Array:
    whole = rng.choice([0.0, 1.0], (2, 1))
    return rng.uniform(0.1, 1.0, (2, 4)) * np.maximum(whole, rng.random((2, 4)) < 0.4)


def _error(R_ref: Array, R: Array) -> Array:
    return np.asarray(Rotation.from_matrix(R_ref @ R.T).as_rotvec())


def _point(v: Array, a: Array, r: Array) -> tuple[Array, Array]:
    spin = np.cross(v[3:], r)
    bend = np.cross(a[3:], r) + np.cross(v[3:], spin)
    return v + np.r_[spin, 0, 0, 0], a + np.r_[bend, 0, 0, 0]


def _plain_foot(
    J: Array, is_: tuple[Array, ...], ref: tuple[Array, ...], corners: Array, load: Array, at: Array
) -> tuple[Array, Array, Array]:
    (R, p, v, a), (ref_R, ref_p, ref_v, ref_a), on = is_, ref, load > 0.0
    middle = corners[on].mean(axis=0) if on.any() else np.zeros(3)
    r, ref_r, turn = R @ middle, ref_R @ middle, _error(ref_R, R)
    T = J.copy()
    T[:3] += np.cross(J[3:].T, r).T
    (v_r, a_r), (slide_v, slide_a) = _point(v, a, r), _point(ref_v, ref_a, ref_r)
    floor = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) * (ref_p[2] + ref_r[2] < FLOOR)
    pivot = min(1.0, abs(ref_v[5]) / PIVOTING) * PIVOT_STIFFNESS
    slide_a = floor * (slide_a + pivot * np.r_[ref_p + ref_r - p - r, turn])
    slide_v = floor * slide_v
    weight, k, d = GAINS[6 if on.any() else 5]
    if on.any():
        linear = k * (at - p - r) + d * (slide_v - v_r)[:3] + slide_a[:3] - a_r[:3]
    else:
        asked = k * (ref_p - p) + d * (ref_v - v_r)[:3]
        asked *= min(1.0, LIMIT / np.linalg.norm(asked))
        linear = ref_a[:3] - a_r[:3] + asked
    turning_weight, k, d = GAINS[6 if on.all() else 5]
    if on.all():
        tilt = np.array([R[1, 2], -R[0, 2], 0.0])
        turning = k * tilt + d * (slide_v - v_r)[3:] + slide_a[3:] - a_r[3:]
    else:
        turning = ref_a[3:] - a_r[3:] + k * turn + d * (ref_v - v_r)[3:]
    return T, np.r_[linear, turning], np.repeat([weight, turning_weight], 3)


@pytest.mark.parametrize("seed", range(30))
def test_rows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    is_, ref, load, anchor = _motion(rng), _motion(rng), _load(rng), rng.normal(size=(2, 3))
    momentum, J = rng.normal(size=(6, 29)), rng.normal(size=(4, 6, 29))
    T, t, w = task_rows(GAINS, momentum, J, MASS, *is_, *ref, CORNERS, load, anchor, LIMIT)
    weight, k, d = GAINS[[0, 0, 1]].T
    com = ref.com[2] - is_.com[2] + k * (ref.com - is_.com)[0] + d * (ref.com - is_.com)[1]
    spin = (ref.angular - is_.angular)[1] + GAINS[2, 2] * (ref.angular - is_.angular)[0]
    rows, targets = [momentum[:3] / MASS, momentum[3:]], [com, spin]
    weights = [weight, np.full(3, GAINS[2, 0])]
    for frame in range(2):
        weight, k, d = GAINS[3 + frame]
        rate = (ref.v - is_.v)[frame, 3:]
        rows.append(J[frame, 3:])
        turn = _error(ref.R[frame], is_.R[frame])
        targets.append((ref.a - is_.a)[frame, 3:] + k * turn + d * rate)
        weights.append(np.full(3, weight))
    for foot in range(2):
        parts = (tuple(x[2 + foot] for x in motion[2:]) for motion in (is_, ref))
        row, target, weight = _plain_foot(
            J[2 + foot], *parts, CORNERS[foot], load[foot], anchor[foot]
        )
        rows.append(row)
        targets.append(target)
        weights.append(weight)
    np.testing.assert_allclose(T, np.concatenate(rows), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(t, np.concatenate(targets), rtol=1e-10, atol=1e-9)
    np.testing.assert_array_equal(w, np.concatenate(weights))


@pytest.mark.parametrize("seed", range(5))
def test_generators(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, load, mu = _motion(rng).R[2:], _load(rng), 0.4
    W, cap = contact_generators(R, CORNERS, load, mu, 900.0)
    edges = FORCE_UNIT * np.array([[mu, 0, 1], [-mu, 0, 1], [0, mu, 1], [0, -mu, 1]])
    expected = np.zeros((2, 6, 4 * int((load > 0.0).sum())))
    for number, (foot, corner) in enumerate(np.argwhere(load > 0.0)):
        columns = slice(4 * number, 4 * number + 4)
        expected[foot, :3, columns] = edges.T
        expected[foot, 3:, columns] = np.cross(R[foot] @ CORNERS[foot, corner], edges).T
    np.testing.assert_allclose(W, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(cap, np.repeat(load[load > 0.0], 4) * 900.0 / FORCE_UNIT)
