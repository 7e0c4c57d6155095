"""Regions: containment, distance to the edge, area."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.contract.fields import BoxField, CircleField, PolygonField, SensorsField
from nlosctl.geometry.regions import Ball, BoxRegion, CircleRegion, PolygonRegion, PrismRegion, Region, box_diagonal
from nlosctl.models.search_regions import search_region

_ELL = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0))


def _regions() -> list[Region]:
    x, y = np.array(_ELL).T
    return [
        BoxRegion((np.array([0.0, -1.0]), np.array([0.0, 2.0])), (np.array([4.0, 1.0]), np.array([3.0, 3.0]))),
        CircleRegion(np.array([1.0, 0.0]), np.array([2.0, 0.0]), np.array([2.0, 0.5])),
        PolygonRegion(np.array([x, 2.0 * x]), np.array([y, y - 1.0])),
    ]


@pytest.mark.parametrize("region", _regions(), ids=["box", "circle", "polygon"])
def test_area_agrees_with_a_fine_grid(region: Region) -> None:
    """The area is that of the cells of a fine grid whose centres are inside."""
    axis = (np.arange(800) + 0.5) / 800
    (xmin, ymin), (xmax, ymax) = ([edge[:, None] for edge in bound] for bound in region.bounds_m)
    grid_x, grid_y = (part.ravel() for part in np.meshgrid(axis, axis))
    inside = region.contains(xmin + grid_x * (xmax - xmin), ymin + grid_y * (ymax - ymin))
    share = inside.mean(axis=1) * ((xmax - xmin) * (ymax - ymin))[:, 0]
    np.testing.assert_allclose(region.volume, share, rtol=3e-3)


@pytest.mark.parametrize("region", _regions(), ids=["box", "circle", "polygon"])
def test_edge_distance_is_that_of_the_nearest_change(region: Region) -> None:
    """No point nearer than the edge distance is on the other side; some point just beyond it is."""
    generator = np.random.default_rng(5)
    x, y = generator.uniform(-3.0, 6.0, (2, 2, 40))
    distance = region.edge_distance_m(x, y)
    assert np.array_equal(distance >= 0.0, region.contains(x, y))
    turn = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    crossed = np.zeros(x.shape, dtype=bool)
    for angle in turn:
        for factor in (0.999, 1.05):
            step = factor * np.abs(distance)
            other = region.contains(x + step * np.cos(angle), y + step * np.sin(angle)) != region.contains(x, y)
            if factor < 1.0:
                assert not other.any()
            crossed |= other
    assert crossed.all()


@pytest.mark.parametrize("region", _regions(), ids=["box", "circle", "polygon"])
def test_nan_is_neither_inside_nor_on_the_edge(region: Region) -> None:
    """NaN is neither inside nor on the edge; each point of shape (B,) is tested against its own region."""
    nan = np.full(2, np.nan)
    assert not region.contains(nan, nan).any()
    assert not region.on_edge(nan, nan, tolerance_m=1.0).any()
    xmin, ymin = region.bounds_m[0]
    assert not region.take(np.array([1])).contains(xmin[1:] - 1.0, ymin[1:]).any()


def test_on_edge_is_within_the_tolerance_of_either_side() -> None:
    """Points within the tolerance of the edge are on it, on either side."""
    box = BoxRegion((np.array([0.0]),) * 2, (np.array([1.0]),) * 2)
    x = np.array([[0.05, -0.05, 0.2, 0.95, 1.2]])
    assert box.on_edge(x, np.full_like(x, 0.5), tolerance_m=0.1).tolist() == [[True, True, False, True, False]]


def test_the_edge_of_boxes_and_circles_is_inside() -> None:
    """Corners, sides and circumference belong to the region; the next floating-point number outside does not."""
    box, circle, _ = _regions()
    x, y = (
        np.array([[0.0, 4.0, 0.0, 4.0, 2.0], [-1.0, 1.0, -1.0, 1.0, 0.0]]),
        np.array([[0.0, 0.0, 3.0, 3.0, 3.0], [2.0, 2.0, 3.0, 3.0, 2.0]]),
    )
    assert box.contains(x, y).all()
    for step_x, step_y in ((-1e-12, 0.0), (1e-12, 0.0), (0.0, -1e-12), (0.0, 1e-12)):
        out = (step_x < 0.0) & (x == x.min(axis=1)[:, None]) | (step_x > 0.0) & (x == x.max(axis=1)[:, None])
        out |= (step_y < 0.0) & (y == y.min(axis=1)[:, None]) | (step_y > 0.0) & (y == y.max(axis=1)[:, None])
        assert np.array_equal(box.contains(x + step_x, y + step_y), ~out)
    assert circle.contains(np.array([3.0, 0.3]), np.array([2.0, -0.4])).all()
    assert not circle.contains(np.array([3.0 + 1e-12, 0.3]), np.array([2.0, -0.4 - 1e-12])).any()


@pytest.mark.parametrize("kind", range(3), ids=["box", "circle", "polygon"])
def test_regions_scale(kind: int) -> None:
    """Scaling a region by a power of two scales its edge distances to the bit."""
    region = _regions()[kind]
    scale = 2.0**-20
    small = type(region)(*(scale * np.asarray(values) for values in vars(region).values()))
    x, y = np.random.default_rng(6).uniform(-3.0, 6.0, (2, 2, 200))
    assert np.array_equal(small.edge_distance_m(scale * x, scale * y), scale * region.edge_distance_m(x, y))
    assert np.array_equal(small.volume, scale**2 * region.volume)


def test_closed_rings_equal_open_rings() -> None:
    """A ring that repeats its first vertex (as in GeoJSON) has the edges and the area of the open ring."""
    ring = _regions()[2]
    closed = PolygonRegion(*(np.concatenate([part, part[:, :1]], axis=1) for part in vars(ring).values()))
    x, y = np.random.default_rng(7).uniform(-3.0, 6.0, (2, 2, 200))
    assert np.array_equal(closed.edge_distance_m(x, y), ring.edge_distance_m(x, y))
    assert np.array_equal(closed.volume, ring.volume)


def test_a_convex_polygon_is_an_intersection_of_half_planes() -> None:
    """A point is inside if it is left of every edge, at the distance of the nearest line."""
    angle = np.array([0.3, 1.1, 2.5, 3.9, 5.2])
    corner_x, corner_y = 3.0 * np.cos(angle) + 1.0, 2.0 * np.sin(angle) - 0.5
    polygon = PolygonRegion(corner_x[None], corner_y[None])
    x, y = np.random.default_rng(8).uniform(-4.0, 4.0, (2, 1, 3000))
    along_x, along_y = np.roll(corner_x, -1) - corner_x, np.roll(corner_y, -1) - corner_y
    left = along_x * (y[0, :, None] - corner_y) - along_y * (x[0, :, None] - corner_x)
    inside = (left > 0.0).all(axis=1)
    assert 0.1 < inside.mean() < 0.9
    assert np.array_equal(polygon.contains(x, y)[0], inside)
    height = (left / np.hypot(along_x, along_y)).min(axis=1)
    np.testing.assert_allclose(polygon.edge_distance_m(x, y)[0][inside], height[inside], rtol=1e-12)
    assert np.array_equal(polygon.on_edge(x, y, tolerance_m=0.2)[0][inside], height[inside] <= 0.2)


def test_edges_of_zero_length_are_ignored() -> None:
    """Two vertices that differ by rounding count as one, for points at any distance."""
    corner_x, corner_y = np.array([[0.0, 1.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 1.0, 1.0]])
    doubled = PolygonRegion(np.append(corner_x, [[1e-100]], axis=1), np.append(corner_y, [[1e-200]], axis=1))
    x, y = np.array([[0.5, 2.0, 1e250, 0.5, -1e250]]), np.array([[0.5, 0.5, 0.5, 1e250, -1e250]])
    found, expected = (region.edge_distance_m(x, y) for region in (doubled, PolygonRegion(corner_x, corner_y)))
    np.testing.assert_array_equal(found, expected)
    assert expected[0, :3].tolist() == [0.5, -1.0, -1e250]


def test_each_region_has_its_own_tolerance() -> None:
    """The tolerance of a snapshot applies to all points of that snapshot, and includes its value."""
    _, circle, _ = _regions()
    x, y = np.array([[2.5, 3.5], [0.25, 1.0]]), np.array([[2.0, 2.0], [0.0, 0.0]])
    assert circle.on_edge(x, y, tolerance_m=np.array([0.5, 0.25])).tolist() == [[True, True], [True, False]]
    assert circle.on_edge(x[:, 0], y[:, 0], tolerance_m=np.array([0.4, 0.25])).tolist() == [False, True]


def test_fields_become_regions_about_the_local_origin() -> None:
    """Each kind of field contains the same points of the plane for any local origin."""
    center = np.array([1e6, 1e6 + 50.0])
    sensor_x = center[:, None] + np.array([[0.0, 10.0], [0.0, 4.0]])
    sensor_y = center[:, None] + np.array([[0.0, 2.0], [0.0, 8.0]])
    fields = [
        BoxField(xmin_m=1e6, xmax_m=1e6 + 60.0, ymin_m=1e6, ymax_m=1e6 + 60.0),
        CircleField(x_m=1e6 + 30.0, y_m=1e6 + 30.0, radius_m=30.0),
        PolygonField(vertices_m=((1e6, 1e6), (1e6 + 60.0, 1e6), (1e6 + 60.0, 1e6 + 60.0), (1e6, 1e6 + 60.0))),
    ]
    point_x, point_y = 1e6 + np.array([30.0, 30.0]), 1e6 + np.array([30.0, 61.0])
    for field in fields:
        region = search_region(field, (sensor_x, sensor_y), (center, center))
        assert region.contains(point_x - center, point_y - center).tolist() == [True, False]
    own = search_region(SensorsField(factor=0.5), (sensor_x, sensor_y), (center, center))
    lower, upper = ([edge.tolist() for edge in bound] for bound in own.bounds_m)
    assert (lower, upper) == ([[-5.0, -4.0], [-5.0, -4.0]], [[15.0, 8.0], [7.0, 12.0]])


def test_regions_of_space_by_counting() -> None:
    """Volumes and edge distances of a box, a prism and a ball of space agree with points spread over their bounds."""
    edge = np.array([1.0]), np.array([2.0]), np.array([-3.0])
    box = BoxRegion(tuple(part - 4.0 for part in edge), edge)
    prism = PrismRegion(
        CircleRegion(*(np.array([value]) for value in (1.0, 2.0, 3.0))), np.array([-1.0]), np.array([2.0])
    )
    generator = np.random.default_rng(4)
    for region in (box, prism):
        lower, upper = (np.array([float(part[0]) for part in bound]) for bound in region.bounds_m)
        points = generator.uniform(lower - 1.0, upper + 1.0, (60_000, 3)).T
        inside = region.contains(*(part[None] for part in points))[0]
        assert inside.mean() * np.prod(upper - lower + 2.0) == pytest.approx(region.volume[0], rel=0.03)
        distance = region.edge_distance_m(*(part[None] for part in points))[0]
        assert np.array_equal(distance >= 0.0, inside)
        step = generator.normal(size=points.shape)
        near = points + 0.99 * np.abs(distance) * step / np.linalg.norm(step, axis=0)
        assert np.array_equal(region.contains(*(part[None] for part in near))[0], inside)
    ball = Ball.about(box, np.array([0]))
    assert ball.volume[0] == pytest.approx(4.0 / 3.0 * np.pi * (0.5 * box_diagonal(*box.bounds_m)[0]) ** 3)
