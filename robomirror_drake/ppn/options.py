"""Settings of a performance prediction network and of its training."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class PPNOptions(BaseModel):
    """What the network looks at, and its size."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    horizon: float = Field(1.0, ge=0.2, le=10.0, description="how far it looks ahead [s]")
    history: float = Field(0.5, ge=0.0, le=5.0, description="how far it looks back [s]")
    rate: float = Field(20.0, ge=5.0, le=60.0, description="of both, in frames [Hz]")
    stack: int = Field(2, ge=1, le=20, description="frames of the reference in one token")
    width: int = Field(96, ge=8, le=1024, description="of a token")
    heads: int = Field(4, ge=1, le=32, description="of attention")
    self_layers: int = Field(2, ge=0, le=12, description="of self-attention among the states")
    cross_layers: int = Field(2, ge=1, le=12, description="of attention to the reference")
    dropout: float = Field(0.2, ge=0.0, lt=1.0, description="while it is trained")
    use_reference: bool = Field(True, description="false: an ablation that sees no reference")
    use_state: bool = Field(True, description="false: an ablation that sees no state")
    states: Literal["measured", "commanded"] = Field(
        "measured",
        description="commanded: a robot that does just what it was told is taken for the state, as"
        " in motions that have yet to begin",
    )
    use_cross_attention: bool = Field(
        True, description="false: an ablation that puts state and reference side by side"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not (self.use_reference or self.use_state):
            raise ValueError("use_reference and use_state are both false: nothing to look at")
        if self.width % self.heads:
            raise ValueError(f"width {self.width} is no multiple of heads {self.heads}")
        if self.ahead % self.stack:
            raise ValueError(f"stack {self.stack} does not divide the {self.ahead} frames ahead")
        return self

    @property
    def ahead(self) -> int:
        """Frames of the reference: the present one, and those of the horizon but its last."""
        return round(self.horizon * self.rate)

    @property
    def back(self) -> int:
        """Frames of the state: the present one is the last."""
        return round(self.history * self.rate) + 1


class TorqueOptions(BaseModel):
    """What a network on the largest torques looks at, and its size."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    rate: float = Field(20.0, ge=5.0, le=60.0, description="of the motion, in frames [Hz]")
    power: float = Field(
        8.0, ge=1.0, le=64.0, description="of the norm over the time that stands for the largest"
    )
    members: int = Field(4, ge=1, le=64, description="networks whose logits are averaged")
    hidden: int = Field(16, ge=1, le=256, description="units of each")


class TrainTorquesOptions(BaseModel):
    """A training on the largest torques: which data, which network, how."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path = Field(Path("results/data"), description="folder of a data set")
    out: Path = Field(Path("results/leg_torques"), description="folder for the weights")
    robot: str = Field("jvrc1", description="name of a YAML in assets/robots, or its path")
    network: TorqueOptions = TorqueOptions()
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of weights and batches")
    epochs: int = Field(150, ge=1, le=100_000, description="all of them are done")
    batch: int = Field(512, ge=2, le=65_536, description="motions in a step")
    learning_rate: float = Field(0.01, gt=0.0, le=1.0, description="of AdamW")
    weight_decay: float = Field(0.001, ge=0.0, le=10.0, description="of AdamW")


class TrainOptions(BaseModel):
    """A training: which data, which network, how."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path = Field(Path("results/data"), description="folder of a data set")
    out: Path = Field(Path("results/ppn"), description="folder for checkpoint, log and weights")
    robot: str = Field("jvrc1", description="name of a YAML in assets/robots, or its path")
    network: PPNOptions = PPNOptions()
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of weights, batches and dropout")
    device: Literal["cpu", "cuda"] = Field("cpu", description="where it is trained")
    threads: int = Field(1, ge=1, le=256, description="of the processor")
    epochs: int = Field(
        24, ge=1, le=10_000, description="at most; in one, each fall is drawn once on average"
    )
    patience: int = Field(6, ge=1, le=10_000, description="epochs without a better one")
    batch: int = Field(256, ge=2, le=65_536, description="windows in a step")
    learning_rate: float = Field(5e-4, gt=0.0, le=1.0, description="highest")
    weight_decay: float = Field(0.05, ge=0.0, le=10.0, description="of AdamW")
    falls: float = Field(0.5, gt=0.0, lt=1.0, description="share of windows with a fall in a step")
    align: float = Field(0.3, ge=0.0, description="weight of the errors but A_qdd (lambda 1)")
    smooth: float = Field(0.1, ge=0.0, description="weight of the error A_qdd (lambda 2)")
    mirror: bool = Field(
        True, description="learn from everything with left and right exchanged too"
    )
    spacing: float = Field(0.1, gt=0.0, le=5.0, description="of the windows of an episode [s]")
    average: float = Field(0.998, ge=0.0, lt=1.0, description="decay of the averaged weights")
    share: float = Field(
        1.0,
        gt=0.0,
        le=1.0,
        description="of the commands to learn from: for learning curves",
    )
