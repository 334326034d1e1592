"""The learned generator's training: it learns, resumes to the same bytes, refuses other data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from robomirror_drake.exceptions import ConfigError, MotionFileError
from robomirror_drake.motion.humanml_features import recover_from_ric
from robomirror_drake.motion.learned import training as training_module
from robomirror_drake.motion.learned.corpus import CorpusOptions, write_corpus
from robomirror_drake.motion.learned.dataset import load_normalizer, load_split
from robomirror_drake.motion.learned.options import TrainOptions
from robomirror_drake.motion.learned.train import train
from robomirror_drake.motion.learned.training import Training
from robomirror_drake.yaml_file import validate

TINY_CORPUS = CorpusOptions(commands=8, candidates=2, captions=2, seed=3, test_share=0.3)


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("corpus") / "data"
    write_corpus(folder, TINY_CORPUS)
    return folder


def tiny(data: Path, out: Path, **changes: object) -> TrainOptions:
    stage = {"steps": 6, "batch": 4}
    settings = {
        "data": data,
        "out": out,
        "checkpoint_every": 2,
        "vae": stage | {"width": 16, "depth": 1, "latent": 4, "window": 32, "steps": 60},
        "diffusion": stage | {"width": 16, "heads": 2, "layers": 1},
        "consistency": stage,
        "evaluator": stage | {"width": 16, "features": 8},
    }
    return validate(TrainOptions, settings | changes, "test")


def test_corpus_is_in_the_published_layout(corpus: Path) -> None:
    names = sorted(path.stem for path in (corpus / "new_joint_vecs").iterdir())
    listed = [
        n for s in ("train", "val", "test") for n in (corpus / f"{s}.txt").read_text().split()
    ]
    assert sorted(listed) == names == sorted(p.stem for p in (corpus / "texts").iterdir())
    normalizer = load_normalizer(corpus)
    motions = load_split(corpus, "train")
    rows = np.concatenate([m.features for m in motions])
    assert abs(rows.mean(axis=0)).max() < 1e-2
    assert 0.3 < rows.std() < 3.0
    for motion in motions[:3]:
        positions = recover_from_ric(normalizer.back(motion.features))
        assert abs(positions[0, 0, [0, 2]]).max() < 1e-6  # over the origin
        assert -0.02 < positions[..., 1].min() < 0.02
    line = (corpus / "texts" / f"{names[0]}.txt").read_text().splitlines()[0].split("#")
    assert len(line) == 4
    assert line[1].split()[0] == f"{line[0].split()[0]}/X"


def test_commands_keep_to_one_split(corpus: Path) -> None:
    said = {}
    for split in ("train", "val", "test"):
        for name in (corpus / f"{split}.txt").read_text().split():
            for line in (corpus / "texts" / f"{name}.txt").read_text().splitlines():
                assert said.setdefault(line, split) == split


def test_same_corpus_again(corpus: Path, tmp_path: Path) -> None:
    write_corpus(tmp_path, TINY_CORPUS)
    for path in corpus.rglob("*.npy"):
        assert path.read_bytes() == (tmp_path / path.relative_to(corpus)).read_bytes()


def test_training_learns_and_resumes_to_the_same_bytes(
    corpus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    losses: list[tuple[str, float]] = []
    train(tiny(corpus, tmp_path / "whole"), lambda s, _n, _of, loss: losses.append((s, loss)))
    first, *_, last = [loss for stage, loss in losses if stage == "vae"]
    assert last < 0.8 * first

    # The power fails at the third, the sixth and so on of all saves; each time it goes on.
    saves = 0

    def fail(self: Training, optimizer: torch.optim.Optimizer) -> None:
        nonlocal saves
        original(self, optimizer)
        saves += 1
        if saves % 9 == 0:
            raise KeyboardInterrupt

    original = Training.save
    monkeypatch.setattr(training_module.Training, "save", fail)
    for _ in range(20):
        try:
            train(tiny(corpus, tmp_path / "parts"))
            break
        except KeyboardInterrupt:
            continue
    assert saves > 9
    for name in ("generator.safetensors", "evaluator.safetensors"):
        whole, parts = load_file(tmp_path / "whole" / name), load_file(tmp_path / "parts" / name)
        assert whole.keys() == parts.keys()
        for key in whole:
            assert torch.equal(whole[key], parts[key]), key


def test_other_settings_do_not_continue_a_checkpoint(corpus: Path, tmp_path: Path) -> None:
    train(tiny(corpus, tmp_path))
    with pytest.raises(ConfigError, match="begun with other options"):
        train(tiny(corpus, tmp_path, seed=1))
    if not torch.cuda.is_available():
        with pytest.raises(ConfigError, match="device is cuda, and there is none here"):
            train(tiny(corpus, tmp_path, device="cuda"))


def test_damaged_data_are_refused(corpus: Path, tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match="cannot be read"):
        load_split(corpus, "nothing")
    with pytest.raises(MotionFileError, match=r"Mean\.npy"):
        load_normalizer(tmp_path)
    for name in ("Mean.npy", "Std.npy"):
        np.save(tmp_path / name, np.ones(263, np.float32))
    (tmp_path / "texts").mkdir()
    (tmp_path / "new_joint_vecs").mkdir()
    (tmp_path / "train.txt").write_text("a\n")
    features = np.zeros((100, 263), np.float32)
    np.save(tmp_path / "new_joint_vecs" / "a.npy", features)
    text = tmp_path / "texts" / "a.txt"
    text.write_text("a man walks#a/DET man/NOUN walk/VERB#0.0#0.0\nhe stops#he/PRON#1.0#4.0\n")
    whole, part = load_split(tmp_path, "train")[::-1]
    assert (len(whole.features), len(part.features)) == (100, 60)
    np.save(tmp_path / "new_joint_vecs" / "b.npy", np.full((100, 263), np.nan, np.float32))
    (tmp_path / "texts" / "b.txt").write_text("a man runs#a/DET man/NOUN run/VERB#0.0#0.0\n")
    (tmp_path / "train.txt").write_text("a\nb\nnone\n")
    assert len(load_split(tmp_path, "train")) == 2
    text.write_text("a man walks\n")
    with pytest.raises(MotionFileError, match="line 1"):
        load_split(tmp_path, "train")
