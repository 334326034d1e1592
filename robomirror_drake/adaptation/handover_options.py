"""Settings of how a motion is changed while it runs, without the imports of the network."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field
from scipy.special import expit, logit

from robomirror_drake.adaptation.ranking import RankingOptions
from robomirror_drake.optimization.planning.options import PlanOptions


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Continuation(_Options):
    """How the rest of a motion may be done instead."""

    tempo: float = Field(1.0, ge=0.1, le=1.0, description="share of the motion's own")
    amplitude: float = Field(1.0, ge=0.0, le=1.0, description="share of its excursions")
    stride: float = Field(1.0, ge=0.0, le=1.0, description="share of its way over the floor")


class AdapterOptions(_Options):
    """When and how a motion that runs is changed."""

    predictor: str = Field(
        "ppn_1s", description="weights in assets/ppn, or a path; of a network that sees states"
    )
    rate: float = Field(5.0, ge=1.0, le=10.0, description="of looking ahead [Hz]")
    latency: float = Field(
        0.3,
        gt=0.0,
        le=2.0,
        description="from a look to the hand-over: what planning is taken to take [s]",
    )
    ahead: float = Field(
        1.0,
        gt=0.0,
        le=10.0,
        description="time in which windows that are looked at begin; each is as long as the"
        " predictor's horizon [s]",
    )
    interval: float = Field(
        0.5, ge=0.0, description="from one hand-over to the next look, at least [s]"
    )
    margin: float = Field(
        0.5,
        ge=0.0,
        description="in the fall's logit: so much safer than allowed a continuation has to be, and"
        " so much better than the motion as it is",
    )
    continuations: tuple[Continuation, ...] = Field(
        (
            Continuation(tempo=0.8),
            Continuation(tempo=0.65),
            Continuation(tempo=0.5),
            Continuation(tempo=0.4),
            Continuation(amplitude=0.6, stride=0.8),
            Continuation(amplitude=0.5, stride=0.5),
            Continuation(tempo=0.8, amplitude=0.6, stride=0.8),
            Continuation(tempo=0.65, amplitude=0.6, stride=0.6),
            Continuation(tempo=0.5, amplitude=0.5, stride=0.5),
        ),
        description="what is tried; to stop is always tried too",
    )
    least: Continuation = Field(
        Continuation(tempo=0.25, amplitude=0.25, stride=0.25),
        description="how much must be left of what was commanded at first, after all hand-overs",
    )
    halting: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="P(fall) of the motion as it is from which on the robot comes to a halt where"
        " nothing goes on safely",
    )
    keeping: float = Field(
        0.5, ge=0.0, description="quality that a continuation has to gain for what it changes"
    )
    soonest: float = Field(0.25, gt=0.0, description="least time to go on before a halt [s]")
    braking: float = Field(0.8, gt=0.0, description="how long coming to a halt takes at most [s]")
    settling: float = Field(0.6, ge=0.2, description="time to come to rest at a halt [s]")
    halts: int = Field(2, ge=1, le=8, description="moments to stop at that are compared")
    attempts: int = Field(3, ge=1, le=16, description="continuations that are planned at most")
    ranking: RankingOptions = Field(RankingOptions(), description="T_safe, and what is preferred")
    planner: PlanOptions = PlanOptions(stride=2)

    @property
    def allowed(self) -> float:
        """P(fall) from which on a motion is changed."""
        return 1.0 - self.ranking.t_safe

    @property
    def aim(self) -> float:
        """P(fall) below which a continuation is safe enough."""
        return float(expit(logit(self.allowed) - self.margin))
