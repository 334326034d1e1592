"""What a tick of the whole-body controller costs, by QP solver."""

from __future__ import annotations

import time
from typing import Any, get_args

import numpy as np
from rich.console import Console
from rich.table import Table

from robomirror_drake.messages import Array, Execution, RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.generate import generate
from robomirror_drake.optimization.dynamics_terms import control_model
from robomirror_drake.optimization.plan import plan_dynamics
from robomirror_drake.optimization.reference_trajectory import reference_trajectory
from robomirror_drake.optimization.retarget import retarget
from robomirror_drake.optimization.stance import initial_stance
from robomirror_drake.optimization.whole_body_control import control_problem, scratch
from robomirror_drake.optimization.whole_body_qp import (
    Solver,
    WholeBodyOptions,
    solve_qp,
    torque_from,
    tuning,
)
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.systems.whole_body_controller import ControllerOptions

COMMAND = "a person walks forward four steps"
RUN = 2.0
"""How much of the motion is simulated for the real-time factor [s]."""


def run(command: str = COMMAND) -> dict[str, Any]:
    """Measures assembly and solution at every recorded state of an executed walk.

    Returns:
        ``rows``, one per solver: ``solver``, ``assembly_us_median``, ``assembly_us_p99``,
        ``solve_us_median``, ``solve_us_p99``, ``total_us_median``, ``total_us_p99``, ``unsolved``
        (ticks without a solution), ``torque_error`` (largest difference from DAQP's
        torques [N·m]) and ``real_time_factor`` (simulated time by time that passed,
        plant included); besides ``command`` and ``ticks``.
    """
    robot = load_robot()
    (motion,) = generate(command, 1, 0)
    reference = plan_dynamics(robot, retarget(robot, motion, foot_contacts(motion)))
    execution = rollout(robot, reference)
    measured = {solver: _ticks(robot, reference, execution, solver) for solver in get_args(Solver)}
    best = measured["daqp"][2]
    rows = [
        {
            "solver": solver,
            **_quantiles("assembly", assembly),
            **_quantiles("solve", solve),
            **_quantiles("total", assembly + solve),
            "unsolved": int(np.isnan(torque[:, 0]).sum()),
            "torque_error": float(np.nanmax(np.abs(torque - best))),
            "real_time_factor": _real_time_factor(robot, reference, solver),
        }
        for solver, (assembly, solve, torque) in measured.items()
    ]
    return {"command": command, "ticks": len(execution.time), "rows": rows}


def _ticks(
    robot: Robot, reference: RobotReference, execution: Execution, solver: Solver
) -> tuple[Array, Array, Array]:
    """(N,) assembly and (N,) solution times [µs], (N, 23) torques, NaN where unsolved."""
    options = WholeBodyOptions(solver=solver)
    model = control_model(robot)
    memory, tuned = scratch(model), tuning(model, options)
    trajectory, stance = reference_trajectory(robot, reference), initial_stance()
    q = robot.to_pinocchio(execution.q)
    v = robot.v_to_pinocchio(execution.q, execution.v)
    ticks = len(execution.time)
    assembly, solve, torque = np.empty(ticks), np.empty(ticks), np.full((ticks, 23), np.nan)
    for k, now in enumerate(execution.time):
        begin = time.perf_counter()
        qp, stance, _ = control_problem(
            model, memory, tuned, q[k], v[k], trajectory, now, stance, 1.0 / 60.0
        )
        middle = time.perf_counter()
        solution = solve_qp(qp, solver)
        assembly[k], solve[k] = middle - begin, time.perf_counter() - middle
        if solution.found:
            torque[k] = torque_from(solution)
    return 1e6 * assembly, 1e6 * solve, torque


def _quantiles(name: str, times: Array) -> dict[str, float]:
    return {
        f"{name}_us_median": float(np.median(times)),
        f"{name}_us_p99": float(np.percentile(times, 99.0)),
    }


def _real_time_factor(robot: Robot, reference: RobotReference, solver: Solver) -> float:
    qp = WholeBodyOptions(solver=solver)
    options = SimulationOptions(hold=0.0, controller=ControllerOptions(qp=qp))
    samples = int(np.searchsorted(reference.time, RUN)) + 1
    begin = time.perf_counter()
    execution = rollout(robot, _first(reference, samples), options)
    return float(execution.time[-1] / (time.perf_counter() - begin))


def _first(reference: RobotReference, samples: int) -> RobotReference:
    """The beginning of a reference."""
    assert reference.foot_force is not None  # always set by the message itself
    return RobotReference(
        time=reference.time[:samples],
        q=reference.q[:samples],
        v=reference.v[:samples],
        a=reference.a[:samples],
        contact=reference.contact[:samples],
        foot_force=reference.foot_force[:samples],
        planned=reference.planned,
    )


def print_table(figures: dict[str, Any], console: Console) -> None:
    """Prints what :func:`run` has measured."""
    table = Table(
        "solver",
        "assembly [µs]",
        "solve [µs]",
        "tick [µs]",
        "unsolved",
        "torque error [N·m]",
        "real-time factor",
        title=f"{figures['command']}: {figures['ticks']} ticks, median / 99th percentile",
    )
    for row in figures["rows"]:
        times = (
            f"{row[f'{name}_us_median']:.0f} / {row[f'{name}_us_p99']:.0f}"
            for name in ("assembly", "solve", "total")
        )
        table.add_row(
            row["solver"],
            *times,
            str(row["unsolved"]),
            f"{row['torque_error']:.2g}",
            f"{row['real_time_factor']:.2f}",
        )
    console.print(table)
