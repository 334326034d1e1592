"""The compiled parts of a control tick give what the same formulas give in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.optimization.centroidal import GRAVITY
from robomirror_drake.optimization.control.dynamics_terms import TaskMotion
from robomirror_drake.optimization.control.preview import Preview, steered
from robomirror_drake.optimization.control.reference_trajectory import (
    LEAST_SHARE,
    ReferenceSample,
    ReferenceTrajectory,
    sample_reference,
)
from robomirror_drake.optimization.control.stance import (
    DESCENT,
    EARLY,
    FARTHEST,
    FELT,
    HANGING,
    LOST,
    SHIFT_TIME,
    TOUCHING,
    Stance,
    moved,
    shifted,
    update_stance,
)
from robomirror_drake.optimization.control.step_adjustment import StepOptions, adjusted_steps

PERIOD, RAMP = 0.004, 0.03
CORNERS = np.array([[[0.13, 0.04, 0], [0.13, -0.04, 0], [-0.06, -0.04, 0], [-0.06, 0.04, 0]]] * 2)
SEEDS = range(40)


def _motion(rng: np.random.Generator) -> TaskMotion:
    """Feet within 2 cm of the floor, some of them on it."""
    p = rng.normal(size=(4, 3))
    p[2:, 2] = rng.choice([0.0, 0.0015, 0.008, 0.02], 2)
    R = np.linalg.qr(np.eye(3) + 0.01 * rng.normal(size=(4, 3, 3)))[0]
    R *= np.sign(np.einsum("kii->ki", R))[:, None]
    com = rng.normal(size=(3, 3)) * 0.2 + [0.0, 0.0, 0.8]
    return TaskMotion(com, *(rng.normal(size=s) for s in ((2, 3),)), R, p, *_spins(rng))


def _spins(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.normal(size=(4, 6)), rng.normal(size=(4, 6))


def _sample(rng: np.random.Generator) -> ReferenceSample:
    nowhere = np.zeros(30), np.zeros(29), np.zeros(29), np.zeros((2, 6))
    load = rng.uniform(0.1, 1.0, (2, 4)) * (rng.random((2, 1)) < 0.6) * (rng.random((2, 4)) < 0.8)
    wait = rng.choice([-0.2, 0.04, 0.08, 0.3, np.inf], (2, 1)) + 0.01 * rng.random((2, 4))
    return ReferenceSample(*nowhere, load, wait, rng.choice([-0.5, -0.05, 0.2], (2, 4)))


def _stance(rng: np.random.Generator) -> Stance:
    load = rng.random((2, 4)) * (rng.random((2, 4)) < 0.7)
    touching = rng.choice([0.0, 0.012, 0.5], 2)
    late = rng.integers(0, 2, 2) * 1.0
    steps = 0.1 * rng.normal(size=(2, 2))
    return Stance(load, rng.normal(size=(2, 3)), rng.normal(size=3), touching, late, steps)


def _force(rng: np.random.Generator) -> np.ndarray:
    measured = rng.choice([0.0, LOST + 1.0, FELT + 1.0, 300.0], (2, 3))
    return measured if rng.random() < 0.8 else np.full((2, 3), np.nan)


def _plain_stance(
    last: Stance, motion: TaskMotion, wanted: TaskMotion, sample: ReferenceSample, force: np.ndarray
) -> Stance:
    world = motion.p[2:, None] + CORNERS @ motion.R[2:].transpose(0, 2, 1)
    height = world[..., 2]
    low, was = height.min(axis=1) < TOUCHING, last.touching > 0.0
    felt = (force[:, 2] > np.where(was, LOST, FELT)) | (low & was)
    on = np.where(np.isnan(force[:, 2]), low, felt)
    touching = np.where(on, last.touching + PERIOD, 0.0)
    above = height - height.min(axis=1, keepdims=True)
    near = np.clip((HANGING - above) / (HANGING - TOUCHING), 0.0, 1.0)
    soon = (sample.wait > 0.0) & (sample.wait < np.minimum(EARLY, -sample.left))
    planned = np.where((sample.load == 0.0).all(axis=1, keepdims=True) & soon, 1.0, sample.load)
    scheduled = planned.any(axis=1)
    if (scheduled & ~on).any() and not (scheduled & on).any():
        planned = np.where(on[:, None], 1.0, planned)
    load = planned * near * np.minimum(touching / RAMP, 1.0)[:, None]
    anchor, offset = last.anchor.copy(), last.offset.copy()
    for foot, loaded in enumerate(load > 0.0):
        if loaded.any() and (loaded != (last.load[foot] > 0.0)).any():
            anchor[foot, :2] = world[foot, loaded, :2].mean(axis=0)
    share = load.mean(axis=1)
    if share.sum() > 0.0:
        apart = share @ (motion.p[2:, :2] - wanted.p[2:, :2]) / share.sum()
        offset[:2] += min(1.0, PERIOD / SHIFT_TIME) * (apart - offset[:2])
        offset[2] = 0.0
    elif not on.any():
        offset = motion.com[0] - wanted.com[0]
    late = 1.0 * ((sample.load > 0.0).any(axis=1) & ~on)
    return Stance(load, anchor, offset.clip(-FARTHEST, FARTHEST), touching, late, last.steps)


def _same(found: tuple[object, ...], expected: tuple[object, ...]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)


def test_stance() -> None:
    landed = flights = changes = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        parts = _stance(rng), _motion(rng), _motion(rng), _sample(rng), _force(rng)
        last, force = parts[0], parts[4]
        expected = _plain_stance(*parts)
        _same(update_stance(*parts[:4], CORNERS, PERIOD, RAMP, force), expected)
        landed += int(expected.load.any())
        flights += int(not expected.touching.any())
        changes += int((expected.anchor != last.anchor).any())
    assert min(landed, flights, changes) > 2, "the cases that matter did not occur"


@pytest.mark.parametrize("seed", SEEDS)
def test_feet_are_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stance, motion, reference = _stance(rng), _motion(rng), _motion(rng)
    p, v, a = reference.p + stance.offset, reference.v.copy(), reference.a.copy()
    p[2:, :2] += stance.steps
    for foot in np.flatnonzero(stance.late) + 2:
        p[foot, 2] = motion.p[foot, 2]
        v[foot, 2] = min(motion.com[1, 2], 0.0) - DESCENT
        a[foot, 2] = 0.0
    com = reference.com.copy()
    com[0] += stance.offset
    expected = reference._replace(com=com, p=p, v=v, a=a)
    found = shifted(moved(reference, stance.offset), motion, stance.late, stance.steps)
    _same(found, expected)


def _plain_steps(
    last: np.ndarray,
    load: np.ndarray,
    motion: TaskMotion,
    reference: TaskMotion,
    sample: ReferenceSample,
    options: StepOptions,
) -> np.ndarray:
    def omega(height: float) -> float:
        return float(np.sqrt(GRAVITY / max(height, 0.1)))

    def xi(of: TaskMotion) -> np.ndarray:
        return np.asarray(of.com[0, :2] + of.com[1, :2] / omega(of.com[0, 2]))

    steps, on, error = last.copy(), load.any(axis=1), xi(motion) - xi(reference)
    for foot in range(2):
        remaining = sample.wait[foot].min()
        planned, support = reference.p[2 + foot, :2], motion.p[3 - foot, :2]
        if on[foot]:
            steps[foot] = motion.p[2 + foot, :2] - planned
        elif on[1 - foot] and options.last < remaining < np.inf:
            size, shift = np.linalg.norm(error), np.zeros(2)
            if size > options.room:
                grown = (size - options.room) * np.exp(omega(motion.com[0, 2]) * remaining)
                shift = error * min(grown, options.longest) / size
            left = motion.R[3 - foot][:2, 1] / np.linalg.norm(motion.R[3 - foot][:2, 1])
            outwards = left * (1.0 if foot == 0 else -1.0)
            least = min(options.least_width, outwards @ (planned - support))
            lacking = least - outwards @ (planned + shift - support)
            change = shift + max(lacking, 0.0) * outwards - steps[foot]
            fastest = options.speed * PERIOD / max(np.linalg.norm(change), 1e-9)
            steps[foot] += change * min(1.0, fastest)
    return steps


def test_steps() -> None:
    stepped = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        motion, reference, sample = _motion(rng), _motion(rng), _sample(rng)
        load = rng.random((2, 4)) * (rng.random((2, 1)) < 0.5)
        last, options = 0.1 * rng.normal(size=(2, 2)), StepOptions()
        parts = last, load, motion, reference, sample
        expected = _plain_steps(*parts, options)
        found = adjusted_steps(*parts, options.limits(), PERIOD)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
        stepped += int((expected != last)[~load.any(axis=1)].any())
    assert stepped > 2, "the case that matters did not occur"


@pytest.mark.parametrize("seed", range(5))
def test_preview(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted, actual, time = _motion(rng), _motion(rng), np.sort(rng.random(7))
    preview = Preview(time, rng.normal(size=(7, 6, 9)), rng.normal(size=(7, 3)), 60.0)
    for now in (-1.0, time[0], time[3], 0.5 * (time[4] + time[5]), 2.0):
        row = max(int(np.searchsorted(time, now, side="right")) - 1, 0)
        away = actual.com[:2] - wanted.com[:2]
        u = -preview.gain[row] @ np.r_[away[0], away[1], actual.angular[0] - wanted.angular[0]]
        com = np.stack([*actual.com[:2], wanted.com[2] + u[3:] / 60.0])
        rate = wanted.angular[1] + u[:3] + np.cross(preview.force[row], away[0])
        angular = np.stack([actual.angular[0], rate])
        _same(steered(preview, now, wanted, actual), wanted._replace(com=com, angular=angular))


@pytest.mark.parametrize("seed", range(5))
def test_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sizes = (30,), (30,), (29,), (29,), (2, 6), (2, 4), (2, 4)
    q, qdot, v, a, force, on, off = (rng.normal(size=(6, *size)) for size in sizes)
    time, contact = np.cumsum(0.01 + rng.random(6)), rng.random((6, 2, 4)) < 0.7
    trajectory = ReferenceTrajectory(time, q, qdot, v, a, force, on, off, contact, True)
    for now in (time[0] - 1.0, time[0], time[2], 0.3 * time[3] + 0.7 * time[4], time[5] + 1.0):
        at = min(max(now, time[0]), time[5])
        right = min(max(int(np.searchsorted(time, at, side="right")), 1), 5)
        k, h = right - 1, time[right] - time[right - 1]
        s, moving = (at - time[k]) / h, time[0] <= now < time[5]
        blend = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * h
        blend += s * s * (3 - 2 * s), s * s * (s - 1) * h

        def hermite(x: np.ndarray, rate: np.ndarray) -> np.ndarray:
            parts = x[k], rate[k], x[k + 1], rate[k + 1]  # noqa: B023 - used at once
            return np.asarray(sum(w * part for w, part in zip(blend, parts, strict=True)))  # noqa: B023

        position = hermite(q, qdot)
        position[3:7] /= np.linalg.norm(position[3:7])
        row = right if at >= time[right] else k
        ramped = np.minimum(now - on[row], off[row] - now) / RAMP
        expected = ReferenceSample(
            position,
            moving * hermite(v, a),
            moving * ((1 - s) * a[k] + s * a[right]),
            (1 - s) * force[k] + s * force[right],
            np.where(contact[row], ramped.clip(LEAST_SHARE, 1.0), 0.0),
            on[row] - now,
            off[row] - now,
        )
        _same(sample_reference(trajectory, now, RAMP), expected)
