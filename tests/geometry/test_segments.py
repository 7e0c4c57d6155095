"""Finite walls: crossings and reflections."""

from __future__ import annotations

import numpy as np

from nlosctl.geometry.lines import crosses_segment, reflect_in_segment


def test_crossings_agree_with_parametrized_lines() -> None:
    """A path crosses a wall where both parameters of the lines' common point are within the ends."""
    generator = np.random.default_rng(1)
    points = generator.uniform(-1.0, 1.0, (8, 500))
    expected = []
    for ax, ay, bx, by, x1, y1, x2, y2 in points.T:
        matrix = np.array([[bx - ax, x1 - x2], [by - ay, y1 - y2]])
        way, wall = np.linalg.solve(matrix, [x1 - ax, y1 - ay])
        expected.append([0.0 < way < 1.0 and 0.0 <= wall <= 1.0, 0.0 < way < 1.0])
    finite, endless = np.array(expected).T
    assert np.array_equal(crosses_segment(*points), finite)
    assert np.array_equal(crosses_segment(*points, endless=True), endless)
    assert 50 < finite.sum() < endless.sum() < 500


def test_paths_through_an_end_of_a_wall_cross_it() -> None:
    """Both ends belong to the wall; a path that ends on its line, or passes beside it, does not cross."""
    ways = np.array([[0.0, -1.0, 0.0, 1.0], [2.0, -1.0, 2.0, 1.0], [1.0, -1.0, 1.0, 0.0], [3.0, -1.0, 3.0, 1.0]]).T
    wall = (np.zeros(4), np.zeros(4), np.full(4, 2.0), np.zeros(4))
    assert crosses_segment(*ways, *wall).tolist() == [True, True, False, False]
    assert crosses_segment(*ways, *wall, endless=True).tolist() == [True, True, False, True]


def test_reflections_are_the_shortest_paths_by_the_wall() -> None:
    """Fermat: no other point of the wall gives a shorter path; points beyond an end or across have none."""
    generator = np.random.default_rng(2)
    points = generator.uniform(-1.0, 1.0, (8, 400))
    x, y = reflect_in_segment(*points)
    ax, ay, bx, by, x1, y1, x2, y2 = points
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    wall_x, wall_y = x1 + share * (x2 - x1), y1 + share * (y2 - y1)
    lengths = np.hypot(wall_x - ax, wall_y - ay) + np.hypot(wall_x - bx, wall_y - by)
    found = np.isfinite(x)
    way = np.hypot(x - ax, y - ay) + np.hypot(x - bx, y - by)
    assert np.all(way[found] <= lengths.min(axis=0)[found] * (1.0 + 1e-12))
    assert np.all(way[found] >= lengths.min(axis=0)[found] * (1.0 - 1e-5))
    inner = (lengths.argmin(axis=0) > 1) & (lengths.argmin(axis=0) < 1999)
    side = [(x2 - x1) * (py - y1) - (y2 - y1) * (px - x1) for px, py in ((ax, ay), (bx, by))]
    assert np.array_equal(found, inner & (side[0] * side[1] > 0.0))


def test_undefined_reflections_give_no_warning() -> None:
    """Points at equal distance on opposite sides, or both on the wall's line, have none, without a warning."""
    ends = np.array([[0.0, 1.0, 3.0, -1.0], [0.5, 0.0, 1.5, 0.0], [1.0, 2.0, 1.0, -2.0]]).T
    x, y = reflect_in_segment(*ends, np.zeros(3), np.zeros(3), np.full(3, 2.0), np.zeros(3))
    assert np.isnan([x, y]).all()
