"""Arrivals: derivatives of the likelihood and of squared differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from arrival_batches import arrival_batch, pair_batch

from nlosctl.models.arrival_offsets import offset_columns
from nlosctl.models.arrivals import ArrivalRows, arrival_rows
from nlosctl.solvers.arrivals.likelihood import ArrivalProblem
from nlosctl.solvers.arrivals.squared_differences import squared_differences

_POINTS = 30


SPEED_CASES = ["speed plane", "speed level", "pairs speed space"]
CASES = ["plane", "space", "level", "held", "pairs plane", "pairs space", "pairs level", "pairs held"]


def _rows(case: str) -> tuple[ArrivalRows, list[Any]]:
    generator = np.random.default_rng(3)
    shape = (_POINTS, 6, 2 if case.endswith("plane") else 3)
    sensors = generator.uniform(-50.0, 50.0, shape)
    arrivals = generator.uniform(0.0, 60.0, (_POINTS, 6))
    known = {"level": {"z_m": 20.0, "z_std_m": 2.0}, "held": {"z_m": 20.0, "z_std_m": 0.0}}
    heights = known.get(case.rpartition(" ")[2], {})
    std = generator.uniform(0.5, 2.0, (_POINTS, 6))
    if "speed" in case:
        heights = {**heights, "speed_std": generator.uniform(0.001, 0.05, _POINTS)}
    if case.startswith("pairs"):
        batch = pair_batch(sensors, generator.uniform(-50.0, 50.0, shape), arrivals - 30.0, std, **heights)
    else:
        batch = arrival_batch(sensors, arrivals, std, **heights)
    rows = arrival_rows(batch)
    return rows, list(generator.uniform(-60.0, 50.0, (len(rows.center), _POINTS)))


@pytest.mark.parametrize("case", [*CASES, *SPEED_CASES])
def test_derivatives_agree_with_finite_differences(case: str) -> None:
    """Gradients of both problems equal central differences; Newton's matrices do so where they are exact."""
    rows, point = _rows(case)
    step = 1e-4
    problems: list[Any] = [ArrivalProblem.of_rows(rows)]
    if not rows.of_pairs:
        problems.append(squared_differences(rows).problem)
    for problem in problems:
        at = problem.evaluate(*point)
        assert at.exact is not None
        assert at.exact.any()
        for axis in range(len(point)):
            beside = [
                problem.evaluate(*(part + sign * step * (i == axis) for i, part in enumerate(point)))
                for sign in (1.0, -1.0)
            ]
            slope = (beside[0].cost - beside[1].cost) / (2.0 * step)
            scale = np.abs(at.gradient[axis]) + 1e-3 * (1.0 + at.cost)
            assert (np.abs(at.gradient[axis] - slope) / scale).max() < 1e-6
            for other in range(len(point)):
                bend = (beside[0].gradient[other] - beside[1].gradient[other]) / (2.0 * step)
                off = np.abs(at.hessian.entry(axis, other) - bend)[at.exact]
                assert (off / at.hessian.trace[at.exact]).max() < 1e-6


@pytest.mark.parametrize("case", CASES)
def test_the_information_is_the_sum_of_squared_slopes(case: str) -> None:
    """The information is that of finite-difference slopes of the residuals, the offset eliminated at each point."""
    rows, point = _rows(case)
    step = 1e-4
    slopes = []
    for axis in range(len(point)):
        ends = [
            rows.residual_m(*(part + sign * step * (i == axis) for i, part in enumerate(point))) for sign in (1.0, -1.0)
        ]
        slopes.append((ends[0] - ends[1]) / (2.0 * step) / rows.std_m)
    expected = np.einsum("ibk,jbk->bij", slopes, slopes)
    if case.endswith("level"):
        expected[:, 2, 2] += 0.25
    np.testing.assert_allclose(rows.information(*point).dense(), expected, atol=1e-6)


@pytest.mark.parametrize("case", ["plane", "held", "pairs plane", "pairs held", *SPEED_CASES])
def test_costs_of_points_are_those_of_the_problem(case: str) -> None:
    """Half the chi-square of points (B, P) is the cost of the problem at each; beyond its reach that is infinite."""
    rows, point = _rows(case)
    costs = rows.half_chi_squares(*(np.stack([part, part + 1.0], axis=1) for part in point))
    problem = ArrivalProblem.of_rows(rows)
    np.testing.assert_allclose(costs[:, 0], problem.evaluate(*point).cost)
    np.testing.assert_allclose(costs[:, 1], problem.evaluate(*(part + 1.0 for part in point)).cost)
    assert np.isinf(problem.evaluate(*(1e9 * np.ones(_POINTS) for _ in point)).cost).all()


def test_differences_of_pairs_have_no_offset() -> None:
    """The residual is the difference less that of the distances, and the columns of the offset are NaN."""
    rows, point = _rows("pairs space")
    away = [np.linalg.norm(np.stack(point)[..., None] - np.stack(rows.sensor)[..., k : k + 6], axis=0) for k in (0, 6)]
    np.testing.assert_allclose(rows.residual_m(*point), rows.arrival_m - away[0] + away[1], rtol=1e-12)
    columns = offset_columns(rows, tuple(point), rows.information(*point).inverse())
    assert np.isnan(list(columns.values())).all()
    assert (rows.degrees_of_freedom == 3).all()


def test_the_offset_has_the_covariance_of_the_joint_information() -> None:
    """Offset, std and covariances are those of the inverse information of position and offset together."""
    rows, point = _rows("space")
    covariance = rows.information(*point).inverse()
    columns = offset_columns(rows, tuple(point), covariance)
    distance = rows.distance_m(*point)
    weight = 1.0 / rows.std_m**2
    slopes = [(part[:, None] - own) / distance for part, own in zip(point, rows.sensor, strict=True)]
    slopes.append(np.ones_like(distance))
    whole = np.linalg.inv(np.einsum("ibk,jbk,bk->bij", slopes, slopes, weight))
    np.testing.assert_allclose(columns["offset_std_m"] ** 2, whole[:, 3, 3], rtol=1e-6)
    for axis, name in enumerate("xyz"):
        np.testing.assert_allclose(columns[f"cov_{name}_offset_m2"], whole[:, axis, 3], rtol=1e-6)
    np.testing.assert_allclose(covariance.dense(), whole[:, :3, :3], rtol=1e-6)
    excess = rows.arrival_m - distance
    np.testing.assert_allclose(columns["offset_m"], (weight * excess).sum(axis=1) / weight.sum(axis=1))
