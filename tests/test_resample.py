"""Resampling is C²-smooth and keeps the path."""

from __future__ import annotations

import numpy as np
import pytest

from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.resample import resample, time_scale


def wave(fps: float, seconds: float = 2.0) -> HumanMotion:
    t = np.arange(round(seconds * fps) + 1)[:, None, None] / fps
    phase = np.linspace(0.0, 3.0, 66).reshape(1, 22, 3)
    return HumanMotion(np.sin(4.0 * t + phase), fps, text="sways", style={"tempo": 1.0})


def test_between_the_frames_is_the_curve() -> None:
    fine = resample(wave(30.0), 240.0)
    assert np.abs(fine.positions - wave(240.0).positions).max() < 1e-4
    assert (fine.text, dict(fine.style)) == ("sways", {"tempo": 1.0})


def test_frames_are_kept_at_the_same_rate() -> None:
    clip = load_clip("kick")
    np.testing.assert_allclose(resample(clip, clip.fps).positions, clip.positions, atol=1e-12)
    again = resample(resample(clip, clip.fps * 4), clip.fps)
    np.testing.assert_allclose(again.positions, clip.positions, atol=1e-12)


def test_second_derivative_is_continuous() -> None:
    """Linear interpolation has acceleration spikes at the old frames; a C² curve has none:
    halving the step halves the jump of the acceleration, where a spike would double."""

    def largest_jump(fps: float) -> float:
        positions = resample(load_clip("walk"), fps).positions
        return float(np.abs(np.diff(positions, 3, axis=0)).max() * fps**2)

    assert largest_jump(1920.0) < 0.6 * largest_jump(960.0)


@pytest.mark.parametrize("fps", [20.0, 24.0, 50.0, 60.0, 1000.0])
def test_covers_the_duration(fps: float) -> None:
    clip = load_clip("dance_b")
    new = resample(clip, fps)
    assert new.fps == fps
    assert 0.0 <= clip.duration - new.duration + 1e-9 < 1.0 / fps + 1e-6


def test_time_scale_slows_the_same_path() -> None:
    clip = load_clip("punch")
    slow = time_scale(clip, 2.0)
    assert slow.fps == clip.fps
    assert slow.duration == pytest.approx(2.0 * clip.duration)
    np.testing.assert_allclose(slow.positions[::2], clip.positions, atol=1e-12)
    back = time_scale(slow, 0.5)
    np.testing.assert_allclose(back.positions, clip.positions, atol=1e-12)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_nonsense_is_refused(bad: float) -> None:
    clip = load_clip("walk")
    with pytest.raises(ValueError, match="positive"):
        resample(clip, bad)
    with pytest.raises(ValueError, match="positive"):
        time_scale(clip, bad)
