"""Batches for training: texts, crops of motions, padded motions, latent tokens."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn

from robomirror_drake.motion.learned.dataset import Float32, TextMotion
from robomirror_drake.motion.learned.networks import FRAMES_PER_TOKEN, MotionVae
from robomirror_drake.motion.learned.texts import sentence_vectors


class TextTable:
    """Every caption's vector once, and which ones belong to each motion."""

    def __init__(self, motions: tuple[TextMotion, ...], encoder: str, device: torch.device) -> None:
        unique = sorted({caption for motion in motions for caption in motion.captions})
        row = {caption: i for i, caption in enumerate(unique)}
        self.rows = [[row[caption] for caption in motion.captions] for motion in motions]
        self.captions = unique
        self.vectors = sentence_vectors(unique, encoder).to(device)
        self.size = int(self.vectors.shape[1])

    def draw(self, motion: int, rng: np.random.Generator) -> int:
        """Row of one of a motion's captions."""
        rows = self.rows[motion]
        return rows[int(rng.integers(len(rows)))]

    def spread(self, most: int) -> Tensor:
        """Rows of at most so many captions that are far from each other, the first one first."""
        unit = nn.functional.normalize(self.vectors, dim=1)
        rows, nearest = [0], unit @ unit[0]
        while len(rows) < min(most, len(unit)):
            rows.append(int(nearest.argmin()))
            nearest = torch.maximum(nearest, unit @ unit[rows[-1]])
        return torch.tensor(rows)


class LatentTable:
    """Every motion's latent tokens: mean and deviation (N, latent) each."""

    @torch.no_grad()
    def __init__(self, vae: MotionVae, motions: tuple[TextMotion, ...], texts: TextTable) -> None:
        self._texts = texts
        self._tokens: list[tuple[Tensor, Tensor]] = []
        for motion in motions:
            features, _ = padded([motion.features])
            mean, log_variance = vae.encode(features.to(texts.vectors.device))
            self._tokens.append((mean[0], (0.5 * log_variance[0]).exp()))
        self._order = np.argsort([len(mean) for mean, _ in self._tokens], kind="stable")

    def scale(self) -> Tensor:
        """(2, latent) mean and deviation of all tokens."""
        means = torch.cat([mean for mean, _ in self._tokens])
        return torch.stack([means.mean(dim=0), means.std(dim=0) + 1e-4])

    def batch(
        self, size: int, scale: Tensor, rng: np.random.Generator, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Latents (B, N, latent) of about unit variance, tokens in use (B,), text (B, E)."""
        # A window over the motions in order of length saves a third of the time: less padding.
        start = rng.integers(len(self._order))
        window = max(len(self._order) // 4, 1)
        chosen = self._order[(start + rng.integers(window, size=size)) % len(self._order)]
        pad = nn.utils.rnn.pad_sequence
        mean = pad([self._tokens[i][0] for i in chosen], batch_first=True)
        deviation = pad([self._tokens[i][1] for i in chosen], batch_first=True)
        number = torch.tensor([len(self._tokens[i][0]) for i in chosen], device=mean.device)
        noise = torch.randn(mean.shape, generator=generator).to(mean)
        rows = [self._texts.draw(int(i), rng) for i in chosen]
        return (mean + deviation * noise - scale[0]) / scale[1], number, self._texts.vectors[rows]


def padded(motions: list[Float32]) -> tuple[Tensor, Tensor]:
    """(B, T, 263) motions, their last frames repeated to whole tokens, and lengths (B,)."""
    longest = max(math.ceil(len(m) / FRAMES_PER_TOKEN) for m in motions) * FRAMES_PER_TOKEN
    rows = [np.pad(m, ((0, longest - len(m)), (0, 0)), mode="edge") for m in motions]
    return torch.from_numpy(np.stack(rows)), torch.tensor([len(m) for m in motions])


def crop(features: Float32, window: int, rng: np.random.Generator) -> Float32:
    """(window, 263) frames from a random start; a short motion's last frame is repeated."""
    if len(features) < window:
        return np.pad(features, ((0, window - len(features)), (0, 0)), mode="edge")
    start = int(rng.integers(len(features) - window + 1))
    return features[start : start + window]
