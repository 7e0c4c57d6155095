"""The covariance of a fix nearer to a sensor than its uncertainty."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from batches import bearing_batch
from bearing_worlds import estimate, squared_mahalanobis

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.methods import bearings_ml
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.line_fits import inflate_near_sensors

FloatArray = npt.NDArray[np.float64]


def close_world(snapshots: int, std_deg: float, seed: int) -> tuple[BearingBatch, FloatArray]:
    """Return bearings of 8 sensors in a square kilometre, with sources about one std from the first sensor."""
    generator = np.random.default_rng(seed)
    sensor = generator.uniform(-500.0, 500.0, (snapshots, 8, 2))
    source = sensor[:, 0] + generator.normal(size=(snapshots, 2)) * 3.0 * std_deg
    offset = source[:, None] - sensor
    std = np.radians(std_deg)
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) + std * generator.normal(size=(snapshots, 8))
    return bearing_batch(sensor, bearing, std, want_flags=False), source


@pytest.mark.parametrize("std_deg", [0.1, 0.3, 1.0])
def test_covariances_near_a_sensor_are_calibrated(method: MethodSpec, std_deg: float) -> None:
    """Within a std of a sensor 95 % ellipses cover 94 to 99 %, and no NEES is extreme (sequential: 1 in 2000)."""
    batch, source = close_world(8000, std_deg, seed=1)
    squared = squared_mahalanobis(estimate(method, batch), source)
    fixes = squared[~np.isnan(squared)]
    assert fixes.size > 5000
    assert 0.94 < (fixes < 5.991).mean() < 0.99
    assert np.mean(fixes >= 100.0) <= (0.0005 if method.name == "sequential" else 0.0)


def test_the_inverse_information_is_not_calibrated_there() -> None:
    """Without widening, the inverse Fisher information is far too small in 1 % of these fixes."""
    batch, source = close_world(8000, 1.0, seed=1)
    position = estimate(bearings_ml.METHOD, batch).position_m
    lines = sight_lines(batch)
    covariance = lines.information(position[:, 0] - lines.center_x, position[:, 1] - lines.center_y).inverse()
    dx, dy = (position - source).T
    squared = (covariance.yy * dx * dx - 2.0 * covariance.xy * dx * dy + covariance.xx * dy * dy) / (
        covariance.determinant
    )
    assert np.mean(squared[np.isfinite(squared)] > 100.0) > 0.01


def test_only_fixes_near_a_sensor_are_widened() -> None:
    """Covariances of fixes more than three stds from every sensor are unchanged to the bit; nearer ones grow."""
    covariance = Symmetric2x2(np.full(2, 4.0), np.zeros(2), np.full(2, 1.0))
    asked: list[list[int]] = []

    def inflated(rows: np.ndarray, extra_m2: FloatArray) -> Symmetric2x2:
        asked.append([*rows.tolist(), *extra_m2.tolist()])
        return Symmetric2x2(4.0 + extra_m2, np.zeros(1), 1.0 + extra_m2)

    wider = inflate_near_sensors(covariance, np.array([6.1, 5.9]), inflated)
    assert asked == [[1, 4.0], [1, 8.0]]
    assert wider.xx.tolist() == [4.0, 12.0]
    assert wider.yy.tolist() == [1.0, 9.0]
    assert inflate_near_sensors(covariance, np.array([6.1, 7.0]), inflated) is covariance


@pytest.mark.slow
def test_precise_bearings_have_no_extreme_nees() -> None:
    """Of a million fixes of 8 bearings of at most 1 deg none has a NEES over 100 with status ok."""
    generator = np.random.default_rng(7)
    for _ in range(250):
        sensor, source = generator.uniform(0.0, 1e3, (4000, 8, 2)), generator.uniform(0.0, 1e3, (4000, 2))
        offset = source[:, None] - sensor
        std = np.radians(np.exp(generator.uniform(np.log(0.05), 0.0, (4000, 8))))
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) + std * generator.normal(size=(4000, 8))
        estimates = estimate(bearings_ml.METHOD, bearing_batch(sensor, bearing, std, want_flags=False))
        squared = squared_mahalanobis(estimates, source)
        assert not np.any(squared > 100.0)
        assert np.all(np.abs(estimates.position_m[~np.isnan(squared)] - 500.0) < 1000.0)
