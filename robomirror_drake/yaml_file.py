"""YAML files as validated models, with errors that name the key, the fault and the value."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from robomirror_drake.exceptions import ConfigError

Model = TypeVar("Model", bound=BaseModel)

_MESSAGES = {"extra_forbidden": "there is no such key; `robomirror scenario` prints them all"}
"""Clearer words for a fault than the validator's own, by its type."""


def load_yaml(model: type[Model], folder: str, file: str | Path) -> Model:
    """Reads a YAML file into a model; an empty file has all defaults.

    Args:
        model: What the file holds.
        folder: Where in ``assets`` files of this kind are.
        file: Name of a file there, without suffix, or any path.

    Raises:
        ConfigError: There is no such file, it is not YAML, or a key or value is wrong.
    """
    shipped = resources.files("robomirror_drake.assets") / folder
    is_path = isinstance(file, Path) or file.endswith((".yaml", ".yml"))
    source = Path(file) if is_path else shipped / f"{file}.yaml"
    try:
        data = yaml.safe_load(source.read_text(encoding="utf-8"))
    except OSError as error:
        known = ", ".join(
            sorted(
                f.name.removesuffix(".yaml") for f in shipped.iterdir() if f.name.endswith(".yaml")
            )
        )
        raise ConfigError(f"no {folder}/{file}; known: {known}; or give a path") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: not YAML: {error}") from error
    return validate(model, {} if data is None else data, str(file))


def validate(model: type[Model], data: object, name: str) -> Model:
    """A model from plain data.

    Raises:
        ConfigError: A key is unknown or a value is wrong; the message names all of them.
    """
    if faults := "; ".join(_not_finite(data)):
        raise ConfigError(f"{name}: {faults}")
    try:
        return model.model_validate(data)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(map(str, e['loc'])) or 'top level'}: "
            f"{_MESSAGES.get(e['type'], e['msg'])} (got {e['input']!r:.60})"
            for e in error.errors()
        )
        raise ConfigError(f"{name}: {faults}") from error


def changed(model: Model, **changes: object) -> Model:
    """A model with what the command line says instead; what is None or empty stays as it is.

    Raises:
        ConfigError: A value is wrong.
    """
    given = {key: value for key, value in changes.items() if value not in (None, "")}
    return validate(type(model), model.model_dump() | given, "command line")


def _not_finite(data: object, key: str = "") -> Iterator[str]:
    """What is wrong with each number that is infinite or NaN."""
    if isinstance(data, float) and not math.isfinite(data):
        yield f"{key}: {data} is not a finite number"
    items: Iterable[tuple[object, object]] = ()
    if isinstance(data, Mapping):
        items = data.items()
    elif isinstance(data, list | tuple):
        items = enumerate(data)
    for name, value in items:
        yield from _not_finite(value, f"{key}.{name}" if key else str(name))


def to_yaml(model: BaseModel) -> str:
    """A model with all its defaults as YAML, each key followed by what it is for."""
    return "".join(f"{line}\n" for line in _lines(model, 0))


def _lines(model: BaseModel, depth: int) -> Iterator[str]:
    indent = "  " * depth
    plain = model.model_dump(mode="json")
    for name, info in type(model).model_fields.items():
        value = getattr(model, name)
        note = f"  # {info.description}" if info.description else ""
        if isinstance(value, BaseModel):
            yield f"{indent}{name}:{note}"
            yield from _lines(value, depth + 1)
        else:
            yield f"{indent}{name}: {_plain(plain[name])}{note}"


def _plain(value: object) -> str:
    """A value on one line; JSON's strings are YAML's, quoted."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=math.inf)
    return str(text).splitlines()[0]
