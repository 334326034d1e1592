"""What a tick of the whole-body controller costs, by QP solver and beside TSID."""

from __future__ import annotations

import time
from typing import Any, NamedTuple, get_args

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from robomirror_drake.bench.peer import peer_ticks
from robomirror_drake.exceptions import BenchError
from robomirror_drake.messages import Array, Execution, RobotReference
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.generate import generate
from robomirror_drake.optimization.control.dynamics_terms import control_model, task_motion
from robomirror_drake.optimization.control.qp import (
    Solver,
    WholeBodyOptions,
    torque_from,
    tuning,
)
from robomirror_drake.optimization.control.reference_trajectory import (
    reference_trajectory,
    sample_reference,
)
from robomirror_drake.optimization.control.solvers import solve_qp
from robomirror_drake.optimization.control.stance import initial_stance
from robomirror_drake.optimization.control.tick import control_problem, scratch
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.systems.whole_body_controller import ControllerOptions

COMMAND = "a person walks forward four steps"
RUN = 2.0
"""How much of the motion is simulated for the real-time factor [s]."""

REPEATS = 5
"""Each tick's time is the least of so many."""


def run(command: str = COMMAND) -> dict[str, Any]:
    """Measures assembly and solution at every recorded state of an executed walk.

    Returns:
        ``rows``, one per solver: ``solver``, ``assembly_us_median``, ``assembly_us_p99``,
        ``solve_us_median``, ``solve_us_p99``, ``total_us_median``, ``total_us_p99``, ``unsolved``
        (ticks without a solution), ``torque_error`` (largest difference from DAQP's
        torques [N·m]) and ``real_time_factor`` (simulated time by time that passed,
        plant included); ``peer`` with the same figures of TSID for the same states, tasks
        and contacts, ``solver`` being ``tsid``, or None; ``ratio`` of the median ticks,
        the default solver's by the peer's; ``ratio_without_reference``, the same without
        reading the reference, which the peer is handed ready-made, and which takes
        ``reference_us_median`` of our assembly; ``no_peer``, why there is none; besides
        ``command`` and ``ticks``.
    """
    robot = load_robot()
    (motion,) = generate(command, 1, 0)
    reference = plan_dynamics(robot, retarget(robot, motion, foot_contacts(motion)))
    execution = rollout(robot, reference)
    with threadpool_limits(1):  # one core for all
        measured = {s: _ticks(robot, reference, execution, s) for s in get_args(Solver)}
    best = measured["daqp"]
    rows = [
        _figures(solver, ticks, best)
        | {"real_time_factor": _real_time_factor(robot, reference, solver)}
        for solver, ticks in measured.items()
    ]
    reading = _reading(robot, reference, execution)
    figures = {
        "command": command,
        "ticks": len(execution.time),
        "rows": rows,
        "reference_us_median": reading,
    }
    try:
        peer = peer_ticks(robot, reference, execution, best.load, REPEATS)
    except BenchError as error:
        nothing = dict.fromkeys(("peer", "ratio", "ratio_without_reference"))
        return figures | nothing | {"no_peer": str(error)}
    theirs = _figures("tsid", Ticks(*peer, best.load), best)
    ours, tick = rows[0]["total_us_median"], theirs["total_us_median"]
    return figures | {
        "peer": theirs,
        "ratio": ours / tick,
        "ratio_without_reference": (ours - reading) / tick,
        "no_peer": None,
    }


class Ticks(NamedTuple):
    """What all ticks of an execution cost and gave.

    Attributes:
        assembly, solve: (N,) times [µs].
        torque: (N, 23), NaN where unsolved [N·m].
        load: (N, 2, 4) share of its full force that each corner of a sole may bear.
    """

    assembly: Array
    solve: Array
    torque: Array
    load: Array


def _figures(solver: str, ticks: Ticks, best: Ticks) -> dict[str, Any]:
    return {
        "solver": solver,
        **_quantiles("assembly", ticks.assembly),
        **_quantiles("solve", ticks.solve),
        **_quantiles("total", ticks.assembly + ticks.solve),
        "unsolved": int(np.isnan(ticks.torque[:, 0]).sum()),
        "torque_error": float(np.nanmax(np.abs(ticks.torque - best.torque))),
    }


def _ticks(robot: Robot, reference: RobotReference, execution: Execution, solver: Solver) -> Ticks:
    """Measures all ticks, several times over."""
    options = WholeBodyOptions(solver=solver)
    model = control_model(robot)
    memory, tuned = scratch(model), tuning(model, options)
    trajectory = reference_trajectory(robot, reference)
    q = robot.to_pinocchio(execution.q)
    v = robot.v_to_pinocchio(execution.q, execution.v)
    n = len(execution.time)
    assembly, solve = np.empty((REPEATS, n)), np.empty((REPEATS, n))
    torque, load = np.full((n, len(model.effort)), np.nan), np.empty((n, 2, 4))
    for repeat in range(REPEATS):
        stance = initial_stance()
        for k, now in enumerate(execution.time):
            begin = time.perf_counter()
            tick = control_problem(
                model, memory, tuned, q[k], v[k], trajectory, now, stance, 1.0 / 60.0
            )
            middle = time.perf_counter()
            solution = solve_qp(tick.qp, solver)
            end = time.perf_counter()
            assembly[repeat, k], solve[repeat, k] = middle - begin, end - middle
            stance, load[k] = tick.stance, tick.stance.load
            if solution.found:
                torque[k] = torque_from(solution)
    return Ticks(1e6 * assembly.min(axis=0), 1e6 * solve.min(axis=0), torque, load)


def _reading(robot: Robot, reference: RobotReference, execution: Execution) -> float:
    """Median time that it takes to read off the reference and the motion of its tasks [µs]."""
    model, ramp = control_model(robot), WholeBodyOptions().contact_ramp
    memory, trajectory = scratch(model), reference_trajectory(robot, reference)
    passed = np.empty((REPEATS, len(execution.time)))
    for repeat in range(REPEATS):
        for k, now in enumerate(execution.time):
            begin = time.perf_counter()
            wanted = sample_reference(trajectory, now, ramp)
            task_motion(model, memory.reference, wanted.q, wanted.v, wanted.a)
            passed[repeat, k] = time.perf_counter() - begin
    return float(1e6 * np.median(passed.min(axis=0)))


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
    peer = [] if figures["peer"] is None else [figures["peer"]]
    for row in figures["rows"] + peer:
        times = (
            f"{row[f'{name}_us_median']:.0f} / {row[f'{name}_us_p99']:.0f}"
            for name in ("assembly", "solve", "total")
        )
        factor = row.get("real_time_factor")
        table.add_row(
            row["solver"],
            *times,
            str(row["unsolved"]),
            f"{row['torque_error']:.2g}",
            "" if factor is None else f"{factor:.2f}",
        )
    console.print(table)
    if figures["no_peer"] is not None:
        console.print(figures["no_peer"], markup=False, highlight=False)
    else:
        first = figures["rows"][0]["solver"]
        console.print(
            f"median tick, {first} / tsid: {figures['ratio']:.2f}; "
            f"{figures['ratio_without_reference']:.2f} without reading the reference "
            f"({figures['reference_us_median']:.0f} µs), which tsid is handed ready-made",
            highlight=False,
            soft_wrap=True,
        )
