"""Key poses are written into a score."""

from __future__ import annotations

import numpy as np

from robomirror_drake.motion.composer.cue import Cue, other
from robomirror_drake.motion.composer.keyed import SIDED, ArmPose, FootPose, Key, Keyed, Stance
from robomirror_drake.motion.composer.score import Score, ahead

STEP_TIME = 0.65
"""Time of a step into a stance, and of the weight shift before it [s]."""
DEEPEST = -0.42
"""Lowest the pelvis goes under its neutral height [m]."""
SHIFT = 0.8
"""Time to bring the weight back onto both feet [s]."""
OVERSHOOT = 0.6
"""How far a motion larger than by a fifth throws its weight too far, per amplitude."""
ARM_MOST = 1.25
"""Largest amplitude of the arms: joints have ends."""
LIFT_OFF = 0.25
"""Share of a foot's way up or down in which it goes nowhere else."""


def play_keyed(score: Score, cue: Cue, keyed: Keyed) -> None:
    """Write an action told by keys, as often as the cue says."""
    player = _Player(score, cue, keyed)
    if keyed.stance is not None:
        player.step(keyed.stance, into=True)
    for _ in range(1 if keyed.beat else (cue.count or 1)):
        player.once()
    if keyed.stance is not None:
        player.step(keyed.stance, into=False)


class _Player:
    """One performance: the cue's side, tempo and size applied to the keys."""

    def __init__(self, score: Score, cue: Cue, keyed: Keyed) -> None:
        self.score, self.cue, self.keyed = score, cue, keyed
        self.side = "left" if cue.side == "both" else cue.side
        if keyed.mirrored:
            self.side = other(self.side)
        self.amplitude = min(cue.amplitude, keyed.most)
        self.home: dict[str, float] = {}

    def once(self) -> None:
        """There, the beats, the pause, and back."""
        keyed, cue, score = self.keyed, self.cue, self.score
        pace = np.sqrt(cue.tempo) * cue.haste if keyed.beat else cue.tempo
        begin, side = score.now, self.side
        self._play(keyed.keys, pace, self.amplitude if keyed.scaled else 1.0, {})
        rest = {name: score.settled(name) - home for name, home in self.home.items()}
        for _ in range(self._beats(score.now - begin)):
            self._play(keyed.beat, cue.tempo, self.amplitude, rest)
            if keyed.alternate:
                self.side = other(self.side)
        self.side = side
        score.now += self._pause(score.now - begin)
        self._back(keyed.fall / pace)

    def step(self, stance: Stance, into: bool) -> None:
        """Step into the stance, or back out of it."""
        score, cue = self.score, self.cue
        side = self.side if stance.foot == "acting" else other(self.side)
        sign = 1.0 if side == "left" else -1.0
        size = min(cue.amplitude, self.keyed.most) * (1.0 if into else -1.0)
        yaw = sign * np.deg2rad(stance.yaw) * (1.0 if into else -1.0)
        foot = score.feet[side]
        if into:
            to = ahead(foot, size * stance.x, size * sign * stance.y, yaw)
        else:  # the way back is told in the heading that the foot had before
            before = ahead(foot, 0.0, 0.0, yaw)
            to = ahead(before, size * stance.x, size * sign * stance.y)
        time = STEP_TIME / cue.haste
        shifted = score.now + time
        landed = shifted + time / np.sqrt(cue.tempo)
        score.shift_load(0.0 if side == "left" else 1.0, score.now, shifted)
        score.swing(side, to, shifted, landed, cue.style.step_height)
        score.shift_load(0.5, landed, landed + time)
        score.now = landed + (0.6 if into else 1.0) * time

    def _beats(self, spent: float) -> int:
        keyed, cue = self.keyed, self.cue
        if not keyed.beat:
            return 0
        if cue.count is not None or cue.duration is None:
            return cue.count or keyed.repeats
        length = max(key.at[1] for key in keyed.beat) / cue.tempo
        return max(1, int((cue.duration - spent - keyed.fall) / length))

    def _pause(self, spent: float) -> float:
        if self.cue.duration is None or self.keyed.beat:
            return self.keyed.hold / self.cue.tempo
        return max(self.cue.duration - spent - self.keyed.fall, 0.2)

    def _play(
        self, keys: tuple[Key, ...], pace: float, size: float, rest: dict[str, float]
    ) -> None:
        t0 = self.score.now
        for key in keys:
            start, end = t0 + key.at[0] / pace, t0 + key.at[1] / pace
            for name, value in self._targets(key).items():
                at_rest = rest.get(name, 0.0)
                most = ARM_MOST if name.startswith(("left", "right")) else size
                grown = at_rest + min(size, most) * (value - at_rest)
                if name == "load":  # a large motion throws the weight past the foot
                    grown = value * (1.0 + OVERSHOOT * max(self.amplitude - 1.2, 0.0))
                self._to(name, max(grown, DEEPEST) if name == "pelvis_z" else grown, start, end)
            if key.foot is not None:
                self._carry(key.foot, size, start, end)
        self.score.now = t0 + max((key.at[1] for key in keys), default=0.0) / pace

    def _targets(self, key: Key) -> dict[str, float]:
        """Channel -> value over neutral, of trunk, head, weight and arms."""
        values: dict[str, float] = {}
        sign = {"left": 1.0, "right": -1.0}[self.side]
        if self.cue.side == "both" and not self.keyed.alternate:
            sign = 0.0
        for name, value in key.body.items():
            if self.cue.duration is not None and name.startswith(("pelvis", "load")):
                continue
            value *= sign if name in SIDED else 1.0
            values[name] = value if name in ("pelvis_z", "load") else float(np.deg2rad(value))
        acting, far = key.arm or key.both, key.other or key.both
        if self.cue.side == "both" and not self.keyed.alternate:
            far = far or acting
        for side, pose in ((self.side, acting), (other(self.side), far)):
            if pose is not None and side not in self.cue.busy_arms:
                values |= _arm(side, pose)
        return values

    def _carry(self, pose: FootPose, size: float, start: float, end: float) -> None:
        """Move the acting foot; it leaves and meets the floor vertically."""
        side, score = self.side, self.score
        sign = 1.0 if side == "left" else -1.0
        stood = score.feet[side]
        there = ahead(stood, size * pose.x, size * sign * pose.y)
        margin = LIFT_OFF * (end - start)
        leaves = score.settled(f"{side}_foot_z") < 1e-6
        lands = pose.z < 1e-6
        across = (start + margin * leaves, end - margin * lands)
        for name, value in (("x", there.x - stood.x), ("y", there.y - stood.y),
                            ("yaw", sign * float(np.deg2rad(pose.yaw)))):  # fmt: skip
            self._to(f"{side}_foot_{name}", value, *across)
        self._to(f"{side}_foot_z", size * pose.z, start, end)
        self._to(f"{side}_foot_heel", float(np.deg2rad(pose.heel)), start, end)

    def _to(self, name: str, value: float, start: float, end: float) -> None:
        """Move a channel to a value over the one that it had before the action."""
        if name == "load":
            self.home.setdefault(name, 0.0)
            self.score.shift_load(0.5 + value, start, end)
            return
        home = self.home.setdefault(name, self.score.settled(name))
        self.score.to(name, home + value, start, end)

    def _back(self, time: float) -> None:
        """Every channel goes back to where it was, a lifted foot before the weight."""
        score = self.score
        start, end = score.now, score.now + time
        lifted = score.settled(f"{self.side}_foot_z") > 1e-6
        for name, home in self.home.items():
            if name == "load":
                continue
            early = LIFT_OFF * time if lifted and name.endswith(("foot_x", "foot_y")) else 0.0
            score.to(name, home, start, end - early)
        if "load" in self.home:
            begin, end = (end, end + SHIFT / self.cue.haste) if lifted else (start, end)
            score.shift_load(0.5, begin, end)
        score.now = end


def _arm(side: str, pose: ArmPose) -> dict[str, float]:
    return {f"{side}_{angle}": value for angle, value in pose.angles.items()}
