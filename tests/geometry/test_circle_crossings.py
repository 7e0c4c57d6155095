"""Crossings of two circles, and the closest approach of circles that miss each other."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.geometry.circles import cross_circles


def cross(one: tuple[float, float, float], other: tuple[float, float, float], gap: float = 0.0) -> np.ndarray:
    """Return the two roots of circles x, y, radius."""
    return cross_circles(
        np.array(one[:2]), np.array(one[2]), np.array(other[:2]), np.array(other[2]), gap_tolerance=gap
    )


def test_roots_lie_on_both_circles() -> None:
    """Each root of crossing circles has each radius as its distance from each centre, the first one to the left."""
    generator = np.random.default_rng(3)
    centers, radii = generator.uniform(-100.0, 100.0, (2, 5000, 2)), generator.uniform(1.0, 150.0, (2, 5000))
    points = cross_circles(centers[0], radii[0], centers[1], radii[1], gap_tolerance=0.0)
    crossing = np.isfinite(points[:, 1, 0])
    assert 1000 < crossing.sum() < 5000
    for center, radius in zip(centers, radii, strict=True):
        distance = np.hypot(*np.moveaxis(points[crossing] - center[crossing, None], -1, 0))
        np.testing.assert_allclose(distance, np.broadcast_to(radius[crossing, None], distance.shape), rtol=1e-9)
    (way_x, way_y), (x, y) = (centers[1] - centers[0]).T, (points[:, 0] - centers[0]).T
    assert (way_x * y - way_y * x)[crossing].min() > 0.0


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ((0.0, 0.0, 3.0), (10.0, 0.0, 5.0), (4.0, 0.0)),
        ((0.0, 0.0, 10.0), (3.0, 0.0, 5.0), (9.0, 0.0)),
        ((3.0, 0.0, 5.0), (0.0, 0.0, 10.0), (9.0, 0.0)),
    ],
    ids=["outside", "second inside first", "first inside second"],
)
def test_a_gap_within_the_tolerance_gives_its_middle(
    one: tuple[float, ...], other: tuple[float, ...], expected: tuple[float, float]
) -> None:
    """Circles that miss each other by no more than the tolerance have one point: the middle of the gap."""
    points = cross(one, other, gap=2.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(points[0], expected, atol=1e-12)
    assert np.isnan(points[1]).all()
    assert np.isnan(cross(one, other, gap=1.9)).all()  # type: ignore[arg-type]


def test_tangent_circles_have_a_point() -> None:
    """Tangent circles have a point, not NaN, although the squared height is a rounding error."""
    generator = np.random.default_rng(5)
    center, angle = generator.uniform(-1e3, 1e3, (1000, 2)), generator.uniform(-np.pi, np.pi, 1000)
    radii = generator.uniform(1.0, 300.0, (2, 1000))
    other = center + (radii[0] + radii[1])[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = cross_circles(center, radii[0], other, radii[1], gap_tolerance=1e-9)
    touch = center + radii[0][:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(points[:, 0], touch, atol=1e-3)


@pytest.mark.parametrize("other", [(0.0, 0.0, 3.0), (0.0, 0.0, 4.0), (5.0, 0.0, 0.0), (5.0, 0.0, np.nan)])
def test_concentric_and_empty_circles_have_no_point(other: tuple[float, float, float]) -> None:
    """Concentric circles and circles without a positive radius have no crossing at any tolerance."""
    one = (0.0, 0.0, 3.0)
    for pair in ((one, other), (other, one)):
        assert np.isnan(cross(*pair, gap=100.0)).all()


@pytest.mark.parametrize("other", [(5.0, 0.0, 4.0), (10.0, 0.0, 5.0), (1.0, 0.5, 1.0), (9.0, 0.0, 1.0)])
def test_crossings_scale_with_the_circles(other: tuple[float, float, float]) -> None:
    """Scaling the circles by a power of two scales the crossings to the bit."""
    one, expected = (0.0, 0.0, 3.0), cross((0.0, 0.0, 3.0), other, gap=2.0)
    for scale in (2.0**-10, 2.0**10):
        small = [tuple(scale * value for value in circle) for circle in (one, other)]
        np.testing.assert_array_equal(cross(*small, gap=2.0 * scale), scale * expected)  # type: ignore[arg-type]
