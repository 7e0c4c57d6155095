"""Fixes that depend on one row: the odds that the row is an outlier and the source far away."""

from __future__ import annotations

import numpy as np
import pytest
from batches import bearing_batch

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.methods import bearings_mixture_ml
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.solvers.mixture.consensus import loose_odds, rival_mass
from nlosctl.solvers.mixture.outlier_model import grouped_batch, outlier_model
from nlosctl.solvers.mixture.ranked_estimates import Misfit, RankedFixes
from nlosctl.solvers.optimization.levenberg_marquardt import minimize

_SIDE_M = 1000.0
_ALPHA = 0.25
_STD_RAD = np.radians(1.0)


def make_batch(sensor: FloatArray, bearing: FloatArray) -> BearingBatch:
    """Return snapshots of bearings in a square kilometre."""
    box = BoxField(xmin_m=0.0, xmax_m=_SIDE_M, ymin_m=0.0, ymax_m=_SIDE_M)
    return bearing_batch(sensor, bearing, _STD_RAD, field=box)


@pytest.mark.parametrize("error_deg", [0.0, 1.5, -2.0])
def test_the_odds_are_those_of_a_fine_grid(error_deg: float) -> None:
    """Two rays at a small angle leave the range to the third row: its odds agree with sums over a grid."""
    sensor = np.array([[100.0, 500.0], [100.0, 560.0], [650.0, 200.0]])
    source = np.array([600.0, 520.0])
    bearing = np.arctan2(*(source - sensor).T[::-1]) + np.radians([0.2, -0.1, error_deg])
    batch, groups = grouped_batch(make_batch(sensor[None], bearing[None]))
    model = outlier_model(batch, groups, MixtureOptions(alpha=_ALPHA, field_of_view_deg=360.0))
    center = np.array([model.lines.center_x[0], model.lines.center_y[0]])
    end = minimize(model.mixture, source[:1] - center[0], source[1:] - center[1])
    direct, information = model.mixture.responsibilities(end.x, end.y)
    covariance, used = information.inverse(), np.ones((1, 3), dtype=bool)
    odds = loose_odds(model.mixture, end.point, covariance, direct, used, model.region.volume)[0]

    axis = (np.arange(2000) + 0.5) * _SIDE_M / 2000
    x, y = np.meshgrid(axis, axis)
    density = []
    for (sensor_x, sensor_y), angle in zip(sensor, bearing, strict=True):
        error = (np.arctan2(y - sensor_y, x - sensor_x) - angle + np.pi) % (2.0 * np.pi) - np.pi
        density.append((1.0 - _ALPHA) * np.exp(-0.5 * (error / _STD_RAD) ** 2) / (np.sqrt(2.0 * np.pi) * _STD_RAD))
    dx, dy = x - end.x[0] - center[0], y - end.y[0] - center[1]
    far = covariance.inverse().quadratic_form(dx, dy) > 100.0
    outlier = _ALPHA / (2.0 * np.pi)
    elsewhere = sum((far * outlier * np.prod([density[j] for j in range(3) if j != k], axis=0)).sum() for k in range(3))
    assert odds == pytest.approx(elsewhere / np.prod(density, axis=0).sum(), rel=0.25)
    assert odds > 0.01


def test_the_mass_of_rivals_by_hand() -> None:
    """Peaks times volumes, at most the region's, in units of the best; each further outlier counts by its density."""
    covariance = SymmetricMatrix(np.array([[4.0, 1.0, 1e6]]), np.zeros((1, 3)), np.array([[1.0, 9.0, 1e6]]))
    cost, used = np.array([[5.0, 5.0 + np.log(3.0), 8.0]]), np.array([[4, 3, 2]])
    misfit = Misfit.unknown((1, 3))
    fixes = RankedFixes((np.zeros((1, 3)), np.zeros((1, 3))), cost, covariance, used, misfit)
    area = np.array([1000.0])
    best = 2.0 * np.pi * 2.0
    second, third = (2.0 * np.pi * 3.0) / best / 3.0, 1000.0 / best * np.exp(-3.0)
    assert rival_mass(fixes, area)[0] == pytest.approx(second + third, rel=1e-12)
    # outliers that are twice as dense
    assert rival_mass(fixes, area, np.array([0.5]))[0] == pytest.approx(2.0 * second + 4.0 * third, rel=1e-12)


def test_few_ok_fixes_are_far_from_their_ellipse() -> None:
    """With a quarter of outliers less than .55 % of the ok fixes of five sensors have a squared error above 100."""
    generator = np.random.default_rng(5)
    sensor = generator.uniform(0.0, _SIDE_M, (30000, 5, 2))
    source = generator.uniform(0.0, _SIDE_M, (30000, 1, 2))
    offset = source - sensor
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) + _STD_RAD * generator.normal(size=sensor.shape[:2])
    anything = generator.uniform(-np.pi, np.pi, bearing.shape)
    bearing = np.where(generator.random(bearing.shape) < _ALPHA, anything, (bearing + np.pi) % (2.0 * np.pi) - np.pi)
    options = MixtureOptions(alpha=_ALPHA, field_of_view_deg=360.0)
    estimates = bearings_mixture_ml.solve(make_batch(sensor, bearing), options).estimates
    ok = np.flatnonzero((estimates.alternative == 0) & (estimates.status == Status.OK))
    assert ok.size > 0.67 * sensor.shape[0]
    dx, dy = (estimates.position_m[ok] - source[estimates.row[ok], 0]).T
    xx, xy, yy = estimates.covariance_m2[ok].T
    squared = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    assert np.mean(squared > 100.0) < 0.0055
