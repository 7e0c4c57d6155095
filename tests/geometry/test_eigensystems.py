"""Eigensystems of small symmetric matrices, compared with the matrices that they make up."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.geometry.eigensystems import eigensystem
from nlosctl.geometry.symmetric import SymmetricMatrix


@pytest.mark.parametrize("dimension", [2, 3])
def test_values_and_vectors_make_up_the_matrix(dimension: int) -> None:
    """The sum of value times v v' over the orthonormal vectors is the matrix; the largest value is first."""
    parts = np.random.default_rng(3).normal(size=(dimension * (dimension + 1) // 2, 50))
    matrix = SymmetricMatrix.gram(*(np.stack([part, part[::-1], np.sin(part)], axis=1) for part in parts[:dimension]))
    values, vectors = eigensystem(matrix)
    total = sum(
        value[:, None, None] * np.stack(vector, axis=1)[:, :, None] * np.stack(vector, axis=1)[:, None, :]
        for value, vector in zip(values, vectors, strict=True)
    )
    np.testing.assert_allclose(total, matrix.dense(), atol=1e-12)
    assert (np.diff(np.array(values), axis=0) <= 0.0).all()


def test_nearly_equal_and_very_different_values_in_space() -> None:
    """The matrix is made up to rounding of its size, and the vectors are orthonormal, however its values are spread."""
    generator = np.random.default_rng(7)
    axes = np.linalg.qr(generator.normal(size=(4000, 3, 3)))[0]
    value = 10.0 ** generator.uniform(-9.0, 9.0, (4000, 3))
    value[:1000, 1] = value[:1000, 0] * (1.0 + 1e-9)
    value[1000:2000] = 1.0
    axes[3000:] = np.eye(3)
    dense = axes @ (value[:, :, None] * np.swapaxes(axes, 1, 2))
    matrix = SymmetricMatrix(*(dense[:, i, j] for i in range(3) for j in range(i + 1)))
    values, vectors = eigensystem(matrix)
    found = np.stack([np.stack(vector, axis=-1) for vector in vectors], axis=-1)
    again = found @ (np.stack(values, axis=-1)[:, :, None] * np.swapaxes(found, 1, 2))
    assert (np.abs(again - dense).max(axis=(1, 2)) <= 1e-14 * value.max(axis=1)).all()
    assert np.abs(np.swapaxes(found, 1, 2) @ found - np.eye(3)).max() < 1e-14
    assert (np.diff(np.array(values), axis=0) <= 0.0).all()


def test_a_matrix_that_is_not_finite_has_no_values() -> None:
    """NaN in one matrix of space gives NaN values there, and leaves the others as they are."""
    parts = np.tile(np.array([2.0, 0.0, 3.0, 0.0, 0.0, 4.0])[:, None], 2)
    parts[1, 0] = np.nan
    values, _ = eigensystem(SymmetricMatrix(*parts))
    assert np.isnan(values[0][0])
    assert [value[1] for value in values] == [4.0, 3.0, 2.0]
