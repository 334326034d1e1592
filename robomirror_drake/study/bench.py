"""One command on the robot: its pools of candidates, and what becomes of motions in physics."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

from robomirror_drake.adaptation.command import Adaptation, adapt_command
from robomirror_drake.adaptation.handover_options import AdapterOptions
from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.closed_loop import Adapted, rollout_adaptive
from robomirror_drake.dataset.options import seed_of, stream
from robomirror_drake.exceptions import InputError, RetargetingError, UnknownCommandError
from robomirror_drake.fall_cause import judge
from robomirror_drake.goals import Goals, make_goals, measure
from robomirror_drake.messages import Execution, RobotReference
from robomirror_drake.motion.generate import generate
from robomirror_drake.motion.text import parse
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.optimization.retargeting.retarget import retarget_batch
from robomirror_drake.ppn.ensemble import Ensemble, load_ensemble
from robomirror_drake.ppn.predictor import Predictor, load_predictor
from robomirror_drake.robot import Robot, load_robot
from robomirror_drake.rollout import rollout
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.study.options import physics
from robomirror_drake.study.records import Job, Row


@dataclass(frozen=True)
class Pool:
    """Candidates of a command.

    Attributes:
        references: Of those that the robot can follow, the command's own motion first.
        numbers: Which candidate each is.
        generate_s, retarget_s: Processor time they took [s].
    """

    references: tuple[RobotReference, ...]
    numbers: tuple[int, ...]
    generate_s: float
    retarget_s: float


@dataclass(frozen=True)
class Tried:
    """What became of a motion in physics.

    Attributes:
        fell: Whether the robot fell; a motion that cannot be executed counts as a fall.
        fall_time_s: When [s].
        why_fell: What went wrong first.
        done: Whether it did the task; None after a fall, or where no words say what that is.
        missed: What of it was not done.
        cpu_s: Processor time of plan and simulation [s].
        failure: Why it could not be executed.
    """

    fell: bool
    fall_time_s: float | None = None
    why_fell: str | None = None
    done: bool | None = None
    missed: str | None = None
    cpu_s: float = 0.0
    failure: str | None = None


class Bench:
    """The command of a job; each motion is planned once, and simulated once a level."""

    def __init__(self, job: Job) -> None:
        """For a job; nothing is made yet."""
        self.job = job
        self.robot: Robot = load_robot(job.scenario.robot)
        self._pools: dict[int, Pool] = {}
        self._plans: dict[str, RobotReference] = {}
        self._tried: dict[tuple[str, str], Tried] = {}
        self._taken: dict[tuple[str, int], tuple[Adaptation, float]] = {}
        self._closed: dict[tuple[str, str, str], tuple[Tried, Adapted]] = {}

    @property
    def predictor(self) -> Ensemble:
        """What foresees falls of motions that have yet to begin."""
        return _ensemble(self.job.scenario.adaptation.predictor, self.job.scenario.robot)

    @property
    def own(self) -> RobotReference:
        """The command's own motion.

        Raises:
            RetargetingError: The robot cannot follow it.
        """
        return self.pool(1).references[0]

    def pool(self, size: int) -> Pool:
        """So many candidates, made anew for each size, so that their time is that of the size.

        Raises:
            RetargetingError: The robot cannot follow the command's own motion.
        """
        if size not in self._pools:
            job, text = self.job, self.job.prompt.text
            began = time.process_time()
            motions = generate(text, size, self.seed, job.scenario.generator)
            generated = time.process_time()
            results = retarget_batch(self.robot, motions, options=job.scenario.retargeter)
            done = time.process_time()
            if isinstance(results[0], RetargetingError):
                raise results[0]
            kept = {
                number: result.reference
                for number, result in enumerate(results)
                if not isinstance(result, RetargetingError)
            }
            self._pools[size] = Pool(
                tuple(kept.values()), tuple(kept), generated - began, done - generated
            )
        return self._pools[size]

    @property
    def seed(self) -> int:
        """Of the candidates."""
        return seed_of(stream(self.job.options, self.job.prompt.text))

    def adapt(self, options: AdaptationOptions, size: int) -> tuple[Adaptation, float]:
        """What adaptation takes from a pool of this size, and its processor time [s].

        Raises:
            RetargetingError: The robot cannot follow the command's own motion.
        """
        key = options.model_dump_json(), size
        if key not in self._taken:
            references, predictor = self.pool(size).references, self.predictor
            began = time.process_time()
            taken = adapt_command(self.robot, self.job.prompt.text, references, predictor, options)
            self._taken[key] = taken, time.process_time() - began
        return self._taken[key]

    def attempt(self, reference: RobotReference, level: str) -> Tried:
        """Plans and simulates a motion, or remembers what became of it."""
        key = digest(reference), level
        if key not in self._tried:
            began = time.process_time()
            try:
                tried = self._execute(reference, level)
            except Exception as error:  # whatever it is, the study goes on and the record says so
                tried = Tried(fell=True, failure=f"{type(error).__name__}: {error}")
            spent = time.process_time() - began
            self._tried[key] = replace(tried, cpu_s=spent)
        return self._tried[key]

    def run_closed(
        self, reference: RobotReference, level: str, adapter: AdapterOptions
    ) -> tuple[Tried, Adapted]:
        """Plans a motion and executes it, changing it on the way.

        Raises:
            PlanningError: There is no dynamic plan of it.
            SimulationError: The physics diverged before a fall was on record.
        """
        key = digest(reference), level, adapter.model_dump_json()
        if key not in self._closed:
            job = self.job
            options = physics(job.options, job.scenario, level)
            plan = self._plan(reference)
            predictor = _predictor(adapter.predictor, job.scenario.robot)
            done = rollout_adaptive(
                self.robot, reference, plan, predictor, options, adapter, self._luck
            )
            tried = self._judged(done.execution, done.plan, options)
            self._closed[key] = tried, done
        return self._closed[key]

    def known(self, reference: RobotReference, level: str) -> Tried | None:
        """What became of a motion, None where it was not simulated."""
        return self._tried.get((digest(reference), level))

    def remember(self, reference: RobotReference, level: str, row: Row) -> None:
        """Takes over what an earlier unit of work has found out."""
        told = {f.name: row[f.name] for f in fields(Tried) if row.get(f.name) is not None}
        self._tried[digest(reference), level] = Tried(**told | {"fell": row["state"] == "fell"})

    def _execute(self, reference: RobotReference, level: str) -> Tried:
        plan, job = self._plan(reference), self.job
        options = physics(job.options, job.scenario, level)
        return self._judged(rollout(self.robot, plan, options, self._luck), plan, options)

    def _plan(self, reference: RobotReference) -> RobotReference:
        key = digest(reference)
        if key not in self._plans:
            self._plans[key] = plan_dynamics(self.robot, reference, self.job.scenario.planner)
        return self._plans[key]

    def _judged(self, done: Execution, plan: RobotReference, options: SimulationOptions) -> Tried:
        outcome, goals = judge(self.robot, done, plan, options), self.goals
        if outcome.fell or goals is None:
            return Tried(outcome.fell, outcome.fall_time_s, outcome.cause)
        found = measure(self.robot, goals, done.q)
        return Tried(False, done=found.done, missed="; ".join(map(str, found.missed)) or None)

    @property
    def _luck(self) -> int:
        """Seed of all disturbances, the same for all motions of the command."""
        return seed_of(stream(self.job.options, self.job.prompt.text, 0))

    @cached_property
    def goals(self) -> Goals | None:
        """What the command means; None where its words are not understood."""
        try:
            return make_goals(self.robot, parse(self.job.prompt.text), self.own.q)
        except (InputError, UnknownCommandError):
            return None


def digest(reference: RobotReference) -> str:
    """What tells motions apart: their samples."""
    parts = (reference.time, reference.q, reference.contact)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


@lru_cache(maxsize=2)
def _ensemble(weights: tuple[str, ...], robot: str) -> Ensemble:
    return load_ensemble(weights, load_robot(robot))


@lru_cache(maxsize=2)
def _predictor(weights: str, robot: str) -> Predictor:
    return load_predictor(weights, load_robot(robot))
