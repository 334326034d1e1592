"""Where a training stands: networks, data, checkpoint, and the loop that all stages share.

What a step draws follows from (seed, stage, step), so a training that was interrupted goes on to
the same weights.
"""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.motion.learned.batches import TextTable
from robomirror_drake.motion.learned.dataset import fingerprint, load_split
from robomirror_drake.motion.learned.networks import Denoiser, Evaluator, LengthHead, MotionVae
from robomirror_drake.motion.learned.options import StageOptions, TrainOptions

STAGES = ("vae", "diffusion", "consistency", "evaluator")
Report = Callable[[str, int, int, float], None]
"""Told stage, steps done, steps in all, and the loss."""

_WARMUP = 100
_LOG_EVERY = 20


class Networks(nn.Module):
    """All that is trained; teacher and target follow denoiser and student slowly."""

    def __init__(self, options: TrainOptions, text: int) -> None:
        super().__init__()
        self.vae = MotionVae(options.vae)
        self.denoiser = Denoiser(options.diffusion, options.vae.latent, text)
        self.length = LengthHead(text, options.diffusion.width)
        self.evaluator = Evaluator(options.evaluator, text)
        self.teacher = copy.deepcopy(self.denoiser)
        self.student = copy.deepcopy(self.denoiser)
        self.target = copy.deepcopy(self.denoiser)


class Training:
    """The networks of one training and where it stands."""

    def __init__(self, options: TrainOptions) -> None:
        """Loads data and, where the folder has one, the checkpoint.

        Raises:
            MotionFileError: The data cannot be used.
            ConfigError: The checkpoint was begun with other settings or data.
        """
        if options.device == "cuda" and not torch.cuda.is_available():
            raise ConfigError("device is cuda, and there is none here; train on the cpu")
        self.options = options
        self.device = torch.device(options.device)
        self.motions = load_split(options.data, "train")
        self.texts = TextTable(self.motions, options.text_encoder, self.device)
        with torch.random.fork_rng():
            torch.manual_seed(options.seed)
            size = self.texts.size
            self.networks = Networks(options, size).to(self.device)
        self.latent_scale = torch.ones(2, options.vae.latent, device=self.device)  # mean, deviation
        self.stage, self.step = 0, 0
        self.header = {
            "options": options.model_dump(
                mode="json", exclude={"data", "out", "device", "start_from"}
            ),
            "data_fingerprint": fingerprint(self.motions),
            "motions": len(self.motions),
            "text_size": size,
        }
        self._pending: dict[str, Tensor] = {}
        options.out.mkdir(parents=True, exist_ok=True)
        if self._path.exists():
            self._resume()
        elif options.start_from is not None:
            tensors, header = checkpoint.load(options.start_from)
            checkpoint.restore("networks", self.networks, tensors)
            self.header["started_from"] = header.get("data_fingerprint", "")

    @property
    def _path(self) -> Path:
        return self.options.out / "checkpoint.safetensors"

    def save(self, optimizer: torch.optim.Optimizer) -> None:
        """Writes a checkpoint."""
        tensors = checkpoint.named("networks", self.networks) | {"latent_scale": self.latent_scale}
        tensors |= checkpoint.named_optimizer(optimizer)
        place = {"stage": self.stage, "step": self.step}
        checkpoint.save(self._path, tensors, self.header | place)

    def _resume(self) -> None:
        tensors, header = checkpoint.load(self._path)
        if "started_from" in header:
            self.header["started_from"] = header["started_from"]
        for key, value in self.header.items():
            if header.get(key) != value:
                raise ConfigError(
                    f"{self._path} was begun with other {key.replace('_', ' ')}; "
                    "continue with the same, or name another folder"
                )
        checkpoint.restore("networks", self.networks, tensors)
        self.latent_scale = tensors["latent_scale"].to(self.device)
        self.stage, self.step = header["stage"], header["step"]
        self._pending = tensors

    def fit(
        self,
        stage: StageOptions,
        trained: list[nn.Module],
        loss_of: Callable[[np.random.Generator, torch.Generator], Tensor],
        report: Report,
        after: Callable[[], None] = lambda: None,
    ) -> None:
        """The loop of a stage: AdamW, warm-up, cosine decay, checkpoints."""
        parameters = [p for module in trained for p in module.parameters()]
        optimizer = torch.optim.AdamW(parameters, lr=stage.learning_rate, weight_decay=1e-2)
        if self._pending:
            checkpoint.restore_optimizer(optimizer, self._pending)
            self._pending = {}
        name = STAGES[self.stage]
        while self.step < stage.steps:
            rng = np.random.default_rng((self.options.seed, self.stage, self.step))
            generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
            for group in optimizer.param_groups:
                group["lr"] = stage.learning_rate * _schedule(self.step, stage.steps)
            loss = loss_of(rng, generator)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(parameters, 1.0)
            optimizer.step()
            after()
            self.step += 1
            if self.step % _LOG_EVERY == 0 or self.step == stage.steps:
                report(name, self.step, stage.steps, float(loss.detach()))
                self._log(name, float(loss.detach()))
            if self.step % self.options.checkpoint_every == 0 and self.step < stage.steps:
                self.save(optimizer)
        self.stage, self.step = self.stage + 1, 0
        self.save(torch.optim.AdamW(parameters))

    def _log(self, stage: str, loss: float) -> None:
        with (self.options.out / "log.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps({"stage": stage, "step": self.step, "loss": loss}) + "\n")


def _schedule(step: int, steps: int) -> float:
    warm = min(_WARMUP, max(steps // 10, 1))
    if step < warm:
        return (step + 1) / warm
    return 0.05 + 0.95 * 0.5 * (1.0 + math.cos(math.pi * (step - warm) / max(steps - warm, 1)))
