"""Preview: feedback on the centre of mass and the angular momentum that knows what comes next.

About a motion with contact forces f, at small deviations x = (δc, δċ, δL) of the centre of
mass c, its velocity and the angular momentum L about it,

    m δc̈ = δf,      δL̇ = δn + f × δc,

where the input u = (δn, δf) is the change of the contact wrench about the planned centre of
mass, a point that does not move with the robot. A time-varying linear-quadratic regulator
weighs deviations by what is tolerable, and the wrench by how far it is from what the ground
can give there and then: with cone rows a·w ≥ b, the cost Σ (a·u)² / (a·w − b)² is the Hessian
of their logarithmic barrier, and where it is below 1 the wrench is possible (Dikin's
ellipsoid). So the centre of pressure moves little on a narrow support, more if a wide one comes
soon, and nothing is asked for in flight.

See B. Anderson, J. Moore, "Optimal Control: Linear Quadratic Methods", 1990, section 2.4;
S. Kuindersma et al., "An efficiently solvable quadratic program for stabilizing dynamic
locomotion", ICRA 2014; S. Boyd, L. Vandenberghe, "Convex Optimization", exercise 8.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import BaseModel, ConfigDict, Field
from scipy.linalg import solve_discrete_are

from robomirror_drake.messages import Array, BoolArray, RobotReference
from robomirror_drake.optimization.centroidal import GRAVITY, cross_matrix
from robomirror_drake.optimization.centroidal_motion import CentroidalMotion, centroidal_motion
from robomirror_drake.optimization.control.dynamics_terms import TaskMotion
from robomirror_drake.optimization.control.reference_trajectory import latest
from robomirror_drake.optimization.planning.contacts import ConeOptions, wrench_cones
from robomirror_drake.robot import Robot

LEAST_SLACK = 0.01
"""Distance from a cone's row, in body weights, at which a wrench near the row counts at least."""


class PreviewOptions(BaseModel):
    """What the regulator weighs: deviations that cost as much as the whole of a wrench's room."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    position: float = Field(0.05, gt=0.0, description="of the centre of mass [m]")
    velocity: float = Field(0.15, gt=0.0, description="of the centre of mass [m/s]")
    angular_momentum: float = Field(6.0, gt=0.0, description="[N·m·s]")
    max_normal_force: float = Field(3.0, gt=1.0, description="normal force [body weights]")


class Preview(NamedTuple):
    """Feedback gains along a motion.

    Attributes:
        time: (T,) [s].
        gain: (T, 6, 9) K of u = -K x, [moment, force] by [position, velocity, momentum].
        force: (T, 3) planned sum of the contact forces [N].
        mass: Of the robot [kg].
    """

    time: Array
    gain: Array
    force: Array
    mass: float


def preview_gains(
    robot: Robot, reference: RobotReference, friction: float, options: PreviewOptions
) -> Preview:
    """The regulator of a reference; beyond its end the robot is meant to stand.

    Args:
        robot: The robot.
        reference: What will be followed.
        friction: Coefficient that the contact forces keep to.
        options: See :class:`PreviewOptions`.
    """
    motion = centroidal_motion(robot, reference.q, reference.v, reference.a)
    weight = robot.mass * GRAVITY
    cone = ConeOptions(friction, 0.0, options.max_normal_force, weight)
    R = wrench_cost(motion, reference.contact, cone)
    tolerable = (options.position, options.velocity, options.angular_momentum)
    Q = np.diag(np.repeat(tolerable, 3) ** -2.0)
    steps = np.diff(reference.time, append=2.0 * reference.time[-1] - reference.time[-2])
    A, B = centroidal_model(motion.force, steps, robot.mass)
    A_end, B_end = centroidal_model(np.array([[0.0, 0.0, weight]]), steps[-1:], robot.mass)
    P_end = solve_discrete_are(A_end[0], B_end[0], steps[-1] * Q, steps[-1] * R[-1])
    in_flight = np.asarray(~reference.contact.any(axis=(1, 2)))
    B[in_flight] = 0.0
    gain = riccati(A, B, steps[:, None, None] * Q, steps[:, None, None] * R, P_end)
    return Preview(
        reference.time.copy(), _before_touchdown(gain, in_flight), motion.force, robot.mass
    )


NO_PREVIEW = Preview(np.empty(0), np.empty((0, 6, 9)), np.empty((0, 3)), 1.0)
"""In place of a preview where there is none."""


@njit(cache=True)
def steered(preview, time, wanted, actual):  # type: ignore[no-untyped-def]
    """The wanted motion, with feedback in its accelerations of centre of mass and momentum.

    Their positions and velocities become the actual ones, so that no other feedback acts.

    Args:
        preview: From :func:`preview_gains`.
        time: Since the reference's own zero [s].
        wanted: The reference, a TaskMotion shifted to where the robot's feet are.
        actual: The robot's own motion.
    """
    row = latest(preview.time, time)
    x = np.empty(9)
    x[:3] = actual.com[0] - wanted.com[0]
    x[3:6] = actual.com[1] - wanted.com[1]
    x[6:] = actual.angular[0] - wanted.angular[0]
    u = -(preview.gain[row] @ x)
    com, angular = actual.com.copy(), actual.angular.copy()
    com[2] = wanted.com[2] + u[3:] / preview.mass
    angular[1] = wanted.angular[1] + u[:3] + np.cross(preview.force[row], x[:3])
    return TaskMotion(com, angular, wanted.R, wanted.p, wanted.v, wanted.a)


def centroidal_model(force: Array, step: Array, mass: float) -> tuple[Array, Array]:
    """Discrete-time model of the deviations, exact for a force that is constant over a step.

    Args:
        force: (T, 3) planned sum of the contact forces [N].
        step: (T,) from each sample to the next [s].
        mass: Of the robot [kg].

    Returns:
        A (T, 9, 9), B (T, 9, 6) of x⁺ = A x + B u.
    """
    F = np.zeros((len(force), 9, 9))
    F[:, :3, 3:6] = np.eye(3)
    F[:, 6:, :3] = cross_matrix(force)
    G = np.zeros((9, 6))
    G[3:6, 3:] = np.eye(3) / mass
    G[6:, :3] = np.eye(3)
    h = step[:, None, None]
    F_h = h * F  # its third power is zero, which ends the exponential series
    A = np.eye(9) + F_h + F_h @ F_h / 2.0
    return A, h * (np.eye(9) + F_h / 2.0 + F_h @ F_h / 6.0) @ G


def wrench_cost(motion: CentroidalMotion, loaded: BoolArray, cone: ConeOptions) -> Array:
    """(T, 6, 6) cost of u, the Hessian of the cones' logarithmic barrier at the planned wrench.

    Args:
        motion: The motion.
        loaded: (T, 2, 4) corners that may bear load.
        cone: Limits of the wrench.
    """
    # Rounded to millimetres, so that there are few different cones while a foot stands.
    cones = wrench_cones(motion.corners.round(3), loaded, cone)
    y = np.einsum("trw,tw->tr", cones.rows, motion.wrench)
    slack = np.maximum(np.minimum(y - cones.lower, cones.upper - y), LEAST_SLACK)
    about_com = np.broadcast_to(np.eye(6), (len(y), 6, 6)).copy()
    about_com[:, :3, 3:] = cross_matrix(motion.com)  # u's moment, taken to the world's origin
    rows = cones.rows @ about_com / slack[..., None]
    return np.asarray(np.swapaxes(rows, 1, 2) @ rows)


@njit(cache=True)
def riccati(A, B, Q, R, P_end):  # type: ignore[no-untyped-def]
    """Gains K (T, m, n) that minimise Σ xᵀQx + uᵀRu + the end's xᵀP_end x with u = -K x.

    Args:
        A, B: (T, n, n), (T, n, m) of x⁺ = A x + B u.
        Q, R: (T, n, n), (T, m, m) costs of state and input.
        P_end: (n, n) cost of the state after the last step.
    """
    K = np.empty((len(A), B.shape[2], B.shape[1]))
    P = P_end.copy()
    for t in range(len(A) - 1, -1, -1):
        B_P = B[t].T @ P
        K[t] = np.linalg.solve(R[t] + B_P @ B[t], B_P @ A[t])
        P = Q[t] + A[t].T @ P @ (A[t] - B[t] @ K[t])
        P = 0.5 * (P + P.T)
    return K


def _before_touchdown(gain: Array, in_flight: BoolArray) -> Array:
    """Gains in flight replaced by those after it, which a foot that lands early needs."""
    rows = np.where(in_flight, len(gain) - 1, np.arange(len(gain)))
    return gain[np.minimum.accumulate(rows[::-1])[::-1]]
