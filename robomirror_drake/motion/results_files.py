"""Result files of published text-to-motion models: joint positions with their texts.

MotionLCM (arXiv 2404.19759) and MLD write a ``.pkl`` a motion: ``joints`` (T, 22, 3), ``text``,
``length``. MDM (G. Tevet et al., "Human Motion Diffusion Model", ICLR 2023) writes all of a run
into one ``results.npy``: ``motion`` (N, 22, 3, T), ``text``, ``lengths``. Both are y up at 20 fps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.checks import checked_motion, existing_file
from robomirror_drake.motion.ground import z_up
from robomirror_drake.motion.humanml_features import FPS
from robomirror_drake.motion.plain_pickle import read_pickle


def load_results(path: Path | str) -> tuple[HumanMotion, ...]:
    """All motions of a result file, each with its text.

    Nothing in the file is executed.

    Raises:
        MotionFileError: Missing, damaged, of another kind, or no human's motion.
    """
    path = existing_file(path)
    content = read_pickle(path)
    if isinstance(content, np.ndarray) and content.shape == ():
        content = content.item()
    if not isinstance(content, Mapping):
        raise MotionFileError(path, "not a result file: it holds no named arrays")
    try:
        motions = tuple(_motions(path, content))
    except (TypeError, ValueError) as error:  # a text or a length that is none
        raise MotionFileError(path, f"not a result file: {error}") from error
    if not motions:
        raise MotionFileError(path, "holds no motion")
    return motions


def load_result(path: Path | str) -> HumanMotion:
    """The motion of a result file that has one.

    Raises:
        MotionFileError: As :func:`load_results`, or there are several.
    """
    motions = load_results(path)
    if len(motions) > 1:
        raise MotionFileError(path, f"holds {len(motions)} motions; use it as a pool of candidates")
    return motions[0]


def _motions(path: Path, content: Mapping[Any, Any]) -> Iterator[HumanMotion]:
    if "joints" in content:
        yield _motion(path, content["joints"], content.get("text"), None)
        return
    if "motion" not in content:
        raise MotionFileError(path, f"has neither joints nor motion; it has {sorted(content)}")
    motions = _numbers(path, content["motion"])
    if motions.ndim != 4 or motions.shape[1:3] != (22, 3):
        raise MotionFileError(
            path, f"motion has shape {motions.shape}, expected (n, 22, 3, frames)"
        )
    texts = list(content.get("text", [""] * len(motions)))
    lengths = list(content.get("lengths", [motions.shape[3]] * len(motions)))
    if not len(motions) == len(texts) == len(lengths):
        raise MotionFileError(path, "motion, text and lengths differ in number")
    for k, (motion, text, length) in enumerate(zip(motions, texts, lengths, strict=True)):
        yield _motion(path, motion.transpose(2, 0, 1)[: int(length)], text, k)


def _motion(path: Path, joints: Any, text: Any, number: int | None) -> HumanMotion:
    positions = _numbers(path, joints)
    if positions.ndim != 3:
        raise MotionFileError(
            path, f"joints have shape {positions.shape}, expected (frames, 22, 3)"
        )
    source = str(path) if number is None else f"{path}#{number}"
    motion = checked_motion(path, z_up(positions, "y"), FPS, source)
    return replace(motion, text=str(text or ""))


def _numbers(path: Path, values: Any) -> Array:
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
        raise MotionFileError(path, "the joint positions are no array of numbers")
    return values.astype(np.float64)
