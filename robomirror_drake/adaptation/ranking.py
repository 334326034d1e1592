"""Candidates ranked in six dimensions: safety first, then quality (the paper's eq. 2 and 3).

Among the candidates with S > T_safe the one with the greatest Q = wᵀs / Σw is taken, where
S = 1 − P(fall) and s are the scores; where none is safe enough, the safest one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, model_validator

from robomirror_drake.goals import Satisfaction
from robomirror_drake.messages import DIMENSIONS, Array, QualityPrediction, Ranking

Residuals = Mapping[str, float]


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RankingWeights(_Options):
    """What each dimension counts; only the ratios matter."""

    collision: float = Field(1.0, ge=0.0, description="of the robot with itself and the floor")
    feasibility: float = Field(1.0, ge=0.0, description="of the pose, the stance and the limits")
    stability: float = Field(1.0, ge=0.0, description="1 - P(fall)")
    tracking: float = Field(1.0, ge=0.0, description="foreseen errors of position")
    smoothness: float = Field(1.0, ge=0.0, description="foreseen errors of speed and acceleration")
    goal: float = Field(2.0, ge=0.0, description="what the command means")

    @model_validator(mode="after")
    def _something_counts(self) -> RankingWeights:
        if not any(self.model_dump().values()):
            raise ValueError("all weights are 0; give one dimension a positive weight")
        return self


class RankingHalves(_Options):
    """Figures at which a score has come down to one half: s = Π 1 / (1 + figure / half)."""

    self_penetration: float = Field(0.01, gt=0.0, description="collision [m]")
    penetration: float = Field(0.01, gt=0.0, description="collision, of a sole in the floor [m]")
    keypoint_error: float = Field(0.05, gt=0.0, description="feasibility [m]")
    stance_drift: float = Field(0.01, gt=0.0, description="feasibility [m]")
    limit_violation: float = Field(0.05, gt=0.0, description="feasibility [rad], [rad/s]")
    A_q: float = Field(0.05, gt=0.0, description="tracking [rad]")
    A_p: float = Field(0.05, gt=0.0, description="tracking [m]")
    A_theta: float = Field(0.10, gt=0.0, description="tracking [rad]")
    A_qd: float = Field(0.25, gt=0.0, description="smoothness [rad/s]")
    A_qdd: float = Field(5.0, gt=0.0, description="smoothness [rad/s²]")


class RankingOptions(_Options):
    """How candidates are compared."""

    t_safe: float = Field(0.9, ge=0.0, lt=1.0, description="T_safe: P(fall) is below 1 - T_safe")
    undone: float = Field(
        0.5, ge=0.0, le=1.0, description="factor on the goal's score where the task is not done"
    )
    weights: RankingWeights = RankingWeights()
    halves: RankingHalves = RankingHalves()


_COLLISION = ("self_penetration", "penetration")
_FEASIBILITY = ("keypoint_error", "stance_drift", "limit_violation")
_TRACKING = ("A_q", "A_p", "A_theta")
_SMOOTHNESS = ("A_qd", "A_qdd")


def rank(
    residuals: Sequence[Residuals],
    prediction: QualityPrediction,
    satisfactions: Sequence[Satisfaction] | None = None,
    options: RankingOptions | None = None,
) -> Ranking:
    """Ranks n candidates.

    Args:
        residuals: Of each candidate's reference, :attr:`RobotReference.residuals`.
        prediction: What is foreseen for them, in the same order.
        satisfactions: How well each does what the command means; all alike where None.
        options: Threshold and weights.

    Raises:
        ValueError: There is no candidate, the numbers differ, or a reference has no residuals.
    """
    options = options or RankingOptions()
    n = len(residuals)
    if n == 0:
        raise ValueError("there is no candidate to rank")
    for count, what in (
        (len(prediction.fall_probability), "predictions"),
        (n if satisfactions is None else len(satisfactions), "satisfactions"),
    ):
        if count != n:
            raise ValueError(f"{n} candidates, but {count} {what}; give one for each")
    scores = dimension_scores(residuals, prediction, satisfactions, options)
    weights = np.array([getattr(options.weights, name) for name in DIMENSIONS])
    quality = scores @ weights / weights.sum()
    safety = 1.0 - prediction.fall_probability
    safe = safety > options.t_safe
    # The last key counts first; what is equal in all keeps its order.
    order = np.lexsort((-quality, -np.where(safe, 1.0, safety)))
    reasons = _reasons(order, scores, weights, safe, prediction, satisfactions, options)
    return Ranking(order=order, scores=scores, quality=quality, safe=safe, reasons=reasons)


def dimension_scores(
    residuals: Sequence[Residuals],
    prediction: QualityPrediction,
    satisfactions: Sequence[Satisfaction] | None,
    options: RankingOptions,
) -> Array:
    """(n, 6) scores in :data:`DIMENSIONS`; arguments and errors are those of :func:`rank`."""
    halves = options.halves.model_dump()
    foreseen = [
        {name: float(getattr(prediction, name)[i]) for name in (*_TRACKING, *_SMOOTHNESS)}
        for i in range(len(residuals))
    ]
    columns = [
        [_score(r, _COLLISION, halves) for r in residuals],
        [_score(r, _FEASIBILITY, halves) for r in residuals],
        1.0 - prediction.fall_probability,
        [_score(f, _TRACKING, halves) for f in foreseen],
        [_score(f, _SMOOTHNESS, halves) for f in foreseen],
        [1.0] * len(residuals)
        if satisfactions is None
        else [s.score * (1.0 if s.done else options.undone) for s in satisfactions],
    ]
    return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=1)


def _score(figures: Residuals, names: Sequence[str], halves: Mapping[str, float]) -> float:
    known = [name for name in names if name in figures]
    if not known:
        raise ValueError(f"a reference has none of the residuals {', '.join(names)}; retarget it")
    return float(np.prod([1.0 / (1.0 + max(figures[n], 0.0) / halves[n]) for n in known]))


def _reasons(
    order: npt.NDArray[np.intp],
    scores: Array,
    weights: Array,
    safe: npt.NDArray[np.bool_],
    prediction: QualityPrediction,
    satisfactions: Sequence[Satisfaction] | None,
    options: RankingOptions,
) -> tuple[str, ...]:
    """A sentence for each candidate, in the candidates' order."""
    best, quality = int(order[0]), scores @ weights / weights.sum()
    allowed = 1.0 - options.t_safe

    def fall(i: int) -> str:
        return f"P(fall) {prediction.fall_probability[i]:.1%}"

    def told(i: int) -> str:
        if i == best and safe[i]:
            return f"safe ({fall(i)}) and the best in quality ({quality[i]:.2f})"
        if i == best:
            return f"the safest, though none is safe enough: {fall(i)}, allowed below {allowed:.1%}"
        if not safe[i]:
            return f"not safe enough: {fall(i)}, allowed below {allowed:.1%}"
        loss = weights * (scores[best] - scores[i])
        most = int(np.argmax(loss))
        if loss[most] <= 0.0:
            return f"safe ({fall(i)}) and as good as the best ({quality[i]:.2f}), which comes first"
        return (
            f"safe ({fall(i)}), but of lower quality ({quality[i]:.2f} against"
            f" {quality[best]:.2f}), most of all in {DIMENSIONS[most]}"
            f" ({scores[i, most]:.2f} against {scores[best, most]:.2f})"
        )

    missed = [() if satisfactions is None else satisfactions[i].missed for i in range(len(safe))]
    return tuple(
        told(i) + "".join(f"; task not done: {m}" for m in missed[i][:1]) for i in range(len(safe))
    )
