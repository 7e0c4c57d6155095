"""The least half chi-square among the vertices of a fine grid, without a look at most of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_invalid
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.grid_search import GridBest, vertex_costs

__all__ = ["search_blocks"]

_BLOCK = 8
"""Vertices along a side of a block."""

_SAFETY = 1.5
"""How much steeper than at its centre a bearing may be within a block."""

_BLOCKS_AT_ONCE = 6
_POINTS_AT_ONCE = 16_384


@dataclass(frozen=True)
class _Blocks:
    """The blocks (M,) of a grid: index ranges of vertices along x and y, about the centre of the grid."""

    first_x: IntArray
    last_x: IntArray
    first_y: IntArray
    last_y: IntArray

    @classmethod
    def of(cls, half_x: int, half_y: int) -> _Blocks:
        starts = [np.arange(-half, half + 1, _BLOCK) for half in (half_x, half_y)]
        first_x, first_y = (part.ravel() for part in np.meshgrid(*starts, indexing="ij"))
        last = (np.minimum(first + _BLOCK - 1, half) for first, half in ((first_x, half_x), (first_y, half_y)))
        last_x, last_y = last
        return cls(first_x, last_x, first_y, last_y)

    def vertices(self, block: IntArray) -> tuple[IntArray, IntArray]:
        """Return the indices (..., 64) of the vertices of blocks (...); those of a smaller block repeat its last."""
        step = np.arange(_BLOCK)
        x = np.minimum(self.first_x[block][..., None] + np.repeat(step, _BLOCK), self.last_x[block][..., None])
        y = np.minimum(self.first_y[block][..., None] + np.tile(step, _BLOCK), self.last_y[block][..., None])
        return x, y


def search_blocks(
    lines: SightLines, center_x: FloatArray, center_y: FloatArray, *, width_m: float, height_m: float, step_m: float
) -> GridBest:
    """Return what `search_grid` returns, the best vertices that the scene allows, of grids about centres (B,).

    The grid is cut into blocks of 8 x 8 vertices. Within a block no bearing differs from that at its middle by more
    than the bearing's gradient there, times 1.5, times half the diagonal: that is a lower bound of the block's cost.
    Blocks are searched by rising bound until the next bound is above the least cost found.
    """
    half_x, half_y = int(0.5 * width_m / step_m), int(0.5 * height_m / step_m)
    blocks = _Blocks.of(half_x, half_y)
    size, columns = center_x.shape[0], 2 * half_y + 1
    best, cost = np.full(size, -1, dtype=np.int64), np.full(size, np.inf)
    evaluations = np.zeros(size, dtype=np.int64)
    usable = np.flatnonzero(np.isfinite(center_x) & np.isfinite(center_y))
    count = blocks.first_x.shape[0]
    bound = np.full((size, count), np.inf)
    for rows in np.array_split(usable, max(1, usable.size * count // _POINTS_AT_ONCE)):
        bound[rows] = _lower_bounds(lines.take(rows), center_x[rows], center_y[rows], blocks, step_m)
    order = np.argsort(bound, axis=1, kind="stable")
    bound = np.take_along_axis(bound, order, axis=1)
    for start in range(0, count, _BLOCKS_AT_ONCE):
        rows = usable[bound[usable, start] <= cost[usable]]
        for part in np.array_split(rows, max(1, rows.size * _BLOCKS_AT_ONCE * _BLOCK**2 // _POINTS_AT_ONCE)):
            if not part.size:
                continue
            index_x, index_y = blocks.vertices(order[part, start : start + _BLOCKS_AT_ONCE])
            index_x, index_y = index_x.reshape(part.size, -1), index_y.reshape(part.size, -1)
            x, y = center_x[part, None] + step_m * index_x, center_y[part, None] + step_m * index_y
            taken = lines.take(np.repeat(part, x.shape[1]))
            costs = vertex_costs(taken, x.ravel(), y.ravel()).reshape(x.shape)
            evaluations[part] += np.isfinite(costs).sum(axis=1)
            vertex = (index_x + half_x) * columns + index_y + half_y
            least = costs.min(axis=1)
            first = np.where(costs == least[:, None], vertex, np.iinfo(np.int64).max).min(axis=1)
            better = (least < cost[part]) | ((least == cost[part]) & np.isfinite(least) & (first < best[part]))
            best[part[better]], cost[part[better]] = first[better], least[better]
    there = best >= 0
    step_x = np.where(there, best // columns - half_x, 0)
    step_y = np.where(there, best % columns - half_y, 0)
    at_boundary = there & ((np.abs(step_x) == half_x) | (np.abs(step_y) == half_y))
    return GridBest(center_x + step_m * step_x, center_y + step_m * step_y, cost, there, at_boundary, evaluations)


def _lower_bounds(
    lines: SightLines, center_x: FloatArray, center_y: FloatArray, blocks: _Blocks, step_m: float
) -> FloatArray:
    """Return the lower bound (B, M) of half the chi-square in each block; 0 where its middle has no path."""
    count = blocks.first_x.shape[0]
    x = (center_x[:, None] + 0.5 * step_m * (blocks.first_x + blocks.last_x)).ravel()
    y = (center_y[:, None] + 0.5 * step_m * (blocks.first_y + blocks.last_y)).ravel()
    half_m = 0.5 * step_m * np.hypot(blocks.last_x - blocks.first_x, blocks.last_y - blocks.first_y)
    taken = lines.take(np.repeat(np.arange(center_x.shape[0]), count))
    paths = taken.paths_from(x, y)
    with ignoring_invalid():
        scaled = np.abs(taken.residual_rad(x, y, paths)) / taken.std_rad
        reach = _SAFETY * np.hypot(*taken.slopes(x, y, paths)) * np.tile(half_m, center_x.shape[0])[:, None]
        least = np.where(np.isfinite(scaled - reach), np.maximum(scaled - reach, 0.0), 0.0)
    return 0.5 * sum_measurements(least * least).reshape(center_x.shape[0], count)
