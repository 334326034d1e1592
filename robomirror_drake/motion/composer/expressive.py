"""Expressive actions: gestures of the arms and the trunk over standing feet."""

from __future__ import annotations

import numpy as np

from robomirror_drake.motion.composer.cue import Cue, hands
from robomirror_drake.motion.composer.score import Score

RAISE, LOWER = 0.9, 1.0
"""Time to bring an arm up, and down again [s]."""


def _arms(score: Score, sides: tuple[str, ...], angles: dict[str, float], start: float, end: float
          ) -> None:  # fmt: skip
    for side in sides:
        for angle, delta in angles.items():
            score.move(f"{side}_{angle}", delta, start, end)


def _back(angles: dict[str, float]) -> dict[str, float]:
    return {angle: -delta for angle, delta in angles.items()}


def _hold(cue: Cue, default: float) -> float:
    """How long a gesture stays: as long as what it goes with, less the way up and down [s]."""
    if cue.duration is None:
        return default / cue.tempo
    return max(cue.duration - RAISE - LOWER, 0.2)


def _repetitions(cue: Cue, default: int, period: float) -> int:
    if cue.count is not None or cue.duration is None:
        return cue.count or default
    return max(1, int(_hold(cue, 0.0) / period))


def wave(score: Score, cue: Cue) -> None:
    """Hand up beside the head, the forearm swinging to and fro, 3 times."""
    up = score.now + RAISE
    sides = hands(cue)
    raised = {"abduction": 1.20, "rotation": 1.35, "elbow": 1.25}
    _arms(score, sides, raised, score.now, up)
    beat = 0.30 / cue.tempo
    swing = 0.38 * min(cue.amplitude, 1.4)
    t = up
    for i in range(_repetitions(cue, 3, 2.0 * beat)):
        out = {"elbow": -swing * (1.0 if i == 0 else 2.0)}
        _arms(score, sides, out, t, t + beat)
        _arms(score, sides, {"elbow": 2.0 * swing}, t + beat, t + 2.0 * beat)
        t += 2.0 * beat
    _arms(score, sides, {"elbow": -swing}, t, t + beat)
    _arms(score, sides, _back(raised), t + 0.5 * beat, t + 0.5 * beat + LOWER)
    if cue.duration is None:  # the trunk leans a little away from a single raised arm
        lean = {"left": 1.0, "right": -1.0}.get(cue.side, 0.0) * 0.06
        score.pulse("chest_roll", lean, score.now, up, t + 0.5 * beat + LOWER)
    score.now = t + 0.5 * beat + LOWER


def bow(score: Score, cue: Cue) -> None:
    """Bend forward from hips and spine by about 45°, more when deep, and rise."""
    angle = np.deg2rad(min(45.0 * cue.amplitude, 80.0))
    for _ in range(cue.count or 1):
        t0 = score.now
        low = t0 + (0.9 + 0.5 * angle) / cue.tempo
        held = low + 0.5 / cue.tempo
        up = held + (1.0 + 0.5 * angle) / cue.tempo
        moves = [("pelvis_pitch", 0.5 * angle), ("chest_pitch", 0.5 * angle),
                 ("head_pitch", 0.2 * angle)]  # fmt: skip
        # The arms hang: they turn back in the shoulder as the chest turns forward.
        moves += [
            (f"{s}_flexion", 0.75 * angle) for s in ("left", "right") if s not in cue.busy_arms
        ]
        for channel, delta in moves:
            score.move(channel, delta, t0, low)
            score.move(channel, -delta, held, up)
        score.now = up + 0.1


def raise_arms(score: Score, cue: Cue) -> None:
    """Arms forward and up over the head, held for a second, and down."""
    raised = {"flexion": 2.4 * min(cue.amplitude, 1.05), "elbow": -0.15, "abduction": 0.05}
    sides = hands(cue)
    time = 1.3 / cue.tempo if cue.duration is None else RAISE
    for _ in range(cue.count or 1):
        up = score.now + time
        held = up + _hold(cue, 0.8)
        down = held + time + 0.1
        _arms(score, sides, raised, score.now, up)
        _arms(score, sides, _back(raised), held, down)
        score.now = down


def clap(score: Score, cue: Cue) -> None:
    """Both hands before the chest, meeting 4 times."""
    both = ("left", "right")
    up = score.now + RAISE
    apart = 0.6 * min(cue.amplitude, 1.3)
    # Turned inward by 0.85 rad the wrists are a palm's thickness apart.
    ready = {"flexion": 0.75, "elbow": 1.10, "abduction": -0.06, "rotation": apart - 0.85}
    _arms(score, both, ready, score.now, up)
    beat = 0.26 / cue.tempo
    t = up
    for _ in range(_repetitions(cue, 4, 2.0 * beat)):
        _arms(score, both, {"rotation": -apart}, t, t + beat)
        _arms(score, both, {"rotation": apart}, t + beat, t + 2.0 * beat)
        t += 2.0 * beat
    _arms(score, both, _back(ready), t, t + LOWER)
    score.now = t + LOWER


def point(score: Score, cue: Cue) -> None:
    """Stretch an arm out ahead, hold, and lower it."""
    out = {"flexion": 1.45, "elbow": -0.20, "abduction": -0.05}
    up = score.now + RAISE
    held = up + _hold(cue, 1.0)
    _arms(score, hands(cue), out, score.now, up)
    _arms(score, hands(cue), _back(out), held, held + LOWER)
    score.now = held + LOWER


def sway(score: Score, cue: Cue) -> None:
    """Shift the weight from foot to foot, twice each way."""
    shift = 0.28 * min(cue.amplitude, 1.2)
    time = 1.0 / cue.tempo
    first = shift if cue.side == "left" else -shift
    for _ in range(cue.count or 2):
        for target in (0.5 + first, 0.5 - first):
            score.shift_load(target, score.now, score.now + time)
            score.now += time
    score.shift_load(0.5, score.now, score.now + time)
    score.now += time


def stand(score: Score, cue: Cue) -> None:
    """Stand still for 2 s."""
    score.now += 2.0 / cue.tempo
