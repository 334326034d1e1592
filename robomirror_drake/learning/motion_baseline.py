"""What a sceptic would try first with whole motions: trees on the largest torques of the legs.

The torques are those that the network sees of a reference: what the force through the
zero-moment point asks of a leg without mass. No time, no posture, nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from sklearn.ensemble import HistGradientBoostingClassifier

from robomirror_drake.learning.calibrate import platt
from robomirror_drake.learning.motions import Motion
from robomirror_drake.messages import Array
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import PAD, reference_frames, rows_at
from robomirror_drake.ppn.predictor import whole
from robomirror_drake.robot import Robot

NAME = "boosted trees on the largest torques"

_RATE = 20.0  # of a reference that is looked at [Hz]


def torque_logits(
    robot: Robot,
    learned: Sequence[Motion],
    calibrated: Sequence[Motion],
    judged: Sequence[Sequence[Motion]],
    seed: int = 0,
) -> list[Array]:
    """Logits of a fall, of trees that see the largest torque of each pair of leg joints.

    Args:
        robot: That does the motions.
        learned: Motions to learn from.
        calibrated: Motions to calibrate with.
        judged: Several lists of motions to foresee.
        seed: Of the trees.

    Returns:
        For each list (n,) logits.
    """
    body = Body.of(robot)

    def raw(motions: Sequence[Motion]) -> Array:
        seen = np.array([_largest(body, motion) for motion in motions])
        return np.asarray(trees.decision_function(seen))

    trees = HistGradientBoostingClassifier(
        max_iter=80, learning_rate=0.05, max_leaf_nodes=8, l2_regularization=1.0, random_state=seed
    )
    trees.fit(
        np.array([_largest(body, motion) for motion in learned]),
        np.array([motion.fell for motion in learned]),
    )
    fell = np.array([motion.fell for motion in calibrated], np.bool_)
    slope, offset = platt(raw(calibrated), fell)
    return [slope * raw(motions) + offset if motions else np.zeros(0) for motions in judged]


def _largest(body: Body, motion: Motion) -> Array:
    """(joints of a leg,) largest torque of either leg, per body weight [m]."""
    count = len(motion.q)
    samples = len(whole(count, _RATE))
    rows = rows_at(np.arange(-PAD, samples + PAD) / _RATE, count)
    q, contact = motion.q[rows], motion.contact[rows[PAD:-PAD]]
    frames = reference_frames(body, torch.from_numpy(q), torch.from_numpy(contact), 1.0 / _RATE)
    legs = [len(leg) for leg in body.legs]
    torque = np.abs(frames.scalars[:, -sum(legs) :].numpy()).max(axis=0)
    return np.asarray(np.maximum(torque[: legs[0]], torque[legs[0] :]))
