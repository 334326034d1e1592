"""What a sceptic would try first with whole motions: trees on the largest torques of the legs.

The torques are those that the network sees of a reference: what the force through the
zero-moment point asks of a leg without mass. No time, no posture, nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier

from robomirror_drake.learning.calibrate import platt
from robomirror_drake.learning.motions import Motion
from robomirror_drake.learning.torques import torques_of
from robomirror_drake.messages import Array
from robomirror_drake.ppn.options import TorqueOptions
from robomirror_drake.robot import Robot

NAME = "boosted trees on the largest torques"


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

    def seen(motions: Sequence[Motion]) -> Array:
        return torques_of(robot, motions, TorqueOptions()).numpy()

    def raw(motions: Sequence[Motion]) -> Array:
        return np.asarray(trees.decision_function(seen(motions)))

    trees = HistGradientBoostingClassifier(
        max_iter=80, learning_rate=0.05, max_leaf_nodes=8, l2_regularization=1.0, random_state=seed
    )
    trees.fit(seen(learned), np.array([motion.fell for motion in learned]))
    fell = np.array([motion.fell for motion in calibrated], np.bool_)
    slope, offset = platt(raw(calibrated), fell)
    return [slope * raw(motions) + offset if motions else np.zeros(0) for motions in judged]
