"""The networks: motion VAE, latent denoiser, length head, evaluator.

Sources: X. Chen et al., "Executing your Commands via Motion Diffusion in Latent Space" (MLD),
CVPR 2023, with a convolutional VAE instead of its transformer, so that latent tokens keep to
their time; N. Petrovich et al., "TMR: Text-to-Motion Retrieval", ICCV 2023, for the evaluator.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from robomirror_drake.motion.humanml_features import FEATURES
from robomirror_drake.motion.learned.options import DiffusionOptions, EvaluatorOptions, VaeOptions

FRAMES_PER_TOKEN = 8
MAX_TOKENS = 32
"""Latent tokens of the longest motion: 12.8 s."""


class ResidualBlock(nn.Module):
    """Convolution over time on normalised channels, added to its input (B, C, T)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.conv = nn.Conv1d(width, width, 3, padding=1)
        self.mix = nn.Conv1d(width, width, 1)

    def forward(self, x: Tensor) -> Tensor:
        h = self.norm(x.transpose(1, 2)).transpose(1, 2)
        mixed: Tensor = self.mix(nn.functional.silu(self.conv(h)))
        return x + mixed


def _tower(width: int, depth: int, outputs: int) -> nn.Sequential:
    """(B, 263, T) to (B, outputs, T / 8)."""
    return nn.Sequential(
        nn.Conv1d(FEATURES, width, 8, stride=4, padding=2),
        *(ResidualBlock(width) for _ in range(depth)),
        nn.Conv1d(width, width, 4, stride=2, padding=1),
        *(ResidualBlock(width) for _ in range(depth)),
        nn.Conv1d(width, outputs, 1),
    )


class MotionVae(nn.Module):
    """Normalised features (B, T, 263) to latent tokens (B, T / 8, latent) and back."""

    def __init__(self, options: VaeOptions) -> None:
        super().__init__()
        width = options.width
        self.encoder = _tower(width, options.depth, 2 * options.latent)
        self.decoder = nn.Sequential(
            nn.Conv1d(options.latent, width, 1),
            *(ResidualBlock(width) for _ in range(options.depth)),
            nn.ConvTranspose1d(width, width, 4, stride=2, padding=1),
            *(ResidualBlock(width) for _ in range(options.depth)),
            nn.ConvTranspose1d(width, FEATURES, 8, stride=4, padding=2),
        )

    def encode(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance (B, N, latent) of the tokens."""
        mean, log_variance = self.encoder(features.transpose(1, 2)).chunk(2, dim=1)
        return mean.transpose(1, 2), log_variance.transpose(1, 2).clamp(-12.0, 6.0)

    def decode(self, latents: Tensor) -> Tensor:
        """Normalised features (B, 8 N, 263) of tokens (B, N, latent)."""
        features: Tensor = self.decoder(latents.transpose(1, 2)).transpose(1, 2)
        return features


class Denoiser(nn.Module):
    """A transformer over latent tokens, told the time, the text and the guidance wanted.

    It predicts v = α ε − σ z₀ (T. Salimans, J. Ho, "Progressive Distillation for Fast Sampling of
    Diffusion Models", ICLR 2022). A text of zeros means no text. The guidance is heard by the
    student only (MotionLCM, arXiv 2404.19759); the teacher is told 0.
    """

    def __init__(self, options: DiffusionOptions, latent: int, text: int) -> None:
        super().__init__()
        width = options.width
        self.width = width
        self.enter = nn.Linear(latent, width)
        self.place = nn.Parameter(0.02 * torch.randn(MAX_TOKENS + 1, width))
        self.time = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))
        self.guidance = nn.Linear(width, width, bias=False)
        self.text = nn.Linear(text, width)
        self.number = nn.Embedding(MAX_TOKENS + 1, width)
        layer = nn.TransformerEncoderLayer(
            width, options.heads, 3 * width, 0.0, "gelu", batch_first=True, norm_first=True
        )
        self.layers = nn.TransformerEncoder(layer, options.layers, enable_nested_tensor=False)
        self.leave = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, latent))
        nn.init.zeros_(self.guidance.weight)

    def forward(
        self, z: Tensor, time: Tensor, text: Tensor, number: Tensor, guidance: Tensor
    ) -> Tensor:
        """Args: z (B, N, latent), time in [0, 1] (B,), text (B, E), tokens in use (B,),
        guidance (B,). Returns v (B, N, latent); rows past the tokens in use mean nothing."""
        said = self.text(text)
        told = self.time(_waves(1000.0 * time, self.width)) + self.number(number)
        told = told + self.guidance(_waves(100.0 * guidance, self.width))
        tokens = torch.cat([said[:, None], self.enter(z)], dim=1)
        tokens = tokens + self.place[: tokens.shape[1]] + (told + said)[:, None]
        unused = torch.arange(tokens.shape[1], device=z.device) > number[:, None]
        v: Tensor = self.leave(self.layers(tokens, src_key_padding_mask=unused)[:, 1:])
        return v


class LengthHead(nn.Module):
    """How many latent tokens a text takes: logits over 0 to the most."""

    def __init__(self, text: int, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(text, width), nn.SiLU(), nn.Linear(width, MAX_TOKENS + 1)
        )

    def forward(self, text: Tensor) -> Tensor:
        logits: Tensor = self.layers(text)
        return logits


class Evaluator(nn.Module):
    """Texts and motions in one space, near where they belong together."""

    def __init__(self, options: EvaluatorOptions, text: int) -> None:
        super().__init__()
        self.tower = _tower(options.width, 2, options.width)
        self.motion_out = nn.Linear(2 * options.width, options.features)
        self.text_out = nn.Sequential(
            nn.Linear(text, 2 * options.width),
            nn.SiLU(),
            nn.Linear(2 * options.width, options.features),
        )

    def motions(self, features: Tensor, lengths: Tensor) -> Tensor:
        """(B, D) unit vectors of normalised features (B, T, 263) of so many frames (B,)."""
        h = nn.functional.silu(self.tower(features.transpose(1, 2)))
        used = torch.arange(h.shape[2], device=h.device) * FRAMES_PER_TOKEN < lengths[:, None]
        mask = used[:, None].to(h.dtype)
        mean = (h * mask).sum(dim=2) / mask.sum(dim=2)
        peak = (h - 1e9 * (1.0 - mask)).amax(dim=2)
        return nn.functional.normalize(self.motion_out(torch.cat([mean, peak], dim=1)), dim=1)

    def texts(self, text: Tensor) -> Tensor:
        """(B, D) unit vectors of sentence vectors (B, E)."""
        return nn.functional.normalize(self.text_out(text), dim=1)


def _waves(values: Tensor, width: int) -> Tensor:
    """(B, width) sines and cosines of values (B,) at frequencies from 1 to 1e-4."""
    half = width // 2
    frequency = torch.exp(
        -math.log(1e4) * torch.arange(half, device=values.device, dtype=values.dtype) / half
    )
    angle = values[:, None] * frequency
    waves = torch.cat([angle.cos(), angle.sin()], dim=1)
    return nn.functional.pad(waves, (0, width - 2 * half))
