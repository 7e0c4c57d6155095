"""Sections of hyperboloids and of surfaces of equal path length."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from nlosctl.contract.scene import LineReflector, PlaneReflector, Reflector, Scene, SegmentReflector, SphereReflector
from nlosctl.models.sections import hyperbola_sections, path_lengths_by_sphere, range_sections

SENSOR, SOURCE = np.array([30.0, -5.0, 12.0]), np.array([-10.0, 33.0, 4.0])


def lengths(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the distances of points (N, P, 3) from ends (N, 3)."""
    return np.asarray(np.linalg.norm(points - ends[:, None], axis=2))


def at_depth(points: np.ndarray, depth: float) -> np.ndarray:
    """Return points (N, P, 2) with their depth."""
    return np.concatenate([points, np.full((*points.shape[:2], 1), depth)], axis=2)


def gaps(points: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the distances (N,) of targets (N, 2) from polylines (N, P, 2)."""
    start, leg = points[:, :-1], np.diff(points, axis=1)
    away = target[:, None] - start
    share = np.clip(np.sum(away * leg, axis=2) / np.sum(leg * leg, axis=2), 0.0, 1.0)
    return np.asarray(np.nanmin(np.linalg.norm(away - share[..., None] * leg, axis=2), axis=1))


@pytest.mark.parametrize("height", [0.0, 300.0])
def test_hyperbolas_have_the_difference_of_their_row(height: float) -> None:
    """Every point is farther from the sensor by the signed difference, and the source is on the branch."""
    draw = np.random.default_rng(7)
    ends = draw.normal(0.0, 500.0, (2, 400, 3))
    source = draw.normal(0.0, 500.0, (400, 3))
    ends[..., 2] *= height / 500.0
    source[:, 2] = 0.4 * height
    difference = np.linalg.norm(source - ends[0], axis=1) - np.linalg.norm(source - ends[1], axis=1)
    curves = hyperbola_sections(*ends, difference, 0.4 * height, 4000.0)
    points = at_depth(curves, 0.4 * height)
    assert (difference > 0.0).any()
    assert (difference < 0.0).any()
    found = lengths(points, ends[0]) - lengths(points, ends[1])
    np.testing.assert_allclose(found, np.broadcast_to(difference[:, None], found.shape), atol=1e-8)
    assert np.quantile(gaps(curves, source[:, :2]), 0.95) < 0.05


def test_hyperbolas_of_special_baselines() -> None:
    """A vertical baseline gives a circle, equal arrivals the bisecting line, a longer difference nothing."""
    up, across = np.array([[0.0, 0.0, 100.0]]), np.array([[100.0, 0.0, 0.0]])
    circle = hyperbola_sections(up, -up, np.array([-60.0]), 80.0, 1000.0)
    assert np.ptp(np.linalg.norm(circle, axis=2)) < 1e-9
    found = lengths(at_depth(circle, 80.0), up) - lengths(at_depth(circle, 80.0), -up)
    np.testing.assert_allclose(found, -60.0, atol=1e-9)
    line = hyperbola_sections(across, -across, np.zeros(1), 50.0, 1000.0)
    np.testing.assert_allclose(line[0, :, 0], 0.0, atol=1e-9)
    assert np.ptp(line[0, :, 1]) > 2000.0
    for ends, difference, depth in ((across, 201.0, 0.0), (up, 60.0, 80.0), (up, 0.0, 80.0)):
        assert np.isnan(hyperbola_sections(ends, -ends, np.array([difference]), depth, 1000.0)).all()


MIRRORS: list[tuple[Reflector, tuple[float, float, float], tuple[float, float, float]]] = [
    (PlaneReflector(name="floor", point=(0.0, 0.0, -3.0), normal=(0.0, 0.0, 2.0)), (0.0, 0.0, -3.0), (0.0, 0.0, 1.0)),
    (PlaneReflector(name="roof", point=(0.0, 60.0, 20.0), normal=(0.3, 1.0, 1.0)), (0.0, 60.0, 20.0), (0.3, 1.0, 1.0)),
    (LineReflector(name="wall", point=(90.0, 0.0), direction=(0.2, 1.0)), (90.0, 0.0, 0.0), (1.0, -0.2, 0.0)),
    (SegmentReflector(name="part", start=(-500.0, -60.0), end=(20.0, -60.0)), (0.0, -60.0, 0.0), (0.0, 1.0, 0.0)),
]


@pytest.mark.parametrize(("mirror", "point", "normal"), MIRRORS, ids=[mirror.name for mirror, *_ in MIRRORS])
@pytest.mark.parametrize("across", [0, 1, 2])
def test_ranges_by_planes_are_paths_with_equal_angles(
    mirror: Reflector, point: tuple[float, ...], normal: tuple[float, ...], across: int
) -> None:
    """By Snell's law on the mirror each point's path has the length of the range; the source is on the curve."""
    unit, base = np.array(normal) / np.linalg.norm(normal), np.array(point)

    def path(source: np.ndarray) -> tuple[float, np.ndarray]:
        own, other = (SENSOR - base) @ unit, (source - base) @ unit
        share = own / (own + other)
        hit = SENSOR - own * unit + share * ((source - other * unit) - (SENSOR - own * unit))
        return float(np.linalg.norm(hit - SENSOR) + np.linalg.norm(source - hit)), hit

    length, _ = path(SOURCE)
    curve = range_sections(
        SENSOR[None], np.array([length]), np.array([0]), Scene(reflectors=(mirror,)), across, SOURCE[across]
    )
    seen = [axis for axis in range(3) if axis != across]
    assert gaps(curve, SOURCE[None, seen])[0] < 0.01
    good = curve[0][np.isfinite(curve[0]).all(axis=1)]
    assert 10 < good.shape[0] <= curve.shape[1]
    for place in good:
        source = np.full(3, SOURCE[across])
        source[seen] = place
        assert (source - base) @ unit * ((SENSOR - base) @ unit) > 0.0
        found, hit = path(source)
        assert found == pytest.approx(length, rel=1e-9)
        assert not isinstance(mirror, SegmentReflector) or hit[0] <= 20.0


def test_direct_ranges_are_circles_of_spheres() -> None:
    """A sphere that the plane misses has no circle."""
    curves = range_sections(
        np.stack([SENSOR, SENSOR]), np.array([10.0, 7.0]), np.array([-1, -1]), Scene(), 2, SENSOR[2] + 8.0
    )
    np.testing.assert_allclose(np.linalg.norm(curves[0] - SENSOR[:2], axis=1), 6.0)
    assert np.isnan(curves[1]).all()


def test_paths_by_a_sphere_are_the_shortest_by_its_points() -> None:
    """scipy's minimum over the points of the sphere."""
    sphere = SphereReflector(name="dome", center=(10.0, 0.0, -60.0), radius=200.0)

    def by(angles: np.ndarray) -> float:
        sine = np.sin(angles[0])
        point = np.array([sine * np.cos(angles[1]), sine * np.sin(angles[1]), np.cos(angles[0])])
        hit = np.array(sphere.center) + sphere.radius * point
        return float(np.linalg.norm(hit - SENSOR) + np.linalg.norm(hit - SOURCE))

    starts = np.random.default_rng(0).uniform([0.1, -3.0], [3.0, 3.0], (8, 2))
    shortest = min(minimize(by, start, options={"gtol": 1e-10}).fun for start in starts)
    assert path_lengths_by_sphere(SENSOR, sphere, SOURCE[None])[0] == pytest.approx(shortest, rel=1e-9)
