"""Rays traced back from a bearing to the source."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.contract.scene import CircleReflector, LineReflector, Reflector, Scene, SegmentReflector
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.models.traced_rays import points_at_range, trace_back

SENSOR = np.array([[0.0, 0.0], [30.0, -5.0], [-20.0, 10.0]])
SOURCE = np.array([[40.0, 25.0], [-10.0, 33.0], [15.0, 12.0]])
REFLECTORS: list[Reflector] = [
    LineReflector(name="slanted", point=(0.0, 60.0), direction=(2.0, -0.3)),
    LineReflector(name="vertical", point=(90.0, 0.0), direction=(0.0, 1.0)),
    SegmentReflector(name="segment", start=(-500.0, -60.0), end=(500.0, -70.0)),
    CircleReflector(name="circle", center=(5.0, -3.0), radius=120.0),
]


@pytest.mark.parametrize("reflector", REFLECTORS, ids=lambda reflector: reflector.name)
def test_a_noise_free_ray_ends_at_its_source(reflector: Reflector) -> None:
    """Traced back over its reflector, a noise-free bearing leads to the source, with equal angles at the hit."""
    place = np.zeros((3, 1), dtype=np.int64)
    bearing = predict_bearings(SENSOR[:, None, :], place, Scene(reflectors=(reflector,)), SOURCE[:, None, :])[:, 0]
    rays = trace_back(SENSOR, bearing, reflector)
    second_leg = np.hypot(*(SOURCE - rays.hit_m).T)
    np.testing.assert_allclose(rays.points_at(second_leg), SOURCE, atol=1e-6)


def test_a_direct_ray_starts_at_its_sensor() -> None:
    """Without a reflector, a ray starts at the sensor along its bearing."""
    rays = trace_back(SENSOR, np.array([0.0, np.pi / 2, np.pi]), None)
    np.testing.assert_allclose(
        rays.points_at(2.0), SENSOR + np.array([[2.0, 0.0], [0.0, 2.0], [-2.0, 0.0]]), atol=1e-12
    )


def test_a_ray_that_never_meets_its_mirror_has_no_hit() -> None:
    """Away from the mirror, or along it, there is no hit."""
    mirror = LineReflector(name="m", point=(0.0, 60.0), direction=(1.0, 0.0))
    rays = trace_back(SENSOR[:2], np.array([-np.pi / 2, 0.0]), mirror)
    assert np.isnan(rays.hit_m).all()
    assert np.isnan(rays.direction_rad).all()


@pytest.mark.parametrize("reflector", REFLECTORS, ids=lambda reflector: reflector.name)
def test_a_curve_of_one_range_passes_its_source(reflector: Reflector) -> None:
    """All points of the curve of a range have that path length, and the curve passes the source."""
    scene = Scene(reflectors=(reflector,))
    for sensor, source in zip(SENSOR, SOURCE, strict=True):
        exact = predict_ranges(sensor[None], np.zeros(1), source[None], np.zeros(1, dtype=np.int64), scene)[0]
        curve = points_at_range(sensor, float(exact), reflector)
        drawn = curve[np.isfinite(curve[:, 0])]
        sensors = np.broadcast_to(sensor, drawn.shape)
        along = np.zeros(drawn.shape[0], dtype=np.int64)
        lengths = predict_ranges(sensors, np.zeros(drawn.shape[0]), drawn, along, scene)
        np.testing.assert_allclose(lengths, exact, rtol=2e-6)
        assert np.hypot(*(drawn - source).T).min() < 0.5


def test_a_curve_of_one_range_ends_with_its_segment() -> None:
    """By a segment the curve has only points whose reflection point is between its ends."""
    wall = SegmentReflector(name="s", start=(-10.0, 30.0), end=(20.0, 30.0))
    curve = points_at_range(np.array([0.0, 0.0]), 90.0, wall)
    drawn = curve[np.isfinite(curve[:, 0])]
    hit_x = drawn[:, 0] * 30.0 / (60.0 - drawn[:, 1])  # on the way from the image (0, 60) to the point
    assert hit_x.min() >= -10.0 - 1e-9
    assert hit_x.max() <= 20.0 + 1e-9
    assert hit_x.max() - hit_x.min() > 29.0
