"""Which action a clause means: a linear classifier over sentence vectors.

Softmax regression over the vectors of :mod:`encoder`, with one class for what is no action of the
library. Its weights are made by ``python -m robomirror_drake.motion.language.train``.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files

import numpy as np

from robomirror_drake.messages import Array
from robomirror_drake.motion.language.encoder import embed

UNKNOWN = "unknown"
"""The class of what is no action of the library."""
WEIGHTS = "understanding.npz"
"""The weights, in ``assets``."""


@dataclass(frozen=True)
class Classifier:
    """Softmax regression.

    Attributes:
        names: (n,) names of the classes; the last is :data:`UNKNOWN`.
        weight: (n, 384) logits per component of a sentence vector.
        bias: (n,) logits.
        digest: Of the corpus that it was trained on.
    """

    names: tuple[str, ...]
    weight: Array
    bias: Array
    digest: str

    def probabilities(self, vector: Array) -> dict[str, float]:
        """Probability of each class for a sentence vector (384,)."""
        logits = self.weight @ vector + self.bias
        share = np.exp(logits - logits.max())
        share /= share.sum()
        return dict(zip(self.names, share.tolist(), strict=True))


@cache
def classifier() -> Classifier:
    """The classifier that comes with the package."""
    data = files("robomirror_drake.assets").joinpath(WEIGHTS).read_bytes()
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        return Classifier(
            names=tuple(str(name) for name in stored["names"]),
            weight=stored["weight"].astype(np.float64),
            bias=stored["bias"].astype(np.float64),
            digest=str(stored["digest"]),
        )


@lru_cache(maxsize=4096)
def meaning(clause: str) -> dict[str, float]:
    """Probability of each action, and of :data:`UNKNOWN`, for the words of a clause."""
    return classifier().probabilities(embed([clause])[0])
