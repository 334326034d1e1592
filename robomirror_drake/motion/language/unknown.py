"""What is no action of the library, in words: to be refused rather than mistaken."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

import yaml
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.motion.language.patterns import pattern


class Unknown(BaseModel):
    """The contents of ``assets/unknown.yaml``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    words: tuple[str, ...] = Field(description="Expressions, as those of an action.")
    phrases: tuple[str, ...] = Field(description="What may follow 'a person', or whole sentences.")


@cache
def unknown() -> Unknown:
    """What is known to be unknown."""
    text = files("robomirror_drake.assets").joinpath("unknown.yaml").read_text(encoding="utf-8")
    return Unknown(**yaml.safe_load(text))


@cache
def _patterns() -> tuple[re.Pattern[str], ...]:
    return tuple(pattern(word) for word in unknown().words)


def foreign(text: str) -> str:
    """The longest stretch of a text that words of no action of the library match; or empty."""
    found = (m[0] for p in _patterns() for m in p.finditer(text))
    return max(found, key=len, default="")
