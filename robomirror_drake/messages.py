"""What flows between the stages: frozen dataclasses with read-only arrays.

One order of coordinates everywhere in these messages, Drake's own:

* ``q`` (30,): base quaternion wxyz, base position in world [m], 23 joints [rad]
* ``v`` (29,): base angular velocity in world [rad/s], base linear velocity in
  world [m/s], 23 joint velocities [rad/s]

with joints in the order of the robot's YAML. Feet are (left, right); the four
corners of a sole are (front left, front right, rear right, rear left) as seen
in the sole's own frame, so the toe is ``[0, 1]`` and the heel ``[2, 3]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def _frozen(value: npt.ArrayLike, dtype: type, shape: tuple[int | None, ...], name: str) -> Any:
    """A read-only, contiguous copy of ``value``, or a ValueError that names the field."""
    array: npt.NDArray[Any] = np.array(value, dtype=dtype, order="C")
    if array.ndim != len(shape) or any(
        want is not None and have != want for have, want in zip(array.shape, shape, strict=True)
    ):
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if dtype is np.float64 and not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f"{name} is not finite at index {tuple(int(i) for i in where)}")
    array.setflags(write=False)
    return array


RESIDUAL_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "keypoint_error": "m",
        "stance_drift": "m",
        "penetration": "m",
        "self_penetration": "m",
        "limit_violation": "rad",
        "velocity_violation": "rad/s",
        "jerk_rms": "rad/s³",
        "dynamic_violation": "body weights",
        "distance_to_raw": "m",
        "distance_to_command": "m",
    }
)
"""Units of :attr:`RobotReference.residuals`; what is not listed has none."""


class _Message:
    """Shared by all messages: fields are frozen on construction."""

    def _freeze(self, name: str, shape: tuple[int | None, ...], dtype: type = np.float64) -> None:
        object.__setattr__(self, name, _frozen(getattr(self, name), dtype, shape, name))

    def __eq__(self, other: object) -> bool:
        """Equal when every field is, arrays bit for bit."""
        if type(other) is not type(self):
            return NotImplemented
        for f in fields(self):  # type: ignore[arg-type]
            a, b = getattr(self, f.name), getattr(other, f.name)
            same = np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
            if not same:
                return False
        return True

    __hash__ = None  # type: ignore[assignment]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Itself: nothing in it can change, and Drake deep-copies every abstract value."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles through the constructor, so that a copy in another process is frozen too."""
        values = (getattr(self, f.name) for f in fields(self))  # type: ignore[arg-type]
        return type(self), tuple(dict(v) if isinstance(v, Mapping) else v for v in values)


@dataclass(frozen=True, eq=False)
class HumanMotion(_Message):
    """A human motion as joint positions (the paper's H_r).

    Attributes:
        positions: (T, 22, 3) joint positions in world [m], z up, HumanML3D joint order.
        fps: Frames per second.
        text: The words that describe it; empty where nobody wrote any.
        source: Provenance: the file, or the generator with its action and seed.
        style: The style parameters drawn for it, by name; empty for a recorded motion.
    """

    positions: Array
    fps: float
    text: str = ""
    source: str = ""
    style: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._freeze("positions", (None, 22, 3))
        if len(self.positions) < 2:
            raise ValueError(f"a motion needs 2 frames at least, this has {len(self.positions)}")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ValueError(f"fps is {self.fps}, expected a positive number")
        object.__setattr__(self, "style", MappingProxyType(dict(self.style)))

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return (len(self.positions) - 1) / self.fps

    @property
    def time(self) -> Array:
        """(T,) time of each frame from 0 [s]."""
        return np.arange(len(self.positions)) / self.fps


@dataclass(frozen=True, eq=False)
class RobotReference(_Message):
    """A robot trajectory to be followed (the paper's R_r), sampled at 60 Hz.

    Attributes:
        time: (T,) from 0 [s].
        q: (T, 30) positions, Drake order.
        v: (T, 29) velocities, Drake order.
        a: (T, 29) accelerations, Drake order.
        contact: (T, 2, 4) which sole corners are meant to bear load.
        text: The command it serves.
        source: Provenance, carried on from the human motion.
        residuals: How well the reference meets its own problem, by name, in SI
            units: ``keypoint_error``, ``stance_drift``, ``penetration``,
            ``self_penetration``, ``limit_violation``, ``jerk_rms`` …
        foot_force: (T, 2, 6) planned wrench on each foot about its sole centre, in
            world axes, [moment N·m, force N]; zero where nothing was planned.
        planned: Whether a dynamic plan was made, so that ``foot_force`` means something.
        lead: When the motion begins that the plan was made from [s]; time before that was
            added, to come from rest.
    """

    time: Array
    q: Array
    v: Array
    a: Array
    contact: BoolArray
    text: str = ""
    source: str = ""
    residuals: Mapping[str, float] = field(default_factory=dict)
    foot_force: Array | None = None
    planned: bool = False
    lead: float = 0.0

    def __post_init__(self) -> None:
        self._freeze("time", (None,))
        n = len(self.time)
        if n < 2 or np.any(np.diff(self.time) <= 0.0):
            raise ValueError("time must be increasing, with 2 samples at least")
        self._freeze("q", (n, None))
        self._freeze("v", (n, self.q.shape[1] - 1))
        self._freeze("a", (n, self.q.shape[1] - 1))
        self._freeze("contact", (n, 2, 4), np.bool_)
        if self.foot_force is None:
            object.__setattr__(self, "foot_force", np.zeros((n, 2, 6)))
        self._freeze("foot_force", (n, 2, 6))
        object.__setattr__(self, "residuals", MappingProxyType(dict(self.residuals)))

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return float(self.time[-1])

    def rows_at(self, time: Array) -> npt.NDArray[np.intp]:
        """(N,) the sample that (N,) times [s] are in, at the latest the last one."""
        after = np.searchsorted(self.time, time + 1e-9, side="right")  # up to rounding
        return np.maximum(after - 1, 0)


@dataclass(frozen=True, eq=False)
class Execution(_Message):
    """What the robot did with a reference in physics (the paper's R_p).

    All arrays are sampled together, at 60 Hz.

    Attributes:
        time: (N,) from 0 [s].
        q, v: (N, 30), (N, 29) what the robot did, Drake order.
        q_ref, v_ref: (N, 30), (N, 29) what it was told, Drake order.
        torque: (N, 23) joint torques applied [N·m].
        foot_force: (N, 2, 3) ground force on each foot in world [N].
        other_force: (N,) norm of the ground force on all links but the feet [N].
        contact_ref: (N, 2, 4) the reference's contact schedule.
        qp_status: (N,) 0 where the controller's QP was solved, else the number of
            control ticks in a row that it had not been.
        qp_slack: (N,) by how much the QP had to let joint accelerations leave the bounds
            that keep to the joint limits [rad/s²].
        contact_scheduled: (N, 2) share of each foot's corners that the controller wanted
            on the ground, its own changes of the schedule included.
        contact_measured: (N, 2) 1 where the controller felt the foot on the ground, else 0.
        torque_limit: (N, 23) +1 where the controller asked for a joint's highest torque, −1
            for its lowest, else 0.
        text: The command.
        source: Provenance, carried on from the reference.
        seed: Seed of the run.
        motion_end: When the reference's motion ends and the hold begins [s].
    """

    time: Array
    q: Array
    v: Array
    q_ref: Array
    v_ref: Array
    torque: Array
    foot_force: Array
    other_force: Array
    contact_ref: BoolArray
    qp_status: Array
    qp_slack: Array
    contact_scheduled: Array
    contact_measured: Array
    torque_limit: Array
    text: str = ""
    source: str = ""
    seed: int = 0
    motion_end: float = 0.0

    def __post_init__(self) -> None:
        self._freeze("time", (None,))
        n = len(self.time)
        self._freeze("q", (n, None))
        nv = self.q.shape[1] - 1
        self._freeze("q_ref", (n, nv + 1))
        self._freeze("v", (n, nv))
        self._freeze("v_ref", (n, nv))
        self._freeze("torque", (n, nv - 6))
        self._freeze("foot_force", (n, 2, 3))
        self._freeze("other_force", (n,))
        self._freeze("contact_ref", (n, 2, 4), np.bool_)
        self._freeze("qp_status", (n,))
        self._freeze("qp_slack", (n,))
        self._freeze("contact_scheduled", (n, 2))
        self._freeze("contact_measured", (n, 2))
        self._freeze("torque_limit", (n, nv - 6))


@dataclass(frozen=True)
class Outcome:
    """How an execution went: the quantities the paper's network learns to predict.

    The five errors are means over the execution up to the fall, if there was one.

    Attributes:
        fell: Whether the robot fell.
        fall_time_s: When [s]; None if it did not.
        fall_cause: Which condition of the definition was met: ``contact``, ``height``,
            ``tilt``; None if it did not fall.
        A_q: Joint position error [rad].
        A_qd: Joint velocity error [rad/s].
        A_qdd: Joint acceleration error [rad/s²].
        A_p: Root position error [m].
        A_theta: Root orientation error [rad].
        torque_saturation: Share of joint samples at the torque limit, 0 to 1.
        friction_margin: Least µ − |f_t|/f_n over loaded feet.
        energy_j: Mechanical work of the joints, positive part [J].
        duration_s: Length of the execution [s].
        cause: Why it fell, see :mod:`robomirror_drake.fall_cause`; None if it did not.
        cause_evidence: One sentence with the figures that say so.
    """

    fell: bool
    fall_time_s: float | None
    fall_cause: str | None
    A_q: float
    A_qd: float
    A_qdd: float
    A_p: float
    A_theta: float
    torque_saturation: float
    friction_margin: float
    energy_j: float
    duration_s: float
    cause: str | None = None
    cause_evidence: str | None = None


@dataclass(frozen=True, eq=False)
class QualityPrediction(_Message):
    """What is foreseen for n candidates over the next ``horizon`` seconds (the paper's s).

    Attributes:
        horizon: How far it looks ahead [s].
        fall_probability: (n,) that the robot falls within the horizon, 0 to 1.
        A_q: (n,) joint position error [rad].
        A_qd: (n,) joint velocity error [rad/s].
        A_qdd: (n,) joint acceleration error [rad/s²].
        A_p: (n,) root position error [m].
        A_theta: (n,) root orientation error [rad].
    """

    horizon: float
    fall_probability: Array
    A_q: Array
    A_qd: Array
    A_qdd: Array
    A_p: Array
    A_theta: Array

    def __post_init__(self) -> None:
        self._freeze("fall_probability", (None,))
        outside = (self.fall_probability < 0.0) | (self.fall_probability > 1.0)
        if outside.any():
            raise ValueError(f"fall_probability is {self.fall_probability[outside][0]}, not 0 to 1")
        for name in ("A_q", "A_qd", "A_qdd", "A_p", "A_theta"):
            self._freeze(name, (len(self.fall_probability),))
        if not (np.isfinite(self.horizon) and self.horizon > 0):
            raise ValueError(f"horizon is {self.horizon}, expected a positive number of seconds")


@dataclass(frozen=True, eq=False)
class Foresight(_Message):
    """How likely a fall within the next ``horizon`` seconds looked while a motion was executed.

    Attributes:
        time: (L,) of the execution [s].
        beforehand: (L,) P(fall) as it looked before the robot moved, if it does what it is told.
        underway: (L,) P(fall) as it looked then, by what the robot had really done.
        horizon: How far is looked ahead [s].
    """

    time: Array
    beforehand: Array
    underway: Array
    horizon: float

    def __post_init__(self) -> None:
        self._freeze("time", (None,))
        for name in ("beforehand", "underway"):
            self._freeze(name, (len(self.time),))


DIMENSIONS = ("collision", "feasibility", "stability", "tracking", "smoothness", "goal")
"""The six dimensions that candidates are ranked by, in the order of the columns."""


@dataclass(frozen=True, eq=False)
class Ranking(_Message):
    """Candidates compared; all arrays but ``order`` are in the candidates' own order.

    Attributes:
        order: (n,) indices of the candidates, the best first.
        scores: (n, 6) in :data:`DIMENSIONS`, each from 0 to 1, 1 the best.
        quality: (n,) weighted mean of the scores, 0 to 1.
        safe: (n,) whether the candidate is safe enough.
        reasons: Why each stands where it does, a sentence each.
    """

    order: npt.NDArray[np.intp]
    scores: Array
    quality: Array
    safe: BoolArray
    reasons: tuple[str, ...]

    def __post_init__(self) -> None:
        n = len(self.reasons)
        self._freeze("order", (n,), np.intp)
        if not n or sorted(self.order) != list(range(n)):
            raise ValueError(f"order is {self.order.tolist()}, expected each of 0 to {n - 1} once")
        self._freeze("scores", (n, len(DIMENSIONS)))
        self._freeze("quality", (n,))
        self._freeze("safe", (n,), np.bool_)

    @property
    def best(self) -> int:
        """Index of the candidate to take."""
        return int(self.order[0])


@dataclass(frozen=True, eq=False)
class Handover(_Message):
    """What was decided about a motion that ran and was not safe enough.

    Attributes:
        time: When it was looked at [s].
        start: From when on the robot was to follow something else [s].
        done: Whether it was given something else; False where nothing better was found.
        stopped: Whether that is to come to a halt and stand.
        tempo, amplitude, stride: Shares of those of the motion, from ``start`` on.
        risk_before: P(fall) foreseen at ``time`` for the motion as it was.
        risk_after: P(fall) foreseen for what is followed from ``start`` on.
        names: What was compared, the motion as it was first.
        risks: (n,) P(fall) foreseen for each of them from ``start`` on.
        reason: A sentence.
    """

    time: float
    start: float
    done: bool
    stopped: bool
    tempo: float
    amplitude: float
    stride: float
    risk_before: float
    risk_after: float
    names: tuple[str, ...]
    risks: Array
    reason: str

    def __post_init__(self) -> None:
        self._freeze("risks", (len(self.names),))
