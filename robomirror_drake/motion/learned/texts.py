"""Sentences as vectors for the learned generator."""

from __future__ import annotations

import os
from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from robomirror_drake.exceptions import ConfigError
from robomirror_drake.motion.language.encoder import embed
from robomirror_drake.motion.learned.options import PACKAGED


def sentence_vectors(sentences: list[str], encoder: str = PACKAGED) -> Tensor:
    """(n, E) vectors of n sentences, with entries of about unit variance.

    Args:
        sentences: In English.
        encoder: ``packaged``, or name or path of a sentence-transformers model.

    Raises:
        ConfigError: There is no such encoder on this machine.
    """
    if encoder == PACKAGED:
        vectors = embed(sentences)
    else:
        vectors = _other(encoder).encode(sentences, normalize_embeddings=True)
    scaled = np.asarray(vectors, dtype=np.float32)
    return torch.from_numpy(scaled * np.float32(np.sqrt(scaled.shape[1])))


@cache
def _other(name: str) -> Any:
    os.environ.setdefault("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    from sentence_transformers import SentenceTransformer

    try:
        return SentenceTransformer(name)
    except Exception as error:  # the libraries below raise many types
        raise ConfigError(f"text encoder {name!r} cannot be loaded: {error}") from error
