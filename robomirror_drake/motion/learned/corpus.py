"""Write a corpus in HumanML3D's own layout from the composer and the recorded clips.

``new_joint_vecs/NAME.npy`` (T, 263) features, ``texts/NAME.txt`` captions, ``Mean.npy`` and
``Std.npy`` (263,), and ``train.txt``, ``val.txt``, ``test.txt`` with a name a line: what C. Guo et
al. publish (CVPR 2022), so that any code for it reads this corpus, and ours reads theirs.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.exceptions import InputError, ResultError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.bones import bone_lengths, mirrored
from robomirror_drake.motion.generate import GeneratorOptions, generate
from robomirror_drake.motion.humanml_features import CONTACTS, FPS, to_features, with_lengths
from robomirror_drake.motion.learned.dataset import MAX_FRAMES, MIN_FRAMES, SPLITS
from robomirror_drake.motion.learned.wording import draw_command
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.recorded import neutral
from robomirror_drake.motion.resample import resample, time_scale
from robomirror_drake.motion.text import Clause

CLIP_CAPTIONS: dict[str, tuple[str, ...]] = {
    "walk": ("a person walks", "someone walks at a normal pace"),
    "walk_forward": ("a person takes a stride forward", "someone walks one stride"),
    "run": ("a person runs", "someone is running"),
    "jump": ("a person jumps", "someone jumps up"),
    "kick": ("a person does a karate kick", "a martial artist kicks"),
    "punch": ("a person steps and punches", "a fighter throws a stepping punch"),
    "spin": ("a person spins", "someone spins around"),
    "spinkick": ("a person does a spinning kick", "a martial artist turns and kicks"),
    "dance_a": ("a person dances", "someone is dancing with the whole body"),
    "dance_b": ("a person dances", "a dancer moves to music"),
}
"""What is said of the recorded clips that are in the corpus as they are."""

_LONGEST_NOMINAL = 1.1  # of the longest motion used; faster styles may still fit
_TEMPOS = (0.9, 1.0, 1.1)


class CorpusOptions(BaseModel):
    """How large a corpus is, and what it is drawn from."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    commands: int = Field(1000, ge=8, le=100_000, description="different commands")
    candidates: int = Field(4, ge=1, le=256, description="motions of each command")
    captions: int = Field(4, ge=1, le=16, description="wordings of each command, at most")
    clips: bool = Field(True, description="whether the recorded clips are in it as well")
    diversity: float = Field(1.0, ge=0.0, le=1.0, description="spread of the style")
    seed: int = Field(0, ge=0, description="of everything that is drawn")
    test_share: float = Field(0.15, gt=0.0, lt=0.5, description="of commands, for the test split")
    val_share: float = Field(0.05, gt=0.0, lt=0.5, description="of commands, for validation")


def write_corpus(
    folder: Path, options: CorpusOptions, report: Callable[[int, int], None] = lambda *_: None
) -> dict[str, int]:
    """Writes a corpus; the same options and library give the same bytes.

    Args:
        folder: Where; it must not exist, or be empty.
        options: How large, and from what.
        report: Told how many commands of how many are done.

    Returns:
        How many motions each split has.

    Raises:
        ResultError: The folder holds something already.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ResultError(f"{folder} is not empty; name another folder")
    for name in ("new_joint_vecs", "texts"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(options.seed)
    sums = _Moments()
    names: dict[str, list[str]] = {split: [] for split in SPLITS}
    count = 0
    for motions, captions, clip in _material(options, rng, report):
        # Motions of one command stay together: no test command was heard in training.
        split = "train" if clip else _split(rng, options)
        for motion in motions:
            features = composer_features(motion)
            if not MIN_FRAMES <= len(features) <= MAX_FRAMES:
                continue
            name = f"{count:06d}"
            count += 1
            np.save(folder / "new_joint_vecs" / f"{name}.npy", features)
            text = "".join(f"{_line(caption)}\n" for caption in captions)
            (folder / "texts" / f"{name}.txt").write_text(text, encoding="utf-8")
            names[split].append(name)
            if split == "train":
                sums.add(features)
    for split, members in names.items():
        lines = "".join(f"{name}\n" for name in members)
        (folder / f"{split}.txt").write_text(lines, encoding="utf-8")
    mean, std = sums.result()
    np.save(folder / "Mean.npy", mean.astype(np.float32))
    np.save(folder / "Std.npy", std.astype(np.float32))
    sizes = {split: len(members) for split, members in names.items()}
    record = {"made_by": "robomirror generator corpus", "motions": sizes} | options.model_dump()
    (folder / "corpus.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return sizes


def _material(
    options: CorpusOptions, rng: np.random.Generator, report: Callable[[int, int], None]
) -> Iterator[tuple[tuple[HumanMotion, ...], tuple[str, ...], bool]]:
    """Motions that share their captions, and whether they are a recording."""
    known: set[tuple[Clause, ...]] = set()
    rejected = 0
    generator = GeneratorOptions(fps=FPS, diversity=options.diversity)
    while len(known) < options.commands and rejected < 50 * options.commands:
        command = draw_command(rng, options.captions)
        if command is None or command.meaning in known:
            rejected += 1
            continue
        seed = int(rng.integers(2**31))
        motions = _candidates(command.captions[0], seed, generator, options.candidates)
        if not motions:
            rejected += 1
            continue
        known.add(command.meaning)
        report(len(known), options.commands)
        yield motions, command.captions, False
    if options.clips:
        for name, captions in CLIP_CAPTIONS.items():
            yield tuple(_variants(load_clip(name))), captions, True


def _candidates(
    caption: str, seed: int, generator: GeneratorOptions, number: int
) -> tuple[HumanMotion, ...]:
    """Motions of a command; none where it cannot be done, or not in ten seconds."""
    try:
        nominal = generate(caption, 1, seed, generator)[0]
        if len(nominal.positions) > _LONGEST_NOMINAL * MAX_FRAMES:
            return ()
        return generate(caption, number, seed, generator)
    except InputError:  # two gestures that need the same arm
        return ()


def _variants(clip: HumanMotion) -> Iterator[HumanMotion]:
    """A clip at a few tempos, as it is and mirrored, at 20 fps."""
    for tempo in _TEMPOS:
        motion = resample(time_scale(clip, 1.0 / tempo), FPS)
        yield motion
        yield replace(motion, positions=mirrored(motion.positions))


def composer_features(motion: HumanMotion) -> Array:
    """(T, 263) features of a motion at 20 fps on the composer's skeleton, in single precision."""
    y_up = with_lengths(motion.positions[..., [1, 2, 0]], bone_lengths(neutral(60.0)))
    features: Array = to_features(y_up).astype(np.float32)
    return features


def _split(rng: np.random.Generator, options: CorpusOptions) -> str:
    drawn = rng.random()
    if drawn < options.test_share:
        return "test"
    return "val" if drawn < options.test_share + options.val_share else "train"


def _line(caption: str) -> str:
    """A caption as HumanML3D has it: words, words with part of speech, start and end (all).

    Parts of speech are not determined: X, the universal tag for that, stands in their place.
    """
    tokens = " ".join(f"{word.strip(',')}/X" for word in caption.split())
    return f"{caption}#{tokens}#0.0#0.0"


class _Moments:
    """Mean and deviation of rows that come in pieces."""

    def __init__(self) -> None:
        self._rows = 0
        self._sum = np.zeros(263)
        self._squares = np.zeros(263)

    def add(self, rows: Array) -> None:
        self._rows += len(rows)
        self._sum += rows.sum(axis=0, dtype=np.float64)
        self._squares += (rows.astype(np.float64) ** 2).sum(axis=0)

    def result(self) -> tuple[Array, Array]:
        """(263,) mean and (263,) deviation, the latter averaged over each kind of feature."""
        mean = self._sum / max(self._rows, 1)
        std = np.sqrt(np.maximum(self._squares / max(self._rows, 1) - mean**2, 0.0))
        for start, end in ((0, 1), (1, 3), (3, 4), (4, 67), (67, 193), (193, 259),
                           (CONTACTS.start, CONTACTS.stop)):  # fmt: skip
            std[start:end] = max(float(std[start:end].mean()), 1e-4)
        return mean, std
