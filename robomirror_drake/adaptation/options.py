"""Settings of how the robot adapts what it was told, without the imports of the network."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from robomirror_drake.adaptation.handover_options import AdapterOptions
from robomirror_drake.adaptation.ranking import RankingOptions
from robomirror_drake.optimization.adaptation.options import AdaptOptions

Method = Literal["none", "selection", "optimisation", "selection_optimisation"]
"""``none`` takes the command's own motion; ``optimisation`` changes that one, if it has to;
``selection`` takes one of the pool; ``selection_optimisation`` changes the likeliest ones of
the pool where none is safe."""


def _listed(given: object) -> object:
    """One name is a list of one."""
    return (given,) if isinstance(given, str) else given


class AdaptationOptions(BaseModel):
    """How the robot adapts what it was told to what it can do."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Method = Field("none", description="what may be done")
    predictor: Annotated[tuple[str, ...], BeforeValidator(_listed)] = Field(
        ("ppn_1s_commanded", "ppn_3s", "leg_torques"),
        min_length=1,
        description="weights in assets/ppn, or paths, whose logits are averaged: one, or a list;"
        " of whole motions one knows no state but the first, and a network that expects to see how"
        " a fall begins takes them for safe; those of train-torques have half of the say on what"
        " is chosen and on what was optimised, and none in what the optimiser climbs",
    )
    every: float = Field(0.5, gt=0.0, le=10.0, description="between windows that are judged [s]")
    optimised: int = Field(2, ge=1, le=64, description="candidates that are changed, at most")
    ranking: RankingOptions = RankingOptions()
    closed_loop: bool = Field(False, description="whether it is adapted while it runs, too")
    adapter: AdapterOptions = Field(
        AdapterOptions(), description="of the closed loop; its T_safe is that of the ranking"
    )
    optimiser: AdaptOptions = Field(AdaptOptions(), description="its T_safe is that of the ranking")

    @model_validator(mode="after")
    def _closed_loop_adapts(self) -> Self:
        if self.closed_loop and self.method == "none":
            raise ValueError("closed_loop with method none: name what may be done beforehand")
        return self
