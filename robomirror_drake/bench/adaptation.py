"""What an adaptation costs: a pool of one second, from words to a choice, stage by stage."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from robomirror_drake.adaptation.command import adapt_command, foresee
from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.messages import HumanMotion, RobotReference
from robomirror_drake.motion.generate import generate
from robomirror_drake.motion.language import recognise
from robomirror_drake.optimization.retargeting.retarget import retarget_batch
from robomirror_drake.ppn.ensemble import Ensemble, load_ensemble
from robomirror_drake.ppn.predictor import load_predictor, sampled
from robomirror_drake.robot import Robot, load_robot

T = TypeVar("T")

COMMAND = "a person strides forward"
POOL = 8
FROM, LENGTH = 1.0, 1.0
"""The part of each candidate that is adapted, in which the robot moves [s]."""

REPEATS = 15
WEIGHTS = ("ppn_1s", "ppn_3s")


def run(repeats: int = REPEATS) -> dict[str, Any]:
    """Measures by the time of one processor, after everything is loaded and compiled.

    Returns:
        ``stages``: list of ``stage``, ``median_ms`` and ``worst_ms``: generation and retargeting
        of the pool, its judgement, the choice with goals, the optimisation of the best two, and
        both sums; ``predictions``: of each network ``weights``, ``horizon_s``, ``forward_ms``
        and ``gradient_ms``, the pool over one horizon.
    """
    robot = load_robot()
    options = AdaptationOptions()
    predictor = load_ensemble(options.predictor, robot)
    with threadpool_limits(1):
        rounds = [_round(robot, predictor, options, seed) for seed in range(repeats + 2)][2:]
        pool = _references(robot, _parts(generate(COMMAND, POOL)))
        predictions = [_predictions(robot, weights, pool, repeats) for weights in WEIGHTS]
    return {
        "stages": [
            {
                "stage": stage,
                "median_ms": float(np.median([one[stage] for one in rounds])),
                "worst_ms": float(np.max([one[stage] for one in rounds])),
            }
            for stage in rounds[0]
        ],
        "predictions": predictions,
    }


def _round(
    robot: Robot, predictor: Ensemble, options: AdaptationOptions, seed: int
) -> dict[str, float]:
    """Times of all stages for the candidates of a seed [ms]."""
    recognise.forget()
    motions, generating = _timed(lambda: generate(COMMAND, POOL, seed))
    pool, retargeting = _timed(lambda: _references(robot, _parts(motions)))

    judged, judging = _timed(lambda: foresee(predictor, pool, options.every))
    # Nothing is safe enough, else there was nothing to do: the safest has to be twice as safe.
    strict = options.ranking.model_copy(
        update={"t_safe": 1.0 - 0.5 * float(judged.fall_probability.min())}
    )

    def adapted(method: str, hurry: bool = False) -> float:
        online = {"hurry": True, "starts": ("command",)} if hurry else {}
        optimiser = options.optimiser.model_copy(update=online)
        asked = options.model_copy(
            update={"method": method, "ranking": strict, "optimiser": optimiser}
        )
        return _timed(lambda: adapt_command(robot, COMMAND, pool, predictor, asked))[1]

    choosing = adapted("selection")
    both, hurried = (adapted("selection_optimisation", hurry) for hurry in (False, True))
    return {
        "generate": generating,
        "retarget": retargeting,
        "judge": judging,
        "goals and choice": choosing - judging,
        "optimise the best two": both - choosing,
        "the same, in a hurry": hurried - choosing,
        "selection, in all": generating + retargeting + choosing,
        "with optimisation, in all": generating + retargeting + both,
        "with optimisation in a hurry, in all": generating + retargeting + hurried,
    }


def _parts(motions: tuple[HumanMotion, ...]) -> list[HumanMotion]:
    """One second of each."""
    return [
        replace(
            motion,
            positions=motion.positions[
                round(FROM * motion.fps) : round((FROM + LENGTH) * motion.fps) + 1
            ],
        )
        for motion in motions
    ]


def _references(robot: Robot, motions: list[HumanMotion]) -> list[RobotReference]:
    return [
        made.reference
        for made in retarget_batch(robot, motions)
        if not isinstance(made, RetargetingError)
    ]


def _predictions(
    robot: Robot, weights: str, pool: list[RobotReference], repeats: int
) -> dict[str, Any]:
    """Median times of a network for a pool over one horizon, without and with gradients."""
    predictor = load_predictor(weights, robot)
    options = predictor.options
    q, contact = sampled(pool, np.arange(options.ahead + 1) / options.rate)
    window = options.horizon
    ways = {
        "forward_ms": lambda: predictor.foresee(q, contact, every=window),
        "gradient_ms": lambda: predictor.judge(q, contact, every=window),
    }
    return {"weights": weights, "horizon_s": window} | {
        name: float(np.median([_timed(way)[1] for _ in range(repeats)][1:]))
        for name, way in ways.items()
    }


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What a piece of work gives, and the processor's time it takes [ms]."""
    began = time.process_time()
    made = work()
    return made, 1e3 * (time.process_time() - began)


def print_table(figures: dict[str, Any], console: Console) -> None:
    """Prints what :func:`run` has measured."""
    stages = Table("stage", "median [ms]", "worst [ms]", title=f"{POOL} candidates of {LENGTH:g} s")
    for row in figures["stages"]:
        stages.add_row(row["stage"], f"{row['median_ms']:.1f}", f"{row['worst_ms']:.1f}")
    console.print(stages)
    predictions = Table("weights", "horizon [s]", "forward [ms]", "with gradients [ms]",
                        title=f"{POOL} candidates over one horizon")  # fmt: skip
    for row in figures["predictions"]:
        predictions.add_row(
            row["weights"], f"{row['horizon_s']:g}",
            f"{row['forward_ms']:.1f}", f"{row['gradient_ms']:.1f}",
        )  # fmt: skip
    console.print(predictions)
