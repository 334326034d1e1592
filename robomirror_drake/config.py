"""A scenario: every setting of a run in one YAML file.

A scenario names only what differs from the defaults; see
``assets/scenarios/default.yaml`` for all keys with their defaults. Unknown keys and
bad values are refused with the key's name.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robomirror_drake.exceptions import ConfigError
from robomirror_drake.motion.generate import GeneratorOptions
from robomirror_drake.optimization.plan import PlanOptions
from robomirror_drake.optimization.retarget import RetargetOptions
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.systems.whole_body_controller import ControllerOptions


class Scenario(BaseModel):
    """All settings of a run, one section a stage."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    command: str = Field("", description="what to do, in words, or a motion file")
    robot: str = Field("jvrc1", description="name of a YAML in assets/robots, or its path")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of everything that is drawn")
    candidates: int = Field(4, ge=1, le=256, description="human motions to generate")
    generator: GeneratorOptions = GeneratorOptions()
    retargeter: RetargetOptions = RetargetOptions()
    planner: PlanOptions = PlanOptions()
    controller: ControllerOptions = ControllerOptions()
    simulation: SimulationOptions = SimulationOptions()

    def to_yaml(self) -> str:
        """The whole scenario, defaults included, as YAML that :func:`load_scenario` reads."""
        return yaml.safe_dump(
            self.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=100
        )


def load_scenario(scenario: str | Path) -> Scenario:
    """Reads a scenario.

    Args:
        scenario: Name of a file in ``assets/scenarios`` without suffix, or a path.

    Raises:
        ConfigError: There is no such file, it is not YAML, or a key or value is wrong.
    """
    folder = resources.files("robomirror_drake.assets") / "scenarios"
    is_path = isinstance(scenario, Path) or scenario.endswith((".yaml", ".yml"))
    file = Path(scenario) if is_path else folder / f"{scenario}.yaml"
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        known = sorted(f.name.removesuffix(".yaml") for f in folder.iterdir())
        raise ConfigError(f"no scenario {str(scenario)!r}; known: {', '.join(known)}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{scenario}: not YAML: {error}") from error
    return validate_scenario({} if data is None else data, str(scenario))


def validate_scenario(data: object, name: str = "scenario") -> Scenario:
    """A scenario from plain data.

    Raises:
        ConfigError: A key is unknown or a value is wrong; the message names all of them.
    """
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(map(str, e['loc'])) or 'top level'}: {e['msg']} (got {e['input']!r:.60})"
            for e in error.errors()
        )
        raise ConfigError(f"{name}: {faults}") from error
