"""A small network that knows nothing of a whole motion but the largest torques of its legs.

An optimiser that climbs the large networks finds where they err. What this one sees cannot be
changed unless the motion asks less of the motors.

The torques are those that the large networks see of a reference, too: what the force through the
zero-moment point asks of a leg without mass.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.special import expit
from torch import Tensor, nn

from robomirror_drake import checkpoint
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import PAD, reference_frames
from robomirror_drake.ppn.options import TorqueOptions
from robomirror_drake.ppn.weights import check_robot
from robomirror_drake.robot import Robot

_LEAST = 1e-3  # of a torque: per body weight [m]


class TorqueNetwork(nn.Module):
    """Several networks with one hidden layer each, whose logits are averaged."""

    scale: Tensor
    calibration: Tensor

    def __init__(self, options: TorqueOptions, joints: int) -> None:
        """Of a leg with so many joints."""
        super().__init__()
        self.options = options
        members, hidden = options.members, options.hidden
        self.register_buffer("scale", torch.stack([torch.zeros(joints), torch.ones(joints)]))
        self.register_buffer("calibration", torch.tensor([1.0, 0.0]))
        self.inner = nn.Parameter(torch.randn(members, joints, hidden) / joints**0.5)
        self.bias = nn.Parameter(torch.randn(members, hidden) / joints**0.5)
        self.outer = nn.Parameter(torch.randn(members, hidden) / hidden**0.5)
        self.offset = nn.Parameter(torch.zeros(members))

    def each(self, largest: Tensor) -> Tensor:
        """(…, members) logits, not calibrated, of the largest torques (…, joints)."""
        mean, deviation = self.scale
        seen = ((largest.clamp(min=_LEAST).log() - mean) / deviation)[..., None, None, :]
        hidden = torch.tanh((seen @ self.inner)[..., 0, :] + self.bias)
        return (hidden * self.outer).sum(-1) + self.offset

    def forward(self, largest: Tensor) -> Tensor:
        """(…,) calibrated logits of a fall, of the largest torques (…, joints)."""
        slope, offset = self.calibration
        mean: Tensor = slope * self.each(largest).mean(-1) + offset
        return mean

    def fit_scales(self, largest: Tensor) -> None:
        """Takes over mean and deviation of the logarithms of (n, joints) torques."""
        seen = largest.clamp(min=_LEAST).log()
        self.scale.copy_(torch.stack([seen.mean(0), seen.std(0).clamp(min=1e-6)]))


class TorquePredictor:
    """A network on the largest torques, and the robot that it knows."""

    def __init__(
        self, network: TorqueNetwork, robot: Robot, header: dict[str, Any] | None = None
    ) -> None:
        """A predictor in the precision of the network's weights."""
        self.network = network.eval().requires_grad_(False)
        self.header = header or {}
        self._type = network.inner.dtype
        self._body = Body.of(robot).to(self._type)

    @property
    def options(self) -> TorqueOptions:
        """What the network looks at."""
        return self.network.options

    def foresee(self, q: Array, contact: Array | BoolArray) -> Array:
        """(n,) probabilities that the robot falls in motions from rest.

        Args:
            q: (n, N, 30) motions at the network's rate, Drake order.
            contact: (n, N, 2, 4) which sole corners are meant to bear load.
        """
        motions, schedules = (
            torch.from_numpy(np.array(part, np.float64)).to(self._type) for part in (q, contact)
        )
        with torch.no_grad():
            logit = self.network(largest_torques(self._body, motions, schedules, self.options))
        return np.asarray(expit(logit.double().numpy()))


def largest_torques(body: Body, q: Tensor, contact: Tensor, options: TorqueOptions) -> Tensor:
    """(n, joints of a leg) largest torque of either leg, per body weight [m].

    A norm over the time stands for the largest: it does not hang on a single sample.

    Args:
        body: Of the robot.
        q: (n, N, 30) motions, Drake order; the robot stands before and after.
        contact: (n, N, 2, 4) which sole corners are meant to bear load, 0 or 1.
        options: Rate of the motions, and power of the norm.
    """
    held = torch.arange(-PAD, q.shape[1] + PAD).clamp(0, q.shape[1] - 1)
    frames = reference_frames(body, q[:, held], contact, 1.0 / options.rate)
    legs = [len(leg) for leg in body.legs]
    torque = frames.scalars[..., -sum(legs) :].abs() + _LEAST
    most = torque.pow(options.power).sum(1).pow(1.0 / options.power)
    return torch.maximum(*torch.split(most, legs, dim=-1))


def load_torques(path: Path, robot: Robot) -> TorquePredictor:
    """A predictor from a file of weights.

    Raises:
        ConfigError: There are no such weights, or they are of another robot.
    """
    tensors, header = checkpoint.load(path, checkpoint.TORQUES)
    check_robot(path, header, robot)
    options = TorqueOptions.model_validate(header["options"]["network"])
    network = TorqueNetwork(options, tensors["network.scale"].shape[1])
    checkpoint.restore("network", network, tensors)
    return TorquePredictor(network, robot, header)
