"""Sums and maxima over the measurements of a block."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from nlosctl.geometry.blocks import RowBlock, gather_rows, max_measurements, rows_of, sum_measurements


@pytest.mark.parametrize("measurements", [0, 1, 2, 7, 8, 9, 64, 200])
@pytest.mark.parametrize("layout", ["C", "F"])
def test_sums_do_not_depend_on_the_block(measurements: int, layout: str) -> None:
    """The sum of a snapshot has the same bits alone, in a small block and in a large one."""
    generator = np.random.default_rng(1)
    values = generator.normal(size=(130, measurements)) * 10.0 ** generator.uniform(-8, 8, (130, measurements))
    values = np.asarray(values, order=layout)  # type: ignore[call-overload]
    whole = sum_measurements(values)
    for rows in ([0], [129], range(3), range(17, 130)):
        np.testing.assert_array_equal(sum_measurements(values[list(rows)]), whole[list(rows)])


def test_sums_agree_with_fsum() -> None:
    """Sums agree with exact summation to rounding."""
    values = np.random.default_rng(2).normal(size=(50, 30))
    np.testing.assert_allclose(sum_measurements(values), [math.fsum(row) for row in values], atol=1e-13)


def test_maxima_propagate_nan() -> None:
    """The maximum of each snapshot; NaN if the snapshot contains NaN."""
    values = np.array([[1.0, -3.0, 2.0], [-1.0, -5.0, -2.0], [1.0, np.nan, 2.0], [np.inf, 0.0, 1.0]])
    np.testing.assert_array_equal(max_measurements(values), [2.0, -1.0, np.nan, np.inf])


def test_only_the_last_axis_is_summed() -> None:
    """Quantities (Q, B, K) are summed over the last axis only."""
    values = np.arange(24.0).reshape(2, 3, 4)
    np.testing.assert_array_equal(sum_measurements(values), values.sum(axis=2))


@dataclass(frozen=True)
class Block(RowBlock):
    """Arrays with one row per snapshot, a nested block, a missing array and an option."""

    values: npt.NDArray[np.float64]
    inner: Block | None
    missing: None = None
    option: bool = True


def test_rows_come_in_the_given_order() -> None:
    """Rows of arrays, tuples and blocks come in the given order, with repetitions, in Fortran order."""
    block = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(gather_rows(block, np.array([2, 0, 2, 1])), block[[2, 0, 2, 1]])
    one, (other, nothing) = rows_of((block[:, 0], (block, None)), np.array([1, 3]))
    np.testing.assert_array_equal(one, block[[1, 3], 0])
    np.testing.assert_array_equal(other, block[[1, 3]])
    assert nothing is None
    taken = Block(block, Block(block + 1.0, None)).take(np.array([3, 1, 3]))
    assert taken.inner is not None
    np.testing.assert_array_equal(taken.values, block[[3, 1, 3]])
    np.testing.assert_array_equal(taken.inner.values, block[[3, 1, 3]] + 1.0)
    assert taken.values.flags.f_contiguous
    assert taken.option
