"""Train a network on the largest torques of whole motions; seconds, once these have been read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ResultError
from robomirror_drake.learning.calibrate import calibrate
from robomirror_drake.learning.motions import Motion, read_motions
from robomirror_drake.learning.train import WEIGHTS, physics_of
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import rows_at
from robomirror_drake.ppn.options import TorqueOptions, TrainTorquesOptions
from robomirror_drake.ppn.predictor import whole
from robomirror_drake.ppn.torques import TorqueNetwork, largest_torques
from robomirror_drake.robot import Robot, load_robot


def train_torques(
    options: TrainTorquesOptions, stepped: Callable[[int, int], None] = lambda *_: None
) -> Path:
    """Trains on motions as they were executed undisturbed; returns the file of the weights.

    Args:
        options: Of the training.
        stepped: Told how many epochs are done, and of how many.

    Raises:
        ResultError: The data set has no motions to learn from or to calibrate with.
    """
    torch.set_num_threads(1)
    robot = load_robot(options.robot)
    motions = read_motions(options.data, ("train", "validation"))
    for split, some in motions.items():
        if len({motion.fell for motion in some}) < 2:
            raise ResultError(
                f"{options.data}: of {len(some)} undisturbed motions of the split {split!r} all "
                "end alike; generate executions of more commands"
            )
    seen = {
        split: torques_of(robot, some, options.network).float() for split, some in motions.items()
    }
    fell = {
        split: np.array([motion.fell for motion in some], np.bool_)
        for split, some in motions.items()
    }
    torch.manual_seed(options.seed)
    network = TorqueNetwork(options.network, seen["train"].shape[1])
    network.fit_scales(seen["train"])
    _fit(network, seen["train"], torch.from_numpy(fell["train"]).float(), options, stepped)
    with torch.no_grad():
        logit = network(seen["validation"]).double().numpy()
    calibrate(network.calibration, logit, fell["validation"])
    header = {
        "options": options.model_dump(mode="json", exclude={"data", "out"}),
        "data": {
            "motions_learned": len(motions["train"]),
            "commands_learned": len({motion.command for motion in motions["train"]}),
            "falls_learned": float(fell["train"].mean()),
            "falls_validation": float(fell["validation"].mean()),
        },
        "scenario": physics_of(options.data),
        "robot": robot.spec.name,
        "joints": list(robot.joint_names),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / WEIGHTS
    checkpoint.save(path, checkpoint.named("network", network), header, checkpoint.TORQUES)
    return path


def torques_of(robot: Robot, motions: Sequence[Motion], options: TorqueOptions) -> Tensor:
    """(n, joints of a leg) the largest torques of motions, see :func:`.largest_torques`."""
    body = Body.of(robot)
    seen = []
    for motion in motions:
        rows = rows_at(whole(len(motion.q), options.rate), len(motion.q))
        q, contact = (torch.from_numpy(part[None, rows]) for part in (motion.q, motion.contact))
        seen.append(largest_torques(body, q.double(), contact.double(), options))
    return torch.cat(seen)


def _fit(
    network: TorqueNetwork,
    seen: Tensor,
    fell: Tensor,
    options: TrainTorquesOptions,
    stepped: Callable[[int, int], None],
) -> None:
    """Each of the members learns by itself, from the same batches."""
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay
    )
    for epoch in range(1, options.epochs + 1):
        for batch in torch.split(torch.randperm(len(seen)), options.batch):
            logit = network.each(seen[batch])
            truth = fell[batch, None].expand_as(logit)
            loss = binary_cross_entropy_with_logits(logit, truth) * options.network.members
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
        stepped(epoch, options.epochs)
