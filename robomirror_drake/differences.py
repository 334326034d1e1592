"""What speaks against a prediction: weights that learned in other physics than there are here."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

from robomirror_drake.config import Scenario, load_scenario
from robomirror_drake.exceptions import ConfigError

_TOLD = 3  # differences in a sentence
_UNLIKE = ("simulation.hold", "simulation.after_fall")  # what a prediction does not depend on


def physics_warnings(header: Mapping[str, Any], scenario: Scenario, weights: str) -> list[str]:
    """A sentence where a scenario is not the one that weights were trained in; else nothing.

    Args:
        header: Of the weights; its ``scenario`` is that of the data set.
        scenario: What is to be predicted for.
        weights: Their name.
    """
    learned: Mapping[str, Any] = header.get("scenario") or {}
    if not learned:
        return [f"the weights {weights} do not say in which physics they were trained"]
    apart = differences(learned, scenario)
    if not apart:
        return []
    more = f", and {len(apart) - _TOLD} more" if len(apart) > _TOLD else ""
    same = _scenario_like(learned)
    advice = f"; --scenario {same} has what they know" if same else ""
    return [
        f"the weights {weights} learned of another world than this one:"
        f" {', '.join(apart[:_TOLD])}{more}. What they foresee may not hold here{advice}"
    ]


def differences(learned: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Settings of robot, planner and physics that are not as they were, a phrase each.

    What did not exist yet when the data set was made is not looked at.
    """
    here = scenario.model_dump(mode="json", include={"robot", "planner", "simulation"})
    there, now = _flat(learned), _flat(here)
    return [
        f"{name} is {_plain(now[name])}, theirs {_plain(there[name])}"
        for name in sorted(now)
        if name in there and there[name] != now[name] and name not in _UNLIKE
    ]


def _scenario_like(learned: Mapping[str, Any]) -> str | None:
    """Name of a packaged scenario with the physics that were learned."""
    folder = resources.files("robomirror_drake.assets") / "scenarios"
    for name in sorted(f.name.removesuffix(".yaml") for f in folder.iterdir()):
        try:
            scenario = load_scenario(name)
        except ConfigError:
            continue  # studies stand in the same folder
        if not differences(learned, scenario):
            return name
    return None


def _flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Settings by their path; lists count as values."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _plain(value: Any) -> str:
    """A value for a reader; a range without extent is one number."""
    if isinstance(value, list) and value and all(entry == value[0] for entry in value):
        value = value[0]
    return (
        "none" if value in (None, []) else f"{value:g}" if isinstance(value, float) else f"{value}"
    )
