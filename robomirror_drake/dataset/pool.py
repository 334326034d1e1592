"""Units of work on the cores of this machine or of a cluster, by Ray."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any, Final, TypeVar

from threadpoolctl import threadpool_limits

from robomirror_drake.exceptions import InputError

RENEWAL: Final = 8
"""Units after which a worker process is replaced: Drake keeps about 2 MB of each diagram."""

RETRIES: Final = 3
"""How often a unit is tried again whose worker died."""

J = TypeVar("J")
M = TypeVar("M")


def here(jobs: Iterable[J], work: Callable[[J], M]) -> Iterator[tuple[J, M]]:
    """Does the work in this process, one unit after the other."""
    with threadpool_limits(1):
        for job in jobs:
            yield job, work(job)


class Pool:
    """Worker processes, started on entering and ended on leaving."""

    def __init__(self, workers: int | None = None, address: str | None = None) -> None:
        """Workers on this machine, or on the cluster at an address.

        Args:
            workers: How many; as many as there are cores where None.
            address: Of a running Ray cluster whose machines have this package, else None.
        """
        self._address = address
        self._asked = workers
        self.workers = workers or os.cpu_count() or 1
        self._ray: Any = None

    def __enter__(self) -> Pool:
        """Starts Ray, or finds the cluster.

        Raises:
            InputError: There is no cluster at the address.
        """
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        import ray  # takes a second

        settings: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
        if self._address:
            settings["address"] = self._address
        else:
            settings |= {"address": "local", "num_cpus": self.workers, "include_dashboard": False}
        try:
            ray.init(**settings)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise InputError(f"no Ray cluster at {self._address!r}: {error}") from error
        self._ray = ray
        resources: dict[str, float] = self._ray.cluster_resources()
        if self._address and not self._asked:
            self.workers = max(1, int(resources.get("CPU", 1)))
        return self

    def __exit__(self, *_: object) -> None:
        self._ray.shutdown()

    def map(
        self,
        jobs: Iterable[J],
        work: Callable[[J], M],
        failed: Callable[[J, BaseException], M],
        at_once: int | None = None,
    ) -> Iterator[tuple[J, M]]:
        """Does the work, and yields what is ready first.

        Args:
            jobs: The units.
            work: What to do with each.
            failed: What is said of one whose workers died of it.
            at_once: How many are under way at most; a worker each, and one waiting for
                each of them, where None.
        """
        # One thread each, since Ray sets OMP_NUM_THREADS to the number of processors of a task.
        task = self._ray.remote(num_cpus=1, max_calls=RENEWAL, max_retries=RETRIES)(work)
        of = self._ray.exceptions
        deaths = (of.WorkerCrashedError, of.OutOfMemoryError, of.NodeDiedError)
        waiting = iter(jobs)
        pending = {task.remote(job): job for job in islice(waiting, at_once or 2 * self.workers)}
        while pending:
            (ready,), _ = self._ray.wait(list(pending), num_returns=1)
            job = pending.pop(ready)
            try:
                made = self._ray.get(ready)
            except deaths as error:
                made = failed(job, error)
            for following in islice(waiting, 1):
                pending[task.remote(following)] = following
            yield job, made
