"""Settings of a study, and the grid of variants that they span."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, Final, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from robomirror_drake.adaptation.handover_options import AdapterOptions
from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.config import Scenario, load_scenario
from robomirror_drake.dataset.options import replaced
from robomirror_drake.dataset.prompts import Split
from robomirror_drake.disturbance import DisturbanceOptions
from robomirror_drake.optimization.adaptation.options import AdaptOptions, Variable
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.yaml_file import validate

Method = Literal[
    "none",
    "random",
    "selection",
    "optimisation",
    "selection_optimisation",
    "closed_loop",
    "closed_loop_alone",
    "oracle",
]
"""``random`` is the mean over the pool without the command's own motion; ``oracle`` simulates
the pool and takes what survives; ``closed_loop`` does what ``selection_optimisation`` takes, and
changes it on the way; ``closed_loop_alone`` does that with the command's own motion; the others
are those of adaptation."""

QPSolver = Literal["daqp", "osqp", "piqp", "proxqp", "quadprog"]
TSafe = Annotated[float, Field(gt=0.0, lt=1.0)]
PoolSize = Annotated[int, Field(ge=1, le=256)]

POOLED: Final = ("random", "selection", "selection_optimisation", "closed_loop", "oracle")
"""Methods that depend on the size of the pool."""

OPTIMISING: Final = ("optimisation", "selection_optimisation", "closed_loop")
"""Methods that depend on the optimiser."""

CLOSED: Final = ("closed_loop", "closed_loop_alone")
"""Methods that change the motion while it runs."""

FORESEEING: Final = ("selection", *OPTIMISING, "closed_loop_alone")
"""Methods that depend on the threshold."""


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Level(_Options):
    """One level of disturbance."""

    name: str = Field(min_length=1, description="in tables and plots")
    disturbance: DisturbanceOptions = Field(
        DisturbanceOptions(), description="what it names replaces that of the scenario"
    )


class Grid(_Options):
    """Every method with every value of what it depends on."""

    methods: tuple[Method, ...] = Field(
        get_args(Method),
        min_length=1,
        description=", ".join(get_args(Method)),
    )
    t_safe: tuple[TSafe, ...] = Field((0.9,), min_length=1, description="thresholds T_safe")
    pool: tuple[PoolSize, ...] = Field((8,), min_length=1, description="candidates, at most")
    variables: tuple[tuple[Variable, ...], ...] = Field(
        (), description="of the optimiser, sets to compare; empty for the scenario's"
    )
    qp_solver: tuple[QPSolver, ...] = Field(
        (), description="of the optimiser, to compare; empty for the scenario's"
    )
    levels: tuple[Level, ...] = Field(
        (Level(name="scenario"),),
        min_length=1,
        description="of disturbance; commands are chosen by how they end in the first",
    )


class StudyOptions(_Options):
    """What is compared, on which commands."""

    scenario: str = Field("worn", description="physics, planner, sources: a scenario, or its path")
    changes: dict[str, Any] = Field(
        {"simulation": {"after_fall": 0.1}}, description="of the scenario, section by section"
    )
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of everything that is drawn")
    prompts: str = Field("corpus", description="file of commands, or a corpus in assets/prompts")
    splits: tuple[Split, ...] = Field(("test",), description="which of them; empty for all")
    failing: int = Field(420, ge=0, description="commands whose own motion falls")
    succeeding: int = Field(60, ge=0, description="commands whose own motion does not")
    patience: int = Field(
        25, ge=0, description="executions without a fall after which a group is given up"
    )
    longest: float = Field(
        10.0, gt=0.0, description="commands whose own motion takes longer are passed over [s]"
    )
    simulated: Literal["whole", "enough", "chosen"] = Field(
        "whole",
        description="of each pool: all of it; until something survives; only what is taken",
    )
    draws: int = Field(
        2, ge=1, description="candidates that `random` is the mean of, where not all are simulated"
    )
    adapter: AdapterOptions = Field(
        AdapterOptions(), description="of closed loops; their T_safe is that of the grid"
    )
    grid: Grid = Grid()

    @model_validator(mode="after")
    def _possible(self) -> Self:
        asked = sorted({"random", "oracle"} & set(self.grid.methods))
        if self.simulated == "chosen" and asked:
            raise ValueError(
                f"{' and '.join(asked)} need more than what is chosen: set simulated to "
                "`enough` or `whole`, or leave them out of grid.methods"
            )
        names = [level.name for level in self.grid.levels]
        if len(set(names)) < len(names):
            raise ValueError(f"levels {names} have a name twice: rename one")
        if "random" in self.grid.methods and max(self.grid.pool) < 2:
            raise ValueError("random needs a pool of 2 at least: add one to grid.pool")
        return self


@dataclass(frozen=True)
class Variant:
    """A method with all that it depends on; None where it does not.

    Attributes:
        method: Which.
        level: Name of the level of disturbance.
        t_safe: Threshold.
        pool: Candidates.
        variables: What the optimiser may change, joined by blanks.
        qp_solver: Of the optimiser.
    """

    method: str
    level: str
    t_safe: float | None = None
    pool: int | None = None
    variables: str | None = None
    qp_solver: str | None = None


def variants(options: StudyOptions, given: AdaptationOptions) -> tuple[Variant, ...]:
    """The grid, without doubles, method by method; what it leaves open is as given."""
    return tuple(dict.fromkeys(_variants(options.grid, given.optimiser)))


def study_scenario(options: StudyOptions) -> Scenario:
    """The scenario of a study, with its changes.

    Raises:
        ConfigError: There is no such scenario, or a change is wrong.
    """
    base = load_scenario(options.scenario).model_dump()
    return validate(Scenario, _merged(base, options.changes), "changes")


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with changes, of mappings in it key by key."""
    made = dict(base)
    for key, value in changes.items():
        own = made.get(key)
        both = isinstance(own, Mapping) and isinstance(value, Mapping)
        made[key] = _merged(own, value) if both else value  # type: ignore[arg-type]
    return made


def physics(options: StudyOptions, scenario: Scenario, level: str) -> SimulationOptions:
    """The scenario's physics at a level of disturbance."""
    (own,) = (one for one in options.grid.levels if one.name == level)
    disturbance = replaced(scenario.simulation.disturbance, own.disturbance)
    return scenario.simulation.model_copy(update={"disturbance": disturbance})


def _variants(grid: Grid, adapter: AdaptOptions) -> Iterator[Variant]:
    sets = grid.variables or (adapter.variables,)
    solvers = grid.qp_solver or (adapter.qp_solver,)
    levels = [level.name for level in grid.levels]
    for method in grid.methods:
        for level, t_safe, pool, variables, solver in product(
            levels, grid.t_safe, grid.pool, sets, solvers
        ):
            if method == "random" and pool < 2:
                continue
            optimised = method in OPTIMISING
            yield Variant(
                method,
                level,
                t_safe if method in FORESEEING else None,
                pool if method in POOLED else None,
                " ".join(variables) if optimised else None,
                solver if optimised else None,
            )


def adaptation_of(variant: Variant, given: AdaptationOptions) -> AdaptationOptions:
    """The settings of adaptation before the motion begins that a variant means."""
    told = given.model_dump()
    before = {"closed_loop": "selection_optimisation", "closed_loop_alone": "none"}
    told["method"] = before.get(variant.method, variant.method)
    if variant.t_safe is not None:
        told["ranking"]["t_safe"] = variant.t_safe
    if variant.variables is not None:
        told["optimiser"]["variables"] = tuple(variant.variables.split())
    if variant.qp_solver is not None:
        told["optimiser"]["qp_solver"] = variant.qp_solver
    return AdaptationOptions.model_validate(told)


def adapter_of(variant: Variant, given: AdapterOptions) -> AdapterOptions:
    """The settings of adaptation while the motion runs that a variant means."""
    ranking = given.ranking.model_copy(update={"t_safe": variant.t_safe})
    return given.model_copy(update={"ranking": ranking})
