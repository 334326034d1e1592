"""What the network sees does not change with place and heading, and has true gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import PAD, reference_frames, seen, state_frames
from robomirror_drake.ppn.model import PPN, Scores
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
BODY = Body.of(ROBOT)
STEP = 0.05
OPTIONS = PPNOptions(horizon=0.4, history=0.2, stack=2, width=16, heads=2, dropout=0.0)


def motion(rng: np.random.Generator, samples: int) -> np.ndarray:
    """(samples, 30) a smooth motion that leans and steps."""
    time = STEP * np.arange(samples)[:, None]
    q = np.tile(ROBOT.standing, (samples, 1))
    q[:, 4:] += 0.2 * np.sin(2.0 * time + rng.uniform(0.0, 6.0, size=(1, 26)))
    lean = 0.3 * np.sin(time + rng.uniform(0.0, 6.0, size=(1, 3)))
    q[:, :4] = Rotation.from_rotvec(lean).as_quat(scalar_first=True)
    return q


@pytest.fixture(scope="module")
def window() -> tuple[torch.Tensor, ...]:
    """States q (S, 30), v (S, 29), and of the reference q (T + 2 PAD, 30), contacts."""
    rng = np.random.default_rng(1)
    contact = rng.random((OPTIONS.ahead, 2, 4)) < 0.7
    return tuple(
        torch.tensor(x, dtype=torch.float64)
        for x in (
            motion(rng, OPTIONS.back),
            rng.normal(size=(OPTIONS.back, 29)),
            motion(rng, OPTIONS.ahead + 2 * PAD),
            contact,
        )
    )


def features(q, v, asked, contact, from_state=True):
    states = state_frames(BODY, q, v).flat()[None]
    references = reference_frames(BODY, asked, contact, STEP).flat()[None]
    return seen(states, references, from_state)


def moved(q: torch.Tensor, turn: Rotation, shift: np.ndarray) -> torch.Tensor:
    base = (turn * Rotation.from_quat(q[:, :4], scalar_first=True)).as_quat(scalar_first=True)
    place = turn.apply(q[:, 4:7]) + shift
    return torch.cat([torch.tensor(base), torch.tensor(place), q[:, 7:]], 1)


def turned(v: torch.Tensor, turn: Rotation) -> torch.Tensor:
    return torch.cat([torch.tensor(turn.apply(x)) for x in (v[:, :3], v[:, 3:6])] + [v[:, 6:]], 1)


@pytest.mark.parametrize("from_state", [True, False])
def test_place_and_heading_do_not_matter(window, from_state):
    q, v, asked, contact = window
    turn, shift = Rotation.from_euler("z", 2.1), np.array([3.0, -7.0, 0.0])
    same = features(
        moved(q, turn, shift), turned(v, turn), moved(asked, turn, shift), contact, from_state
    )
    for a, b in zip(features(*window, from_state), same, strict=True):
        torch.testing.assert_close(a, b, atol=1e-10, rtol=0.0)


def test_tilt_height_and_the_way_between_do(window):
    q, v, asked, contact = window
    tilt, none = Rotation.from_euler("x", 0.1), np.zeros(3)
    up, away = np.array([0.0, 0.0, 0.05]), np.array([0.1, 0.0, 0.0])
    here = Rotation.identity()
    for changed in (
        (moved(q, tilt, none), turned(v, tilt), moved(asked, tilt, none), contact),
        (moved(q, here, up), v, moved(asked, here, up), contact),
        (q, v, moved(asked, here, away), contact),
    ):
        old, new = (torch.cat([x.flatten() for x in features(*f)]) for f in (window, changed))
        assert float((old - new).abs().max()) > 0.01


def network() -> PPN:
    torch.manual_seed(0)
    made = PPN(OPTIONS, 78, 103).double().eval()
    rng = torch.Generator().manual_seed(0)
    some = [torch.randn(50, n, generator=rng, dtype=torch.float64) for n in (78, 103, 5)]
    made.fit_scales(*some)
    return made


def test_gradients_of_all_scores_are_those_of_finite_differences(window):
    q, v, asked, contact = window
    net = network()

    def scores(state_q: torch.Tensor, reference_q: torch.Tensor) -> torch.Tensor:
        found: Scores = net(*features(state_q, v, reference_q, contact))
        return torch.cat([found.fall, found.errors[0]])

    inputs = (q.clone().requires_grad_(), asked.clone().requires_grad_())
    rng = torch.Generator().manual_seed(3)
    ways = [torch.randn(x.shape, generator=rng, dtype=torch.float64) for x in inputs]
    small = 1e-6
    with torch.no_grad():
        ends = [scores(*(x + s * small * w for x, w in zip(inputs, ways, strict=True)))
                for s in (-1.0, 1.0)]  # fmt: skip
    measured = (ends[1] - ends[0]) / (2.0 * small)
    for number, score in enumerate(scores(*inputs)):
        gradients = torch.autograd.grad(score, inputs, retain_graph=True)
        told = sum((g * w).sum() for g, w in zip(gradients, ways, strict=True))
        assert float(told) == pytest.approx(float(measured[number]), rel=1e-5, abs=1e-9)
        assert all(float(g.abs().max()) > 0.0 for g in gradients)


@pytest.mark.parametrize("changes", [
    {"use_reference": False}, {"use_state": False}, {"use_cross_attention": False},
])  # fmt: skip
def test_ablations_do_without(window, changes):
    torch.manual_seed(0)
    net = PPN(OPTIONS.model_copy(update=changes), 78, 103).double().eval()
    state, reference = features(*window)
    before = net(state, reference)
    assert before.errors.shape == (1, 5)
    other_state, other_reference = net(state + 1.0, reference), net(state, reference + 1.0)
    assert torch.equal(before.fall, other_state.fall) == (changes == {"use_state": False})
    assert torch.equal(before.fall, other_reference.fall) == (changes == {"use_reference": False})


def test_a_batch_gives_what_single_windows_give(window):
    net = network()
    state, reference = features(*window)
    more = torch.cat([reference, reference + 0.3, reference - 0.2])
    together = net(state.expand(3, -1, -1), more)
    for number in range(3):
        alone = net(state, more[number : number + 1])
        torch.testing.assert_close(together.fall[number], alone.fall[0])
        torch.testing.assert_close(together.errors[number], alone.errors[0])
    torch.testing.assert_close(net(state, more).fall, together.fall)
