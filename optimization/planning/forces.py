"""How two feet share a planned contact wrench, smoothly and within what each can bear."""

from __future__ import annotations

import numpy as np
import qpsolvers
import scipy.sparse as sp

from robomirror_drake.exceptions import PlanningError
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.optimization.centroidal import cross_matrix
from robomirror_drake.optimization.planning.contacts import ConeOptions, wrench_cones

_ARM = 0.1  # a moment of 0.1 m times a force costs as much as the force
_SUM_WEIGHT = 1e4  # of meeting the planned wrench; soft, as a plan may stand a little outside
_SMOOTHNESS = 30.0  # of the change from one sample to the next, beside the size


def share_wrench(wrench: Array, standing: Array, loaded: BoolArray, cone: ConeOptions) -> Array:
    """(T, 2, 6) wrench on each foot about its sole centre, world axes, [moment N·m, force N].

    One convex QP over the whole motion: least norm plus least change, where a foot in the air
    counts with zero, so that loads ramp at every switch; subject to the friction and CoP limits
    of each foot; the two wrenches summing up to the planned one.

    Args:
        wrench: (T, 6) planned wrench about the world's origin.
        standing: (T, 2, 4, 3) sole corners at their anchors [m].
        loaded: (T, 2, 4) corners that bear load.
        cone: Limits of one foot.

    Raises:
        PlanningError: The QP could not be solved.
    """
    T = len(wrench)
    centers = standing.mean(axis=2)
    scale = np.repeat([_ARM * cone.weight, cone.weight], 3)
    # The sum of both feet's wrenches about the point between them.
    middle = centers.mean(axis=1)
    total = wrench.copy()
    total[:, :3] -= np.cross(middle, wrench[:, 3:])
    transfer = np.tile(np.eye(6), (T, 2, 1, 1))
    transfer[..., :3, 3:] = cross_matrix(centers - middle[:, None])
    transfer = transfer * scale / scale[:, None]
    on = np.asarray(loaded.any(axis=2))
    sums = _block_diagonal(np.concatenate([transfer[:, 0], transfer[:, 1]], axis=2))
    change = sp.diags([-1.0, 1.0], [0, 12], shape=(12 * (T - 1), 12 * T))
    P = _SUM_WEIGHT * sums.T @ sums + _SMOOTHNESS * change.T @ change + sp.eye(12 * T)
    q = -_SUM_WEIGHT * sums.T @ (total / scale).ravel()
    rows, lower, upper = [], [], []
    for foot in range(2):
        alone = np.zeros_like(loaded)
        alone[:, foot] = loaded[:, foot]
        made = wrench_cones(standing - centers[:, foot, None, None], alone, cone)
        wide = np.zeros((T, made.rows.shape[1], 12))
        wide[:, :, 6 * foot : 6 * foot + 6] = made.rows * scale
        used = on[:, foot, None] & (np.isfinite(made.lower) | np.isfinite(made.upper))
        rows.append(_block_diagonal(wide)[used.ravel()])
        lower.append(made.lower[used])
        upper.append(made.upper[used])
    A, low, high = sp.vstack(rows), np.concatenate(lower), np.concatenate(upper)
    G = sp.vstack([A[np.isfinite(high)], -A[np.isfinite(low)]])
    h = np.concatenate([high[np.isfinite(high)], -low[np.isfinite(low)]])
    off = np.repeat(~on.ravel(), 6)
    free = np.flatnonzero(~off)
    force = np.zeros(12 * T)
    if len(free):
        try:
            # A fixed interval, not the clock, says when OSQP adapts: same input, same bytes.
            solution = qpsolvers.solve_qp(
                P[free][:, free].tocsc(),
                q[free],
                G[:, free].tocsc(),
                h,
                solver="osqp",
                eps_abs=1e-5,
                eps_rel=1e-5,
                max_iter=20_000,
                adaptive_rho_interval=50,
            )
        except qpsolvers.QPError as error:
            raise PlanningError(f"foot forces: {error}", {}) from error
        if solution is None:
            raise PlanningError("no foot forces carry the planned wrench", {})
        force[free] = solution
    return np.asarray(force.reshape(T, 2, 6) * scale)


def _block_diagonal(blocks: Array) -> sp.csr_matrix:
    """Sparse block-diagonal matrix of blocks (T, m, n)."""
    T, m, n = blocks.shape
    index = np.arange(T)
    matrix = sp.bsr_matrix((blocks, index, np.arange(T + 1)), shape=(T * m, T * n))
    made = matrix.tocsr()
    made.eliminate_zeros()
    return made
