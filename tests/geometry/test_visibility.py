"""The regions A1, A2 and A3, compared with brute force over all specular points and with traced rays."""

from __future__ import annotations

import numpy as np
import pytest
from circle_worlds import EARTH_M, IONOSPHERE_M, distance_from_center, parts, unblocked_points

from nlosctl.geometry.circular_reflection import all_reflections
from nlosctl.geometry.short_arc import short_arc_reflection
from nlosctl.geometry.visibility import (
    clears_blocker,
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
    """Return visibility by the two legs of the path."""
    shape = sensor.shape
    radius, blocker = np.full(shape, IONOSPHERE_M), np.full(shape, EARTH_M)
    path = short_arc_reflection(*parts(sensor), *parts(source), radius)
    return sees_by_reflection(*parts(sensor), *parts(source), path, radius, blocker, np.full(shape, least))


def in_closed_form(sensor, source, least=0.0):
    """Return visibility by the edge of Lemma 2."""
    shape = sensor.shape
    limits = (np.full(shape, IONOSPHERE_M), np.full(shape, EARTH_M), np.full(shape, least))
    return sees_by_reflection_from_ground(*parts(sensor), *parts(source), *limits)


@pytest.mark.parametrize("height", [0.0, 80e3])
def test_a_source_is_visible_if_a_path_is_unblocked(height):
    """A source is visible exactly if one of all specular points has two free legs."""
    sensor, source = draw_annulus(1200, 12, height)
    radius, blocker = np.full(sensor.shape, IONOSPHERE_M), np.full(sensor.shape, EARTH_M)
    paths = all_reflections(*parts(sensor), *parts(source), radius)
    limits = (radius, blocker, np.full(sensor.shape, -np.inf))
    visible = sees_by_reflection(*parts(sensor), *parts(source), paths, *limits).any(axis=0)
    expected = [len(unblocked_points(a, b, IONOSPHERE_M, EARTH_M)) > 0 for a, b in zip(sensor, source, strict=True)]
    assert 0.3 < visible.mean() < 0.95
    assert visible.tolist() == expected


def test_visibility_agrees_with_lemma_2():
    """From the ground the closed form (2 acos(r/R) - acos(r/rho)) and the path agree, A1 included."""
    sensor, source = draw_annulus(20_000, 13)
    assert (by_path(sensor, source) == in_closed_form(sensor, source)).all()


def test_the_edge_of_a2():
    """A source a kilometre inside the edge is visible, one a kilometre outside is not."""
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
def test_direct_visibility_needs_a_clear_segment(height):
    """A3 is where the straight segment stays outside the blocker."""
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


def test_the_ground_has_a_tolerance():
    """Sources up to 1e-10 of the blocker's radius below the ground are visible; twice as deep they are not."""
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
    """Half of 1e-10 of the radius beyond the edge, along the ground, is visible; twice that is not."""
    radius = np.full(2, EARTH_M + 100e3)
    edge = reach_by_reflection(radius, *(np.full(2, value) for value in (IONOSPHERE_M, EARTH_M, 0.0)))
    beyond = np.array([0.5, 2.0]) * 1e-10 * EARTH_M / radius
    assert in_closed_form(np.full(2, EARTH_M + 0j), radius * np.exp(1j * (edge + beyond))).tolist() == [True, False]


@pytest.mark.parametrize("height", [0.0, 80e3])
def test_a_segment_may_dip_into_the_ground_by_the_tolerance(height):
    """Half of 1e-10 of the radius beyond both horizons is clear; twice that is not."""
    first, second = EARTH_M + height, EARTH_M + 200e3
    reach = np.arccos(EARTH_M / first) + np.arccos(EARTH_M / second)
    beyond = np.array([0.5, 2.0]) * 1e-10 * EARTH_M / first
    ends = (np.full(2, first + 0j), second * np.exp(1j * (reach + beyond)))
    for start, end in (ends, ends[::-1]):
        assert clears_blocker(*parts(start), *parts(end), np.full(2, EARTH_M)).tolist() == [True, False]


@pytest.mark.parametrize("height", [0.0, 200e3])
def test_direct_visibility_needs_the_least_elevation(height):
    """A source is visible if its elevation is at least the least elevation, to 1e-10 rad."""
    sensor, source = draw_annulus(2000, 16, height, span=0.05)
    apart = source - sensor
    angle = np.arcsin(np.real(apart * np.conj(sensor)) / np.abs(apart) / np.abs(sensor))
    blocker = np.full(sensor.shape, EARTH_M)
    free = sees_directly(*parts(sensor), *parts(source), blocker, np.full(sensor.shape, -np.inf))
    for least in (-0.1, 0.02, 0.3):
        limit = np.full(sensor.shape, least)
        seen = sees_directly(*parts(sensor), *parts(source), blocker, limit)
        assert np.array_equal(seen, free & (angle >= least))
        assert 0.01 < seen.mean() < 1.0
    clear = free & (np.abs(angle) < 1.0)
    for share, expected in ((0.5, True), (2.0, False)):
        seen = sees_directly(*parts(sensor), *parts(source), blocker, angle + share * 1e-10)
        assert (seen[clear] == expected).all()


def test_the_least_elevation_has_a_tolerance():
    """A reflected ray half of 1e-10 rad below the least elevation is visible, one twice as far below is not."""
    sensor, source = draw_annulus(500, 17, 0.0, span=0.03)
    radius, blocker = np.full(sensor.shape, IONOSPHERE_M), np.full(sensor.shape, EARTH_M)
    path = short_arc_reflection(*parts(sensor), *parts(source), radius)
    hit = path.hit_x + 1j * path.hit_y
    angle = np.arcsin(np.real((hit - sensor) * np.conj(sensor)) / np.abs(hit - sensor) / EARTH_M)
    clear = (angle < 1.0) & by_path(sensor, source)
    assert clear.sum() > 100
    for share, expected in ((0.5, True), (2.0, False)):
        seen = sees_by_reflection(*parts(sensor), *parts(source), path, radius, blocker, angle + share * 1e-10)
        assert (seen[clear] == expected).all()


def test_the_centre_is_under_the_ground():
    """A source at the centre is not visible, without a warning."""
    source, limit = np.zeros(1, dtype=complex), np.full(1, -np.inf)
    assert not sees_directly(np.full(1, EARTH_M), np.zeros(1), *parts(source), np.full(1, EARTH_M), limit).any()
