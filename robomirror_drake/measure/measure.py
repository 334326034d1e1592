"""Measure text to motion: is it understood, is it human, is it diverse, is it quick."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import yaml
from pydantic import BaseModel, ConfigDict, Field
from threadpoolctl import threadpool_limits

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion import plausibility
from robomirror_drake.motion.generate import GeneratorOptions, generate
from robomirror_drake.motion.language import intent, recognise
from robomirror_drake.motion.learned import metrics
from robomirror_drake.motion.learned.corpus import composer_features
from robomirror_drake.motion.learned.dataset import MAX_FRAMES
from robomirror_drake.motion.learned.evaluate import (
    EvaluateOptions,
    EvaluatorNetworks,
    evaluate,
    load_evaluator,
)
from robomirror_drake.motion.learned.generator import load_generator
from robomirror_drake.motion.learned.options import SamplingOptions
from robomirror_drake.motion.mocap import FEET_ONLY_CLIPS, load_clip
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.sources import SourceOptions

Kind = Literal["composer", "learned"]
Report = Callable[[str, int, int], None]

SHEET_CANDIDATES = 4
"""Candidates of a command on the contact sheet."""
USUAL = (3.0, 5.0)
"""Mean durations of pools whose time is told: those of about 4 s [s]."""


class MeasureOptions(BaseModel):
    """What is measured, and how much of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sentences: str = Field(intent.PACKAGED, description="sentences and their meaning, for intent")
    texts: int = Field(100, ge=2, description="of these sentences, how many get pools")
    candidates: int = Field(8, ge=SHEET_CANDIDATES, le=64, description="motions in a pool")
    sources: tuple[Kind, ...] = Field(("composer", "learned"), min_length=1)
    repeats: int = Field(10, ge=2, description="draws of pairs and of pools of texts")
    pairs: int = Field(300, ge=1, description="pairs of motions for diversity")
    seed: int = Field(0, ge=0, description="of everything that is drawn")
    sampling: SamplingOptions = SamplingOptions()


@dataclass(frozen=True)
class Pool:
    """Candidates of one command, and what they cost.

    Attributes:
        text: The command.
        motions: Its candidates.
        clock_s: Time they took [s].
        core_s: Time that cores worked meanwhile [s].
    """

    text: str
    motions: tuple[HumanMotion, ...]
    clock_s: float
    core_s: float

    @property
    def duration(self) -> float:
        """Mean duration of its motions [s]."""
        return float(np.mean([motion.duration for motion in self.motions]))


def sheet_texts() -> list[str]:
    """The commands of the contact sheet."""
    file = resources.files("robomirror_drake.assets") / "sentences" / "contact_sheet.yaml"
    return [str(text) for text in yaml.safe_load(file.read_text(encoding="utf-8"))]


def measure(
    options: MeasureOptions, data: Path | None = None, report: Report = lambda *_: None
) -> tuple[dict[str, Any], dict[str, list[Pool]]]:
    """All figures, on one thread, and the pools of the contact sheet by their source.

    Args:
        options: What and how much.
        data: A data set in HumanML3D's layout, on whose test split the learned generator is
            measured as well; None for none.
        report: Told the stage, how much of it is done, and of how much.

    Raises:
        InputError: The sentences or the data cannot be used.
        ConfigError: The weights cannot be used.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(limits=1):
            return _measure(options, data, report)
    finally:
        torch.set_num_threads(threads)


def _measure(
    options: MeasureOptions, data: Path | None, report: Report
) -> tuple[dict[str, Any], dict[str, list[Pool]]]:
    sentences = intent.load_sentences(options.sentences)
    evaluator = load_evaluator(options.sampling.weights)
    spread = np.linspace(0, len(sentences) - 1, min(options.texts, len(sentences))).astype(int)
    meanings = dict(sentences[i] for i in spread)
    sheet = sheet_texts()
    sources: dict[str, Any] = {}
    sheets: dict[str, list[Pool]] = {}
    for kind in options.sources:
        texts = list(dict.fromkeys([*meanings, *sheet]))
        pools, refused = make_pools(texts, kind, options, report)
        made = {pool.text: pool for pool in pools}
        own = [pool for pool in pools if pool.text in meanings]
        sheets[kind] = [made[text] for text in sheet if text in made]
        if len(own) < 2:
            raise InputError(f"{options.sentences}: {kind} knows fewer than two of these sentences")
        sources[kind] = {
            "sentences": len(meanings),
            "refused": [text for text in refused if text in meanings],
            "motions": sum(len(pool.motions) for pool in pools),
            **_variety(own, meanings, evaluator, options),
            "quality": quality([m for p in pools for m in p.motions], kind, report),
            "time": _time(pools, options.candidates),
        }
    clips = [load_clip(name) for name in FEET_ONLY_CLIPS]
    figures: dict[str, Any] = {
        "options": options.model_dump(),
        "intent": intent.accuracy(sentences),
        "space": f"motion embedding of the evaluator ({options.sampling.weights} weights)",
        "clips": {"motions": len(clips), "quality": quality(clips, "clips", report)},
        "sources": sources,
    }
    if data is not None:
        figures["test_split"] = evaluate(
            load_generator(options.sampling.weights),
            evaluator,
            data,
            options.sampling,
            EvaluateOptions(seed=options.seed),
            lambda done, total: report("test split", done, total),
        )
    return figures, sheets


def make_pools(
    texts: Sequence[str], kind: Kind, options: MeasureOptions, report: Report = lambda *_: None
) -> tuple[list[Pool], list[str]]:
    """Pools of the commands that a source knows, with their time, and those that it refuses.

    What is loaded once is loaded before; sentences read before are forgotten.
    """
    source = SourceOptions(kind=kind, learned=options.sampling)
    generator = GeneratorOptions(source=source)
    pools, refused = [], []
    generate("a person walks forward", options.candidates, options.seed, generator)
    for number, text in enumerate(texts, start=1):
        recognise.forget()
        start = time.perf_counter(), time.process_time()
        try:
            motions = generate(text, options.candidates, options.seed, generator)
            spent = time.perf_counter() - start[0], time.process_time() - start[1]
            pools.append(Pool(text, motions, *spent))
        except InputError:
            refused.append(text)
        report(f"{kind}: pools", number, len(texts))
    return pools, refused


def quality(
    motions: Sequence[HumanMotion], name: str = "", report: Report = lambda *_: None
) -> dict[str, dict[str, Any]]:
    """Each figure of how human motions move: median, 95th percentile, worst, and whose that is."""
    rows = []
    for number, motion in enumerate(motions, start=1):
        rows.append(plausibility.figures(motion))
        report(f"{name}: quality", number, len(motions))
    found = {}
    for key in rows[0]:
        values = np.array([row[key] for row in rows])
        worst = motions[int(values.argmax())]
        found[key] = {
            "median": float(np.median(values)),
            "p95": float(np.percentile(values, 95)),
            "worst": float(values.max()),
            "worst_is": f"{worst.text} ({worst.source})" if worst.text else worst.source,
        }
    return found


def _variety(
    pools: list[Pool],
    meanings: dict[str, str],
    evaluator: EvaluatorNetworks,
    options: MeasureOptions,
) -> dict[str, Any]:
    """Diversity, multimodality and R-precision of pools, each with half its 95 % interval."""
    rng = np.random.default_rng(options.seed)
    points = [evaluator.motions([_features(m) for m in pool.motions]) for pool in pools]
    texts = evaluator.texts([pool.text for pool in pools])
    every = np.concatenate(points)
    draws: dict[str, list[float]] = {"diversity": [], "multimodality": []}
    several = [p for p in points if len(p) > 1]
    alike: dict[str, list[int]] = {}
    for i, pool in enumerate(pools):
        alike.setdefault(meanings[pool.text], []).append(i)
    for _ in range(options.repeats):
        draws["diversity"].append(metrics.diversity(every, options.pairs, rng))
        within = [metrics.diversity(p, options.candidates, rng) for p in several]
        draws["multimodality"].append(float(np.mean(within)))
        if len(alike) < metrics.POOL:
            continue
        chosen = rng.choice(len(alike), metrics.POOL, replace=False)
        members = [int(rng.choice(list(alike.values())[i])) for i in chosen]
        motions = np.stack([points[i][rng.integers(len(points[i]))] for i in members])
        for top in (1, 2, 3):
            share = metrics.r_precision(texts[members], motions, top)
            draws.setdefault(f"r_precision_top{top}", []).append(share)
    return {name: _mean(values) for name, values in draws.items()}


def _features(motion: HumanMotion) -> Array:
    """(T, 263) features of at most the ten seconds that the evaluator was trained on."""
    return composer_features(resample(motion, plausibility.RATE))[:MAX_FRAMES]


def _time(pools: list[Pool], candidates: int) -> dict[str, Any]:
    """Time of a pool whose motions last about 4 s, from the command to the motions."""
    usual = [pool for pool in pools if USUAL[0] <= pool.duration <= USUAL[1]]
    chosen = usual or pools
    return {
        "candidates": candidates,
        "pools": len(chosen),
        "mean_duration_s": float(np.mean([pool.duration for pool in chosen])),
        "median_s": float(np.median([pool.clock_s for pool in chosen])),
        "p95_s": float(np.percentile([pool.clock_s for pool in chosen], 95)),
        "core_median_s": float(np.median([pool.core_s for pool in chosen])),
    }


def _mean(values: list[float]) -> dict[str, float]:
    half = 1.96 * float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return {"mean": float(np.mean(values)), "ci95": float(half)}
