"""What an action is told: the words' parameters and the style, merged into plain numbers."""

from __future__ import annotations

from dataclasses import dataclass

from robomirror_drake.motion.body import SIDES
from robomirror_drake.motion.composer.score import STANCE_WIDTH


@dataclass(frozen=True)
class Style:
    """How a person does whatever they do; 1 is nominal for the factors.

    Attributes:
        tempo: Factor on speed.
        amplitude: Factor on the size of gestures, jumps, squats.
        step_length: Factor on the length of steps.
        step_width: Distance of the feet while stepping [m].
        step_height: Lift of the swing foot [m].
        arms: Factor on the swing of the arms.
        mirrored: 1 where left and right are exchanged, if the words leave it open; else 0.
        spring: Factor on how far the body goes down and up, and how long it flies, in what
            bounces: hops, runs, skips, leaps, jumping jacks. A jump has to fly.
    """

    tempo: float = 1.0
    amplitude: float = 1.0
    step_length: float = 1.0
    step_width: float = STANCE_WIDTH
    step_height: float = 0.07
    arms: float = 1.0
    mirrored: float = 0.0
    spring: float = 1.0


@dataclass(frozen=True)
class Cue:
    """The parameters of one action.

    Attributes:
        side: ``left``, ``right`` or ``both``.
        count: Repetitions or steps; None where the action's default holds.
        speed: Walking speed [m/s]; None where the action's default holds.
        angle: Angle to turn by [rad], positive; None where the default holds.
        distance: Way to go [m], positive; None where the default holds.
        tempo: Factor on speed, of the words and the style together.
        amplitude: Factor on size, of the words and the style together.
        style: The style.
        busy_arms: Sides whose arm another action holds.
        duration: For a gesture that goes with something: how long that lasts [s].
    """

    side: str = "right"
    count: int | None = None
    speed: float | None = None
    angle: float | None = None
    distance: float | None = None
    tempo: float = 1.0
    amplitude: float = 1.0
    style: Style = Style()
    busy_arms: frozenset[str] = frozenset()
    duration: float | None = None

    @property
    def free_arms(self) -> tuple[str, ...]:
        """The sides whose arm no other action holds."""
        return tuple(side for side in SIDES if side not in self.busy_arms)

    @property
    def haste(self) -> float:
        """Factor by which weight shifts, too, are hurried where the tempo is far over the usual."""
        return max(1.0, self.tempo / 1.25)


def other(side: str) -> str:
    """The opposite side."""
    return "right" if side == "left" else "left"


def hands(cue: Cue) -> tuple[str, ...]:
    """The sides that a gesture uses."""
    return ("left", "right") if cue.side == "both" else (cue.side,)
