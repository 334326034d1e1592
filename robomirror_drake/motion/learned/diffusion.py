"""Diffusion in the latent space: noise schedule, DDIM, consistency function, sampling in few steps.

Sources: A. Nichol, P. Dhariwal, "Improved Denoising Diffusion Probabilistic Models", ICML 2021
(cosine schedule); J. Ho, T. Salimans, "Classifier-Free Diffusion Guidance", 2022; S. Luo et al.,
"Latent Consistency Models", arXiv 2310.04378; W. Dai et al., "MotionLCM", arXiv 2404.19759.

Time t runs from 0 (data) to 1 (noise): z_t = α_t z₀ + σ_t ε with α_t = cos(πt/2), σ_t = sin(πt/2).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from robomirror_drake.motion.learned.networks import Denoiser

LAST = 0.999
"""Where sampling starts: close to noise alone, and never without a trace of data."""
_SIGMA_DATA = 0.5
_TIME_SCALE = 1e4


def alpha_sigma(time: Tensor) -> tuple[Tensor, Tensor]:
    """α and σ of times (B,), shaped (B, 1, 1)."""
    angle = 0.5 * math.pi * time[:, None, None]
    return angle.cos(), angle.sin()


def add_noise(latents: Tensor, noise: Tensor, time: Tensor) -> Tensor:
    """z_t of z₀ and ε (B, N, latent) at times (B,)."""
    alpha, sigma = alpha_sigma(time)
    return alpha * latents + sigma * noise


def velocity(latents: Tensor, noise: Tensor, time: Tensor) -> Tensor:
    """v = α ε − σ z₀, what the denoiser learns."""
    alpha, sigma = alpha_sigma(time)
    return alpha * noise - sigma * latents


def ddim(z: Tensor, v: Tensor, time: Tensor, earlier: Tensor) -> Tensor:
    """The deterministic step from z_t with its v to an earlier time."""
    alpha, sigma = alpha_sigma(time)
    clean, noise = alpha * z - sigma * v, sigma * z + alpha * v
    return add_noise(clean, noise, earlier)


def guided(
    denoiser: Denoiser, z: Tensor, time: Tensor, text: Tensor, number: Tensor, guidance: Tensor
) -> Tensor:
    """The teacher's v with guidance w: (1 + w) v(text) − w v(no text), in one batch."""
    zero = torch.zeros_like(guidance)
    both = denoiser(
        torch.cat([z, z]), torch.cat([time, time]), torch.cat([text, torch.zeros_like(text)]),
        torch.cat([number, number]), torch.cat([zero, zero]),
    )  # fmt: skip
    with_text, without = both.chunk(2)
    w = guidance[:, None, None]
    v: Tensor = (1.0 + w) * with_text - w * without
    return v


def consistency(
    student: Denoiser, z: Tensor, time: Tensor, text: Tensor, number: Tensor, guidance: Tensor
) -> Tensor:
    """f(z_t, t) = c_skip z_t + c_out ẑ₀: the start of the path that z_t is on; f(z, 0) = z."""
    alpha, sigma = alpha_sigma(time)
    clean = alpha * z - sigma * student(z, time, text, number, guidance)
    scaled = _TIME_SCALE * time[:, None, None]
    skip = _SIGMA_DATA**2 / (scaled**2 + _SIGMA_DATA**2)
    out = scaled / (scaled**2 + _SIGMA_DATA**2).sqrt()
    start: Tensor = skip * z + out * clean
    return start


def sample(
    student: Denoiser,
    noise: Callable[[], Tensor],
    text: Tensor,
    number: Tensor,
    guidance: float,
    steps: int,
) -> Tensor:
    """(B, N, latent) latents in ``steps`` evaluations of the consistency function.

    Args:
        student: The distilled model.
        noise: Draws standard normal numbers (B, N, latent), anew at each call.
        text: (B, E) sentence vectors.
        number: (B,) tokens in use.
        guidance: Strength of the text, within what was trained.
        steps: 1 to 4 are usual.
    """
    latents = torch.zeros(())
    w = torch.full((len(text),), guidance)
    for k in range(steps):
        time = torch.full((len(text),), LAST * (1.0 - k / steps))
        z = noise() if k == 0 else add_noise(latents, noise(), time)
        latents = consistency(student, z, time, text, number, w)
    return latents
