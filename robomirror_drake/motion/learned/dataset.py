"""Read a data set in HumanML3D's own layout: features, captions, splits, mean and deviation.

Source: C. Guo et al., "Generating Diverse and Natural 3D Human Motions from Text", CVPR 2022.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.motion.humanml_features import FEATURES, FPS

Float32 = npt.NDArray[np.float32]

SPLITS = ("train", "val", "test")
MIN_FRAMES, MAX_FRAMES = 40, 199
"""Shortest and longest motions used: 2 to 10 s, as in the source."""


@dataclass(frozen=True)
class TextMotion:
    """A motion and what is said of it.

    Attributes:
        features: (T, 263) normalised.
        captions: One or more sentences.
    """

    features: Float32
    captions: tuple[str, ...]


@dataclass(frozen=True)
class Normalizer:
    """Mean and deviation of the features, (263,) each."""

    mean: Float32
    std: Float32

    def to(self, features: npt.ArrayLike) -> Float32:
        """Features (…, 263) as the networks see them."""
        return np.asarray((np.asarray(features) - self.mean) / self.std, dtype=np.float32)

    def back(self, features: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Features (…, 263) in their own units."""
        scaled = np.asarray(features, dtype=np.float64) * self.std + self.mean
        return np.asarray(scaled, dtype=np.float64)


def load_normalizer(folder: Path) -> Normalizer:
    """``Mean.npy`` and ``Std.npy``.

    Raises:
        MotionFileError: One is missing or not (263,) numbers, or a deviation is not positive.
    """
    mean, std = (_numbers(folder / name, (FEATURES,)) for name in ("Mean.npy", "Std.npy"))
    if not (np.isfinite(mean).all() and np.isfinite(std).all() and (std > 0).all()):
        raise MotionFileError(folder / "Std.npy", "a mean or deviation is no sensible number")
    return Normalizer(mean, std)


def load_split(folder: Path, split: str) -> tuple[TextMotion, ...]:
    """All motions of a split; a caption that is about a part of a motion makes one of its own.

    Names without a file, motions of another length than 2 to 10 s and motions with NaN are left
    out, as in the source, whose published data have some of each.

    Raises:
        MotionFileError: A list, an array or a text is damaged, or nothing is left.
    """
    normalizer = load_normalizer(folder)
    motions: list[TextMotion] = []
    for name in _names(folder / f"{split}.txt"):
        path = folder / "new_joint_vecs" / f"{name}.npy"
        text = folder / "texts" / f"{name}.txt"
        if not (path.is_file() and text.is_file()):
            continue
        features = normalizer.to(_numbers(path, (None, FEATURES)))
        if not np.isfinite(features).all():
            continue
        whole: list[str] = []
        for caption, start, end in _captions(text):
            if start == end == 0.0:
                whole.append(caption)
            else:
                part = features[int(start * FPS) : int(end * FPS)]
                motions.append(TextMotion(part, (caption,)))
        if whole:
            motions.append(TextMotion(features, tuple(whole)))
    kept = tuple(m for m in motions if MIN_FRAMES <= len(m.features) <= MAX_FRAMES)
    if not kept:
        raise MotionFileError(folder / f"{split}.txt", "names no motion of 2 to 10 s")
    return kept


def fingerprint(motions: tuple[TextMotion, ...]) -> str:
    """A hash of the motions and captions, to tell later what was trained on."""
    digest = hashlib.sha256()
    for motion in motions:
        digest.update(motion.features.tobytes())
        digest.update("\n".join(motion.captions).encode())
    return digest.hexdigest()[:16]


def _names(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionFileError(path, f"cannot be read: {error}") from error


def _captions(path: Path) -> list[tuple[str, float, float]]:
    """Sentence, start and end [s] of each line ``sentence#tokens#start#end``; 0, 0 is all."""
    found = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        fields = line.strip().split("#")
        if not line.strip():
            continue
        try:
            caption, _, start, end = fields
            span = [0.0 if np.isnan(float(t)) else float(t) for t in (start, end)]
        except ValueError as error:
            raise MotionFileError(path, f"line {number}: not caption#tokens#start#end") from error
        found.append((caption, span[0], span[1]))
    return found


def _numbers(path: Path, shape: tuple[int | None, ...]) -> Float32:
    try:
        array = np.load(path, allow_pickle=False)
    except Exception as error:  # numpy raises half a dozen types on a damaged file
        raise MotionFileError(path, "not a .npy array of numbers, or a damaged one") from error
    fits = isinstance(array, np.ndarray) and array.dtype.kind == "f" and len(shape) == array.ndim
    if not fits or any(w not in (None, h) for w, h in zip(shape, array.shape, strict=True)):
        raise MotionFileError(path, f"expected an array of {shape} numbers")
    return np.asarray(array, dtype=np.float32)
