"""The spline's basis, and that banded sums equal dense ones."""

import numpy as np
import pytest

from robomirror_drake.optimization import spline

SPACING = 0.1


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def dense(band):
    size, width = band.shape
    A = np.zeros((size, size))
    for j in range(size):
        for d in range(min(width, size - j)):
            A[j + d, j] = A[j, j + d] = band[j, d]
    return A


def jacobian(basis, n, derivative):
    """(T, n, K n) derivative of the samples with respect to the control points."""
    J = np.zeros((len(basis.first), n, basis.points * n))
    for t, first in enumerate(basis.first):
        for r in range(4):
            for i in range(n):
                J[t, i, (first + r) * n + i] = basis.weights[derivative, t, r]
    return J


def test_count_covers_the_last_sample():
    assert spline.control_count(1.0, SPACING) == 13
    assert spline.control_count(1.01, SPACING) == 14
    assert spline.basis(np.arange(61) / 60, SPACING).first[-1] == 9


@pytest.mark.parametrize("derivative", [1, 2, 3])
def test_derivatives_by_finite_differences(rng, derivative):
    control = rng.normal(size=(13, 3))
    time, step = np.linspace(0.003, 0.98, 50), 1e-6
    ahead, behind = (
        spline.evaluate(spline.basis(time + s, SPACING, 13), control, derivative - 1)
        for s in (step, -step)
    )
    expected = spline.evaluate(spline.basis(time, SPACING, 13), control, derivative)
    np.testing.assert_allclose((ahead - behind) / (2 * step), expected, rtol=1e-6, atol=1e-3)


def test_cubics_are_reproduced():
    time = np.arange(61) / 60
    basis = spline.basis(time, SPACING)
    cubic = (1 + 2 * time - 3 * time**2 + 0.5 * time**3)[:, None]
    control = spline.fit(basis, cubic, smoothing=0.0)
    np.testing.assert_allclose(spline.evaluate(basis, control), cubic, atol=1e-11)
    np.testing.assert_allclose(spline.evaluate(basis, control, 3), 3.0, atol=1e-6)


def test_shift_by_a_knot_is_a_shift_of_the_index(rng):
    control = rng.normal(size=(13, 2))
    time = np.arange(54) / 60
    whole = spline.evaluate(spline.basis(time + SPACING, SPACING, 13), control)
    tail = spline.evaluate(spline.basis(time, SPACING, 12), control[1:])
    np.testing.assert_allclose(tail, whole, atol=1e-13)


def test_gradient_is_the_adjoint(rng):
    basis = spline.basis(np.arange(31) / 60, SPACING)
    control, g = rng.normal(size=(basis.points, 4)), rng.normal(size=(31, 4))
    for derivative in range(4):
        left = np.sum(g * spline.evaluate(basis, control, derivative))
        right = np.sum(spline.spread_gradient(basis, g, derivative) * control)
        assert left == pytest.approx(right, rel=1e-12)


@pytest.mark.parametrize(("rows", "columns"), [(0, 0), (2, 2), (0, 1), (2, 0)])
def test_blocks_equal_the_dense_sum(rng, rows, columns):
    n, basis = 3, spline.basis(np.arange(31) / 60, SPACING)
    H = rng.normal(size=(31, n, n))
    H = H + H.transpose(0, 2, 1) if rows == columns else H
    band = spline.zero_band(basis.points, n)
    spline.add_blocks(band, basis, H, rows, columns)
    y, z = jacobian(basis, n, rows), jacobian(basis, n, columns)
    expected = np.einsum("tia,tij,tjb->ab", y, H, z)
    expected = expected if rows == columns else expected + expected.T
    np.testing.assert_allclose(dense(band), expected, atol=1e-9 * np.abs(expected).max())


def test_diagonal_equals_blocks(rng):
    n, basis = 4, spline.basis(np.arange(31) / 60, SPACING)
    d = rng.uniform(size=(31, n))
    by_diagonal, by_blocks = spline.zero_band(basis.points, n), spline.zero_band(basis.points, n)
    spline.add_diagonal(by_diagonal, basis, d, derivative=1)
    blocks = np.einsum("ti,ij->tij", d, np.eye(n))
    spline.add_blocks(by_blocks, basis, blocks, rows=1, columns=1)
    np.testing.assert_allclose(by_diagonal, by_blocks, atol=1e-9)


def test_solve_whole_and_trailing(rng):
    n, basis = 3, spline.basis(np.arange(61) / 60, SPACING)
    J = rng.normal(size=(61, n, n))
    band = spline.zero_band(basis.points, n)
    spline.add_blocks(band, basis, J @ J.transpose(0, 2, 1))
    spline.add_diagonal(band, basis, np.full((61, n), 1e-3), derivative=2)
    b = rng.normal(size=basis.points * n)
    for start in (0, 3 * n):
        x = spline.substitute(spline.factorize(band[start:]), b[start:])
        np.testing.assert_allclose(dense(band[start:]) @ x, b[start:], atol=1e-8)
        np.testing.assert_allclose(spline.multiply(band[start:], x), b[start:], atol=1e-8)
        np.testing.assert_allclose(spline.solve_in_place(band[start:].copy(), b[start:]), x)


def test_indefinite_matrix_is_refused():
    band = spline.zero_band(4, 1)
    band[:, 0] = -1.0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        spline.factorize(band)
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        spline.solve_in_place(band, np.ones(4))
