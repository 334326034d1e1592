"""Evaluate predictors on commands they have not seen: the paper's Table 1, and what it hides."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from scipy.special import logit
from threadpoolctl import threadpool_limits

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.dataset.folder import description
from robomirror_drake.dataset.windows import ERRORS
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.learning.baselines import fit_baselines
from robomirror_drake.learning.calibrate import balanced_threshold
from robomirror_drake.learning.judge import (
    Told,
    Truth,
    error_figures,
    fall_figures,
    family_figures,
)
from robomirror_drake.learning.metrics import Draws, interval
from robomirror_drake.learning.motion_baseline import NAME as TORQUES
from robomirror_drake.learning.motion_baseline import torque_logits
from robomirror_drake.learning.motions import Motion, foreseen, motion_figures, read_motions
from robomirror_drake.learning.train import predict
from robomirror_drake.learning.weights import Weights, load_all, load_all_torques
from robomirror_drake.learning.windows import Integers, Windows, load_windows
from robomirror_drake.messages import Array
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.ppn.predictor import Predictor
from robomirror_drake.ppn.torques import TorquePredictor
from robomirror_drake.robot import Robot, load_robot

Report = Callable[[str, int, int | None], None]

_JUDGED = ("test", "held_out")
_MINDED = -float(logit(AdaptationOptions().ranking.t_safe))  # logit of 1 - T_safe


class EvaluateOptions(BaseModel):
    """What predictors are judged on, and how."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path = Field(Path("results/data"), description="folder of a data set")
    robot: str = Field("jvrc1", description="name of a YAML in assets/robots, or its path")
    spacing: float = Field(0.1, gt=0.0, le=5.0, description="of an episode's windows [s]")
    draws: int = Field(2000, ge=10, le=1_000_000, description="of the bootstrap")
    baselines: bool = Field(True, description="train and judge the baselines too")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of the bootstrap and the baselines")
    threads: int = Field(1, ge=1, le=256, description="of the processor")


class Judgement(NamedTuple):
    """One predictor on one part of the data.

    Attributes:
        row: Its figures.
        truth, told: Of the windows of unseen commands.
    """

    row: dict[str, Any]
    truth: Truth
    told: Told


def evaluate(
    paths: Sequence[Path],
    options: EvaluateOptions,
    report: Report = lambda *_: None,
) -> tuple[dict[str, Any], list[Judgement]]:
    """All figures, as they go to JSON, and what they were worked out from.

    Args:
        paths: Files of weights, or folders with such files at any depth; none: the packaged.
        options: What they are judged on.
        report: Told the stage, how much of it is done, and of how much.

    Raises:
        ConfigError: A file holds no weights for this robot.
        ResultError: There are no weights, or the data set has no windows to judge by.
    """
    torch.set_num_threads(options.threads)
    robot = load_robot(options.robot)
    models, torques = load_all(paths, robot), load_all_torques(paths, robot)
    judged: list[Judgement] = []
    parts: dict[str, Any] = {}
    for horizon, rate in sorted({(m.options.horizon, m.options.rate) for m in models}):
        own = [m for m in models if (m.options.horizon, m.options.rate) == (horizon, rate)]
        farthest = max((m.options for m in own), key=lambda network: network.back)
        data = load_windows(
            options.data, robot, farthest, options.spacing, options.baselines,
            lambda count: report(f"{horizon:g} s: episodes", count, None),  # noqa: B023
        )  # fmt: skip
        made = _judge(own, data, robot, options, report)
        judged += made
        parts[f"{horizon:g}"] = {"fingerprint": data.fingerprint, **_parts(data)}
    figures = {
        "options": options.model_dump(mode="json", exclude={"threads"}),
        "data": _told_of(options.data),
        "parts": parts,
        "rows": [judgement.row for judgement in judged],
        "whole_motions": _whole_motions(models, torques, robot, options, report),
    }
    return figures, judged


def _judge(
    models: list[Weights], data: Windows, robot: Robot, options: EvaluateOptions, report: Report
) -> list[Judgement]:
    """Models of one horizon, then the baselines, on the same windows."""
    unseen, held, judged = (data.of_split(name) for name in ("test", "held_out", "validation"))
    data.check_falls(unseen, options.data, "of the split 'test'")
    truths = [Truth.of(data, which) for which in (unseen, held)]
    draws = [Draws(truth.command, options.draws, options.seed) for truth in truths]
    horizon = models[0].options.horizon
    made = []
    for number, model in enumerate(models, start=1):
        told = [_told(model.predictor, data, which) for which in (unseen, held)]
        about = _about(model, data)
        made.append(Judgement(about | _row(truths, told, draws), truths[0], told[0]))
        report(f"{horizon:g} s: networks", number, len(models))
    if options.baselines:
        learned = data.of(lambda row: row["split"] == "train")
        for name, which in (("validation", judged), ("train", learned)):
            data.check_falls(which, options.data, f"of the split {name!r}")
        with threadpool_limits(options.threads):
            fitted = fit_baselines(
                data, learned, judged, robot, models[0].options, options.seed,
                lambda done, total: report(f"{horizon:g} s: baselines", done, total),
            )  # fmt: skip
        threshold = balanced_threshold(float(data.fall[judged].float().mean()))
        for baseline in fitted:
            about = {"model": baseline.name, "horizon_s": horizon, "share": 1.0}
            told = [Told(*baseline.predict(which), threshold) for which in (unseen, held)]
            made.append(Judgement(about | _row(truths, told, draws), truths[0], told[0]))
    _compare(made, draws[0])
    return made


def _told(predictor: Predictor, data: Windows, which: Integers) -> Told:
    """What a network predicts."""
    threshold = balanced_threshold(predictor.header["data"]["falls_validation"])
    if not len(which):
        return Told(np.zeros(0), np.zeros((0, len(ERRORS))), threshold)
    scores = predict(predictor.network, data, which)
    return Told(scores.fall.double().numpy(), scores.errors.double().numpy(), threshold)


def _about(model: Weights, data: Windows) -> dict[str, Any]:
    """What is to be said of a network; ``same_data``: it learned from this very data set."""
    return {
        "model": model.model,
        "horizon_s": model.options.horizon,
        "share": model.training["share"],
        "seed": model.training["seed"],
        "weights": str(model.path),
        "name": model.name,
        "parameters": sum(p.numel() for p in model.predictor.network.parameters()),
        "trained_on": model.predictor.header["data"],
        "same_data": model.predictor.header["data"]["fingerprint"] == data.fingerprint,
    }


def _whole_motions(
    models: Sequence[Weights],
    torques: Mapping[str, TorquePredictor],
    robot: Robot,
    options: EvaluateOptions,
    report: Report,
) -> list[dict[str, Any]]:
    """Figures of motions that have yet to begin: of each network, of those that adaptation
    averages, and of the baseline."""
    splits = ("train", "validation") if options.baselines else ()
    motions = read_motions(options.data, (*_JUDGED, *splits))
    rows = []
    for number, model in enumerate(models, start=1):
        own = [foreseen(model.predictor, motions[split]) for split in _JUDGED]
        rows.append(_of_motions(model.model, model.options.horizon, own, motions, options))
        report("whole motions", number, len(models))
    for name, one in torques.items():
        own = [foreseen(one, motions[split]) for split in _JUDGED]
        words = f"network on the largest torques, {name}"
        rows.append(_of_motions(words, None, own, motions, options))
    loaded: dict[str, Predictor | TorquePredictor] = {m.name: m.predictor for m in models}
    loaded |= torques
    used = AdaptationOptions().predictor
    if set(used) <= loaded.keys():
        climbed = [name for name in used if name not in torques]
        for words, names in (
            (f"mean of {' and '.join(climbed)}", climbed),
            ("as adaptation is told: that mean, and torques", used),
        ):
            ensemble = Ensemble([loaded[name] for name in names])
            own = [foreseen(ensemble, motions[split]) for split in _JUDGED]
            rows.append(_of_motions(words, None, own, motions, options))
    learned, calibrated = (motions.get(split, []) for split in ("train", "validation"))
    if all(len({motion.fell for motion in some}) == 2 for some in (learned, calibrated)):
        own = torque_logits(
            robot, learned, calibrated, [motions[split] for split in _JUDGED], options.seed
        )
        rows.append(_of_motions(TORQUES, None, own, motions, options))
    return rows


def _of_motions(
    name: str,
    horizon: float | None,
    logits: Sequence[Array],
    motions: dict[str, list[Motion]],
    options: EvaluateOptions,
) -> dict[str, Any]:
    """Figures by split; None where there are no motions. Told is what adaptation minds."""
    told = {
        split: motion_figures(motions[split], own, _MINDED, options.draws, options.seed)
        if motions[split] else None
        for split, own in zip(_JUDGED, logits, strict=True)
    }  # fmt: skip
    return {"model": name, "horizon_s": horizon, "motions": told}


def _row(truths: list[Truth], told: list[Told], draws: list[Draws]) -> dict[str, Any]:
    """All figures on the commands of the test split, and on the held-out families."""
    (test, held), (test_told, held_told) = truths, told
    row = fall_figures(test, test_told, draws[0])
    row |= {"errors": error_figures(test, test_told), "test": test.counts(), "held_out": None}
    if len(held.fall):
        row["held_out"] = {
            **fall_figures(held, held_told, draws[1]),
            "errors": error_figures(held, held_told),
            **held.counts(),
            "families": family_figures(held, held_told),
        }
    return row


def _compare(judged: list[Judgement], draws: Draws) -> None:
    """Adds to each row by how much the first one, the full model, is ahead of it."""
    if judged[0].row["model"] != "PPN":
        return
    truth = judged[0].truth
    best = draws.balanced(judged[0].told.alarm, truth.fall)
    for judgement in judged[1:]:
        behind = best - draws.balanced(judgement.told.alarm, truth.fall)
        judgement.row["behind_ppn"] = {
            "fall_accuracy": judged[0].row["fall_accuracy"] - judgement.row["fall_accuracy"],
            "interval": interval(behind),
        }


def _parts(data: Windows) -> dict[str, dict[str, int]]:
    """How much there is of each split."""
    names = ("train", "validation", "test", "held_out")
    return {name: Truth.of(data, data.of_split(name)).counts() for name in names}


def _told_of(folder: Path) -> dict[str, Any]:
    """What a data set says of how it was made.

    Raises:
        ConfigError: It does not say all of it.
        ResultError: The file that says so is missing or damaged.
    """
    told = description(folder)
    try:
        return {
            "folder": str(folder),
            "seed": told["options"]["seed"],
            "per_prompt": told["options"]["per_prompt"],
            "executions": told["options"]["executions"],
            "prompts": told["prompts"],
            "versions": told["versions"],
        }
    except KeyError as error:
        raise ConfigError(
            f"{folder}/dataset.json: does not tell what data set this is: {error}"
        ) from error
