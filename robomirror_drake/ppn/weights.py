"""Files of weights: which one is meant, and whether it is for this robot."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from robomirror_drake.exceptions import ConfigError
from robomirror_drake.robot import Robot

PACKAGED = Path(str(files("robomirror_drake.assets") / "ppn"))
"""Folder of the weights that come with the package."""


def weights_file(weights: str | Path) -> Path:
    """The file of weights.

    Args:
        weights: Name of a file in ``assets/ppn`` without suffix, or a path.

    Raises:
        ConfigError: None of the packaged has this name.
    """
    path = Path(weights)
    if path.suffix:
        return path
    path = PACKAGED / f"{weights}.safetensors"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in PACKAGED.glob("*.safetensors"))) or "none"
        raise ConfigError(f"no weights {str(weights)!r}; known: {known}; or give a path")
    return path


def check_robot(path: Path, header: Mapping[str, Any], robot: Robot) -> None:
    """Raises ConfigError where weights in a file were made for another robot."""
    for what, there, here in (
        ("robot", header["robot"], robot.spec.name),
        ("joints", header["joints"], list(robot.joint_names)),
    ):
        if there != here:
            raise ConfigError(f"{path}: weights of {what} {there}, but here it is {here}")
