"""Finds trained weights, and says what each is a model of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ResultError
from robomirror_drake.learning.train import CHECKPOINT, WEIGHTS
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import Predictor, load_predictor
from robomirror_drake.ppn.torques import TorquePredictor, load_torques
from robomirror_drake.ppn.weights import PACKAGED
from robomirror_drake.robot import Robot


class Weights(NamedTuple):
    """Trained weights.

    Attributes:
        path: Their file.
        model: What they are a model of, in words.
        predictor: Made from them.
    """

    path: Path
    model: str
    predictor: Predictor

    @property
    def name(self) -> str:
        """Under which they are packaged, or the folder that they were trained into."""
        return _name(self.path)

    @property
    def options(self) -> PPNOptions:
        """Of the network."""
        return self.predictor.options

    @property
    def training(self) -> dict[str, Any]:
        """Settings that they were trained with."""
        return dict(self.predictor.header["options"])


def load_all(paths: Sequence[Path], robot: Robot) -> list[Weights]:
    """All weights in files and folders, the full models first.

    Raises:
        ConfigError: A file holds no weights for this robot.
        ResultError: There are none.
    """
    found = [path for path in _found(paths) if not checkpoint.is_of(path, checkpoint.TORQUES)]
    if not found:
        raise ResultError(
            f"{', '.join(map(str, _places(paths)))}: no weights of a {checkpoint.PREDICTOR}; "
            "train them with `robomirror train`, or name others with --weights"
        )
    loaded = [(path, load_predictor(path, robot)) for path in found]
    told = [(p.options.horizon, _described(p)) for _, p in loaded]
    models = [
        Weights(
            path,
            words if told.count((horizon, words)) == 1 else f"{words} ({path})",
            predictor,
        )
        for (path, predictor), (horizon, words) in zip(loaded, told, strict=True)
    ]
    return sorted(models, key=lambda m: (m.options.horizon, len(m.model), m.model))


def load_all_torques(paths: Sequence[Path], robot: Robot) -> dict[str, TorquePredictor]:
    """All weights in the same places that see nothing but torques, by name.

    Raises:
        ConfigError: A file holds weights of another robot.
    """
    return {
        _name(path): load_torques(path, robot)
        for path in _found(paths)
        if checkpoint.is_of(path, checkpoint.TORQUES)
    }


def _places(paths: Sequence[Path]) -> Sequence[Path]:
    return paths or [PACKAGED]


def _found(paths: Sequence[Path]) -> list[Path]:
    return list(dict.fromkeys(file for place in _places(paths) for file in _files(place)))


def _name(path: Path) -> str:
    return path.parent.name if path.name == WEIGHTS else path.stem


def _files(place: Path) -> Iterator[Path]:
    if place.is_file():
        yield place
        return
    if not place.is_dir():
        raise ResultError(
            f"{place}: no such file or folder of weights; train some with `robomirror train`"
        )
    for path in sorted(place.rglob("*.safetensors")):
        if path.name != CHECKPOINT:
            yield path


def _described(predictor: Predictor) -> str:
    """What a network is: all of it, or what it does without."""
    options, share = predictor.options, predictor.header["options"]["share"]
    lacks = [
        words
        for words, there in (
            ("reference", options.use_reference),
            ("state", options.use_state),
            ("cross-attention", options.use_cross_attention),
        )
        if not there
    ]
    of = " of commanded states" if options.states == "commanded" else ""
    words = f"PPN{of}" + (f" without {' and '.join(lacks)}" if lacks else "")
    return words if share == 1.0 else f"{words}, {100 * share:g} % of the commands"
