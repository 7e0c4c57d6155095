"""Ranges with outliers in space: spheres, heights, mirror images, calibration."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from batches import range_batch
from range_spheres import distances, sphere_batch
from range_worlds import solve, words

from nlosctl.contract.fields import SensorsField
from nlosctl.contract.random_streams import choose_subsets
from nlosctl.contract.result_checks import contract_violation
from nlosctl.geometry.spheres import cross_spheres
from nlosctl.methods import ranges_mixture_ml
from nlosctl.models.ranges.spheres import RangeSpheres, range_rows
from nlosctl.solvers.mixture.late_ranges import LateRanges
from nlosctl.solvers.mixture.range_rows import DirectRanges
from nlosctl.solvers.ranges.sphere_crossings import cross_at_height, cross_triples

METHOD = ranges_mixture_ml.METHOD
Array = np.ndarray
SIZE = np.array([40.0, 40.0, 15.0])
SENSORS = np.random.default_rng(2).uniform(0.0, 1.0, (8, 3)) * SIZE


def _world(snapshots: int, share: float, seed: int = 3, sensors: Array = SENSORS) -> tuple[Array, Array, Array]:
    """Return sources (B, 3), ranges (B, K) of std .1, and which are outliers of any length."""
    generator = np.random.default_rng(seed)
    sources = generator.uniform(0.1, 0.9, (snapshots, 3)) * SIZE
    ranges = distances(sensors, sources) + 0.1 * generator.normal(size=(snapshots, sensors.shape[0]))
    outlier = generator.random(ranges.shape) < share
    return sources, np.where(outlier, generator.uniform(1.0, 60.0, ranges.shape), ranges), outlier


def test_outliers_are_found_in_space() -> None:
    """With two of eight ranges wrong the fix is that of the others, whose rows alone are line of sight."""
    sources, ranges, _ = _world(20, 0.0)
    ranges[:, 2] += 7.0
    ranges[:, 5] -= 3.0
    solution = solve(METHOD, sphere_batch(SENSORS, ranges))
    assert contract_violation(solution, ranges.shape, 3) == ""
    best = solution.estimates.alternative == 0
    assert np.linalg.norm(solution.estimates.position_m[best] - sources, axis=1).max() < 0.8
    assert solution.flags is not None
    los = np.asarray(solution.flags.columns["los"])
    assert not los[:, [2, 5]].any()
    assert los[:, [0, 1, 3, 4, 6, 7]].all()


def test_a_ceiling_leaves_the_mirror_image() -> None:
    """Sensors on a ceiling: both images are alternatives of an ambiguous fix; a measured height leaves one."""
    sensors = SENSORS * np.array([1.0, 1.0, 0.0]) + np.array([0.0, 0.0, 5.0])
    sources, _, _ = _world(1, 0.0)
    sources[:, 2] = 1.5
    ranges = distances(sensors, sources)
    ranges[0, 3] += 9.0
    solution = solve(METHOD, sphere_batch(sensors, ranges))
    assert words(solution)[:2] == ["ambiguous", "ambiguous"]
    found = solution.estimates.position_m[:2]
    found = found[np.argsort(found[:, 2])]
    np.testing.assert_allclose(found, [sources[0], sources[0] * [1, 1, 0] + [0, 0, 8.5]], atol=1e-4)
    known = solve(METHOD, sphere_batch(sensors, ranges, 0.1, 1.6, 0.3))
    assert words(known) == ["ok"]
    np.testing.assert_allclose(known.estimates.position_m[0], sources[0], atol=0.1)
    assert known.estimates.degrees_of_freedom is not None
    assert known.estimates.degrees_of_freedom.tolist() == [5]


def test_a_held_height_is_the_plane() -> None:
    """An exact height gives the fixes of slant ranges in the plane, with that height and its covariances 0."""
    _, ranges, _ = _world(30, 0.2)
    batch = sphere_batch(SENSORS, ranges, 0.1, 4.0, 0.0)
    held = solve(METHOD, batch)
    flat = range_batch(SENSORS[:, :2], ranges, 0.1, height=SENSORS[:, 2] - 4.0)
    plane = solve(METHOD, dataclasses.replace(flat, field=SensorsField()))
    assert contract_violation(held, ranges.shape, 3) == ""
    assert words(held) == words(plane)
    np.testing.assert_allclose(held.estimates.position_m[:, :2], plane.estimates.position_m, atol=1e-7)
    fixed = np.isfinite(held.estimates.position_m[:, 0])
    assert (held.estimates.position_m[fixed, 2] == 4.0).all()


def test_too_few_scalars() -> None:
    """Two ranges are too few in space, with a measured height they have two fixes at it."""
    sources, ranges, _ = _world(1, 0.0)
    assert words(solve(METHOD, sphere_batch(SENSORS[:2], ranges[:, :2]))) == ["too_few"]
    exact = distances(SENSORS[:2], sources)
    solution = solve(METHOD, sphere_batch(SENSORS[:2], exact, 0.1, sources[:, 2], 0.2))
    assert words(solution) == ["ambiguous", "ambiguous"]
    assert np.linalg.norm(solution.estimates.position_m - sources[0], axis=1).min() < 1e-3


@pytest.mark.parametrize("options", [{}, {"covariance": "posterior"}, {"bias": "positive"}], ids=str)
def test_fixes_are_calibrated(options: dict[str, Any]) -> None:
    """Of 200 snapshots with a quarter of outliers .93 to .99 of the ok fixes are within their 95 % ellipsoid."""
    sources, ranges, _ = _world(200, 0.25, seed=9)
    solution = solve(METHOD, sphere_batch(SENSORS, ranges, seed=np.arange(200, dtype=np.uint64)), **options)
    estimates = solution.estimates
    fixed = (estimates.alternative == 0) & (estimates.status == 0)
    assert fixed.sum() > 130
    error = estimates.position_m[fixed] - sources[estimates.row[fixed]]
    covariance = estimates.covariance_m2[fixed][:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert 0.90 < (nees < 7.815).mean() <= 1.0
    assert np.median(np.linalg.norm(error, axis=1)) < 0.3


@pytest.mark.parametrize("law", ["direct", "late", "late of a known mean"])
def test_derivatives_in_space(law: str) -> None:
    """Gradients and second derivatives of the rows in space equal central differences."""
    sources, ranges, _ = _world(20, 0.3)
    circles = range_rows(sphere_batch(SENSORS, ranges, 0.5))
    mean_m = {"late": None, "late of a known mean": 4.0}.get(law)
    rows = DirectRanges(circles) if law == "direct" else LateRanges.of(circles, mean_m, np.full(20, -5.0))
    assert rows.dimension == 3
    point = [part - middle + 1.0 for part, middle in zip(sources.T, circles.center, strict=True)]
    step = 1e-5
    for k in (0, 5):
        at = rows.derivatives(k, *point)
        for axis in range(3):
            beside = [
                rows.derivatives(k, *(part + sign * step * (i == axis) for i, part in enumerate(point)))
                for sign in (1.0, -1.0)
            ]
            slope = (beside[0].half_chi_square - beside[1].half_chi_square) / (2.0 * step)
            np.testing.assert_allclose(at.gradient[axis], slope, atol=1e-5, rtol=1e-5)
            for other in range(3):
                bend = (beside[0].gradient[other] - beside[1].gradient[other]) / (2.0 * step)
                np.testing.assert_allclose(at.hessian.entry(axis, other), bend, atol=1e-4, rtol=1e-4)


def test_three_spheres_cross_at_their_common_points() -> None:
    """Both crossings are at the radii from the centres, and one is the source; without one the points coincide."""
    generator = np.random.default_rng(6)
    centers = [tuple(generator.normal(size=(3, 50))) for _ in range(3)]
    source = generator.normal(size=(3, 50)) * 3.0
    radii = [np.sqrt(sum((s - c) ** 2 for s, c in zip(source, center, strict=True))) for center in centers]
    one, other = cross_spheres(centers, radii)
    for point in (one, other):
        for center, radius in zip(centers, radii, strict=True):
            away = np.sqrt(sum((p - c) ** 2 for p, c in zip(point, center, strict=True)))
            np.testing.assert_allclose(away, radius, rtol=1e-9)
    nearest = np.minimum(*(np.linalg.norm(np.array(point) - source, axis=0) for point in (one, other)))
    assert nearest.max() < 1e-6
    short = cross_spheres(centers, [0.01 * np.ones(50)] * 3)
    np.testing.assert_array_equal(*short)


def test_subsets_are_all_or_random_of_different_rows() -> None:
    """All subsets where they are few enough, else as many random ones of different rows, by the snapshot's seed."""
    assert choose_subsets(np.zeros(2, dtype=np.uint64), 6, 3, 20).shape == (20, 3)
    some = choose_subsets(np.arange(4, dtype=np.uint64), 12, 3, 50)
    assert some.shape == (4, 50, 3)
    assert (np.diff(some, axis=2) > 0).all()
    assert some.max() == 11
    np.testing.assert_array_equal(some[2], choose_subsets(np.array([2], dtype=np.uint64), 12, 3, 50)[0])
    assert not np.array_equal(some[0], some[1])
    four = choose_subsets(np.arange(40, dtype=np.uint64), 7, 4, 30)[..., None] == np.arange(7)
    assert (four.any(axis=2).sum(axis=2) == 4).all()
    np.testing.assert_allclose(four.any(axis=2).mean(axis=(0, 1)), 4.0 / 7.0, atol=0.05)


def test_crossings_of_rows_are_at_their_ranges() -> None:
    """Crossings of triples have the ranges of their rows, those at a height of their pairs and that height."""
    sources, _, _ = _world(3, 0.0)
    rows = range_rows(sphere_batch(SENSORS, distances(SENSORS, sources), 0.1, sources[:, 2], 0.5))
    assert isinstance(rows, RangeSpheres)
    triples = np.array([[0, 1, 2], [3, 5, 7]])
    point = cross_triples(rows, triples)
    for n, triple in enumerate(np.concatenate([triples, triples])):
        away = rows.distance_m(*(part[:, n] for part in point))
        np.testing.assert_allclose(away[:, triple], rows.range_m[:, triple], atol=1e-6)
    level = cross_at_height(rows, np.array([0, 3]), np.array([1, 6]))
    np.testing.assert_allclose(level[2] + rows.center[2][:, None], np.broadcast_to(sources[:, 2, None], (3, 4)))
    for n, pair in enumerate([[0, 1], [3, 6], [0, 1], [3, 6]]):
        away = rows.distance_m(*(part[:, n] for part in level))
        np.testing.assert_allclose(away[:, pair], rows.range_m[:, pair], atol=1e-6)
