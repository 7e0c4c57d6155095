"""The least half chi-square among the vertices of a grid, for many snapshots at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.models.bearings import SightLines

__all__ = ["GridBest", "search_grid", "vertex_costs"]


_POINTS_AT_ONCE = 4096
_VALUES_AT_ONCE = 1 << 18
"""Points times rows at once, of snapshots of many rows."""


@dataclass(frozen=True)
class GridBest:
    """The best vertex (B,) about the local origins, and its half chi-square.

    ``exists`` is false if no vertex is allowed; x and y are then the centre. ``evaluations`` (B,) counts the
    vertices at which the model was evaluated.
    """

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    exists: BoolArray
    at_boundary: BoolArray
    evaluations: IntArray


def search_grid(
    lines: SightLines, center_x: FloatArray, center_y: FloatArray, *, width_m: float, height_m: float, step_m: float
) -> GridBest:
    """Return the best vertices that the scene allows, of grids along x and y about centres (B,).

    The centre is a vertex; the grid has floor(size / step / 2) steps to each side. Of equal vertices the first counts.
    """
    half_x, half_y = int(0.5 * width_m / step_m), int(0.5 * height_m / step_m)
    offset_x = np.repeat(np.arange(-half_x, half_x + 1), 2 * half_y + 1)
    offset_y = np.tile(np.arange(-half_y, half_y + 1), 2 * half_x + 1)
    size = center_x.shape[0]
    best, cost = np.full(size, -1, dtype=np.int64), np.full(size, np.inf)
    evaluations = np.zeros(size, dtype=np.int64)
    usable = np.flatnonzero(np.isfinite(center_x) & np.isfinite(center_y))
    points = max(1, min(_POINTS_AT_ONCE, _VALUES_AT_ONCE // lines.std_rad.shape[1]))
    for rows, vertices in _blocks(usable, offset_x.shape[0], points):
        x = center_x[rows][:, None] + step_m * offset_x[vertices]
        y = center_y[rows][:, None] + step_m * offset_y[vertices]
        costs = vertex_costs(lines.take(np.repeat(rows, vertices.shape[0])), x.ravel(), y.ravel()).reshape(x.shape)
        evaluations[rows] += np.isfinite(costs).sum(axis=1)
        index = np.argmin(costs, axis=1)
        least = costs[np.arange(rows.shape[0]), index]
        lower = least < cost[rows]
        best[rows[lower]], cost[rows[lower]] = vertices[index[lower]], least[lower]
    there = best >= 0
    step_x, step_y = np.where(there, offset_x[best], 0), np.where(there, offset_y[best], 0)
    at_boundary = there & ((np.abs(step_x) == half_x) | (np.abs(step_y) == half_y))
    return GridBest(center_x + step_m * step_x, center_y + step_m * step_y, cost, there, at_boundary, evaluations)


def _blocks(rows: IntArray, vertices: int, points: int) -> list[tuple[IntArray, IntArray]]:
    """Return pieces of snapshots and vertices of at most ``points`` points."""
    rows_at_once = max(1, points // vertices)
    vertices_at_once = max(1, points // rows_at_once)
    return [
        (rows[i : i + rows_at_once], np.arange(j, min(j + vertices_at_once, vertices)))
        for i in range(0, rows.shape[0], rows_at_once)
        for j in range(0, vertices, vertices_at_once)
    ]


def vertex_costs(lines: SightLines, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return half the chi-square (P,) at points, infinite where the scene does not allow them."""
    allowed = np.flatnonzero(~lines.outside_scene(x, y))
    cost = np.full(x.shape, np.inf)
    cost[allowed] = 0.5 * lines.take(allowed).ray_residuals(x[allowed], y[allowed]).chi_square
    return cost
