"""Measure a trained generator on its test split, with the networks trained apart for that."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError, InputError
from robomirror_drake.messages import Array
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.humanml_features import FPS, recover_from_ric, to_features
from robomirror_drake.motion.learned import metrics
from robomirror_drake.motion.learned.batches import padded
from robomirror_drake.motion.learned.dataset import Normalizer, load_split
from robomirror_drake.motion.learned.generator import LearnedGenerator, weights_file
from robomirror_drake.motion.learned.networks import Evaluator
from robomirror_drake.motion.learned.options import PACKAGED, EvaluatorOptions, SamplingOptions
from robomirror_drake.motion.learned.texts import sentence_vectors

_BATCH = 32


class EvaluateOptions(BaseModel):
    """How much is generated and drawn."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    repeats: int = Field(10, ge=2, description="draws of pools and pairs")
    pairs: int = Field(300, ge=1, description="pairs of motions for the diversity")
    texts: int = Field(24, ge=2, description="texts for the multimodality")
    each: int = Field(10, ge=2, description="motions of each of these texts")
    limit: int = Field(2000, ge=32, description="test motions at most")
    seed: int = Field(0, ge=0, description="of everything that is drawn")


class EvaluatorNetworks:
    """``evaluator.safetensors``: texts and motions as points in one space."""

    def __init__(self, path: Path) -> None:
        """Raises ConfigError where the file is missing, damaged or not an evaluator's."""
        tensors, header = checkpoint.load(path)
        try:
            options = EvaluatorOptions.model_validate(header["options"]["evaluator"])
            self.encoder = str(header["options"]["text_encoder"])
            self._network = Evaluator(options, int(header["text_size"]))
            self.normalizer = Normalizer(tensors["mean"].numpy(), tensors["std"].numpy())
        except (KeyError, ValueError) as error:
            raise ConfigError(f"{path}: no weights of an evaluator: {error}") from error
        checkpoint.restore("evaluator", self._network, tensors)
        self._network.eval().requires_grad_(False)

    def texts(self, sentences: list[str]) -> Array:
        """(n, D) points of sentences."""
        points = self._network.texts(sentence_vectors(sentences, self.encoder))
        return np.asarray(points.numpy(), dtype=np.float64)

    def motions(self, features: list[Array]) -> Array:
        """(n, D) points of motions, each (T, 263) in its own units."""
        points = []
        for start in range(0, len(features), _BATCH):
            batch, lengths = padded(
                [self.normalizer.to(f) for f in features[start : start + _BATCH]]
            )
            points.append(self._network.motions(batch, lengths).numpy())
        return np.concatenate(points).astype(np.float64)


def load_evaluator(weights: str = PACKAGED) -> EvaluatorNetworks:
    """The evaluator that was trained along with those weights of a generator.

    Raises:
        ConfigError: The file is missing, damaged, or not an evaluator's.
    """
    return EvaluatorNetworks(weights_file(checkpoint.EVALUATOR_FILE, weights))


def evaluate(
    generator: LearnedGenerator,
    evaluator: EvaluatorNetworks,
    data: Path,
    sampling: SamplingOptions,
    options: EvaluateOptions,
    report: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Figures of the test split as it is (``real``) and as generated from its texts.

    Motions that share their captions are one command; pools for the R-precision hold different
    commands only. Means over the repeats, each with half its 95 % interval.

    Raises:
        MotionFileError: The data cannot be used.
        InputError: The test split has fewer than 32 commands.
    """
    rng = np.random.default_rng(options.seed)
    motions = load_split(data, "test")[: options.limit]
    commands = [" / ".join(sorted(set(motion.captions))) for motion in motions]
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(commands):
        groups.setdefault(name, []).append(i)
    if len(groups) < metrics.POOL:
        raise InputError(f"the test split has {len(groups)} commands; {metrics.POOL} are needed")
    captions = [str(rng.choice(motion.captions)) for motion in motions]
    many = list(groups)[: options.texts]
    asked = captions + [captions[groups[name][0]] for name in many for _ in range(options.each)]

    made: list[Array] = []
    for start in range(0, len(asked), _BATCH):
        part = asked[start : start + _BATCH]
        seeds = [int(rng.integers(2**62)) for _ in part]
        draws = [torch.Generator().manual_seed(s) for s in seeds]
        made += generator.positions(part, draws, sampling)
        report(len(made), len(asked))
    real_features = [evaluator.normalizer.back(motion.features) for motion in motions]
    real = [recover_from_ric(f) for f in real_features]
    points = evaluator.motions([to_features(p) for p in made])
    text_points = evaluator.texts(captions)
    real_points = evaluator.motions(real_features)
    pools = points[len(motions) :].reshape(len(many), options.each, -1)
    same_command = [real_points[members] for members in groups.values() if len(members) > 1]
    found: dict[str, Any] = {
        "commands": len(groups),
        "motions": len(motions),
        "real": _figures(text_points, real_points, real, groups, options, rng),
        "generated": _figures(text_points, points[: len(motions)], made, groups, options, rng),
        "fid": metrics.frechet_distance(real_points, points[: len(motions)]),
    }
    if same_command:
        several = [metrics.diversity(p, options.pairs, rng) for p in same_command]
        found["real"]["multimodality"] = _mean(several)
    alike = [metrics.diversity(p, options.pairs, rng) for p in pools]
    found["generated"]["multimodality"] = _mean(alike)
    return found | {"time": _time(generator, captions[0], sampling)}


def _figures(
    texts: Array,
    points: Array,
    positions: list[Array],
    groups: dict[str, list[int]],
    options: EvaluateOptions,
    rng: np.random.Generator,
) -> dict[str, Any]:
    draws: dict[str, list[float]] = {f"r_precision_top{k}": [] for k in (1, 2, 3)}
    draws |= {"matching_distance": [], "diversity": []}
    for _ in range(options.repeats):
        pools = [_pool(groups, rng) for _ in range(max(len(positions) // metrics.POOL, 1))]
        for k in (1, 2, 3):
            share = [metrics.r_precision(texts[pool], points[pool], k) for pool in pools]
            draws[f"r_precision_top{k}"].append(float(np.mean(share)))
        draws["matching_distance"].append(metrics.matching_distance(texts, points))
        draws["diversity"].append(metrics.diversity(points, options.pairs, rng))
    figures = {name: _mean(values) for name, values in draws.items()}
    figures["foot_skate"] = _mean([metrics.foot_skate(p, FPS) for p in positions])
    lengths = [bone_lengths(p) for p in positions]
    figures["bone_drift"] = _mean([float((b.std(axis=0) / b.mean(axis=0)).max()) for b in lengths])
    figures["penetration"] = _mean([float(max(0.0, -p[..., 1].min())) for p in positions])
    return figures


def _pool(groups: dict[str, list[int]], rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """(32,) motions of different commands."""
    members = list(groups.values())
    drawn = rng.choice(len(members), metrics.POOL, replace=False)
    return np.array([rng.choice(members[i]) for i in drawn])


def _mean(values: list[float]) -> dict[str, float]:
    half = 1.96 * float(np.std(values, ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else 0.0
    return {"mean": float(np.mean(values)), "ci95": float(half)}


def _time(generator: LearnedGenerator, text: str, sampling: SamplingOptions) -> dict[str, float]:
    """Time of 8 candidates with one thread [s]: medians of 9, by the clock and of the core."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    spent = []
    for k in range(10):
        draws = [torch.Generator().manual_seed(8 * k + i) for i in range(8)]
        start = time.perf_counter(), time.process_time()
        generator.positions([text] * 8, draws, sampling)
        spent.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    torch.set_num_threads(threads)
    clock, core = np.median(spent[1:], axis=0)  # the first one warms up
    return {"candidates": 8.0, "median_s": float(clock), "core_s": float(core)}
