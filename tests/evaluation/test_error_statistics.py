"""Standard errors of metrics, compared with the spread of repeated draws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nlosctl.evaluation.error_statistics import rmse_std_error, share_std_error


@pytest.mark.parametrize("law", ["normal", "laplace"])
def test_the_error_of_an_rmse_is_its_spread(law: str) -> None:
    """The mean of the standard error is the standard deviation of the RMSE over many draws."""
    generator = np.random.default_rng(7)
    draws = getattr(generator, law)(size=(4000, 400))
    square, fourth = (draws**2).mean(axis=1), (draws**4).mean(axis=1)
    estimated = [rmse_std_error(400, float(m2), float(m4)) for m2, m4 in zip(square, fourth, strict=True)]
    assert np.mean(estimated) == pytest.approx(np.sqrt(square).std(), rel=0.06)


def test_the_error_of_a_fraction_is_its_spread() -> None:
    """The standard error is the standard deviation of a binomial fraction over many draws."""
    shares = np.random.default_rng(7).binomial(50, 0.2, size=200_000) / 50
    assert share_std_error(0.2, 50) == pytest.approx(shares.std(), rel=0.01)


def test_standard_errors_of_few_values_by_hand() -> None:
    """Two values have the error by the sample variance of their squares; a single row has a share's."""
    squares = np.array([1.0, 9.0])
    expected = 0.5 * np.sqrt(squares.var(ddof=1) / 2.0 / squares.mean())
    assert rmse_std_error(2, float(squares.mean()), float((squares**2).mean())) == pytest.approx(expected, rel=1e-12)
    assert share_std_error(0.5, 1) == 0.5


def test_undefined_standard_errors() -> None:
    """One value has no standard error, no rows no fraction; equal values have an undefined error."""
    assert math.isnan(rmse_std_error(1, 4.0, 16.0))
    assert math.isnan(rmse_std_error(0, math.nan, math.nan))
    assert math.isnan(share_std_error(0.5, 0))
    assert rmse_std_error(5, 4.0, 16.0) == 0.0
    assert rmse_std_error(5, 0.0, 0.0) == 0.0
