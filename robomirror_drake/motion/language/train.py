"""Trains the classifier of clauses: ``python -m robomirror_drake.motion.language.train``.

The corpus is the phrases of ``assets/actions.yaml`` and those of ``assets/unknown.yaml``, each
also with a side, a number or a manner added, drawn by a seed. The cross entropy with a ridge on
the weights is convex, so L-BFGS finds the one optimum.
"""

from __future__ import annotations

import hashlib
from importlib.resources import as_file, files

import numpy as np
from scipy.optimize import minimize

from robomirror_drake.messages import Array
from robomirror_drake.motion.language.classifier import UNKNOWN, WEIGHTS
from robomirror_drake.motion.language.encoder import embed
from robomirror_drake.motion.language.unknown import unknown
from robomirror_drake.motion.library import library

SEED = 0
VARIANTS = 1
"""Variants of each phrase beside itself."""
RIDGE = 2e-4
"""Weight of the squared norm of the weights against the mean cross entropy."""
_MANNERS = (
    "slowly", "quickly", "carefully", "again", "a little", "with the left hand", "to the right",
    "with the right leg", "angrily", "happily", "in place", "forward", "for a while", "to the left",
    "while standing", "and stops", "like a robot", "gracefully", "with both arms", "energetically",
)  # fmt: skip
_SUBJECTS = ("a person", "a man", "the figure", "someone")


def corpus() -> tuple[list[str], list[str]]:
    """Sentences, and the class of each."""
    rng = np.random.default_rng(SEED)
    groups = {name: action.phrases for name, action in library().items()}
    sentences, classes = [], []
    for name, phrases in (groups | {UNKNOWN: unknown().phrases}).items():
        for phrase in phrases:
            sentences.append(f"a person {phrase}")
            classes.append(name)
            for _ in range(VARIANTS):
                subject = _SUBJECTS[rng.integers(len(_SUBJECTS))]
                manner = _MANNERS[rng.integers(len(_MANNERS))]
                sentences.append(f"{subject} {phrase} {manner}")
                classes.append(name)
    return sentences, classes


def digest(sentences: list[str], classes: list[str]) -> str:
    """Tells one corpus from another."""
    lines = "\n".join(f"{c}\t{s}" for s, c in zip(sentences, classes, strict=True))
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


def fit(vectors: Array, labels: Array, classes: int) -> tuple[Array, Array]:
    """Weights (c, d) and biases (c,) of the softmax regression of labels (n,) on vectors (n, d)."""
    n, d = vectors.shape
    target = np.eye(classes)[labels.astype(int)]
    share = target.mean(axis=0)
    balance = (1.0 / (classes * share))[labels.astype(int)]  # each class counts alike
    balance = np.minimum(balance, 1.0) / n

    def loss(flat: Array) -> tuple[float, Array]:
        w, b = flat[: classes * d].reshape(classes, d), flat[classes * d :]
        logits = vectors @ w.T + b
        logits -= logits.max(axis=1, keepdims=True)
        p = np.exp(logits)
        total = p.sum(axis=1, keepdims=True)
        entropy = balance @ (np.log(total[:, 0]) - np.sum(logits * target, axis=1))
        error = balance[:, None] * (p / total - target)
        gradient = np.concatenate([(error.T @ vectors + 2 * RIDGE / classes * w).ravel(),
                                   error.sum(axis=0)])  # fmt: skip
        return float(entropy + RIDGE / classes * np.sum(w * w)), gradient

    start = np.zeros(classes * (d + 1))
    best = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 400})
    return best.x[: classes * d].reshape(classes, d), best.x[classes * d :]


def main() -> None:
    """Train and write the weights."""
    sentences, classes = corpus()
    names = [*library(), UNKNOWN]
    labels = np.array([names.index(name) for name in classes])
    vectors = embed(sentences)
    weight, bias = fit(vectors, labels, len(names))
    right = (np.argmax(vectors @ weight.T + bias, axis=1) == labels).mean()
    with as_file(files("robomirror_drake.assets").joinpath(WEIGHTS)) as path:
        np.savez_compressed(
            path,
            names=np.array(names),
            weight=weight.astype(np.float32),
            bias=bias.astype(np.float32),
            digest=np.array(digest(sentences, classes)),
        )
    print(f"{len(sentences)} sentences, {len(names)} classes, {right:.3f} of them fitted")


if __name__ == "__main__":
    main()
