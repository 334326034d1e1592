"""Clauses and a style become joint positions: one score, one balance, from rest to rest."""

from __future__ import annotations

from dataclasses import replace

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Array
from robomirror_drake.motion.cue import Cue, Style, hands, other
from robomirror_drake.motion.library import library
from robomirror_drake.motion.perform import perform
from robomirror_drake.motion.score import Score
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
        InputError: The motion would last longer than :data:`MAX_DURATION`.
    """
    score = Score(now=REST)
    for i, clause in enumerate(clauses):
        if not clause.accompanies:
            gestures = _following(clauses[i + 1 :])
            _write(score, clause, gestures, style)
            score.now += BETWEEN
    score.now += REST
    if score.now > MAX_DURATION:
        raise InputError(
            f"the motion would last {score.now:.0f} s; {MAX_DURATION:.0f} s is the longest"
        )
    return perform(score, fps)


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
    cues = [cue_of(gesture, style) for gesture in gestures]
    busy: set[str] = set()
    for gesture, cue in zip(gestures, cues, strict=True):
        used = {"left", "right"} if gesture.action in ("clap", "punch") else set(hands(cue))
        if used & busy:
            raise InputError(f"{gesture.text!r} needs an arm that is already in use")
        busy |= used
    start = score.now
    cue = replace(cue_of(clause, style), busy_arms=frozenset(busy))
    library()[clause.action].perform(score, cue)
    end, duration = score.now, score.now - start
    for gesture, cue in zip(gestures, cues, strict=True):
        score.now = start
        gesture_cue = replace(cue, duration=duration)
        library()[gesture.action].perform(score, gesture_cue)
        end = max(end, score.now)
    score.now = end


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
