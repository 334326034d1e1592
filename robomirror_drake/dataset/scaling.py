"""How much faster more workers are, measured in one run."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

from robomirror_drake.dataset.generate import Work
from robomirror_drake.dataset.pool import Pool
from robomirror_drake.dataset.records import Job
from robomirror_drake.dataset.unit import failed, make


class Scaling(NamedTuple):
    """One measurement.

    Attributes:
        workers: How many worked at a time.
        simulated_s: Time simulated [s].
        wall_s: Time it took [s].
        cpu_s: Processor time of the workers [s].
    """

    workers: int
    simulated_s: float
    wall_s: float
    cpu_s: float


def measure_scaling(
    jobs: Sequence[Job], counts: Sequence[int] = (1, 2), work: Work = make
) -> list[Scaling]:
    """Does the same work with each number of workers, after each worker has warmed up."""
    most, measured = max(counts), []
    with Pool(most) as pool:
        for _ in pool.map([jobs[0]] * most, work, failed=failed):
            pass
        for workers in counts:
            began = time.perf_counter()
            timings = [
                made.timing for _, made in pool.map(jobs, work, failed=failed, at_once=workers)
            ]
            wall = time.perf_counter() - began
            simulated = sum(timing["simulated_s"] for timing in timings)
            spent = sum(sum(timing["cpu_s"].values()) for timing in timings)
            measured.append(Scaling(workers, simulated, wall, spent))
    return measured
