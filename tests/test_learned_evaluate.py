"""The figures that a trained generator is judged by, and their command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from robomirror_drake import checkpoint
from robomirror_drake.cli import app
from robomirror_drake.motion.humanml_features import to_features
from robomirror_drake.motion.learned import metrics
from robomirror_drake.motion.learned.networks import Denoiser, Evaluator, LengthHead, MotionVae
from robomirror_drake.motion.learned.options import DiffusionOptions, EvaluatorOptions, VaeOptions
from robomirror_drake.motion.learned.texts import sentence_vectors
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.resample import resample


def test_r_precision_counts_nearer_texts() -> None:
    texts = np.arange(5.0)[:, None]
    assert metrics.r_precision(texts, texts, 1) == 1.0
    # One up: the text above is nearer, save for the last one, whose own is the nearest.
    assert metrics.r_precision(texts, texts + 0.9, 1) == 0.2
    assert metrics.r_precision(texts, texts + 0.9, 2) == 1.0
    assert metrics.matching_distance(texts, texts + 0.9) == pytest.approx(0.9)


def test_frechet_distance_of_normals() -> None:
    rng = np.random.default_rng(0)
    a = rng.normal(size=(4000, 3))
    assert metrics.frechet_distance(a, a) == pytest.approx(0.0, abs=1e-6)
    assert metrics.frechet_distance(a, a + np.array([2.0, 0.0, 0.0])) == pytest.approx(4.0)
    # Deviations 1 and 3 in each of three directions: 3·(3 − 1)².
    assert metrics.frechet_distance(a, 3.0 * a) == pytest.approx(12.0, rel=0.05)


def test_diversity_is_of_pairs_that_differ() -> None:
    rng = np.random.default_rng(0)
    assert metrics.diversity(np.array([[0.0], [2.0]]), 50, rng) == 2.0
    pools = np.array([[[0.0], [1.0]], [[5.0], [8.0]]])
    assert np.mean([metrics.diversity(pool, 10, rng) for pool in pools]) == 2.0


def test_foot_skate_sees_sliding_feet_only() -> None:
    standing = np.tile(resample(load_clip("walk"), 20.0).positions[0][:, [1, 2, 0]], (40, 1, 1))
    assert metrics.foot_skate(standing, 20.0) == 0.0
    slide = standing + np.linspace(0.0, 2.0, 40)[:, None, None] * [1.0, 0.0, 0.0]
    assert metrics.foot_skate(slide, 20.0) == 1.0
    assert metrics.foot_skate(slide, 5.0) == 0.0  # the same steps, in four times the time
    assert (
        metrics.foot_skate(slide + np.linspace(0, 9, 40)[:, None, None] * [0, 1.0, 0], 20.0) < 0.1
    )


def data_set(folder: Path, commands: int) -> None:
    """A test split of walks at different tempos, each with its own caption."""
    for name in ("texts", "new_joint_vecs"):
        (folder / name).mkdir(parents=True)
    walk = np.concatenate([resample(load_clip("walk"), 20.0).positions[..., [1, 2, 0]]] * 2)
    for k in range(commands):
        np.save(folder / "new_joint_vecs" / f"{k:03d}.npy", to_features(walk)[: 40 + k % 9])
        (folder / "texts" / f"{k:03d}.txt").write_text(f"a person walks {k} steps#a/X#0.0#0.0\n")
    (folder / "test.txt").write_text("".join(f"{k:03d}\n" for k in range(commands)))
    np.save(folder / "Mean.npy", to_features(walk).mean(axis=0).astype(np.float32))
    np.save(folder / "Std.npy", np.full(263, 0.1, np.float32))


def untrained(folder: Path) -> None:
    torch.manual_seed(0)
    vae, diffusion = VaeOptions(width=16, latent=4), DiffusionOptions(width=16, heads=2, layers=1)
    evaluator = EvaluatorOptions(width=16, features=8)
    options = {"vae": vae, "diffusion": diffusion, "evaluator": evaluator}
    header = {
        "options": {k: v.model_dump() for k, v in options.items()} | {"text_encoder": "packaged"},
        "text_size": 384,
        "known": ["a person walks"],
    }
    scales = {
        name: torch.from_numpy(np.load(folder / "data" / f"{name.title()}.npy"))
        for name in ("mean", "std")
    }
    known = torch.nn.functional.normalize(sentence_vectors(["a person walks"]), dim=1)
    tensors = scales | {"latent_scale": torch.ones(2, 4), "bones": torch.full((21,), 0.2)}
    tensors |= {"known": known} | checkpoint.named("vae", MotionVae(vae))
    tensors |= checkpoint.named("student", Denoiser(diffusion, 4, 384))
    tensors |= checkpoint.named("length", LengthHead(384, 16))
    checkpoint.save(folder / checkpoint.GENERATOR_FILE, tensors, header)
    judge = scales | checkpoint.named("evaluator", Evaluator(evaluator, 384))
    checkpoint.save(folder / checkpoint.EVALUATOR_FILE, judge, header)


def test_evaluate_writes_every_figure(tmp_path: Path) -> None:
    data_set(tmp_path / "data", 33)
    untrained(tmp_path)
    weights = str(tmp_path / checkpoint.GENERATOR_FILE)
    arguments = ["generator", "evaluate", str(tmp_path / "data"), "--weights", weights]
    runs = []
    for name in ("a.json", "b.json"):
        done = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        runs.append(json.loads((tmp_path / name).read_text()))
    assert runs[0].pop("time")["median_s"] > 0
    runs[1].pop("time")
    assert runs[0] == runs[1]
    assert (runs[0]["commands"], runs[0]["motions"]) == (33, 33)
    for kind in ("real", "generated"):
        figures = runs[0][kind]
        top = [figures[f"r_precision_top{k}"]["mean"] for k in (1, 2, 3)]
        assert 0.0 <= top[0] <= top[1] <= top[2] <= 1.0
        assert 0.0 <= figures["diversity"]["mean"] <= 2.0
        assert 0.0 <= figures["foot_skate"]["mean"] <= 1.0


def test_evaluate_wants_enough_commands(tmp_path: Path) -> None:
    data_set(tmp_path / "data", 31)
    untrained(tmp_path)
    weights = str(tmp_path / checkpoint.GENERATOR_FILE)
    done = CliRunner().invoke(
        app, ["generator", "evaluate", str(tmp_path / "data"), "--weights", weights]
    )
    assert "has 31 commands; 32 are needed" in str(done.exception)
