"""Settings of how the robot adapts what it was told, without the imports of the network."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.optimization.adapt_options import AdaptOptions
from robomirror_drake.ranking import RankingOptions

Method = Literal["none", "selection", "optimisation", "selection_optimisation"]
"""``none`` takes the command's own motion; ``optimisation`` changes that one, if it has to;
``selection`` takes one of the pool; ``selection_optimisation`` changes the likeliest ones of
the pool where none is safe."""


class AdaptationOptions(BaseModel):
    """How the robot adapts what it was told to what it can do."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Method = Field("none", description="what may be done")
    predictor: str = Field("ppn_1s", description="weights in assets/ppn, or a path")
    every: float = Field(0.5, gt=0.0, le=10.0, description="between windows that are judged [s]")
    optimised: int = Field(2, ge=1, le=64, description="candidates that are changed, at most")
    ranking: RankingOptions = RankingOptions()
    optimiser: AdaptOptions = Field(AdaptOptions(), description="its T_safe is that of the ranking")
