"""The network: states attend to each other, then to the reference (the paper's section 3.3)."""

from __future__ import annotations

from typing import Final, NamedTuple

import torch
from torch import Tensor, nn

from robomirror_drake.ppn.options import PPNOptions

SCORES: Final = ("fall", "A_q", "A_qd", "A_qdd", "A_p", "A_theta")
"""What is predicted: the logit of a fall, and the logarithms of five errors."""

_FAR = 8.0  # standard deviations at which features are cut off


class Scores(NamedTuple):
    """Predictions of n windows.

    Attributes:
        fall: (n,) logit of the probability of a fall.
        errors: (n, 5) natural logarithms of the errors, in the order of :data:`SCORES`.
    """

    fall: Tensor
    errors: Tensor


class PPN(nn.Module):
    """Performance Prediction Network."""

    state_scale: Tensor
    reference_scale: Tensor
    error_scale: Tensor
    calibration: Tensor
    motion_calibration: Tensor

    def __init__(self, options: PPNOptions, state: int, reference: int) -> None:
        """A network for frames with so many features.

        Features and errors are normalised inside, by :meth:`fit_scales`; ``calibration`` holds
        slope and offset of the logit, ``motion_calibration`` those of the logit of a whole
        motion, which is worked out from its windows'.
        """
        super().__init__()
        self.options = options
        width = options.width
        self.register_buffer("state_scale", torch.stack([torch.zeros(state), torch.ones(state)]))
        ones = torch.stack([torch.zeros(reference), torch.ones(reference)])
        self.register_buffer("reference_scale", ones)
        self.register_buffer("error_scale", torch.stack([torch.zeros(5), torch.ones(5)]))
        self.register_buffer("calibration", torch.tensor([1.0, 0.0]))
        self.register_buffer("motion_calibration", torch.tensor([1.0, 0.0]))
        self.cls = nn.Parameter(torch.randn(1, 1, width) * 0.02)
        if options.use_state:
            self.encode_state = _mlp(state, width, width)
            self.state_place = nn.Parameter(torch.randn(options.back, width) * 0.02)
            self.among_states = nn.ModuleList(
                _SelfAttention(options) for _ in range(options.self_layers)
            )
        if options.use_reference:
            tokens = options.ahead // options.stack
            self.encode_reference = _mlp(reference * options.stack, width, width)
            self.reference_place = nn.Parameter(torch.randn(tokens, width) * 0.02)
        if options.use_reference and options.use_cross_attention:
            self.to_reference = nn.ModuleList(
                _CrossAttention(options) for _ in range(options.cross_layers)
            )
        beside = options.use_reference and not options.use_cross_attention
        self.head = nn.Sequential(
            nn.LayerNorm(2 * width if beside else width),
            _mlp(2 * width if beside else width, width, len(SCORES)),
        )

    def forward(self, state: Tensor, reference: Tensor) -> Scores:
        """Scores of windows.

        Args:
            state: (n, S, F_s) features of the states up to now.
            reference: (n, T, F_r) features of the reference from now on.
        """
        count = max(len(state), len(reference))
        tokens = self.cls.expand(count, -1, -1)
        if self.options.use_state:
            seen = self.encode_state(_normal(state, self.state_scale)) + self.state_place
            tokens = torch.cat([tokens, seen.expand(count, -1, -1)], 1)
            for layer in self.among_states:
                tokens = layer(tokens)
        if self.options.use_reference:
            frames = _normal(reference, self.reference_scale)
            stacked = frames.reshape(len(frames), -1, self.options.stack * frames.shape[-1])
            asked = self.encode_reference(stacked) + self.reference_place
            if self.options.use_cross_attention:
                for layer in self.to_reference:
                    tokens = layer(tokens, asked)
                context = tokens[:, 0]
            else:
                context = torch.cat([tokens[:, 0], asked.mean(1).expand(count, -1)], -1)
        else:
            context = tokens[:, 0]
        out = self.head(context)
        slope, offset = self.calibration
        mean, deviation = self.error_scale
        return Scores(slope * out[:, 0] + offset, mean + deviation * out[:, 1:])

    def fit_scales(self, state: Tensor, reference: Tensor, errors: Tensor) -> None:
        """Normalises by the frames (N, F_s), (M, F_r) and logarithmic errors (W, 5) of the data."""
        for scale, data in (
            (self.state_scale, state), (self.reference_scale, reference),
            (self.error_scale, errors),
        ):  # fmt: skip
            scale.copy_(torch.stack([data.mean(0), data.std(0).clamp(min=1e-3)]))


def _normal(x: Tensor, scale: Tensor) -> Tensor:
    # Smooth to the ends, so that gradients do not vanish at once where features are far out.
    return _FAR * torch.tanh((x - scale[0]) / (_FAR * scale[1]))


def _mlp(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.GELU(), nn.Linear(hidden, outputs))


class _SelfAttention(nn.Module):
    """Pre-norm attention among tokens, then a feed-forward layer."""

    def __init__(self, options: PPNOptions) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(options.width)
        self.attention = _Attention(options)
        self.feed = _FeedForward(options)

    def forward(self, tokens: Tensor) -> Tensor:
        normed = self.norm(tokens)
        attended: Tensor = self.feed(tokens + self.attention(normed, normed))
        return attended


class _CrossAttention(nn.Module):
    """Pre-norm attention of tokens to the reference (equation 4), then a feed-forward layer."""

    def __init__(self, options: PPNOptions) -> None:
        super().__init__()
        self.norm, self.asked_norm = nn.LayerNorm(options.width), nn.LayerNorm(options.width)
        self.attention = _Attention(options)
        self.feed = _FeedForward(options)

    def forward(self, tokens: Tensor, asked: Tensor) -> Tensor:
        attended = self.attention(self.norm(tokens), self.asked_norm(asked))
        fed: Tensor = self.feed(tokens + attended)
        return fed


class _Attention(nn.Module):
    """Attention with several heads."""

    def __init__(self, options: PPNOptions) -> None:
        super().__init__()
        self.heads, self.dropout = options.heads, options.dropout
        self.query = nn.Linear(options.width, options.width)
        self.key_value = nn.Linear(options.width, 2 * options.width)
        self.out = nn.Linear(options.width, options.width)

    def forward(self, tokens: Tensor, other: Tensor) -> Tensor:
        query = self._split(self.query(tokens))
        key, value = self.key_value(other).chunk(2, -1)
        found = nn.functional.scaled_dot_product_attention(
            query, self._split(key), self._split(value)
        )
        mixed: Tensor = self.out(found.transpose(-2, -3).flatten(-2))
        return nn.functional.dropout(mixed, self.dropout, self.training)

    def _split(self, x: Tensor) -> Tensor:
        return x.reshape(*x.shape[:-1], self.heads, -1).transpose(-2, -3)


class _FeedForward(nn.Module):
    def __init__(self, options: PPNOptions) -> None:
        super().__init__()
        self.dropout = options.dropout
        self.layers = nn.Sequential(
            nn.LayerNorm(options.width), _mlp(options.width, 2 * options.width, options.width)
        )

    def forward(self, tokens: Tensor) -> Tensor:
        fed: Tensor = self.layers(tokens)
        return tokens + nn.functional.dropout(fed, self.dropout, self.training)
