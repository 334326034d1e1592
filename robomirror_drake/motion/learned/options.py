"""Settings of the learned generator's training, as its YAML file gives them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

PACKAGED = "packaged"
"""Stands for what comes with the package: the sentence encoder, the weights."""


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class StageOptions(_Options):
    """How one network is trained."""

    steps: int = Field(2000, ge=0, description="updates")
    batch: int = Field(64, ge=2, description="motions in an update")
    learning_rate: float = Field(5e-4, gt=0.0, le=0.1, description="at its peak; AdamW")


class VaeOptions(StageOptions):
    """The motion VAE: eight frames become one latent token."""

    width: int = Field(128, ge=8, description="channels inside")
    depth: int = Field(2, ge=1, description="residual blocks at each of two rates")
    latent: int = Field(24, ge=1, description="channels of a latent token")
    kl: float = Field(1e-4, ge=0.0, description="weight of the Kullback-Leibler term")
    window: int = Field(64, ge=16, multiple_of=8, description="frames of a crop in training")


class DiffusionOptions(StageOptions):
    """The text-conditioned latent diffusion model, and the student that is made of it."""

    width: int = Field(160, ge=8, description="channels of a token inside")
    heads: int = Field(4, ge=1, description="attention heads")
    layers: int = Field(4, ge=1, description="transformer layers")
    drop_text: float = Field(0.1, gt=0.0, lt=1.0, description="share trained without text")


class ConsistencyOptions(StageOptions):
    """Distillation of the diffusion model into one of few steps."""

    guidance_low: float = Field(0.0, ge=0.0, description="least guidance trained for")
    guidance_high: float = Field(4.0, gt=0.0, description="most guidance trained for")
    solver_steps: int = Field(50, ge=2, le=1000, description="DDIM steps the teacher would take")
    ema: float = Field(0.95, ge=0.0, lt=1.0, description="decay of the target network")


class EvaluatorOptions(StageOptions):
    """The contrastive text-motion networks that measure the others."""

    width: int = Field(128, ge=8, description="channels inside")
    features: int = Field(128, ge=2, description="dimension of the shared space")
    temperature: float = Field(0.07, gt=0.0, description="of the contrastive loss")


class SamplingOptions(_Options):
    """How the trained generator is asked."""

    weights: str = Field(PACKAGED, description="packaged, or a generator.safetensors of your own")
    steps: int = Field(2, ge=1, le=50, description="evaluations of the network for a motion")
    guidance: float = Field(1.5, ge=0.0, le=20.0, description="how strongly the text pulls")


class TrainOptions(_Options):
    """One training, from data set to generator."""

    data: Path = Field(description="folder in HumanML3D's layout")
    out: Path = Field(description="folder for checkpoints and results")
    seed: int = Field(0, ge=0, description="of everything that is drawn")
    device: Literal["cpu", "cuda"] = Field("cpu", description="where to train")
    text_encoder: str = Field(
        PACKAGED, description="sentence encoder: packaged, or a sentence-transformers model"
    )
    start_from: Path | None = Field(
        None, description="checkpoint.safetensors of a like training, to begin with its weights"
    )
    checkpoint_every: int = Field(500, ge=1, description="updates between checkpoints")
    vae: VaeOptions = VaeOptions()
    diffusion: DiffusionOptions = DiffusionOptions()
    consistency: ConsistencyOptions = ConsistencyOptions()
    evaluator: EvaluatorOptions = EvaluatorOptions()
