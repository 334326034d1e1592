"""Whole motions before they begin: whether the robot will fall is all that a choice rests on."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.compute as pc
from scipy.special import logit

from robomirror_drake.learning import metrics
from robomirror_drake.learning.metrics import Draws, Integers
from robomirror_drake.learning.windows import executed, take_reference
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.ppn.features import rows_at
from robomirror_drake.ppn.predictor import EVERY, Predictor, whole
from robomirror_drake.ppn.torques import TorquePredictor


class Motion(NamedTuple):
    """A kinematic reference that was executed, with nothing that disturbed it.

    Attributes:
        q: (N, 30) at 60 Hz, Drake order.
        contact: (N, 2, 4) which sole corners are meant to bear load.
        command: Which one it is a candidate of.
        fell: Whether the robot fell.
    """

    q: Array
    contact: Array
    command: int
    fell: bool


def read_motions(folder: Path, splits: Collection[str]) -> dict[str, list[Motion]]:
    """All motions of some splits of a data set that were executed without a disturbance.

    Raises:
        ResultError: It was made before episodes held their kinematic reference.
    """
    motions: dict[str, list[Motion]] = {split: [] for split in splits}
    wanted = (pc.field("kind") == "nominal") & pc.field("split").isin(list(splits))
    for _, table in executed(folder):
        for row in table.filter(wanted).to_pylist():
            motion = Motion(*take_reference(row), row["prompt_index"], bool(row["fell"]))
            motions[row["split"]].append(motion)
    return motions


def foreseen(predictor: Predictor | Ensemble | TorquePredictor, motions: Sequence[Motion]) -> Array:
    """(n,) logits of the probability that the robot falls in each motion, begun from rest."""
    logits = []
    for motion in motions:
        rows = rows_at(whole(len(motion.q), predictor.options.rate), len(motion.q))
        q, contact = motion.q[None, rows], motion.contact[None, rows]
        if isinstance(predictor, TorquePredictor):
            fall = predictor.foresee(q, contact)
        else:
            fall = predictor.foresee(q, contact, every=EVERY).fall_probability
        logits.append(float(logit(fall[0])))
    return np.array(logits)


def motion_figures(
    motions: Sequence[Motion], logits: Array, threshold: float, draws: int, seed: int
) -> dict[str, Any]:
    """How well motions are told apart, and what choosing by that is worth.

    ``chosen_upright`` is the share of the commands, of those whose motions end in different
    ways, where the motion of the least risk stands; ``drawn_upright`` that of a motion drawn
    at random.

    Args:
        motions: All of some commands.
        logits: (n,) of the probability of a fall.
        threshold: From which logit on a fall is predicted.
        draws: Of the bootstrap over commands.
        seed: Of it.
    """
    fell = np.array([motion.fell for motion in motions], np.bool_)
    command = np.array([motion.command for motion in motions], np.int64)
    drawn = Draws(command, draws, seed)
    hit, alarm = metrics.rates(logits > threshold, fell)
    return {
        "commands": len(np.unique(command)),
        "motions": len(motions),
        "falls": int(fell.sum()),
        "auroc": metrics.auroc(logits, fell),
        "auroc_interval": metrics.interval(drawn.auroc(logits, fell)),
        "true_positive_rate": hit,
        "false_positive_rate": alarm,
        **_choice(logits, fell, command),
    }


def _choice(logits: Array, fell: BoolArray, command: Integers) -> dict[str, Any]:
    own = [command == one for one in np.unique(command)]
    mixed = [one for one in own if 0 < fell[one].sum() < one.sum()]
    chosen = [not fell[one][np.argmin(logits[one])] for one in mixed]
    drawn = [1.0 - fell[one].mean() for one in mixed]
    return {
        "commands_mixed": len(mixed),
        "chosen_upright": float(np.mean(chosen)) if mixed else float("nan"),
        "drawn_upright": float(np.mean(drawn)) if mixed else float("nan"),
    }
