"""Train the generator: motion VAE, latent diffusion, its few-step student, and the evaluator.

Four stages in a row, each a loss and a plain loop.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from robomirror_drake import checkpoint
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.humanml_features import FEATURES, JOINTS, ROOT, recover_from_ric
from robomirror_drake.motion.learned.batches import LatentTable, crop, padded
from robomirror_drake.motion.learned.dataset import (
    Float32,
    Normalizer,
    TextMotion,
    load_normalizer,
)
from robomirror_drake.motion.learned.diffusion import (
    LAST,
    add_noise,
    consistency,
    ddim,
    guided,
    velocity,
)
from robomirror_drake.motion.learned.options import TrainOptions
from robomirror_drake.motion.learned.training import STAGES, Report, Training

_ROOT_WEIGHT, _JOINT_WEIGHT = 5.0, 2.0  # the root's errors add up over time
_TEACHER_DECAY = 0.999
_KNOWN_CAPTIONS = 512  # kept with the weights, to tell what they know


def train(options: TrainOptions, report: Report = lambda *_: None) -> Path:
    """Trains a generator, or goes on with it; see the module.

    Returns:
        The folder with ``generator.safetensors`` and ``evaluator.safetensors``.

    Raises:
        MotionFileError: The data set cannot be used.
        ConfigError: The folder holds a checkpoint of another training.
    """
    training = Training(options)
    while training.stage < len(STAGES):
        _RUN[STAGES[training.stage]](training, report)
    normalizer = load_normalizer(options.data)
    common = {"mean": torch.from_numpy(normalizer.mean), "std": torch.from_numpy(normalizer.std)}
    generator = common | {
        "latent_scale": training.latent_scale,
        "bones": torch.from_numpy(_bones(training.motions, normalizer)),
    }
    known = training.texts.spread(_KNOWN_CAPTIONS)
    generator["known"] = nn.functional.normalize(training.texts.vectors[known], dim=1)
    said = {"known": [training.texts.captions[i] for i in known]}
    networks = training.networks
    for name, module in (("vae", networks.vae), ("student", networks.student),
                         ("length", networks.length)):  # fmt: skip
        generator |= checkpoint.named(name, module)
    checkpoint.save(
        options.out / checkpoint.GENERATOR_FILE, _half(generator), training.header | said
    )
    evaluator = common | checkpoint.named("evaluator", networks.evaluator)
    checkpoint.save(options.out / checkpoint.EVALUATOR_FILE, _half(evaluator), training.header)
    return options.out


def _train_vae(training: Training, report: Report) -> None:
    options, vae = training.options.vae, training.networks.vae
    weight = torch.ones(FEATURES, device=training.device)
    weight[ROOT], weight[JOINTS] = _ROOT_WEIGHT, _JOINT_WEIGHT

    def loss_of(rng: np.random.Generator, generator: torch.Generator) -> Tensor:
        crops = [crop(training.motions[i].features, options.window, rng)
                 for i in rng.integers(len(training.motions), size=options.batch)]  # fmt: skip
        features = torch.from_numpy(np.stack(crops)).to(training.device)
        mean, log_variance = vae.encode(features)
        noise = torch.randn(mean.shape, generator=generator).to(mean)
        back = vae.decode(mean + noise * (0.5 * log_variance).exp())
        error = functional.smooth_l1_loss(back, features, reduction="none")
        divergence = 0.5 * (mean**2 + log_variance.exp() - 1.0 - log_variance).mean()
        return (error * weight).mean() + options.kl * divergence

    training.fit(options, [vae], loss_of, report)


def _train_diffusion(training: Training, report: Report) -> None:
    options, networks = training.options.diffusion, training.networks
    denoiser, length, teacher = networks.denoiser, networks.length, networks.teacher
    latents = LatentTable(networks.vae, training.motions, training.texts)
    training.latent_scale = latents.scale()

    def loss_of(rng: np.random.Generator, generator: torch.Generator) -> Tensor:
        clean, number, text = latents.batch(options.batch, training.latent_scale, rng, generator)
        time = _uniform(rng, len(clean), training.device)
        noise = torch.randn(clean.shape, generator=generator).to(clean)
        kept = torch.from_numpy(rng.random(len(clean)) >= options.drop_text).to(text)
        v = denoiser(add_noise(clean, noise, time), time, text * kept[:, None], number, 0.0 * time)
        logits = length(text)
        return _masked(
            (v - velocity(clean, noise, time)) ** 2, number
        ) + 0.1 * functional.cross_entropy(logits, number)

    training.fit(
        options, [denoiser, length], loss_of, report,
        after=lambda: _follow(teacher, denoiser, _TEACHER_DECAY),
    )  # fmt: skip


def _train_consistency(training: Training, report: Report) -> None:
    options, networks = training.options.consistency, training.networks
    student, target, teacher = networks.student, networks.target, networks.teacher
    if training.step == 0:
        for module in (student, target):
            module.load_state_dict(teacher.state_dict())
    latents = LatentTable(networks.vae, training.motions, training.texts)
    span = LAST / options.solver_steps

    def loss_of(rng: np.random.Generator, generator: torch.Generator) -> Tensor:
        clean, number, text = latents.batch(options.batch, training.latent_scale, rng, generator)
        draw = rng.integers(1, options.solver_steps + 1, size=len(clean))
        time = torch.from_numpy((span * draw).astype(np.float32)).to(training.device)
        earlier = time - span
        low, high = options.guidance_low, options.guidance_high
        guidance = low + (high - low) * _uniform(rng, len(clean), training.device)
        z = add_noise(clean, torch.randn(clean.shape, generator=generator).to(clean), time)
        with torch.no_grad():
            v = guided(teacher, z, time, text, number, guidance)
            aim = consistency(
                target, ddim(z, v, time, earlier), earlier.clamp(min=0.0), text, number, guidance
            )
        error = consistency(student, z, time, text, number, guidance) - aim
        return _masked((error**2 + 1e-6).sqrt() - 1e-3, number)

    training.fit(
        options, [student], loss_of, report,
        after=lambda: _follow(target, student, options.ema),
    )  # fmt: skip


def _train_evaluator(training: Training, report: Report) -> None:
    options, evaluator = training.options.evaluator, training.networks.evaluator
    motions = training.motions

    def loss_of(rng: np.random.Generator, _: torch.Generator) -> Tensor:
        chosen = rng.integers(len(motions), size=options.batch)
        features, lengths = padded([motions[i].features for i in chosen])
        said = [training.texts.draw(int(i), rng) for i in chosen]
        rows = torch.tensor(said, device=training.device)
        moved = evaluator.motions(features.to(training.device), lengths.to(training.device))
        told = evaluator.texts(training.texts.vectors[rows])
        logits = told @ moved.T / options.temperature
        same = (rows[:, None] == rows) & ~torch.eye(len(rows), dtype=torch.bool, device=rows.device)
        logits = logits.masked_fill(same, -1e4)  # who says the same is not a wrong answer
        right = torch.arange(len(rows), device=rows.device)
        return 0.5 * (
            functional.cross_entropy(logits, right) + functional.cross_entropy(logits.T, right)
        )

    training.fit(options, [evaluator], loss_of, report)


_RUN: dict[str, Callable[[Training, Report], None]] = {
    "vae": _train_vae,
    "diffusion": _train_diffusion,
    "consistency": _train_consistency,
    "evaluator": _train_evaluator,
}


def _masked(error: Tensor, number: Tensor) -> Tensor:
    """Mean of (B, N, latent) over the tokens in use."""
    used = (torch.arange(error.shape[1], device=error.device) < number[:, None])[..., None]
    return (error * used).sum() / (used.sum() * error.shape[2])


def _uniform(rng: np.random.Generator, size: int, device: torch.device) -> Tensor:
    return torch.from_numpy(rng.random(size, dtype=np.float32)).to(device)


@torch.no_grad()
def _follow(target: nn.Module, source: nn.Module, decay: float) -> None:
    """Moves the target's weights towards the source's."""
    for to, of in zip(target.parameters(), source.parameters(), strict=True):
        to.lerp_(of, 1.0 - decay)


def _bones(motions: tuple[TextMotion, ...], normalizer: Normalizer) -> Float32:
    """(21,) median length of the bone that ends at each joint but the pelvis [m]."""
    frames = np.concatenate([motion.features[::20] for motion in motions])
    positions = recover_from_ric(normalizer.back(frames)[:, None])[:, 0]
    return np.median(bone_lengths(positions), axis=0).astype(np.float32)


def _half(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Networks in half precision, which loses nothing that can be seen; scales as they are."""
    keep = {"mean", "std", "latent_scale", "bones"}
    return {name: t if name in keep else t.half() for name, t in tensors.items()}
