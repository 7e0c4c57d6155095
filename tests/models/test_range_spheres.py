"""Ranges in space: derivatives, information, and what mirrors hide."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from range_spheres import distances, sphere_batch

from nlosctl.contract.scene import PlaneReflector, Scene
from nlosctl.models.ranges.spheres import RangeSpheres, range_rows
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS
from nlosctl.solvers.ranges.likelihood import RangeProblem, SquaredRangeProblem

_POINTS = 30
SCENE = Scene(reflectors=(PlaneReflector(name="roof", point=(0.0, 0.0, 150.0), normal=(0.2, 0.1, -1.0)),))


def _rows(seed: int, *, height: bool) -> tuple[RangeSpheres, tuple[Any, ...]]:
    generator = np.random.default_rng(seed)
    sensors = generator.uniform(-50.0, 50.0, (_POINTS, 5, 3))
    source = generator.uniform(-50.0, 50.0, (_POINTS, 3))
    ranges = distances(sensors, source) + generator.normal(size=(_POINTS, 5))
    heights = {"z_m": source[:, 2] + 1.0, "z_std_m": 2.0} if height else {}
    reflector = np.asfortranarray(np.where(np.arange(5) == 2, 0, -1) * np.ones((_POINTS, 1), dtype=np.int64))
    batch = sphere_batch(sensors, ranges, 0.7, scene=SCENE, reflector=reflector, **heights)
    rows = range_rows(batch)
    assert isinstance(rows, RangeSpheres)
    return rows, tuple(generator.uniform(-60.0, 50.0, (3, _POINTS)))


@pytest.mark.parametrize("height", [False, True])
def test_derivatives_agree_with_finite_differences(height: bool) -> None:
    """Gradients of both problems equal central differences; Newton's matrices do so where they are exact."""
    rows, point = _rows(3, height=height)
    step = 1e-4
    for problem in (RangeProblem.of_rows(rows), SquaredRangeProblem.of_rows(rows)):
        at = problem.evaluate(*point)
        assert at.exact is not None
        assert at.exact.any()
        for axis in range(3):
            beside = [
                problem.evaluate(*(part + sign * step * (i == axis) for i, part in enumerate(point)))
                for sign in (1.0, -1.0)
            ]
            slope = (beside[0].cost - beside[1].cost) / (2.0 * step)
            scale = np.abs(at.gradient[axis]) + 1e-3 * (1.0 + at.cost)
            assert (np.abs(at.gradient[axis] - slope) / scale).max() < 1e-6
            for other in range(3):
                bend = (beside[0].gradient[other] - beside[1].gradient[other]) / (2.0 * step)
                off = np.abs(at.hessian.entry(axis, other) - bend)[at.exact]
                assert (off / at.hessian.trace[at.exact]).max() < 1e-6


@pytest.mark.parametrize("height", [False, True])
def test_the_information_is_the_sum_of_squared_slopes(height: bool) -> None:
    """The information is the sum of products of finite-difference slopes over the variances, the height's included."""
    rows, point = _rows(4, height=height)
    step = 1e-4
    slopes = []
    for axis in range(3):
        ends = [
            rows.residual_m(*(part + sign * step * (i == axis) for i, part in enumerate(point))) for sign in (1.0, -1.0)
        ]
        slopes.append((ends[0] - ends[1]) / (2.0 * step) / rows.std_m)
    expected = np.einsum("ibk,jbk->bij", slopes, slopes)
    if height:
        expected[:, 2, 2] += 0.25
    np.testing.assert_allclose(rows.information(*point).dense(), expected, atol=1e-6)


def test_a_mirror_hides_what_is_beyond_it() -> None:
    """Beyond the roof its row is unseen, and too long by a thousand standard deviations for every function."""
    rows, (x, y, z) = _rows(5, height=False)
    z = np.where(np.arange(_POINTS) % 2 == 0, 400.0, z)
    beyond = z == 400.0
    np.testing.assert_array_equal(rows.unseen(x, y, z)[:, 2], beyond)
    assert not rows.unseen(x, y, z)[:, [0, 1, 3, 4]].any()
    length = rows.length_m(2, x[:, None], y[:, None], z[:, None])[:, 0]
    np.testing.assert_allclose((length - rows.range_m[:, 2])[beyond], 700.0)
    path = rows.path(2, x, y, z)
    np.testing.assert_allclose(path.length_m, length)
    assert all((part[beyond] == 0.0).all() for part in path.along)
    straight = rows.path(0, x, y, z)
    np.testing.assert_allclose(straight.length_m, rows.distance_m(x, y, z)[:, 0])
    np.testing.assert_allclose(sum(part * part for part in straight.along), 1.0)


def test_costs_of_points_are_those_of_the_problem() -> None:
    """Half the chi-square of points (B, P) is the cost of the problem at each, the height included."""
    rows, point = _rows(6, height=True)
    direct = sphere_batch(np.zeros(3), np.ones((1, 1)))
    assert direct.dimension == 3
    costs = rows.half_chi_squares(*(np.stack([part, part + 1.0], axis=1) for part in point))
    for column, moved in enumerate((0.0, 1.0)):
        there = [part + moved for part in point]
        seen = ~rows.unseen(*there).any(axis=1)
        np.testing.assert_allclose(costs[seen, column], RangeProblem.of_rows(rows).evaluate(*there).cost[seen])


def test_scaled_residuals_have_three_slopes() -> None:
    """The scaled residuals of ranges in space are (r - |x - a|) / std with slopes -u / std."""
    sensors = np.random.default_rng(7).uniform(-50.0, 50.0, (4, 5, 3))
    source = np.random.default_rng(8).uniform(-50.0, 50.0, (4, 3))
    batch = sphere_batch(sensors, distances(sensors, source) + 0.3, 0.5)
    (scalars,) = SCALED_RESIDUALS["ranges"](batch, source, with_ranges=False)
    np.testing.assert_allclose(scalars.residual, 0.6)
    away = (source[:, None] - sensors) / distances(sensors, source)[..., None]
    np.testing.assert_allclose(np.stack(scalars.slopes, axis=-1), -away / 0.5)
