"""The regions A1, A2, A3, against brute force over all specular points and against traced rays."""

from __future__ import annotations

import numpy as np
import pytest
from circle_worlds import EARTH_M, IONOSPHERE_M, distance_from_center, parts, unblocked_points

from nlosctl.geometry.circular_reflection import all_reflections
from nlosctl.geometry.short_arc import short_arc_reflection
from nlosctl.geometry.visibility import (
    elevation,
    horizon_elevation,
    reach_by_reflection,
    sees_by_reflection,
    sees_by_reflection_from_ground,
    sees_directly,
)


def draw_annulus(count, seed, height=0.0, span=0.25):
    """Return sensors at a height and sources between the circles, as complex numbers."""
    generator = np.random.default_rng(seed)
    sensor = (EARTH_M + height) * np.exp(2j * np.pi * generator.random(count))
    source_radius = generator.uniform(EARTH_M, IONOSPHERE_M, count)
    turn = np.exp(1j * np.pi * generator.uniform(-span, span, count))
    return sensor, sensor / np.abs(sensor) * source_radius * turn


def by_path(sensor, source, least=-np.inf):
    """Return the answer by the two legs of the path."""
    shape = sensor.shape
    radius, blocker = np.full(shape, IONOSPHERE_M), np.full(shape, EARTH_M)
    path = short_arc_reflection(*parts(sensor), *parts(source), radius)
    return sees_by_reflection(*parts(sensor), *parts(source), path, radius, blocker, np.full(shape, least))


def in_closed_form(sensor, source, least=0.0):
    """Return the answer by Lemma 2's edge."""
    shape = sensor.shape
    limits = (np.full(shape, IONOSPHERE_M), np.full(shape, EARTH_M), np.full(shape, least))
    return sees_by_reflection_from_ground(*parts(sensor), *parts(source), *limits)


@pytest.mark.parametrize("height", [0.0, 80e3])
def test_visible_by_reflection_is_having_an_unblocked_path(height):
    """A source is visible exactly where one of all specular points has two free legs."""
    sensor, source = draw_annulus(1200, 12, height)
    radius, blocker = np.full(sensor.shape, IONOSPHERE_M), np.full(sensor.shape, EARTH_M)
    paths = all_reflections(*parts(sensor), *parts(source), radius)
    limits = (radius, blocker, np.full(sensor.shape, -np.inf))
    visible = sees_by_reflection(*parts(sensor), *parts(source), paths, *limits).any(axis=0)
    expected = [len(unblocked_points(a, b, IONOSPHERE_M, EARTH_M)) > 0 for a, b in zip(sensor, source, strict=True)]
    assert 0.3 < visible.mean() < 0.95
    assert visible.tolist() == expected


def test_lemma_2_is_the_same_region():
    """From the ground the closed form (2 acos(r/R) - acos(r/rho)) and the path agree, A1 included."""
    sensor, source = draw_annulus(20_000, 13)
    assert (by_path(sensor, source) == in_closed_form(sensor, source)).all()


def test_the_edge_of_a2():
    """A kilometre inside of the edge a source is visible, a kilometre outside it is not."""
    radius = np.linspace(EARTH_M + 1e3, IONOSPHERE_M - 1e3, 200)
    edge = 2.0 * np.arccos(EARTH_M / IONOSPHERE_M) - np.arccos(EARTH_M / radius)
    sensor = np.full(radius.shape, EARTH_M + 0j)
    for side in (-1.0, 1.0):
        assert by_path(sensor, radius * np.exp(1j * side * (edge - 1e3 / radius))).all()
        assert not by_path(sensor, radius * np.exp(1j * side * (edge + 1e3 / radius))).any()


@pytest.mark.parametrize("least_deg", [0.5, 5.0, 30.0])
def test_least_elevation_shrinks_the_region(least_deg):
    """The reach is that of the ray that leaves at the least elevation, traced to the reflector and back."""
    least = np.radians(least_deg)
    ray = np.exp(1j * (np.pi / 2 - least))  # from EARTH_M on the real axis
    along = np.real(np.conj(ray) * EARTH_M)
    hit = EARTH_M + ray * (np.sqrt(along**2 + IONOSPHERE_M**2 - EARTH_M**2) - along)
    normal = hit / IONOSPHERE_M
    back = -(normal**2) * np.conj(ray)
    traced = hit + back * np.linspace(0.0, 100e3, 20)
    assert np.abs(traced).min() > EARTH_M
    shape = traced.shape
    limits = (np.full(shape, IONOSPHERE_M), np.full(shape, EARTH_M), np.full(shape, least))
    np.testing.assert_allclose(reach_by_reflection(np.abs(traced), *limits), np.angle(traced), atol=1e-12)
    sensor, source = draw_annulus(5000, 14)
    low, high = in_closed_form(sensor, source), in_closed_form(sensor, source, least)
    assert (high <= low).all()
    assert high.sum() < low.sum()
    assert (by_path(sensor, source, least) == high).all()


@pytest.mark.parametrize("height", [0.0, 200e3])
def test_direct_sight_is_a_segment_that_clears_the_blocker(height):
    """A3 is where the straight segment stays out of the blocker."""
    sensor, source = draw_annulus(20_000, 15, height)
    clear = distance_from_center(sensor, source) - EARTH_M
    seen = sees_directly(*parts(sensor), *parts(source), np.full(sensor.shape, EARTH_M), np.full(sensor.shape, -np.inf))
    decided = np.abs(clear) > 1e-2
    if height == 0.0:
        # The sensor itself is on the blocker: rho cos(dphi) >= r says the same.
        above = np.real(source * np.conj(sensor)) / np.abs(sensor) - EARTH_M
        assert (seen == (above >= 0.0))[np.abs(above) > 1e-2].all()
    else:
        assert (seen == (clear >= 0.0))[decided].all()
    assert 0.05 < seen.mean() < 0.9


def test_elevation_and_horizon():
    """Straight up is 90 degrees, along the ground 0; from above the horizon dips by acos(r / s)."""
    x, y = np.array([0.0, 0.0, 0.0]), np.full(3, 2.0)
    bearing = np.array([np.pi / 2, 0.0, np.pi + 0.1])
    np.testing.assert_allclose(elevation(x, y, bearing), [np.pi / 2, 0.0, -0.1], atol=1e-15)
    horizon = horizon_elevation(np.array([2.0, 1.0, 0.999]), np.ones(3))
    np.testing.assert_allclose(horizon, [-np.pi / 3, 0.0, 0.0], atol=1e-15)


def test_what_is_on_the_ground_is_not_under_it():
    """Lengths are good to 1e-10 of the blocker: sources that much under it are seen, those twice as deep are not."""
    depth = np.array([0.0, 0.5, 2.0]) * 1e-10
    for height, angle in ((80e3, 0.001), (0.0, 0.2)):
        sensor = np.full(3, EARTH_M + height + 0j)
        source = EARTH_M * (1.0 - depth) * np.exp(1j * angle)
        blocker, none = np.full(3, EARTH_M), np.full(3, -np.inf)
        if height:
            assert sees_directly(*parts(sensor), *parts(source), blocker, none).tolist() == [True, True, False]
        else:
            assert by_path(sensor, source).tolist() == in_closed_form(sensor, source).tolist() == [True, True, False]


def test_the_edge_of_a2_is_as_wide_as_the_tolerance():
    """Half of 1e-10 of the blocker beyond the edge, along the ground, a source is seen, twice as much it is not."""
    radius = np.full(2, EARTH_M + 100e3)
    edge = reach_by_reflection(radius, *(np.full(2, value) for value in (IONOSPHERE_M, EARTH_M, 0.0)))
    beyond = np.array([0.5, 2.0]) * 1e-10 * EARTH_M / radius
    assert in_closed_form(np.full(2, EARTH_M + 0j), radius * np.exp(1j * (edge + beyond))).tolist() == [True, False]
