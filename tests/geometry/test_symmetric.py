"""Symmetric matrices of two to six unknowns, compared with numpy.linalg."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.geometry.symmetric import Symmetric2x2, SymmetricMatrix

FloatArray = npt.NDArray[np.float64]


def random_positive(size: int, condition: float) -> tuple[Symmetric2x2, FloatArray]:
    """Return positive matrices with condition numbers up to ``condition``, and the same as (B, 2, 2)."""
    generator = np.random.default_rng(3)
    scale = 10.0 ** generator.uniform(-12, 12, size)
    ratio = condition ** generator.uniform(-1, 0, size)
    angle = generator.uniform(-np.pi, np.pi, size)
    cosine, sine = np.cos(angle), np.sin(angle)
    xx = scale * (cosine**2 + ratio * sine**2)
    xy = scale * (1.0 - ratio) * cosine * sine
    yy = scale * (sine**2 + ratio * cosine**2)
    return Symmetric2x2(xx, xy, yy), full(Symmetric2x2(xx, xy, yy))


def full(matrix: Symmetric2x2) -> FloatArray:
    """Return the matrices as (B, 2, 2)."""
    rows = [np.stack([matrix.xx, matrix.xy], axis=-1), np.stack([matrix.xy, matrix.yy], axis=-1)]
    return np.stack(rows, axis=-2)


def relative_error(got: FloatArray, expected: FloatArray) -> float:
    """Return the largest difference relative to the largest entry of each matrix or vector."""
    axes = tuple(range(1, expected.ndim))
    return float((np.abs(got - expected).max(axis=axes) / np.abs(expected).max(axis=axes)).max())


def test_inverse_and_solution_agree_with_numpy() -> None:
    """Inverse and solution agree with numpy.linalg for conditions up to 1e3 at any scale."""
    matrix, dense = random_positive(500, 1e3)
    right = np.random.default_rng(4).normal(size=(500, 2))
    assert relative_error(full(matrix.inverse()), np.linalg.inv(dense)) < 1e-12
    solved = np.stack(matrix.solve(right[:, 0], right[:, 1]), axis=-1)
    assert relative_error(solved, np.linalg.solve(dense, right[..., None])[..., 0]) < 1e-12


def test_determinant_trace_and_eigenvalues_agree_with_numpy() -> None:
    """Determinant, trace and both eigenvalues agree with numpy.linalg."""
    matrix, dense = random_positive(500, 1e3)
    smaller, larger = matrix.eigenvalues()
    expected = np.linalg.eigvalsh(dense)
    np.testing.assert_allclose(smaller, expected[:, 0], rtol=1e-11)
    np.testing.assert_allclose(larger, expected[:, 1], rtol=1e-13)
    np.testing.assert_allclose(matrix.determinant, np.linalg.det(dense), rtol=1e-11)
    np.testing.assert_allclose(matrix.trace, np.trace(dense, axis1=1, axis2=2), rtol=1e-15)


def test_congruence_agrees_with_the_matrix_product() -> None:
    """``congruence`` is the matrix product self @ middle @ self."""
    matrix, dense = random_positive(300, 50.0)
    middle = Symmetric2x2(matrix.yy[::-1], -matrix.xy[::-1], matrix.xx[::-1])
    assert relative_error(full(matrix.congruence(middle)), dense @ full(middle) @ dense) < 1e-13


@pytest.mark.parametrize("entries", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (4.0, 0.0, 0.0)])
def test_singular_matrices_leave_other_rows_unchanged(entries: tuple[float, float, float]) -> None:
    """A singular matrix gives values that are not finite, without a warning; its neighbour is unaffected."""
    singular = Symmetric2x2(
        *(np.array([entry, identity]) for entry, identity in zip(entries, (1.0, 0.0, 1.0), strict=True))
    )
    x, y = singular.solve(np.array([1.0, 3.0]), np.array([2.0, 4.0]))
    assert not np.isfinite([x[0], y[0]]).all()
    assert (x[1], y[1]) == (3.0, 4.0)
    assert not np.isfinite(full(singular.inverse())[0]).all()
    assert singular.eigenvalues()[0].tolist() == [0.0, 1.0]


def test_a_matrix_that_is_not_positive_gives_no_warning() -> None:
    """If the larger eigenvalue is 0 to rounding, the smaller is reported as 0."""
    x, y = np.random.default_rng(5).normal(size=(2, 1000))
    smaller, larger = Symmetric2x2(-x * x, x * y, -y * y).eigenvalues()
    assert np.count_nonzero(larger == 0.0) > 100
    assert not smaller[larger <= 0.0].any()


def test_overflow_gives_no_warning() -> None:
    """Inverse, solution and eigenvalues beyond float64 are not finite, without a warning."""
    tiny, huge = (Symmetric2x2(np.full(1, size), np.zeros(1), np.full(1, 2.0 * size)) for size in (1e-160, 1e200))
    assert not np.isfinite(tiny.inverse().xx).any()
    assert not np.isfinite(tiny.solve(np.ones(1), np.ones(1))).any()
    assert not np.isfinite(huge.eigenvalues()).all()


def test_congruence_overflows_to_infinity():
    """Entries beyond float64 are infinite, without a warning."""
    huge = Symmetric2x2(np.full(1, 1e200), np.zeros(1), np.full(1, 1e200))
    found = huge.congruence(huge)
    assert np.isposinf(found.xx).all()
    assert np.isposinf(found.yy).all()


@st.composite
def positive_matrices(draw: st.DrawFn) -> tuple[SymmetricMatrix, FloatArray, np.random.Generator]:
    """Draw positive definite matrices of 2 to 6 unknowns, as parts and as (B, D, D), with a generator."""
    size = draw(st.integers(2, 6))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    factor = generator.normal(size=(5, size, size))
    dense = factor @ np.swapaxes(factor, 1, 2) + 0.1 * np.eye(size)
    scale = 10.0 ** generator.uniform(-3.0, 3.0, (5, size))  # unknowns of different units
    dense *= scale[:, :, None] * scale[:, None, :]
    return SymmetricMatrix(*(dense[:, i, j] for i in range(size) for j in range(i + 1))), dense, generator


def assert_equal_matrices(got: SymmetricMatrix, expected: FloatArray, rtol: float = 1e-9) -> None:
    """Assert that matrices are those of (B, D, D), up to ``rtol`` of the geometric mean of their diagonal entries."""
    root = np.sqrt(np.abs(np.diagonal(expected, axis1=1, axis2=2)))
    scale = root[:, :, None] * root[:, None, :]
    assert (np.abs(got.dense() - expected) <= rtol * scale).all()


@given(drawn=positive_matrices())
def test_any_number_of_unknowns_as_numpy(drawn: tuple[SymmetricMatrix, FloatArray, np.random.Generator]) -> None:
    """Factor, inverse, solution, determinant, sandwich and quadratic form agree with numpy.linalg for D = 2 to 6."""
    matrix, dense, generator = drawn
    size = dense.shape[-1]
    assert matrix.dimension == size
    np.testing.assert_array_equal(matrix.dense(), dense)
    zero = np.zeros(5)
    factor = np.stack([np.stack([*row, *[zero] * (size - len(row))], axis=-1) for row in matrix.cholesky()], axis=1)
    np.testing.assert_allclose(factor, np.linalg.cholesky(dense), rtol=1e-6, atol=1e-9 * np.abs(dense).max() ** 0.5)
    np.testing.assert_allclose(matrix.determinant, np.linalg.det(dense), rtol=1e-9)
    np.testing.assert_allclose(matrix.trace, np.trace(dense, axis1=1, axis2=2), rtol=1e-13)
    assert_equal_matrices(matrix.inverse(), np.linalg.inv(dense))
    middle = matrix.map(np.flip)
    assert_equal_matrices(matrix.congruence(middle), dense @ dense[::-1] @ dense)
    vector = generator.normal(size=(5, size)) / np.sqrt(np.diagonal(dense, axis1=1, axis2=2))
    solved = np.stack(matrix.solve(*(dense @ vector[..., None])[..., 0].T), axis=-1)
    np.testing.assert_allclose(solved, vector, rtol=1e-6, atol=1e-9 * np.abs(vector).max())
    form = np.einsum("bi,bij,bj->b", vector, dense, vector)
    np.testing.assert_allclose(matrix.quadratic_form(*vector.T), form, rtol=1e-9)
    smallest, largest = matrix.eigenvalues()
    expected = np.linalg.eigvalsh(dense)
    np.testing.assert_allclose(largest, expected[:, -1], rtol=1e-11)
    np.testing.assert_allclose(smallest, expected[:, 0], rtol=1e-6, atol=1e-12 * expected[:, -1].max())


@given(drawn=positive_matrices())
def test_sums_of_products(drawn: tuple[SymmetricMatrix, FloatArray, np.random.Generator]) -> None:
    """``outer`` and ``gram`` are products of vectors and their sums; matrices add and scale as arrays do."""
    _, dense, generator = drawn
    size = dense.shape[-1]
    vector, weight = generator.normal(size=(size, 5, 7)), generator.uniform(0.5, 2.0, (5, 7))
    products = np.einsum("bk,ibk,jbk->bij", weight, vector, vector)
    np.testing.assert_allclose(SymmetricMatrix.gram(*vector, weight=weight).dense(), products, atol=1e-12)
    np.testing.assert_allclose(
        SymmetricMatrix.outer(*vector[:, :, 0]).dense(), np.einsum("ib,jb->bij", *[vector[:, :, 0]] * 2), atol=1e-13
    )
    twice = SymmetricMatrix.gram(*vector) + SymmetricMatrix.gram(*vector)
    np.testing.assert_array_equal(twice.dense(), (SymmetricMatrix.gram(*vector) * np.full(5, 2.0)).dense())
    ridged = twice.add_to_diagonal(weight[:, 0]).dense() - twice.dense()
    np.testing.assert_allclose(ridged, weight[:, 0, None, None] * np.eye(size), atol=1e-12)


@pytest.mark.parametrize("size", [2, 3, 6])
def test_a_singular_row_leaves_its_neighbours(size: int) -> None:
    """Of matrices of any size, a singular one gives what is not finite, and the others stay as they are."""
    dense = np.stack([np.eye(size), np.ones((size, size)), 4.0 * np.eye(size)])
    matrix = SymmetricMatrix(*(dense[:, i, j] for i in range(size) for j in range(i + 1)))
    inverse = matrix.inverse().dense()
    np.testing.assert_array_equal(inverse[[0, 2]], [np.eye(size), 0.25 * np.eye(size)])
    assert not np.isfinite(inverse[1]).all()
    assert not np.isfinite(np.stack(matrix.solve(*np.ones((size, 3))))[:, 1]).all()


def test_rows_of_matrices() -> None:
    """``at``, ``take``, ``put``, ``where`` and ``stack`` act on every part alike."""
    matrix, dense = random_positive(6, 10.0)
    np.testing.assert_array_equal(full(matrix.take(np.array([4, 1, 4]))), dense[[4, 1, 4]])
    np.testing.assert_array_equal(full(matrix.at(dense[:, 0, 0] > 1.0)), dense[dense[:, 0, 0] > 1.0])
    other = matrix.map(np.copy)
    other.put(np.array([0]), matrix.at([5]))
    np.testing.assert_array_equal(full(other), dense[[5, 1, 2, 3, 4, 5]])
    chosen = np.array([True, False] * 3)
    np.testing.assert_array_equal(full(matrix.where(chosen, matrix.map(np.flip)))[1], dense[4])
    np.testing.assert_array_equal(matrix.stack(), np.stack([matrix.xx, matrix.xy, matrix.yy], axis=1))


def test_eigenvalues_in_space_keep_the_smallest() -> None:
    """Of 3 x 3 matrices the largest eigenvalue is exact to 1e-12, the smallest to 1e-15 of it; NaN stays NaN."""
    generator = np.random.default_rng(7)
    wanted = 10.0 ** generator.uniform(-9.0, 3.0, (2000, 3))
    basis = np.linalg.qr(generator.standard_normal((2000, 3, 3)))[0]
    dense = np.einsum("bij,bj,bkj->bik", basis, wanted, basis)
    matrices = SymmetricMatrix(*(dense[:, i, j] for i in range(3) for j in range(i + 1)))
    smallest, largest = matrices.eigenvalues()
    np.testing.assert_allclose(largest, wanted.max(axis=1), rtol=1e-12)
    np.testing.assert_allclose(smallest, wanted.min(axis=1), rtol=1e-9, atol=1e-15 * wanted.max())
    flat = SymmetricMatrix(*(np.array([value, np.nan]) for value in (2.0, 0.0, 3.0, 0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(np.stack(flat.eigenvalues()), [[0.0, np.nan], [3.0, np.nan]])
