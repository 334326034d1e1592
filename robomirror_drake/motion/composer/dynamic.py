"""Dynamic actions: jump, kick, punch, lunge, squats, standing on one leg."""

from __future__ import annotations

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.motion.composer.balance import GRAVITY
from robomirror_drake.motion.composer.cue import Cue, hands, other
from robomirror_drake.motion.composer.score import Score, ahead, quintic


def _free_arms(cue: Cue) -> list[str]:
    return [side for side in ("left", "right") if side not in cue.busy_arms]


def _carry(score: Score, side: str, forward: float, up: float, start: float, end: float) -> None:
    """Carry a lifted foot along its own heading and up."""
    yaw = score.feet[side].yaw
    score.move(f"{side}_foot_x", forward * np.cos(yaw), start, end)
    score.move(f"{side}_foot_y", forward * np.sin(yaw), start, end)
    score.move(f"{side}_foot_z", up, start, end)


def jump(score: Score, cue: Cue) -> None:
    """Jump on the spot, or by ``distance``: crouch, ballistic flight, absorbed landing."""
    count = cue.count or 1
    for i in range(count):
        _jump_once(score, cue, (cue.distance or 0.0) / count)
        if i < count - 1:
            score.now += 0.15


def _jump_once(score: Score, cue: Cue, distance: float) -> None:
    rise = min(0.10 * cue.amplitude, 0.16)
    take_off_speed = np.sqrt(2.0 * GRAVITY * rise)
    flight = 2.0 * take_off_speed / GRAVITY
    crouch, tip_off = -0.24, -0.035
    push = 0.34
    t0 = score.now
    bottom = t0 + 0.75 / np.sqrt(cue.tempo)
    off, down = bottom + push, bottom + push + flight
    absorbed = down + 0.38
    up = absorbed + 0.8 / np.sqrt(cue.tempo)
    at_off, at_down = (tip_off, take_off_speed, -GRAVITY), (tip_off, -take_off_speed, -GRAVITY)
    score.move("pelvis_z", crouch, t0, bottom)
    rest_in_crouch = (crouch, 0.0, 0.0)
    for start, end, t_start, t_end in (
        (rest_in_crouch, at_off, bottom, off),
        (at_off, at_down, off, down),
        (at_down, rest_in_crouch, down, absorbed),
    ):
        score.curve("pelvis_z", quintic(start, end, t_end - t_start) - _constant(start[0]),
                    t_start, t_end)  # fmt: skip
    score.move("pelvis_z", -crouch, absorbed, up)
    score.move("ballistic", 1.0, t0, bottom)
    score.move("ballistic", -1.0, absorbed, up)
    top = 0.5 * (off + down)
    for side in ("left", "right"):
        score.pulse(f"{side}_foot_z", 1.35 * rise, off, top, down)
        if distance:
            landing = ahead(score.feet[side], distance, 0.0)
            here = score.feet[side]
            score.move(f"{side}_foot_x", landing.x - here.x, off, down)
            score.move(f"{side}_foot_y", landing.y - here.y, off, down)
            score.feet[side] = landing
    for side in _free_arms(cue):
        swing = 0.7 * cue.style.arms
        score.move(f"{side}_flexion", -swing, t0, bottom)
        score.move(f"{side}_flexion", 2.4 * swing, bottom, off + 0.05)
        score.move(f"{side}_flexion", -1.4 * swing, top, absorbed + 0.2)
        score.pulse(f"{side}_elbow", 0.5, bottom, off, absorbed)
    score.move("chest_pitch", 0.35, t0, bottom)
    score.move("pelvis_pitch", 0.30, t0, bottom)
    for part, lean in (("chest_pitch", 0.35), ("pelvis_pitch", 0.30)):
        score.move(part, -lean, bottom, off)
        score.pulse(part, 0.8 * lean, down - 0.05, absorbed, up)
    score.now = up


def _constant(value: float) -> Array:
    return np.array([value, 0.0, 0.0, 0.0, 0.0, 0.0])


def _onto_one_leg(score: Score, lifted: str, time: float = 0.8) -> float:
    """Bring the weight over the other foot; returns when that is done."""
    score.shift_load(0.0 if lifted == "left" else 1.0, score.now, score.now + time)
    return score.now + time


def front_kick(score: Score, cue: Cue) -> None:
    """Weight over the stance foot, knee up, snap forward, knee back, foot down."""
    for _ in range(cue.count or 1):
        _kick_once(score, cue)


def _kick_once(score: Score, cue: Cue) -> None:
    side, pace = cue.side, np.sqrt(cue.tempo)
    height = 0.42 * min(cue.amplitude, 1.6)
    begin = score.now
    t0 = _onto_one_leg(score, side)
    chambered = t0 + 0.50 / pace
    out = chambered + 0.28 / pace
    held = out + 0.06
    back = held + 0.32 / pace
    down = back + 0.55 / pace
    _carry(score, side, 0.0, 0.80 * height, t0, chambered)
    _carry(score, side, 0.12, 0.0, t0 + 0.12, chambered)
    _carry(score, side, 0.48, 0.20 * height, chambered, out)
    _carry(score, side, -0.48, -0.20 * height, held, back)
    _carry(score, side, -0.12, 0.0, back, down - 0.12)
    _carry(score, side, 0.0, -0.80 * height, back, down)
    score.move(f"{side}_foot_heel", 0.7, t0, chambered)
    score.move(f"{side}_foot_heel", -1.3, chambered, out)
    score.move(f"{side}_foot_heel", 1.3, held, back)
    score.move(f"{side}_foot_heel", -0.7, back, down)
    score.pulse("pelvis_pitch", -0.20, chambered - 0.1, out, down)
    score.pulse("chest_pitch", 0.12, chambered - 0.1, out, down)
    for arm in _free_arms(cue):
        score.pulse(f"{arm}_elbow", 1.0, begin, chambered, down + 0.3)
        score.pulse(f"{arm}_flexion", 0.35, begin, chambered, down + 0.3)
        score.pulse(f"{arm}_abduction", 0.25, begin, chambered, down + 0.3)
    score.shift_load(0.5, down, down + 0.8)
    score.now = down + 0.8


def stand_on_one_leg(score: Score, cue: Cue) -> None:
    """Stand on the leg of ``side`` for 2 s, the other foot off the floor."""
    lifted = other(cue.side)
    begin = score.now
    t0 = _onto_one_leg(score, lifted)
    up, hold = t0 + 0.7, t0 + 0.7 + 2.0 / cue.tempo
    down = hold + 0.7
    for start, end, sign, pause in ((t0, up, 1.0, 0.1), (hold, down, -1.0, 0.0)):
        _carry(score, lifted, 0.0, sign * 0.16 * cue.amplitude, start, end)
        _carry(score, lifted, sign * 0.06, 0.0, start + pause, end - 0.1 + pause)
    for arm in _free_arms(cue):
        score.move(f"{arm}_abduction", 0.7 * cue.style.arms, begin, up)
        score.move(f"{arm}_abduction", -0.7 * cue.style.arms, hold, down + 0.4)
    score.shift_load(0.5, down, down + 0.8)
    score.now = down + 0.8


def lunge(score: Score, cue: Cue) -> None:
    """A long step ahead, down between the feet, and back."""
    side, length = cue.side, 0.46 * min(cue.amplitude * cue.style.step_length, 1.35)
    for _ in range(cue.count or 1):
        home = score.feet[side]
        lead = 0.55 if side == "left" else 0.45
        t0 = _onto_one_leg(score, side)
        landed = t0 + 0.70 / cue.tempo
        score.swing(side, ahead(home, length, 0.0), t0, landed, cue.style.step_height)
        low = landed + 0.80 / cue.tempo
        score.shift_load(lead, landed, low)
        held, rear = low + 0.3, low + 0.3 + 0.90 / cue.tempo
        score.move("pelvis_z", -0.20 * min(cue.amplitude, 1.3), landed - 0.1, low)
        score.move("pelvis_z", 0.20 * min(cue.amplitude, 1.3), held, rear)
        score.shift_load(0.0 if side == "left" else 1.0, held, rear)
        closed = rear + 0.70 / cue.tempo
        score.swing(side, home, rear, closed, cue.style.step_height)
        for arm in _free_arms(cue):
            score.pulse(f"{arm}_elbow", 0.9, landed - 0.2, low, rear)
            score.pulse(f"{arm}_flexion", 0.2, landed - 0.2, low, rear)
        score.shift_load(0.5, closed, closed + 0.7)
        score.now = closed + 0.7


def squat(score: Score, cue: Cue) -> None:
    """Down by 0.18 m and up again, arms forward."""
    _squat(score, cue, depth=min(0.18 * cue.amplitude, 0.28), lean=0.5)


def deep_squat(score: Score, cue: Cue) -> None:
    """Down by 0.34 m and up again, arms forward."""
    _squat(score, cue, depth=min(0.34 * cue.amplitude, 0.38), lean=0.9)


def _squat(score: Score, cue: Cue, depth: float, lean: float) -> None:
    pace = (0.8 + 1.5 * depth) / cue.tempo
    for _ in range(cue.count or 1):
        t0 = score.now
        low, rising = t0 + pace, t0 + pace + 0.25
        up = rising + pace
        moves = [("pelvis_z", -depth), ("pelvis_pitch", 0.5 * lean), ("chest_pitch", 0.5 * lean),
                 ("head_pitch", -0.5 * lean)]  # fmt: skip
        moves += [(f"{arm}_flexion", 1.1 * cue.style.arms) for arm in _free_arms(cue)]
        for channel, delta in moves:
            score.move(channel, delta, t0, low)
            score.move(channel, -delta, rising, up)
        score.now = up + 0.1


def punch(score: Score, cue: Cue) -> None:
    """Fists up, strike ahead with the trunk behind it, fists back, arms down."""
    arms = _free_arms(cue)
    t0 = score.now
    ready = t0 + 0.7
    guard = {"flexion": 0.55, "elbow": 1.75, "rotation": -0.35}
    for arm in arms:
        for angle, delta in guard.items():
            score.move(f"{arm}_{angle}", delta, t0, ready)
    score.move("pelvis_z", -0.04, t0, ready)
    score.now = ready
    fists = hands(cue)
    for i in range(cue.count or len(fists)):
        _strike(score, cue, fists[i % len(fists)])
    down = score.now + 0.8
    for arm in arms:
        for angle, delta in guard.items():
            score.move(f"{arm}_{angle}", -delta, score.now, down)
    score.move("pelvis_z", 0.04, score.now, down)
    score.now = down


def _strike(score: Score, cue: Cue, fist: str) -> None:
    pace = cue.tempo
    wound = score.now + 0.20 / pace
    out = wound + 0.26 / pace
    back = out + 0.05 + 0.34 / pace
    twist = (-0.35 if fist == "left" else 0.35) * cue.amplitude
    score.move("chest_yaw", -0.3 * twist, score.now, wound)  # wind up the other way
    score.move("chest_yaw", 1.3 * twist, wound, out)
    score.move("chest_yaw", -twist, out + 0.05, back)
    reach = min(cue.amplitude, 1.1)
    for angle, delta in (("flexion", 0.90), ("elbow", -1.80), ("rotation", 0.25)):
        score.move(f"{fist}_{angle}", reach * delta, wound, out)
        score.move(f"{fist}_{angle}", -reach * delta, out + 0.05, back)
    score.now = back + 0.05
