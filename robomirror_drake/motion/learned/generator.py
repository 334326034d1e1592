"""Candidates from the trained generator: text to human motions in a few network evaluations."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError, UnknownCommandError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.ground import ground, z_up
from robomirror_drake.motion.humanml_features import FPS, recover_from_ric
from robomirror_drake.motion.learned.dataset import Normalizer
from robomirror_drake.motion.learned.diffusion import sample
from robomirror_drake.motion.learned.feet import make_whole
from robomirror_drake.motion.learned.networks import (
    FRAMES_PER_TOKEN,
    MAX_TOKENS,
    Denoiser,
    LengthHead,
    MotionVae,
)
from robomirror_drake.motion.learned.options import (
    PACKAGED,
    DiffusionOptions,
    SamplingOptions,
    VaeOptions,
)
from robomirror_drake.motion.learned.texts import sentence_vectors
from robomirror_drake.motion.resample import resample

LEAST_LIKENESS = 0.45
"""Cosine to the nearest caption trained on from which a command counts as known."""

_LEAST_TOKENS = 3  # 1.2 s


class LearnedGenerator:
    """The networks of ``generator.safetensors``, ready to be asked."""

    def __init__(self, path: Path) -> None:
        """Loads the weights.

        Raises:
            ConfigError: The file is missing, damaged, or not a generator's.
        """
        tensors, self.header = checkpoint.load(path)
        try:
            settings = self.header["options"]
            vae = VaeOptions.model_validate(settings["vae"])
            diffusion = DiffusionOptions.model_validate(settings["diffusion"])
            text = int(self.header["text_size"])
            self._encoder = str(settings["text_encoder"])
            self._normalizer = Normalizer(tensors["mean"].numpy(), tensors["std"].numpy())
            self._shift, self._scale = tensors["latent_scale"]
            self._known, self._said = tensors["known"], list(map(str, self.header["known"]))
            self._bones = tensors["bones"].numpy().astype(float)
        except (KeyError, ValueError) as error:
            raise ConfigError(f"{path}: no weights of a motion generator: {error}") from error
        self._latent = vae.latent
        self._vae = MotionVae(vae)
        self._student = Denoiser(diffusion, vae.latent, text)
        self._length = LengthHead(text, diffusion.width)
        for name, module in self._modules().items():
            checkpoint.restore(name, module, tensors)
            module.eval().requires_grad_(False)
        self.name = path.stem if path.parent.name == "" else f"{path.parent.name}/{path.stem}"

    def _modules(self) -> dict[str, nn.Module]:
        return {"vae": self._vae, "student": self._student, "length": self._length}

    def positions(
        self, texts: list[str], generators: list[torch.Generator], options: SamplingOptions
    ) -> list[Array]:
        """Joint positions (T, 22, 3) [m], y up, at 20 fps, of a motion for each text.

        Each motion's length and noise come from a random generator of its own.
        """
        unique = sorted(set(texts))
        rows = [unique.index(text) for text in texts]
        text = sentence_vectors(unique, self._encoder)[rows]
        number = self._draw_tokens(text, generators)

        def noise() -> Tensor:
            shape = (int(number.max()), self._latent)
            return torch.stack([torch.randn(shape, generator=g) for g in generators])

        with torch.no_grad():
            latents = sample(self._student, noise, text, number, options.guidance, options.steps)
            used = torch.arange(latents.shape[1]) < number[:, None]
            last = latents[torch.arange(len(number)), number - 1]
            latents = torch.where(used[..., None], latents, last[:, None])
            features = self._vae.decode(latents * self._scale + self._shift).numpy()
        joints = recover_from_ric(self._normalizer.back(features))
        whole = make_whole(joints, self._bones, FPS)
        return [w[: n * FRAMES_PER_TOKEN] for w, n in zip(whole, number.tolist(), strict=True)]

    def check_known(self, text: str) -> None:
        """Raises UnknownCommandError where a text is far from all that was trained on."""
        vector = nn.functional.normalize(sentence_vectors([text], self._encoder)[0], dim=0)
        cosine = self._known @ vector
        if cosine.max() < LEAST_LIKENESS:
            nearest = cosine.topk(min(3, len(cosine))).indices.tolist()
            raise UnknownCommandError(text, [self._said[i] for i in nearest])

    @torch.no_grad()
    def _draw_tokens(self, text: Tensor, generators: list[torch.Generator]) -> Tensor:
        """(B,) latent tokens of each motion, drawn as often as the data have them."""
        share = self._length(text).softmax(dim=1)
        share[:, :_LEAST_TOKENS] = 0.0
        # Rare lengths at the tails are the head's uncertainty rather than the data's.
        share[share < 0.02 * share.amax(dim=1, keepdim=True)] = 0.0
        drawn = [
            torch.multinomial(row, 1, generator=g) for row, g in zip(share, generators, strict=True)
        ]
        return torch.cat(drawn).clamp(max=MAX_TOKENS)


def weights_file(name: str, weights: str = PACKAGED) -> Path:
    """A file of the packaged weights, or the one beside weights of the user's own."""
    if weights != PACKAGED:
        return Path(weights) if name == checkpoint.GENERATOR_FILE else Path(weights).with_name(name)
    with resources.as_file(resources.files("robomirror_drake.assets") / "generator") as folder:
        return folder / name


@cache
def load_generator(weights: str = PACKAGED) -> LearnedGenerator:
    """The generator of that file, loaded once.

    Raises:
        ConfigError: The file is missing, damaged, or not a generator's.
    """
    return LearnedGenerator(weights_file(checkpoint.GENERATOR_FILE, weights))


def generate_learned(
    text: str, indices: list[int], seed: int, fps: float, options: SamplingOptions
) -> tuple[HumanMotion, ...]:
    """Candidates of a command by the trained networks: the same request gives the same bytes.

    Args:
        text: The command, in English.
        indices: Numbers of the candidates; each draws from (seed, its number).
        seed: Not negative.
        fps: Frames per second of the motions.
        options: Weights and sampling.

    Raises:
        ConfigError: The weights cannot be used.
        UnknownCommandError: The text is far from all that they were trained on.
    """
    model = load_generator(options.weights)
    model.check_known(text)
    generators = [
        torch.Generator().manual_seed(int(np.random.default_rng((seed, k)).integers(2**62)))
        for k in indices
    ]
    found = model.positions([text] * len(indices), generators, options)
    return tuple(
        resample(
            HumanMotion(
                positions=ground(z_up(positions, "y")),
                fps=FPS,
                text=text,
                source=f"learned:{model.name} seed {seed} candidate {k}",
                style={"guidance": options.guidance, "steps": float(options.steps)},
            ),
            fps,
        )
        for k, positions in zip(indices, found, strict=True)
    )
