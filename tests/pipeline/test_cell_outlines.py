"""Outlines of cells: closed rings along cell edges, counter-clockwise outside, clockwise holes, nothing lost."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.antimeridian import rings_by_polygon
from nlosctl.pipeline.convert.cell_outlines import cell_outlines


def area(ring: FloatArray) -> float:
    """Return the area of a ring, negative if it is clockwise."""
    x, y = ring.T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def is_inside(ring: FloatArray, x: float, y: float) -> bool:
    """Return whether a point is inside a ring, by the crossings of a ray to the right."""
    crossings = 0
    for (x0, y0), (x1, y1) in pairwise(ring):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            crossings += 1
    return crossings % 2 == 1


def filled(polygons: list[list[FloatArray]], shape: tuple[int, int]) -> BoolArray:
    """Return which cells are in exactly one polygon and in none of its holes."""
    count = np.zeros(shape, dtype=int)
    for outside, *holes in polygons:
        for row in range(shape[0]):
            for column in range(shape[1]):
                at = (column + 0.5, row + 0.5)
                count[row, column] += is_inside(outside, *at) and not any(is_inside(hole, *at) for hole in holes)
    assert count.max() <= 1
    return np.asarray(count == 1)


@pytest.mark.parametrize("seed", range(12))
def test_random_sets_of_cells_come_back(seed: int) -> None:
    """Filling the polygons, less their holes, gives the cells again; rings are closed, simple and turn as they must."""
    draw = np.random.default_rng(seed)
    inside = draw.random((draw.integers(1, 14), draw.integers(1, 14))) < draw.uniform(0.2, 0.9)
    rings = cell_outlines(inside)
    polygons = rings_by_polygon(rings)
    assert sum(map(len, polygons)) == len(rings)
    np.testing.assert_array_equal(filled(polygons, inside.shape), inside)
    for outside, *holes in polygons:
        assert area(outside) > 0.0
        assert all(area(hole) < 0.0 for hole in holes)
    for ring in rings:
        assert (ring[0] == ring[-1]).all()
        assert len({tuple(vertex) for vertex in ring[:-1].tolist()}) == len(ring) - 1
        assert (np.abs(np.diff(ring, axis=0)).sum(axis=1) == 1.0).all()
    assert sum(map(area, rings)) == np.count_nonzero(inside)


def test_an_island_in_a_hole_is_a_polygon_of_its_own() -> None:
    """A ring of cells about another ring of cells: the hole belongs to the outer one."""
    inside = np.ones((7, 7), dtype=bool)
    inside[1:6, 1:6] = False
    inside[2:5, 2:5] = True
    inside[3, 3] = False
    assert [[area(ring) for ring in polygon] for polygon in rings_by_polygon(cell_outlines(inside))] in (
        [[49.0, -25.0], [9.0, -1.0]],
        [[9.0, -1.0], [49.0, -25.0]],
    )


def test_no_cells_have_no_outline() -> None:
    """Nothing inside: no ring."""
    assert cell_outlines(np.zeros((3, 4), dtype=bool)) == []
