"""A scenario: every setting of a run in one YAML file.

A scenario names only what differs from the defaults; ``robomirror scenario`` prints
all keys with their defaults. Unknown keys and bad values are refused with the key's
name.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.motion.generate import GeneratorOptions
from robomirror_drake.optimization.planning.plan import PlanOptions
from robomirror_drake.optimization.retargeting.retarget import RetargetOptions
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.yaml_file import load_yaml


class Scenario(BaseModel):
    """All settings of a run, one section a stage."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    command: str = Field("", description="what to do, in words, or a motion file")
    robot: str = Field("jvrc1", description="name of a YAML in assets/robots, or its path")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of everything that is drawn")
    candidates: int = Field(4, ge=1, le=256, description="human motions to generate")
    generator: GeneratorOptions = GeneratorOptions()
    retargeter: RetargetOptions = RetargetOptions()
    adaptation: AdaptationOptions = AdaptationOptions()
    planner: PlanOptions = PlanOptions()
    simulation: SimulationOptions = SimulationOptions()


def load_scenario(scenario: str | Path) -> Scenario:
    """Reads a scenario.

    Args:
        scenario: Name of a file in ``assets/scenarios`` without suffix, or a path.

    Raises:
        ConfigError: There is no such file, it is not YAML, or a key or value is wrong.
    """
    return load_yaml(Scenario, "scenarios", scenario)
