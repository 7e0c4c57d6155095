"""Sums and largest values over the measurements of a block."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nlosctl.geometry.blocks import gather_rows, max_measurements, sum_measurements, take_rows


@pytest.mark.parametrize("measurements", [0, 1, 2, 7, 8, 9, 64, 200])
@pytest.mark.parametrize("layout", ["C", "F"])
def test_a_row_keeps_its_bits_among_any_neighbours(measurements: int, layout: str) -> None:
    """The sum of a snapshot is the same to the bit alone, in a small block, and in a large one."""
    generator = np.random.default_rng(1)
    values = generator.normal(size=(130, measurements)) * 10.0 ** generator.uniform(-8, 8, (130, measurements))
    values = np.asarray(values, order=layout)  # type: ignore[call-overload]
    whole = sum_measurements(values)
    for rows in ([0], [129], range(3), range(17, 130)):
        np.testing.assert_array_equal(sum_measurements(values[list(rows)]), whole[list(rows)])


def test_the_sum_is_the_sum() -> None:
    """The sums are those of exact summation, to rounding."""
    values = np.random.default_rng(2).normal(size=(50, 30))
    np.testing.assert_allclose(sum_measurements(values), [math.fsum(row) for row in values], atol=1e-13)


def test_the_largest_is_the_largest_and_nan_shows() -> None:
    """The largest value of each snapshot; NaN where a snapshot holds NaN."""
    values = np.array([[1.0, -3.0, 2.0], [-1.0, -5.0, -2.0], [1.0, np.nan, 2.0], [np.inf, 0.0, 1.0]])
    np.testing.assert_array_equal(max_measurements(values), [2.0, -1.0, np.nan, np.inf])


def test_only_the_last_axis_is_summed() -> None:
    """Of several quantities (Q, B, K) each is summed over the measurements of each snapshot."""
    values = np.arange(24.0).reshape(2, 3, 4)
    np.testing.assert_array_equal(sum_measurements(values), values.sum(axis=2))


def test_rows_are_those_that_are_named() -> None:
    """Rows come in the order named; all of them, rising, are the block itself and no copy."""
    block = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(gather_rows(block, np.array([2, 0, 2, 1])), block[[2, 0, 2, 1]])
    np.testing.assert_array_equal(take_rows(block, np.array([1, 3])), block[[1, 3]])
    assert take_rows(block, np.arange(4)) is block
