"""Candidates from the learned generator, from ready motions, and from all in turn."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError, InputError, UnknownCommandError
from robomirror_drake.motion.bones import bone_lengths
from robomirror_drake.motion.generate import GeneratorOptions, generate
from robomirror_drake.motion.humanml_features import to_features
from robomirror_drake.motion.learned.feet import make_whole
from robomirror_drake.motion.learned.generator import load_generator
from robomirror_drake.motion.learned.networks import Denoiser, LengthHead, MotionVae
from robomirror_drake.motion.learned.options import DiffusionOptions, SamplingOptions, VaeOptions
from robomirror_drake.motion.learned.texts import sentence_vectors
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.sources import SourceOptions, shares
from robomirror_drake.systems.motion_generator import MotionGenerator

KNOWN = ["a person walks forward", "a person waves"]


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Networks that were never trained, with the walk's own scales: shapes and seeds are theirs."""
    torch.manual_seed(0)
    vae, diffusion = VaeOptions(width=16, latent=4), DiffusionOptions(width=16, heads=2, layers=1)
    features = to_features(resample(load_clip("walk"), 20.0).positions[..., [1, 2, 0]])
    modules = {
        "vae": MotionVae(vae),
        "student": Denoiser(diffusion, 4, 384),
        "length": LengthHead(384, 16),
    }
    tensors = {
        "mean": torch.tensor(features.mean(axis=0), dtype=torch.float32),
        "std": torch.full((263,), 0.02),
        "latent_scale": torch.tensor([[0.0] * 4, [1.0] * 4]),
        "bones": torch.tensor(bone_lengths(load_clip("walk").positions[:1])[0]),
        "known": functional.normalize(sentence_vectors(KNOWN), dim=1),
    }
    for name, module in modules.items():
        tensors |= checkpoint.named(name, module)
    header = {
        "options": {
            "vae": vae.model_dump(),
            "diffusion": diffusion.model_dump(),
            "text_encoder": "packaged",
        },
        "text_size": 384,
        "known": KNOWN,
    }
    path = tmp_path_factory.mktemp("weights") / "generator.safetensors"
    checkpoint.save(path, tensors, header)
    return str(path)


def learned(weights: str) -> GeneratorOptions:
    source = SourceOptions(kind="learned", learned=SamplingOptions(weights=weights, steps=2))
    return GeneratorOptions(source=source)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A pool: three clips as arrays with texts, and one in a result file."""
    place = tmp_path_factory.mktemp("pool")
    said = {"walk": "a person walks forward#a/X#0.0#0.0\na man strolls", "jump": "a person jumps",
            "kick": "a person kicks"}  # fmt: skip
    for name, text in said.items():
        y_up = resample(load_clip(name), 20.0).positions[..., [1, 2, 0]]
        np.save(place / f"{name}.npy", y_up)
        (place / f"{name}.txt").write_text(text)
    run = resample(load_clip("run"), 20.0).positions[..., [1, 2, 0]]
    result = {"joints": run, "text": "a person runs forward", "length": len(run)}
    (place / "made.pkl").write_bytes(pickle.dumps(result))
    return str(place)


def test_learned_candidates_differ_and_come_again(weights: str) -> None:
    first = generate("a person walks", 4, 3, learned(weights))
    assert generate("a person walks", 4, 3, learned(weights)) == first
    assert len({m.positions.tobytes() for m in first}) == 4
    other = generate("a person walks", 4, 4, learned(weights))
    assert all(
        a.positions.tobytes() != b.positions.tobytes() for a, b in zip(first, other, strict=True)
    )
    for k, motion in enumerate(first):
        assert motion.fps == 60.0
        assert motion.source.startswith("learned:")
        assert motion.source.endswith(f"generator seed 3 candidate {k}")
        lengths = bone_lengths(motion.positions[::3])  # every third is a frame of the networks'
        assert (lengths.std(axis=0) / lengths.mean(axis=0)).max() < 1e-6


def test_learned_generator_says_what_it_does_not_know(weights: str) -> None:
    with pytest.raises(UnknownCommandError, match="a person waves"):
        generate("the stock market fell by two percent", 2, 0, learned(weights))


def test_files_that_are_no_weights(tmp_path: Path) -> None:
    (tmp_path / "generator.safetensors").write_bytes(b"nothing")
    for path in (tmp_path / "generator.safetensors", tmp_path / "none.safetensors"):
        with pytest.raises(ConfigError, match="no weights of a motion generator"):
            load_generator(str(path))


def test_ready_motions_are_found_by_their_texts(folder: str) -> None:
    options = GeneratorOptions(source=SourceOptions(kind="files", files=folder))
    walk = generate("someone is walking forward", 1, 0, options)[0]
    assert walk.source == f"files:{folder}/walk.npy (a person walks forward)"
    assert (walk.fps, walk.text) == (60.0, "someone is walking forward")
    assert "made.pkl" in generate("someone runs", 1, 0, options)[0].source
    assert len(generate("a person jumps up", 50, 0, options)) <= 4
    with pytest.raises(UnknownCommandError, match="the nearest are: a "):
        generate("the stock market fell by two percent", 1, 0, options)


def test_pools_without_motions_are_refused(tmp_path: Path) -> None:
    for place, fault in {"": "names no folder", str(tmp_path): "holds no motion with a text",
                         str(tmp_path / "none"): "no folder of motions"}.items():  # fmt: skip
        options = GeneratorOptions(source=SourceOptions(kind="files", files=place))
        with pytest.raises(InputError, match=fault):
            generate("a person walks", 1, 0, options)


def test_sources_take_turns(weights: str, folder: str) -> None:
    source = SourceOptions(kind="mix", files=folder, learned=SamplingOptions(weights=weights))
    assert shares(source, 5) == {"composer": [0, 3], "learned": [1, 4], "files": [2]}
    assert shares(source, 1) == {"composer": [0]}
    motions = generate("a person walks forward", 5, 0, GeneratorOptions(source=source))
    assert [m.source.split(":")[0] for m in motions] == [
        "generator", "learned", "files", "generator", "learned"
    ]  # fmt: skip
    assert "candidate 3" in motions[3].source


def test_system_has_the_source_as_a_setting(weights: str) -> None:
    generator = MotionGenerator(n=2, seed=1, options=learned(weights))
    context = generator.CreateDefaultContext()
    generator.get_input_port().FixValue(context, "a person walks")
    made = generator.get_output_port().Eval(context)
    assert made == generate("a person walks", 2, 1, learned(weights))


def test_planted_feet_stay_and_bones_keep_their_length() -> None:
    """A walk whose body drifts: afterwards feet stand still and nothing else moves much."""
    clip = resample(load_clip("walk"), 20.0).positions[..., [1, 2, 0]]
    lengths = bone_lengths(clip[:1])[0]
    good = make_whole(clip[None], lengths, 20.0)[0]
    drift = np.linspace(0.0, 0.06, len(clip))[:, None, None] * [1.0, 0.0, 0.0]
    shaken = clip + drift
    mended = make_whole(shaken[None], lengths, 20.0)[0]
    np.testing.assert_allclose(bone_lengths(mended), np.tile(lengths, (len(clip), 1)), rtol=1e-3)
    toes = mended[:, [10, 11]]
    speed = 20.0 * np.linalg.norm(np.diff(toes[..., [0, 2]], axis=0), axis=-1)
    planted = (toes[1:, :, 1] < toes[..., 1].min() + 0.03) & (speed < 0.3)
    assert planted.sum() > 10
    assert np.median(speed[planted]) < 0.02
    for was, made in ((clip, good), (shaken, mended)):
        moved = made - was
        moved[..., 1] -= np.median(moved[..., 1])  # onto the floor
        assert np.linalg.norm(moved, axis=-1).mean() < 0.03
