"""How generated motions compare with recorded ones, as the field defines it.

Source: C. Guo et al., "Generating Diverse and Natural 3D Human Motions from Text", CVPR 2022
(R-precision, FID, diversity, multimodality), which MotionLCM (arXiv 2404.19759) follows;
K. Karunratanakul et al., "Guided Motion Diffusion", ICCV 2023 (foot skating ratio).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import sqrtm

from robomirror_drake.messages import Array
from robomirror_drake.motion.skeleton import INDEX

POOL = 32
"""Texts among which a motion has to find its own."""
SKATE_HEIGHT, SKATE_STEP = 0.05, 0.025
"""A foot lower than this [m] that moves further than that in 50 ms [m] skates."""

_TOES = [INDEX["left_foot"], INDEX["right_foot"]]


def r_precision(texts: Array, motions: Array, top: int) -> float:
    """Share of motions (n, D) whose text (n, D) is among the nearest ``top`` of all n texts."""
    distance = np.linalg.norm(motions[:, None] - texts[None], axis=-1)
    own = np.diag(distance)[:, None]
    return float(((distance < own).sum(axis=1) < top).mean())


def matching_distance(texts: Array, motions: Array) -> float:
    """Mean distance of a motion (n, D) to its text (n, D)."""
    return float(np.linalg.norm(texts - motions, axis=1).mean())


def diversity(motions: Array, pairs: int, rng: np.random.Generator) -> float:
    """Mean distance in pairs of different motions (n, D), drawn at random.

    Of motions of one text it is their share in the multimodality, which is the mean over texts.
    """
    first = rng.integers(len(motions), size=pairs)
    second = (first + rng.integers(1, len(motions), size=pairs)) % len(motions)
    return float(np.linalg.norm(motions[first] - motions[second], axis=1).mean())


def frechet_distance(real: Array, generated: Array) -> float:
    """FID: distance of two normal distributions fitted to features (n, D) and (m, D).

    M. Heusel et al., "GANs Trained by a Two Time-Scale Update Rule …", NeurIPS 2017.
    """
    shift = real.mean(axis=0) - generated.mean(axis=0)
    a, b = np.cov(real, rowvar=False), np.cov(generated, rowvar=False)
    root = np.real(sqrtm(a @ b))
    return float(shift @ shift + np.trace(a) + np.trace(b) - 2.0 * np.trace(root))


def foot_skate(positions: Array, fps: float) -> float:
    """Share of frames of (T, 22, 3) [m], y up, in which a low foot slides."""
    toes = positions[:, _TOES]
    step = np.linalg.norm(np.diff(toes[..., [0, 2]], axis=0), axis=-1) * fps / 20.0
    height = toes[..., 1] - toes[..., 1].min()
    low = (height[1:] < SKATE_HEIGHT) & (height[:-1] < SKATE_HEIGHT)
    return float((low & (step > SKATE_STEP)).any(axis=1).mean())
