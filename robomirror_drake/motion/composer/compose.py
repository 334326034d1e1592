"""Clauses and a style become joint positions, from rest to rest.

Parametric actions in a row share one score and one balance; recordings come between.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Array
from robomirror_drake.motion.composer.cue import Cue, Style, other
from robomirror_drake.motion.composer.perform import perform
from robomirror_drake.motion.composer.score import Score
from robomirror_drake.motion.ground import heading
from robomirror_drake.motion.library import library
from robomirror_drake.motion.recorded import play
from robomirror_drake.motion.text import Clause

REST = 0.5
"""Stillness before the first action and after the last [s]."""
BETWEEN = 0.1
"""Stillness between two actions [s]."""
MAX_DURATION = 180.0
"""Longest motion that is made [s]."""


def compose(clauses: tuple[Clause, ...], style: Style, fps: float) -> Array:
    """Joint positions (T, 22, 3) [m] of the clauses done in turn in one style.

    The motion starts and ends at rest in neutral stance, facing +x with the pelvis over the origin.

    Raises:
        InputError: The motion would last longer than :data:`MAX_DURATION`, or two gestures
            need the same arm.
    """
    parts: list[Array] = []
    score = Score(now=REST)
    for i, clause in enumerate(clauses):
        if clause.accompanies:
            continue
        clip = clip_of(clause, style)
        if clip is not None:
            if score.now > REST:
                score.now += REST
                parts.append(perform(score, fps))
            parts.extend([play(clip, cue_of(clause, style), fps)] * (clause.count or 1))
            score = Score(now=REST)
        else:
            _write(score, clause, _following(clauses[i + 1 :]), style)
            score.now += BETWEEN
        _check_duration(score.now + sum(len(part) for part in parts) / fps)
    score.now += REST
    return _joined([*parts, perform(score, fps)])


def _check_duration(duration: float) -> None:
    if duration > MAX_DURATION:
        raise InputError(f"the motion would last {duration:.0f} s; {MAX_DURATION:.0f} s at most")


def _joined(parts: list[Array]) -> Array:
    """One motion: each part begins in the neutral stance where the one before it ended."""
    whole = parts[0]
    for part in parts[1:]:
        yaw = heading(whole[-1:])[0]
        c, s = np.cos(yaw), np.sin(yaw)
        turned = part @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        turned[..., :2] += whole[-1, 0, :2]
        whole = np.concatenate([whole, turned[1:]])
    return whole


def _following(clauses: tuple[Clause, ...]) -> list[Clause]:
    """The clauses that go along with the one before these."""
    gestures = []
    for clause in clauses:
        if not clause.accompanies:
            break
        gestures.append(clause)
    return gestures


def _write(score: Score, clause: Clause, gestures: list[Clause], style: Style) -> None:
    """Write an action, and over it the gestures that go along."""
    cue = cue_of(clause, style)
    cues = [cue_of(gesture, style) for gesture in gestures]
    taken = _arms_of(clause, cue)
    busy: set[str] = set()
    for gesture, gesture_cue in zip(gestures, cues, strict=True):
        used = _arms_of(gesture, gesture_cue)
        if used & (taken | busy):
            raise InputError(f"{gesture.text!r} needs an arm that is already in use")
        busy |= used
    start = score.now
    library()[clause.action].perform(score, replace(cue, busy_arms=frozenset(busy)))
    end, duration = score.now, score.now - start
    for gesture, gesture_cue in zip(gestures, cues, strict=True):
        score.now = start
        library()[gesture.action].perform(score, replace(gesture_cue, duration=duration))
        end = max(end, score.now)
    score.now = end


def _arms_of(clause: Clause, cue: Cue) -> set[str]:
    """The arms that an action of the arms holds."""
    return library()[clause.action].arms_held(cue)


def clip_of(clause: Clause, style: Style) -> str | None:
    """The recording that a clause is played from; None for a parametric action."""
    clips = library()[clause.action].clip
    return clips[int(style.mirrored) % len(clips)] or None if clips else None


def cue_of(clause: Clause, style: Style) -> Cue:
    """What the words and the style together tell an action."""
    action = library()[clause.action]
    # "Both" means something only where both sides can act at once.
    said = None if clause.side == "both" and not action.arms else clause.side
    side: str = said or action.side
    if said is None and style.mirrored and action.sided:
        side = other(side)
    return Cue(
        side=side,
        count=clause.count,
        speed=clause.speed,
        angle=clause.angle,
        distance=clause.distance,
        tempo=clause.tempo * style.tempo,
        amplitude=clause.amplitude * style.amplitude,
        style=style,
    )
