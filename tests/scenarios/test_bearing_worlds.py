"""Bearing scenarios: physical paths, errors of the stated size, correct truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nlosctl.contract.options import parse_options
from nlosctl.errors import UsageError
from nlosctl.scenarios.catalogue import scenarios

WORLDS = [
    ("song-flat", {}),
    ("ring", {"sensors": 5}),
    ("random", {}),
    ("random", {"layout": "fixed", "sensors": 4}),
    ("random", {"mirrors": 0}),
]


def generate(name, snapshots, seed=6, **options):
    """Return the scene and the columns of one call."""
    spec = scenarios()[name]
    chosen = spec.options(**options)
    return spec.scene(chosen), spec.generate(chosen, np.random.default_rng(seed), snapshots)


def complex_positions(columns):
    """Return sensors and sources as complex numbers."""
    return (columns["sensor_x_m"] + 1j * columns["sensor_y_m"], columns["truth_x_m"] + 1j * columns["truth_y_m"])


def noise_of(scene, columns):
    """Return bearing error over its standard deviation, the path traced with complex numbers."""
    sensor, source = complex_positions(columns)
    seen = source.copy()
    for mirror in scene.reflectors:
        rows = np.flatnonzero(columns["reflector"] == mirror.name)
        point = complex(*mirror.point)
        along = complex(*mirror.direction) / abs(complex(*mirror.direction))
        seen[rows] = point + along**2 * np.conj(source[rows] - point)
    error = np.angle(np.exp(1j * columns["bearing_rad"]) * np.exp(-1j * np.angle(seen - sensor)))
    return error / columns["bearing_std_rad"]


@pytest.mark.parametrize(("name", "options"), WORLDS)
def test_errors_are_normal_with_the_stated_sigma(name, options):
    """Measured minus true bearing over sigma has mean 0, variance 1 and 95 % within 1.96."""
    scene, columns = generate(name, 4000, **options)
    error = noise_of(scene, columns)
    count = error.size
    assert abs(error.mean()) < 4.0 / math.sqrt(count)
    assert abs(error.var() - 1.0) < 4.0 * math.sqrt(2.0 / count)
    assert abs((np.abs(error) < 1.959964).mean() - 0.95) < 4.0 * math.sqrt(0.95 * 0.05 / count)
    assert columns["truth_los"].all()


@pytest.mark.parametrize(("name", "options"), WORLDS)
def test_source_and_sensor_are_on_one_side_of_the_mirror(name, options):
    """Both ends of a mirror row are on the same side, off the mirror."""
    scene, columns = generate(name, 1000, **options)
    sensor, source = complex_positions(columns)
    for mirror in scene.reflectors:
        rows = np.flatnonzero(columns["reflector"] == mirror.name)
        assert rows.size
        normal = 1j * complex(*mirror.direction)
        sides = [np.real((ends[rows] - complex(*mirror.point)) * np.conj(normal)) for ends in (sensor, source)]
        assert (sides[0] * sides[1] > 0.0).all()


@pytest.mark.parametrize("name", ["ring", "random"])
def test_outliers_are_uniform_and_flagged_in_the_truth(name):
    """The requested fraction of rows has truth_los false and bearings independent of the source."""
    scene, columns = generate(name, 4000, outlier_fraction=0.25)
    outlier = ~columns["truth_los"]
    assert outlier.mean() == pytest.approx(0.25, abs=0.012)
    direction = np.exp(1j * columns["bearing_rad"][outlier])
    assert abs(direction.mean()) < 4.0 / math.sqrt(outlier.sum())
    error = noise_of(scene, columns)
    assert np.abs(error[~outlier]).max() < 6.0
    assert (np.abs(error[outlier]) > 6.0).mean() > 0.8


def test_ring_positions():
    """Sensors are evenly spaced on the circle; sources are uniform over the disc, half within 0.707 of its radius."""
    scene, columns = generate("ring", 8000, sensors=6, radius_m=50.0, source_radius_m=40.0)
    sensors = np.array([complex(*sensor.position) for sensor in scene.sensors])
    np.testing.assert_allclose(sensors, 50.0 * np.exp(1j * np.pi / 3.0 * np.arange(6)), atol=1e-12)
    distance = np.abs(complex_positions(columns)[1][::6])
    assert distance.max() < 40.0
    assert (distance < 40.0 / math.sqrt(2.0)).mean() == pytest.approx(0.5, abs=0.025)


def test_random_field_keeps_its_bounds():
    """Sensors and sources are in the region, no source nearer than min_range_m, sigmas within bounds."""
    _, columns = generate("random", 3000, field_m=200.0, min_range_m=15.0, bearing_std_deg=(1.0, 3.0))
    sensor, source = complex_positions(columns)
    for position in (sensor, source):
        assert np.abs(position.real).max() <= 100.0
        assert np.abs(position.imag).max() <= 100.0
    assert np.abs(sensor - source).min() >= 15.0
    sigma = np.degrees(columns["bearing_std_rad"])
    assert sigma.min() >= 1.0 - 1e-12
    assert sigma.max() <= 3.0 + 1e-12
    assert (sigma < math.sqrt(3.0)).mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_random_field_reflects_the_requested_fraction(fraction):
    """Mirror rows have the requested fraction, spread over all mirrors."""
    _, columns = generate("random", 3000, reflected_fraction=fraction, mirrors=4)
    reflected = np.array([name is not None for name in columns["reflector"]])
    assert reflected.mean() == pytest.approx(fraction, abs=0.015)
    names, counts = np.unique(columns["reflector"][reflected].astype(str), return_counts=True)
    assert len(names) == (4 if fraction else 0)
    assert all(count / reflected.sum() == pytest.approx(0.25, abs=0.03) for count in counts)


def test_fixed_layout_is_drawn_from_its_own_seed():
    """A fixed layout is the same for all snapshots and noise seeds; layout_seed changes it, mirrors or not."""
    few, many, moved = (
        generate("random", 2, layout="fixed", **options)[0]
        for options in ({"mirrors": 1}, {"mirrors": 5}, {"mirrors": 1, "layout_seed": 1})
    )
    assert few.sensors == many.sensors
    assert few.sensors != moved.sensors
    assert few.reflectors != moved.reflectors


def test_impossible_min_range_is_refused():
    """A min_range_m that no source can satisfy is an error instead of an endless loop."""
    with pytest.raises(UsageError, match="'min_range_m' parameter of random leaves no room"):
        generate("random", 5, min_range_m=2000.0)


def test_sigma_bounds_are_read_from_text_and_checked():
    """``bearing_std_deg=0.5,2`` is a pair; the wrong order is refused."""
    options = scenarios()["random"].options
    assert parse_options(options, {"bearing_std_deg": "0.5,2"}, "random").bearing_std_deg == (0.5, 2.0)
    with pytest.raises(UsageError, match=r"must be smallest,largest. Got 2,0.5 instead"):
        parse_options(options, {"bearing_std_deg": "2,0.5"}, "random")
