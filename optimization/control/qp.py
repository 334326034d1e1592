"""The inverse-dynamics QP: accelerations and contact forces that serve all tasks best.

With the robot's joint accelerations a_j and the contact forces' generators λ,

    min   Σ_k w_k² ‖J_k q̈ + J̇_k v − r̈_k‖² + w_f² ‖W λ − f_plan‖² + ε_a ‖a_j‖² + ε_λ ‖λ‖²
    s.t.  |τ| ≤ τ_max,   τ = [M q̈ + h − Σ_i J_iᵀ W_i λ]_joints
          a_min ≤ a_j ≤ a_max                        (joint limits a short time ahead)
          0 ≤ λ ≤ λ_max                              (friction pyramid, unilateral, ramps)

The six rows of the floating base are not constraints: they are solved for its
acceleration, which leaves x = (a_j, λ) and dynamics that hold whatever the solver's
tolerance. Each corner of a sole that may bear load has four generators, the edges of a
pyramid inside the friction cone. See Wensing & Orin, "Generation of dynamic humanoid
behaviors through task-space control with conic optimization", ICRA 2013; Herzog et
al., "Momentum control with hierarchical inverse dynamics", Autonomous Robots 2016.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.messages import Array
from robomirror_drake.optimization.control.assembly import Scalars, assemble
from robomirror_drake.optimization.control.collision import ApartRows, CollisionOptions
from robomirror_drake.optimization.control.dynamics_terms import (
    ControlModel,
    DynamicsTerms,
    TaskMotion,
)
from robomirror_drake.optimization.control.step_adjustment import StepLimits, StepOptions

Solver = Literal["daqp", "osqp", "proxqp", "quadprog", "piqp"]


class _Options(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TaskGains(_Options):
    """One task: its acceleration is ``r̈ + stiffness (r − x) + damping (ṙ − ẋ)``."""

    weight: float = Field(ge=0.0, description="w in (w · residual)²")
    stiffness: float = Field(ge=0.0, description="[1/s²]")
    damping: float = Field(ge=0.0, description="[1/s]")


class PostureWeights(_Options):
    """Weights of the joints' own tracking, w in (w · residual)²."""

    leg: float = Field(1.0, ge=0.0)
    waist: float = Field(0.5, ge=0.0)
    arm: float = Field(1.0, ge=0.0)


class WholeBodyOptions(_Options):
    """Gains and limits of the QP."""

    solver: Solver = "daqp"
    com_horizontal: TaskGains = TaskGains(weight=40.0, stiffness=25.0, damping=10.0)
    com_vertical: TaskGains = TaskGains(weight=40.0, stiffness=60.0, damping=14.0)
    angular_momentum: TaskGains = TaskGains(weight=1.0, stiffness=0.0, damping=8.0)
    pelvis: TaskGains = TaskGains(weight=4.0, stiffness=100.0, damping=20.0)
    trunk: TaskGains = TaskGains(weight=3.0, stiffness=100.0, damping=20.0)
    swing: TaskGains = TaskGains(weight=15.0, stiffness=500.0, damping=45.0)
    swing_feedback: float = Field(
        20.0, gt=0.0, description="most acceleration asked for because a foot lags [m/s²]"
    )
    stance: TaskGains = TaskGains(weight=30.0, stiffness=0.0, damping=40.0)
    posture: PostureWeights = PostureWeights()
    posture_stiffness: float = Field(100.0, ge=0.0, description="[1/s²]")
    posture_damping: float = Field(20.0, ge=0.0, description="[1/s]")
    planned_force: float = Field(0.002, ge=0.0, description="weight of the planned wrench [1/N]")
    acceleration_cost: float = Field(1e-3, gt=0.0, description="ε_a [(s²/rad)²]")
    force_cost: float = Field(2e-6, gt=0.0, description="ε_λ [1/N²]")
    friction: float = Field(0.5, gt=0.0, description="µ that the forces keep to")
    corner_force: float = Field(1000.0, gt=0.0, description="most normal force of a corner [N]")
    contact_ramp: float = Field(0.03, gt=0.0, description="time to take up the load [s]")
    limit_horizon: float = Field(0.03, gt=0.0, description="look-ahead of the joint limits [s]")
    min_knee: float = Field(
        0.22, ge=0.0, le=1.0, description="least knee angle: a straight leg is stuck [rad]"
    )
    step: StepOptions = StepOptions()
    acceleration_limit: float = Field(3000.0, gt=0.0, description="[rad/s²]")
    collision: CollisionOptions = CollisionOptions()


class QP(NamedTuple):
    """``min ½ xᵀPx + qᵀx  s.t.  Gx ≤ h, lb ≤ x ≤ ub`` over x = (a_j, λ), and the way back.

    Attributes:
        P, q, G, h, lb, ub: As above; G stacks the upper and the lower torque limits, and
            below them what keeps links apart.
        N, n: (29, x), (29,) the generalised accelerations are N x + n.
        S, s: (23, x), (23,) the joint torques are S x + s.
        W: (2, 6, g) wrench of each generator at 1 about each sole's centre, [force, moment].
    """

    P: Array
    q: Array
    G: Array
    h: Array
    lb: Array
    ub: Array
    N: Array
    n: Array
    S: Array
    s: Array
    W: Array


class Targets(NamedTuple):
    """What the QP is asked for.

    Attributes:
        motion: The reference's task motion, shifted to where the robot's feet are.
        q, v, a: (23,) the reference's joint positions, velocities, accelerations.
        load: (2, 4) share of its full force that each corner may bear, 0 without contact.
        force: (2, 6) planned wrench about each sole's centre, [force, moment], world axes.
        planned: Whether ``force`` means something.
        anchor: (2, 3) where the middle of each sole's loaded corners stands [m].
    """

    motion: TaskMotion
    q: Array
    v: Array
    a: Array
    load: Array
    force: Array
    planned: bool
    anchor: Array


class Solution(NamedTuple):
    """What the QP gives.

    Attributes:
        found: Whether the solver found a finite optimum.
        x: The optimum (a_j, λ); zeros if there is none.
        z: (46 + k,) multipliers of G, none negative.
        z_box: (x,) multipliers of the bounds: positive at the upper, negative at the lower.
        problem: The QP.
    """

    found: bool
    x: Array
    z: Array
    z_box: Array
    problem: QP


class Tuning(NamedTuple):
    """Options as the compiled code wants them.

    Attributes:
        options: What it was made of.
        gains: (7, 3) weight, stiffness, damping of the tasks in the kernels' order.
        posture: (23,) weight of each joint's own tracking.
        lower: (23,) joint limits that are kept to, with knees bent [rad].
        steps: Where a foot in swing may be moved to.
        scalars: Weights, gains and limits that are one number each.
    """

    options: WholeBodyOptions
    gains: Array
    posture: Array
    lower: Array
    steps: StepLimits
    scalars: Scalars


def tuning(robot: ControlModel, options: WholeBodyOptions) -> Tuning:
    """The tuning of a robot."""
    tasks = (
        options.com_horizontal,
        options.com_vertical,
        options.angular_momentum,
        options.pelvis,
        options.trunk,
        options.swing,
        options.stance,
    )
    gains = np.array([[task.weight, task.stiffness, task.damping] for task in tasks])
    weights = options.posture.model_dump()
    posture = np.array([weights[limb] for limb in robot.limbs])
    bent = np.maximum(robot.lower, options.min_knee)
    lower = np.where(robot.knees, bent, robot.lower)
    scalars = Scalars(*(getattr(options, name) for name in Scalars._fields))
    return Tuning(options, gains, posture, lower, options.step.limits(), scalars)


def build_qp(
    robot: ControlModel,
    terms: DynamicsTerms,
    targets: Targets,
    tuned: Tuning,
    apart: ApartRows | None = None,
) -> QP:
    """The QP at a state.

    Args:
        robot: The model.
        terms: Its dynamics at the state.
        targets: What is asked for.
        tuned: Weights and gains.
        apart: Bounds that keep links apart; None if there are none.
    """
    if apart is None:
        apart = ApartRows(np.empty((0, robot.effort.size)), np.empty(0))
    matrices = assemble(
        tuned.gains,
        tuned.posture,
        (tuned.lower, robot.upper, robot.effort),
        tuned.scalars,
        (robot.corners, robot.mass),
        terms,
        targets,
        apart,
    )
    return QP(*matrices)


def without_joint_limits(qp: QP) -> QP:
    """The same QP with nothing but torque and force limits, which always has a solution.

    Torque limits alone can be met by any contact force; joint limits, or links, too near for
    the torque that is there cannot.
    """
    joints = qp.s.size
    lb, ub = qp.lb.copy(), qp.ub.copy()
    lb[:joints], ub[:joints] = -np.inf, np.inf
    return qp._replace(G=qp.G[: 2 * joints], h=qp.h[: 2 * joints], lb=lb, ub=ub)


def torque_from(solution: Solution) -> Array:
    """(23,) joint torques of a solution [N·m]."""
    return solution.problem.S @ solution.x + solution.problem.s


def acceleration_from(solution: Solution) -> Array:
    """(29,) generalised accelerations of a solution, Pinocchio's order."""
    return solution.problem.N @ solution.x + solution.problem.n


def foot_wrench_from(solution: Solution) -> Array:
    """(2, 6) wrench on each foot about its sole's centre, [force, moment], world axes."""
    W = solution.problem.W
    return np.asarray(W @ solution.x[solution.x.size - W.shape[2] :])
