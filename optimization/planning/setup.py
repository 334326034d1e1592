"""From a kinematic reference to the problem of its dynamic plan."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robomirror_drake.exceptions import PlanningError
from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization import centroidal, spline
from robomirror_drake.optimization.contact_schedule import picked_samples
from robomirror_drake.optimization.floating_base import continuous
from robomirror_drake.optimization.planning.contacts import (
    anchors,
    clearance,
    outside,
    wrench_cones,
)
from robomirror_drake.optimization.planning.frames import Frames, soles
from robomirror_drake.optimization.planning.options import PlanOptions
from robomirror_drake.optimization.planning.penalty import Rows
from robomirror_drake.optimization.planning.problem import (
    Problem,
    Weights,
    at_rest,
)
from robomirror_drake.optimization.planning.schedule import (
    loaded_corners,
    standing_end,
    steady,
)
from robomirror_drake.optimization.planning.solver import Standing
from robomirror_drake.optimization.planning.tempo import slowed
from robomirror_drake.optimization.planning.torque import Split
from robomirror_drake.robot import Robot

_INSET = 2e-3  # of joint limits, as a soft bound may be overrun a little [rad]
_AT_REST = 0.2  # speeds below this are rest [m/s, rad/s]


class Knots(NamedTuple):
    """Where the knots of a plan are, and at which of its two ends it rests."""

    spacing: float
    intervals: int
    rest: tuple[bool, bool] = (True, True)

    def free(self, time: Array) -> spline.Basis:
        """The basis at times [s], with no regard to the ends."""
        return spline.basis(time, self.spacing, self.intervals + spline.ORDER - 1)

    def basis(self, time: Array) -> spline.Basis:
        """The basis of the plan's control points."""
        return at_rest(self.free(time), *self.rest)


class Padded(NamedTuple):
    """A reference with time to come from rest and to come to rest.

    Attributes:
        time: (N,) from 0 [s].
        q: (N, 30) positions with continuous quaternion signs.
        contact: (N, 2, 4) schedule.
        kept: Which of the frames are the reference's own.
    """

    time: Array
    q: Array
    contact: BoolArray
    kept: slice


def time_step(reference: RobotReference) -> float:
    """The reference's constant time step [s].

    Raises:
        PlanningError: It is too short, or its rate is not constant.
    """
    steps = np.diff(reference.time)
    if np.ptp(steps) > 1e-6:
        raise PlanningError(
            "a plan needs a reference at a constant rate",
            {"shortest_step": float(steps.min()), "longest_step": float(steps.max())},
        )
    if reference.duration < 0.2:
        raise PlanningError(
            "a plan needs a reference of 0.2 s at least", {"duration": reference.duration}
        )
    return float(reference.duration / len(steps))


def pad(
    robot: Robot, reference: RobotReference, options: PlanOptions, tempo: float = 1.0
) -> Padded:
    """Slows a reference down, and adds standing time where it is cut in mid-motion.

    That is at an end where it moves or has a foot in the air.

    Raises:
        PlanningError: See :func:`time_step`.
    """
    dt, q = time_step(reference), reference.q
    corners = soles(Frames.of(robot).points_of(robot, q))
    shortest = round(options.shortest_phase / dt)
    own = steady(reference.contact, corners, reference.a[:, 5], shortest)
    moving = slowed(replace(reference, contact=own), tempo)
    q, own = continuous(moving.q), moving.contact
    frames = round(options.lead / dt)
    before, after = (
        0 if np.abs(moving.v[cut]).max() < _AT_REST and own[cut].all() else frames
        for cut in (0, -1)
    )
    count = before + len(q) + after
    return Padded(
        time=np.arange(count, dtype=np.float64) * dt,
        q=np.concatenate([q[:1].repeat(before, 0), q, q[-1:].repeat(after, 0)]),
        contact=np.concatenate(
            [standing_end(own[0], before)[::-1], own, standing_end(own[-1], after)], axis=0
        ),
        kept=slice(before, before + len(q)),
    )


def limits(robot: Robot, options: PlanOptions) -> tuple[Array, Array]:
    """(30,), (30,) bounds of the configuration; the chart of the base has none."""
    free = np.full(7, np.inf)
    lower, upper = robot.position_limits
    lower = np.where(robot.knees, np.maximum(lower, options.min_knee), lower)
    return np.concatenate([-free, lower]), np.concatenate([free, upper])


def first_guess(padded: Padded, knots: Knots) -> Array:
    """(K, 30) control points nearest to the reference."""
    return spline.fit(knots.basis(padded.time), padded.q)


def problem(
    robot: Robot, padded: Padded, knots: Knots, options: PlanOptions
) -> tuple[Problem, Standing]:
    """The least-squares problem of a plan, and its contacts."""
    picked = picked_samples(padded.contact, options.stride)
    time = padded.time[picked]
    free = knots.free(time)
    fitted = spline.fit(knots.free(padded.time), padded.q)
    target, rate, surge = (spline.evaluate(free, fitted, order) for order in range(3))
    looked_at = Frames.of(robot)
    kinematic = centroidal.sample(robot, looked_at.links, target, rate, surge, derivatives=False)
    points = looked_at.points(kinematic.links)
    contact = padded.contact[picked]
    frames = np.arange(len(padded.time), dtype=np.float64)
    loaded = loaded_corners(padded.contact, frames, 1.0)[picked]
    path = soles(looked_at.points_of(robot, padded.q[picked]))
    placed = anchors(soles(points), contact, robot.sole_corners, path)
    cones = wrench_cones(placed, loaded, options.cone(robot))
    standing = Standing(
        contact=contact,
        loaded=loaded,
        path=path,
        least=clearance(padded.contact, options.clearance, 1.0 / padded.time[1])[picked],
        cone=options.cone(robot),
        torque_share=options.torque_share,
        slack=(1.0 - options.strength) * outside(cones, kinematic.wrench).max(axis=1),
    )
    unbounded = np.full((len(time), 24), np.inf)
    share = np.full((len(time), 23), options.speed_share)
    unlimited = np.full((len(time), 23), np.inf)
    apart = np.full((len(time), len(looked_at.capsules.pairs)), options.self_distance)
    basis = knots.basis(time)
    low, high = (np.tile(bound, (basis.points, 1)) for bound in limits(robot, options))
    made = Problem(
        robot=robot,
        frames=looked_at,
        basis=basis,
        target=target,
        target_acceleration=surge,
        target_points=points,
        target_trunk=kinematic.links[:, looked_at.trunk, :3, :3],
        rows={
            "wrench": Rows(cones.lower, cones.upper),
            "corners": Rows(-unbounded, unbounded),
            "speed": Rows(-share, share),
            # From the first split of the wrench on they have bounds.
            "torque": Rows(-unlimited, unlimited),
            "gaps": Rows(apart, np.full_like(apart, np.inf)),
            "limits": Rows(low + _INSET, high - _INSET),
        },
        cones=cones,
        split=Split(np.zeros((len(time), 2, 6, 6)), np.zeros((len(time), 2, 6))),
        weights=Weights(
            keypoint=1.0,
            orientation=0.3,
            posture=np.concatenate([np.zeros(4), np.full(26, 0.1)]),
            acceleration=np.full(30, 1e-2),
            damping=np.full(30, 3e-4),
            ending=30.0,
        ),
    )
    return made, standing
