"""Ranges: residuals, information and the fitting problem."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from nlosctl.models.ranges.circles import range_circles
from nlosctl.solvers.ranges.likelihood import RangeProblem, SquaredRangeProblem
from nlosctl.testing.draws import draw_ranges

_POINTS = 40


def _batch(seed: int, height: float):  # type: ignore[no-untyped-def]
    batch = draw_ranges(np.random.default_rng(seed), _POINTS, 5, None).batch
    scale = float(batch.range_m.max())
    return dataclasses.replace(batch, sensor_height_m=np.full((_POINTS, 5), height * scale, order="F")), scale


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_the_gradient_agrees_with_finite_differences(height: float) -> None:
    """Gradients of both range problems equal central differences of their costs."""
    for seed in range(4):
        batch, scale = _batch(seed, height)
        circles = range_circles(batch)
        x, y = np.random.default_rng(seed).uniform(-scale, scale, (2, _POINTS))
        step = 1e-5 * scale
        for problem in (RangeProblem.of_rows(circles), SquaredRangeProblem.of_rows(circles)):
            at = problem.evaluate(x, y)
            slope_x = (problem.evaluate(x + step, y).cost - problem.evaluate(x - step, y).cost) / (2.0 * step)
            slope_y = (problem.evaluate(x, y + step).cost - problem.evaluate(x, y - step).cost) / (2.0 * step)
            size = np.hypot(slope_x, slope_y) + at.cost / scale
            assert (np.hypot(at.gradient_x - slope_x, at.gradient_y - slope_y) / size).max() < 1e-6


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_second_derivatives_agree_with_finite_differences(height: float) -> None:
    """Newton's matrix equals central differences of the gradient where used; elsewhere it is positive."""
    batch, scale = _batch(2, height)
    problem = RangeProblem.of_rows(range_circles(batch))
    x, y = np.random.default_rng(1).uniform(-scale, scale, (2, _POINTS))
    step = 1e-5 * scale
    at, right, left = problem.evaluate(x, y), problem.evaluate(x + step, y), problem.evaluate(x - step, y)
    xx = (right.gradient_x - left.gradient_x) / (2.0 * step)
    xy = (right.gradient_y - left.gradient_y) / (2.0 * step)
    exact = np.abs(at.hessian.xx - xx) + np.abs(at.hessian.xy - xy) < 1e-5 * at.hessian.trace
    assert exact.sum() > _POINTS // 4
    assert (at.hessian.xx > 0.0).all()
    assert (at.hessian.determinant > 0.0).all()


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_the_information_is_the_sum_of_squared_slopes(height: float) -> None:
    """The information is the sum over ranges of squared finite-difference slopes over the variance."""
    batch, scale = _batch(3, height)
    circles = range_circles(batch)
    x, y = np.random.default_rng(2).uniform(-scale, scale, (2, _POINTS))
    step = 1e-6 * scale
    slope_x = -(circles.residual_m(x + step, y) - circles.residual_m(x - step, y)) / (2.0 * step)
    slope_y = -(circles.residual_m(x, y + step) - circles.residual_m(x, y - step)) / (2.0 * step)
    information = circles.information(x, y)
    weight = 1.0 / batch.range_std_m**2
    np.testing.assert_allclose(information.xx, (weight * slope_x**2).sum(axis=1), rtol=1e-5)
    np.testing.assert_allclose(information.yy, (weight * slope_y**2).sum(axis=1), rtol=1e-5)
    trace = information.trace
    assert (np.abs(information.xy - (weight * slope_x * slope_y).sum(axis=1)) / trace).max() < 1e-6
