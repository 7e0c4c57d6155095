"""Reflection in a sphere, compared with a search over the whole sphere, finite differences, the circle and a plane."""

from __future__ import annotations

import numpy as np
import pytest
from circle_worlds import EARTH_M, IONOSPHERE_M

from nlosctl.geometry.circular_reflection import all_points
from nlosctl.geometry.directions import direction_frame, dot, length
from nlosctl.geometry.planes import reflect_in_plane
from nlosctl.geometry.short_arc import short_arc_point, short_arc_reflection
from nlosctl.geometry.spheres import central_plane, elevation_above_horizon, leave_sphere
from nlosctl.geometry.visibility import sees_by_reflection


def draw_ball(generator, count, radius=1.0):
    """Return points (3, N) uniformly distributed over a ball about the origin."""
    vector = generator.normal(size=(3, count))
    return radius * np.cbrt(generator.random(count)) * vector / np.linalg.norm(vector, axis=0)


def draw_visible(count, seed):
    """Return sensors on the earth and sources visible to them by the ionosphere, (3, N), in any direction."""
    generator = np.random.default_rng(seed)
    up, side = generator.normal(size=(2, 3, count))
    up /= np.linalg.norm(up, axis=0)
    side -= np.sum(side * up, axis=0) * up
    side /= np.linalg.norm(side, axis=0)
    height = generator.uniform(EARTH_M, 0.999 * IONOSPHERE_M, count)
    angle = generator.uniform(0.0, 0.999, count) * (
        2.0 * np.arccos(EARTH_M / IONOSPHERE_M) - np.arccos(EARTH_M / height)
    )
    return EARTH_M * up, height * (np.cos(angle) * up + np.sin(angle) * side)


def short_path(sensor, source, radius=IONOSPHERE_M):
    """Return the path on the short arc."""
    plane = central_plane(tuple(sensor), tuple(source))
    return plane.path_by(*short_arc_point(*plane.points, np.full(sensor.shape[1], radius)))


def stationary_points(sensor, source, starts=400):
    """Return all points of the unit sphere where the path's length is stationary: Newton's method from everywhere.

    Also from points around the two ends' nearest ones, because the paths there have narrow basins.
    """
    index = np.arange(starts) + 0.5
    level = 1.0 - 2.0 * index / starts
    turn = np.pi * (1.0 + 5**0.5) * index
    even = np.stack([np.sqrt(1 - level**2) * np.cos(turn), np.sqrt(1 - level**2) * np.sin(turn), level], axis=1)
    point = np.concatenate([even, *(end + 2.0 * (1.0 - np.linalg.norm(end)) * even for end in (sensor, source))])
    point /= np.linalg.norm(point, axis=1)[:, None]

    def slope(at, one, two):
        """Return the derivatives of the length along the tangents, by the law of reflection."""
        way = sum((at - end) / np.linalg.norm(at - end, axis=1)[:, None] for end in (sensor, source))
        way -= np.sum(way * at, axis=1)[:, None] * at
        return np.stack([np.sum(way * one, axis=1), np.sum(way * two, axis=1)], axis=1)

    def normalized(vector):
        return vector / np.linalg.norm(vector, axis=1)[:, None]

    for _ in range(80):
        one = normalized(np.cross(point, np.where(np.abs(point[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])))
        two = np.cross(point, one)
        value = slope(point, one, two)
        columns = []
        for tangent in (one, two):
            ahead, behind = normalized(point + 1e-5 * tangent), normalized(point - 1e-5 * tangent)
            columns.append((slope(ahead, one, two) - slope(behind, one, two)) / 2e-5)
        step = np.linalg.solve(np.stack(columns, axis=2), -value[:, :, None])[:, :, 0]
        step *= (0.3 / np.maximum(0.3, np.linalg.norm(step, axis=1)))[:, None]
        point = normalized(point + step[:, :1] * one + step[:, 1:] * two)
    settled = point[np.linalg.norm(value, axis=1) < 1e-12]
    different: list[np.ndarray] = []
    for candidate in settled:
        if all(np.linalg.norm(candidate - other) > 1e-6 for other in different):
            different.append(candidate)
    return np.array(different)


def test_all_stationary_paths_are_in_the_plane():
    """A search over the sphere that knows of no plane finds the points of the circle in it, and no others."""
    generator = np.random.default_rng(1)
    sensor, source = draw_ball(generator, 40), draw_ball(generator, 40)
    plane = central_plane(tuple(sensor), tuple(source))
    points = np.stack(plane.path_by(*all_points(*plane.points, np.ones(40))).hit)
    counts = set()
    for row in range(40):
        planar = points[:, ~np.isnan(points[0, :, row]), row].T
        found = stationary_points(sensor[:, row], source[:, row])
        apart = np.linalg.norm(planar[:, None] - found[None], axis=2)
        assert apart.shape[0] == apart.shape[1]
        assert apart.min(axis=1).max() < 1e-11
        counts.add(len(planar))
    assert counts == {2, 4}


def test_gradients_are_finite_differences():
    """The derivatives of the direction by the source are central differences."""
    sensor, source = draw_visible(300, 2)
    path = short_path(sensor, source)
    jacobian = np.stack([np.stack(path.gradient(tuple(np.eye(3)[axis][:, None]))) for axis in range(3)])
    numeric = np.empty_like(jacobian)
    for axis in range(3):
        shift = 20.0 * np.eye(3)[axis][:, None]
        ahead, behind = (np.stack(short_path(sensor, source + sign * shift).direction) for sign in (1.0, -1.0))
        numeric[:, axis] = (ahead - behind) / 40.0
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-7 * np.abs(jacobian).max())


def test_the_width_across_the_plane_is_that_of_a_turned_ray():
    """ws times the sine of the direction to the vertical is the source's distance from the line sensor - centre."""
    sensor, source = draw_visible(500, 3)
    path = short_path(sensor, source)
    sine = np.abs(path.plane.source_y / length(tuple(source)))
    away = np.cos(elevation_above_horizon(tuple(sensor), path.direction))
    clear = sine > 1e-3
    expected = length(tuple(source)) * sine / np.where(clear, away, 1.0)
    np.testing.assert_allclose(path.across_width_m[clear], expected[clear], rtol=1e-9)


def test_a_plane_through_the_centre_has_the_circle():
    """Sensors and sources at z = 0 see what those of the circle see: bearing, legs, width and visibility."""
    sensor, source = draw_visible(300, 4)
    generator = np.random.default_rng(5)
    turn = np.exp(2j * np.pi * generator.random(300))
    plane = central_plane(tuple(sensor), tuple(source))
    flat_sensor = EARTH_M * turn
    flat_source = (plane.source_x + 1j * plane.source_y * np.sign(generator.normal(size=300))) * turn
    radius = np.full(300, IONOSPHERE_M)
    flat = [part(point).copy() for point in (flat_sensor, flat_source) for part in (np.real, np.imag)]
    expected = short_arc_reflection(*flat, radius)
    zero = np.zeros(300)
    path = short_path(np.stack([*flat[:2], zero]), np.stack([*flat[2:], zero]))
    u = path.direction
    turned = np.angle(np.exp(1j * (np.arctan2(u[1], u[0]) - expected.bearing_rad)))
    np.testing.assert_allclose(turned, 0.0, atol=1e-11)
    np.testing.assert_allclose(u[2], 0.0, atol=1e-15)
    np.testing.assert_allclose(path.flat.tube_width_m, expected.tube_width_m, rtol=1e-8)
    np.testing.assert_allclose(path.flat.length_m, expected.length_m, rtol=1e-13)
    limits = (radius, np.full(300, EARTH_M), np.full(300, -np.inf))
    assert sees_by_reflection(*path.plane.points, path.flat, *limits).all()
    gradient = path.gradient((-np.sin(expected.bearing_rad), np.cos(expected.bearing_rad), zero))
    np.testing.assert_allclose(np.stack(gradient[:2]), np.stack(expected.bearing_gradient()), atol=1e-13)


def test_the_ray_back_along_a_direction_is_the_path():
    """Where the direction of a path leaves the sphere is its point; the mirror there leads the ray to the source."""
    sensor, source = draw_visible(300, 6)
    path = short_path(sensor, source)
    hit = leave_sphere(tuple(sensor), path.direction, np.full(300, IONOSPHERE_M))
    np.testing.assert_allclose(np.stack(hit.point), np.stack(path.hit), atol=1e-4)
    np.testing.assert_allclose(length(hit.normal), 1.0, atol=1e-14)
    image = np.stack(reflect_in_plane(tuple(sensor), hit.point, hit.normal))
    way = source - image
    np.testing.assert_allclose(np.linalg.norm(way, axis=0), path.flat.length_m, rtol=1e-13)
    second = path.flat.second_leg_m
    for strength, width in ((hit.strength, path.flat.tube_width_m), (hit.across_strength, path.across_width_m)):
        np.testing.assert_allclose(path.flat.length_m - strength * second, width, rtol=1e-6)
    back = way / np.linalg.norm(way, axis=0)
    np.testing.assert_allclose(length(tuple(image + path.flat.first_leg_m * back - np.stack(path.hit))), 0.0, atol=1e-2)
    outside = leave_sphere(tuple(sensor * 2.0), path.direction, np.full(300, IONOSPHERE_M))
    assert np.isnan(np.stack(outside.point)).all()


def test_a_large_sphere_is_a_plane():
    """A sphere of 1e9 m, a kilometre off, reflects as the plane that touches it: to 4e-6 rad."""
    generator = np.random.default_rng(7)
    sensor, source = generator.uniform(-500.0, 500.0, (2, 3, 200))
    radius = 1e9
    down = np.array([[0.0], [0.0], [radius - 1000.0]])
    u = np.stack(short_path(sensor + down, source + down, radius).direction)
    none, one = np.zeros(200), np.ones(200)
    image = np.stack(reflect_in_plane(tuple(source), (none, none, 1000.0 * one), (none, none, one)))
    flat = (image - sensor) / np.linalg.norm(image - sensor, axis=0)
    assert np.linalg.norm(u - flat, axis=0).max() < 4e-6


@pytest.mark.parametrize("turn", [0.0, 1e-14, 1e-9, 1e-6])
def test_a_source_above_the_sensor_is_seen_straight_up(turn):
    """With source, sensor and centre in one line, or nearly, direction and gradients are those of the limit."""
    sensor = np.array([[0.3], [-0.4], [0.5]]) / np.sqrt(0.5) * EARTH_M
    side = np.array([[0.8], [0.6], [0.0]])
    source = sensor * (1.0 + 100e3 / EARTH_M) + turn * EARTH_M * side
    path = short_path(sensor, source)
    up = sensor / EARTH_M
    np.testing.assert_allclose(np.stack(path.direction), up, atol=30.0 * turn + 1e-15)
    legs = (IONOSPHERE_M - EARTH_M, IONOSPHERE_M - EARTH_M - 100e3)
    width = sum(legs) - 2.0 * legs[0] * legs[1] / IONOSPHERE_M
    gradient = np.stack(path.gradient(tuple(side)))
    np.testing.assert_allclose(gradient, side / width, atol=(1e-8 + 1e3 * turn) / width)


def test_the_elevation_is_above_the_local_horizon():
    """The angle above the plane that touches the sensor's sphere: 90 degrees minus that to the vertical."""
    sensor, _ = draw_visible(200, 8)
    generator = np.random.default_rng(9)
    u, _, _ = direction_frame(generator.uniform(-np.pi, np.pi, 200), np.arcsin(generator.uniform(-1.0, 1.0, 200)))
    expected = 0.5 * np.pi - np.arccos(dot(u, tuple(sensor)) / EARTH_M)
    np.testing.assert_allclose(elevation_above_horizon(tuple(sensor), u), expected, atol=1e-7)
