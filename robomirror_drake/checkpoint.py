"""Networks on disk: safetensors whose header says what they are and what they were trained on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from robomirror_drake.exceptions import ConfigError, ResultError

GENERATOR, PREDICTOR, TORQUES = "motion generator", "performance predictor", "torque predictor"
"""Kinds of networks."""

GENERATOR_FILE, EVALUATOR_FILE = "generator.safetensors", "evaluator.safetensors"


def save(
    path: Path, tensors: Mapping[str, Tensor], header: Mapping[str, Any], kind: str = GENERATOR
) -> None:
    """Writes tensors and a header, whole or not at all."""
    text = json.dumps({"format": _format(kind)} | dict(header), sort_keys=True)
    unfinished = path.with_suffix(".part")
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    try:
        save_file(plain, unfinished, metadata={"robomirror": text})
        unfinished.replace(path)
    except (OSError, SafetensorError) as error:
        raise ResultError(f"{path} cannot be written: {error}") from error


def load(path: Path, kind: str = GENERATOR) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors, in single precision where they are numbers, and the header.

    Raises:
        ConfigError: The file is missing, damaged, or not one of these.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = _header(file)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, json.JSONDecodeError) as error:
        raise ConfigError(f"{path}: no weights of a {kind}: {error}") from error
    if header.get("format") != _format(kind):
        raise ConfigError(f"{path}: no weights of a {kind}")
    return {
        name: tensor.float() if tensor.is_floating_point() else tensor
        for name, tensor in tensors.items()
    }, header


def is_of(path: Path, kind: str) -> bool:
    """Whether a file holds weights of a kind; it need not be there, nor be any weights."""
    try:
        with safe_open(path, framework="pt") as file:
            return bool(_header(file).get("format") == _format(kind))
    except (OSError, SafetensorError, json.JSONDecodeError):
        return False


def _header(file: Any) -> dict[str, Any]:
    told: dict[str, Any] = json.loads((file.metadata() or {}).get("robomirror", "{}"))
    return told


def _format(kind: str) -> str:
    return f"robomirror {kind} 1"


def named(prefix: str, module: nn.Module) -> dict[str, Tensor]:
    """A module's tensors, each name begun with the prefix."""
    return {f"{prefix}.{name}": tensor for name, tensor in module.state_dict().items()}


def restore(prefix: str, module: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Puts the tensors whose names begin with the prefix into a module.

    Raises:
        ConfigError: They do not fit it.
    """
    own = {
        name.removeprefix(f"{prefix}."): tensor
        for name, tensor in tensors.items()
        if name.startswith(f"{prefix}.")
    }
    try:
        module.load_state_dict(own)
    except RuntimeError as error:
        raise ConfigError(f"the weights of {prefix} do not fit its settings: {error}") from error


def named_optimizer(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """An optimizer's moments, by number of the parameter."""
    return {
        f"optimizer.{i}.{name}": tensor
        for i, state in optimizer.state_dict()["state"].items()
        for name, tensor in state.items()
    }


def restore_optimizer(optimizer: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Puts back what :func:`named_optimizer` gave."""
    state: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        if name.startswith("optimizer."):
            _, number, moment = name.split(".")
            state.setdefault(int(number), {})[moment] = tensor
    optimizer.load_state_dict(optimizer.state_dict() | {"state": state})
