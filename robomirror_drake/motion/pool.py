"""Ready motions as candidates: a folder of motion files with a text each, or a result file.

A motion ``NAME.bvh`` (or any other kind of :mod:`~robomirror_drake.motion.load`) is described by
``NAME.txt`` beside it, a sentence a line, or in HumanML3D's form ``sentence#tokens#start#end``. A
folder in HumanML3D's own layout (``new_joint_vecs/``, ``texts/``) is one as well. Result files of
MotionLCM and MDM bring their texts with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from robomirror_drake.exceptions import InputError, MotionFileError, UnknownCommandError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.checks import read_text
from robomirror_drake.motion.language.encoder import embed
from robomirror_drake.motion.load import LOADERS, load_motion
from robomirror_drake.motion.plain_pickle import is_pickled_npy
from robomirror_drake.motion.resample import resample
from robomirror_drake.motion.results_files import load_results

LEAST_LIKENESS = 0.5
"""Cosine of command and caption from which a motion is a candidate."""

_SUFFIXES = tuple(suffix for suffix in LOADERS if suffix != ".txt")  # those are captions here


@dataclass(frozen=True)
class Entry:
    """A motion of a pool: its file, or itself where it came out of a result file."""

    captions: tuple[str, ...]
    path: Path | None = None
    loaded: HumanMotion | None = None

    def motion(self) -> HumanMotion:
        """The motion.

        Raises:
            MotionFileError: Its file cannot be read.
        """
        if self.loaded is not None:
            return self.loaded
        assert self.path is not None
        return load_motion(self.path)


@dataclass(frozen=True)
class Pool:
    """Motions that commands are looked up in, and the vectors of what is said of them."""

    name: str
    entries: tuple[Entry, ...]
    vectors: Array
    owner: npt.NDArray[np.int64]


@cache
def load_pool(path: str) -> Pool:
    """The pool of a folder or a result file, read once; motion files are read when chosen.

    Raises:
        InputError: There is no such place, or no motion with a text in it.
        MotionFileError: A text or a result file is damaged.
    """
    place = Path(path)
    if place.is_dir():
        entries = tuple(entry for file in _motion_files(place) for entry in _entries(file, place))
    elif place.is_file():
        entries = tuple(_entries(place, place.parent))
    else:
        raise InputError(f"{path}: no folder of motions and no result file")
    if not entries:
        raise InputError(f"{path}: holds no motion with a text; put NAME.txt beside NAME.bvh")
    owner = [i for i, entry in enumerate(entries) for _ in entry.captions]
    return Pool(path, entries, embed([c for e in entries for c in e.captions]), np.array(owner))


def choose(text: str, indices: list[int], pool: Pool, fps: float) -> tuple[HumanMotion, ...]:
    """The motions of a pool that a command means best, in that order.

    Args:
        text: The command, in English.
        indices: Places in the order, from 0; those with no motion left are left out.
        pool: Where to look.
        fps: Frames per second of what is returned.

    Raises:
        UnknownCommandError: No motion of the pool is like it.
        MotionFileError: A chosen file cannot be read.
    """
    cosine = pool.vectors @ embed([text])[0]
    best = np.full(len(pool.entries), -1.0)
    np.maximum.at(best, pool.owner, cosine)
    order = np.argsort(-best, kind="stable")
    if best[order[0]] < LEAST_LIKENESS:
        nearest = np.argsort(-cosine, kind="stable")[:3]
        said = [c for entry in pool.entries for c in entry.captions]
        raise UnknownCommandError(text, [said[i] for i in nearest])
    order = order[best[order] >= LEAST_LIKENESS]
    chosen = [pool.entries[order[k]] for k in indices if k < len(order)]
    motions = [entry.motion() for entry in chosen]
    return tuple(
        replace(resample(m, fps), text=text, source=f"files:{m.source} ({entry.captions[0]})")
        for m, entry in zip(motions, chosen, strict=True)
    )


def _motion_files(folder: Path) -> list[Path]:
    vectors = folder / "new_joint_vecs"
    places = [vectors] if vectors.is_dir() else [folder]
    return sorted(p for place in places for p in place.iterdir() if p.suffix.lower() in _SUFFIXES)


def _entries(path: Path, folder: Path) -> list[Entry]:
    if path.suffix.lower() == ".pkl" or (path.suffix.lower() == ".npy" and is_pickled_npy(path)):
        return [Entry((m.text,), loaded=m) for m in load_results(path) if m.text]
    beside, apart = path.with_suffix(".txt"), folder / "texts" / f"{path.stem}.txt"
    text = next((file for file in (beside, apart) if file.is_file()), None)
    if text is None:
        return []
    lines = [line.split("#")[0].strip() for line in read_text(text).splitlines()]
    captions = tuple(line for line in lines if line)
    if not captions:
        raise MotionFileError(text, "says nothing of the motion")
    return [Entry(captions, path=path)]
