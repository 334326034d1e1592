"""Uniform cubic B-splines on a global knot grid, and least squares over their control points.

A trajectory x(t) of n coordinates is the sum of control points c_k (K, n) times
the uniform cubic B-spline basis. Knots stand at multiples of a spacing h
counted from t = 0, and nothing is clamped at the ends: in [i h, (i+1) h] the
trajectory is a blend of c_i … c_{i+3}. So a horizon moves on by dropping
leading rows of the control points, and where the first three rows are kept the
trajectory continues with equal position, velocity and acceleration.

Costs that are sums over samples of functions of x, ẋ, ẍ have a Hessian with
4 n − 1 bands below its diagonal. It is kept here as ``band`` (K n, 4 n) with
``band[j, d] = A[j + d, j]``, which is LAPACK's lower form transposed; the
trailing matrix that is left when leading control points are fixed is a slice,
``band[3 * n:]``.

Source: C. de Boor, "A Practical Guide to Splines", 1978, ch. IX–XI.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.linalg import lapack
from threadpoolctl import ThreadpoolController

from robomirror_drake.messages import Array

ORDER = 4
"""Number of control points that act on one instant."""

_BLAS = ThreadpoolController().select(user_api="blas")
_UNBLOCKED = 32  # width up to which LAPACK works on a band without BLAS

# Row r: coefficients of 1, u, u², u³ in the weight of the r-th control point.
_BLEND = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6.0


class Basis(NamedTuple):
    """The basis at T samples.

    Attributes:
        first: (T,) index of the first control point that acts on each sample.
        weights: (4, T, 4) weights of the four for the value and derivatives 1 to 3
            [1, 1/s, 1/s², 1/s³].
        points: Number K of control points.
    """

    first: npt.NDArray[np.int64]
    weights: Array
    points: int


def control_count(duration: float, spacing: float) -> int:
    """Number of control points that a trajectory of this duration [s] needs."""
    return max(1, int(np.ceil(duration / spacing - 1e-9))) + ORDER - 1


def basis(time: Array, spacing: float, count: int | None = None) -> Basis:
    """The basis at given times.

    Args:
        time: (T,) samples [s], from 0 on.
        spacing: Distance of the knots [s].
        count: Number of control points; by default just enough for the last sample.
    """
    count = control_count(float(time[-1]), spacing) if count is None else count
    phase = np.asarray(time) / spacing
    # The last sample may stand on the last knot, where the interval before it ends.
    first = np.clip(np.floor(phase + 1e-9).astype(np.int64), 0, count - ORDER)
    u = (phase - first)[:, None]
    zero, one = np.zeros_like(u), np.ones_like(u)
    powers = [
        [one, u, u**2, u**3],
        [zero, one, 2 * u, 3 * u**2],
        [zero, zero, 2 * one, 6 * u],
        [zero, zero, zero, 6 * one],
    ]
    weights = [np.hstack(row) @ _BLEND.T / spacing**d for d, row in enumerate(powers)]
    return Basis(first, np.array(weights), count)


def evaluate(basis: Basis, control: Array, derivative: int = 0) -> Array:
    """(T, n) the trajectory, or one of its time derivatives up to 3, at the samples.

    Args:
        basis: Basis at the samples.
        control: (K, n) control points.
        derivative: 0 for x, 1 for ẋ, 2 for ẍ, 3 for the jerk.
    """
    weights = basis.weights[derivative]
    return np.asarray(_evaluate(basis.first, weights, np.ascontiguousarray(control)))


def spread_gradient(basis: Basis, gradient: Array, derivative: int = 0) -> Array:
    """(K, n) gradient with respect to the control points; the adjoint of :func:`evaluate`.

    Args:
        basis: Basis at the samples.
        gradient: (T, n) gradient with respect to that derivative of x at each sample.
        derivative: Which derivative of x.
    """
    control = np.zeros((basis.points, gradient.shape[1]))
    _spread_gradient(basis.first, basis.weights[derivative], gradient, control)
    return control


def zero_band(count: int, coordinates: int) -> Array:
    """(K n, 4 n) an empty banded Hessian."""
    return np.zeros((count * coordinates, ORDER * coordinates))


def add_blocks(band: Array, basis: Basis, hessian: Array, rows: int = 0, columns: int = 0) -> None:
    """Adds Σ_t (∂y/∂c)ᵀ H_t (∂z/∂c), y and z being derivatives of x at sample t, to ``band``.

    For y ≠ z both H_t and its transpose's mirror image are meant: the function adds the
    symmetric sum (∂y/∂c)ᵀ H (∂z/∂c) + (∂z/∂c)ᵀ Hᵀ (∂y/∂c), so call it once per pair.

    Args:
        band: (K n, 4 n) banded Hessian, changed in place.
        basis: Basis at the samples.
        hessian: (T, n, n) blocks; symmetric where ``rows == columns``.
        rows: Which derivative of x is y.
        columns: Which derivative of x is z.
    """
    y, z = basis.weights[rows], basis.weights[columns]
    if rows == columns:
        _add_blocks(band, basis.first, y, z, hessian)
    else:
        _add_blocks(band, basis.first, y, z, np.ascontiguousarray(hessian.transpose(0, 2, 1)))
        _add_blocks(band, basis.first, z, y, hessian)


def add_diagonal(band: Array, basis: Basis, diagonal: Array, derivative: int = 0) -> None:
    """Adds Σ_t (∂y/∂c)ᵀ diag(d_t) (∂y/∂c), y being one derivative of x, to ``band``.

    Args:
        band: (K n, 4 n) banded Hessian, changed in place.
        basis: Basis at the samples.
        diagonal: (T, n) d_t.
        derivative: Which derivative of x is y.
    """
    _add_diagonal(band, basis.first, basis.weights[derivative], diagonal)


def multiply(band: Array, x: Array) -> Array:
    """(K n,) product of the symmetric banded matrix with ``x`` (K n,)."""
    return np.asarray(_multiply(band, x))


def one_thread(width: int) -> AbstractContextManager[object]:
    """Context in which linear algebra on bands (…, ``width``) keeps to one thread.

    A band is too narrow to share: on a busy machine, threads that wait for each other made one
    factorization a thousand times slower. The narrowest are not shared anyway.
    """
    return _BLAS.limit(limits=1) if width > _UNBLOCKED else nullcontext()


def factorize(band: Array) -> Array:
    """Cholesky factor of a banded Hessian, or of its trailing part, in the same form.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite.
    """
    with one_thread(band.shape[1]):
        factor, info = lapack.dpbtrf(band.T, lower=1)
    _check(info)
    return np.asarray(factor).T


def substitute(factor: Array, right: Array) -> Array:
    """Solves A x = ``right`` with A's factor from :func:`factorize`."""
    with one_thread(factor.shape[1]):
        x, _ = lapack.dpbtrs(factor.T, right, lower=1)
    return np.asarray(x)


def solve_in_place(band: Array, right: Array) -> Array:
    """Solves A x = ``right`` and spends ``band`` on it; call it within :func:`one_thread`.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite.
    """
    _, x, info = lapack.dpbsv(band.T, right, lower=1, overwrite_ab=1)
    _check(info)
    return np.asarray(x)


def _check(info: int) -> None:
    if info != 0:
        raise np.linalg.LinAlgError(f"leading minor {info} is not positive definite")


def fit(basis: Basis, samples: Array, smoothing: float = 1e-8) -> Array:
    """(K, n) control points whose trajectory is nearest to the samples.

    Args:
        basis: Basis at the samples.
        samples: (T, n) values to be approached.
        smoothing: Weight of the squared jerk [s⁶], and a little acceleration, beside the
            squared error; without any the control points at the ends may be undetermined.
    """
    band = zero_band(basis.points, 1)
    ones = np.ones((len(samples), 1))
    add_diagonal(band, basis, ones)
    add_diagonal(band, basis, smoothing * ones, derivative=3)
    add_diagonal(band, basis, 1e-4 * smoothing * ones, derivative=2)
    return substitute(factorize(band), spread_gradient(basis, np.ascontiguousarray(samples)))


def stretched(control: Array, count: int) -> Array:
    """(count, n) control points of about the same motion over another number of knots."""
    at = np.linspace(0.0, len(control) - 1.0, count)
    before = np.minimum(at.astype(int), len(control) - 2)
    blend = (at - before)[:, None]
    return np.asarray((1.0 - blend) * control[before] + blend * control[before + 1])


@njit(cache=True)
def _evaluate(first, weights, control):  # type: ignore[no-untyped-def]
    samples, n = len(first), control.shape[1]
    x = np.zeros((samples, n))
    for t in range(samples):
        for r in range(4):
            w = weights[t, r]
            for i in range(n):
                x[t, i] += w * control[first[t] + r, i]
    return x


@njit(cache=True)
def _spread_gradient(first, weights, gradient, control):  # type: ignore[no-untyped-def]
    for t in range(len(first)):
        for r in range(4):
            w = weights[t, r]
            for i in range(gradient.shape[1]):
                control[first[t] + r, i] += w * gradient[t, i]


@njit(cache=True)
def _add_blocks(band, first, y, z, mirrored):  # type: ignore[no-untyped-def]
    """Adds blocks given by their transposes, whose rows are the band's."""
    n = mirrored.shape[1]
    for t in range(len(first)):
        for r in range(4):
            for s in range(r + 1):  # control points on and below the diagonal
                w = y[t, r] * z[t, s]
                for j in range(n):
                    start = j if r == s else 0
                    shift = (r - s) * n - j
                    column = band[(first[t] + s) * n + j, shift + start : shift + n]
                    block = mirrored[t, j, start:]
                    for i in range(n - start):
                        column[i] += w * block[i]


@njit(cache=True)
def _add_diagonal(band, first, weights, diagonal):  # type: ignore[no-untyped-def]
    n = diagonal.shape[1]
    for t in range(len(first)):
        for r in range(4):
            for s in range(r + 1):
                w = weights[t, r] * weights[t, s]
                for i in range(n):
                    band[(first[t] + s) * n + i, (r - s) * n] += w * diagonal[t, i]


@njit(cache=True)
def _multiply(band, x):  # type: ignore[no-untyped-def]
    y = np.zeros_like(x)
    for j in range(band.shape[0]):
        y[j] += band[j, 0] * x[j]
        for d in range(1, min(band.shape[1], band.shape[0] - j)):
            y[j + d] += band[j, d] * x[j]
            y[j] += band[j, d] * x[j + d]
    return y
