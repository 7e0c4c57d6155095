"""The maps of snapshots: dense batches, their grids, and the cost of their positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point
from nlosctl.contract.fields import Field
from nlosctl.contract.methods import CostAt
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.posterior.cell_grids import CellGrid, region_bounds
from nlosctl.pipeline.posterior.cell_masses import cell_probabilities
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.reference_rows import alike_blocks, lacks_reference
from nlosctl.pipeline.solve.solve_chunk import dense_batch, dense_blocks
from nlosctl.pipeline.solve.target_heights import by_height
from nlosctl.solvers.optimization.split_batches import take_snapshots
from nlosctl.solvers.sequential.priors import Prior, PriorOptions, prior_of

__all__ = ["BatchCost", "SnapshotMap", "SnapshotMaps"]

_CELLS_AT_ONCE = 1 << 17
_SNAPSHOTS_AT_ONCE = 256
_HEIGHT_NODES = np.linspace(-4.0, 4.0, 17)
"""A measured height is averaged over these numbers of its standard deviations."""


class SnapshotMap(NamedTuple):
    """The map of one snapshot: its index in the chunk, its grid and the probabilities of the cells (P,)."""

    snapshot: int
    grid: CellGrid
    probability: FloatArray


@dataclass(frozen=True)
class BatchCost:
    """The negative logarithm of likelihood times prior of the snapshots of a batch, at positions in the plane."""

    cost_at: CostAt
    options: Any
    batch: Any
    prior: PriorOptions | None

    def __call__(self, rows: IntArray, points: Point, cell_m: float) -> FloatArray:
        """Return that (N, P) of some snapshots at points, or of cells about them; infinite where impossible."""
        whole = rows.shape[0] == self.batch.size and bool((rows == np.arange(rows.shape[0])).all())
        batch = self.batch if whole else take_snapshots(self.batch, rows)
        total = self._likelihood(batch, points, cell_m)
        if self._prior is not None:
            total += self._prior.take(rows).half_chi_square(*points)
        return total

    @cached_property
    def _prior(self) -> Prior | None:
        zero = np.zeros(self.batch.size)
        return None if self.prior is None else prior_of(self.batch, (zero, zero), self.prior)

    def priors(self) -> Prior | None:
        """Return the different priors of the snapshots that have one, in order; None without any."""
        if self._prior is None:
            return None
        numbers = np.stack([self._prior.x, self._prior.y, *self._prior.covariance.parts])
        _, first = np.unique(numbers[:, self._prior.known], axis=1, return_index=True)
        return self._prior.take(np.flatnonzero(self._prior.known)[np.sort(first)])

    def _likelihood(self, batch: Any, points: Point, cell_m: float) -> FloatArray:
        if batch.dimension == 2 or batch.height_held:
            return self.cost_at(batch, self.options, points, cell_m)
        total = np.full(points[0].shape, np.inf)
        for node in _HEIGHT_NODES:
            z = (batch.target_z_m + node * batch.target_z_std_m)[:, None]
            place = (*points, np.broadcast_to(z, points[0].shape))
            np.logaddexp(-total, -self.cost_at(batch, self.options, place, cell_m), out=total)
            np.negative(total, out=total)
        return total


@dataclass(frozen=True, kw_only=True)
class SnapshotMaps:
    """Makes the maps of the snapshots of chunks, by one method."""

    kind: str
    scene: Scene
    dimension: int
    run: MethodRun
    prior: PriorOptions
    field: Field
    cell_m: float | None
    max_cells: int

    def maps(self, chunk: Chunk, first: int = 0, last: int | None = None) -> Iterator[SnapshotMap]:
        """Yield the maps of the snapshots ``first`` to before ``last`` of a chunk, in order.

        A snapshot without a row that takes part has none. Raises UsageError for too many cells.
        """
        last = len(chunk.snapshot) if last is None else last
        grids = self._grids(chunk, first, last)
        cells = np.cumsum([grid.count if grid is not None else 0 for grid in grids])
        start = 0
        while start < last - first:
            done = cells[start - 1] if start else 0
            end = max(start + 1, int(np.searchsorted(cells, done + _CELLS_AT_ONCE, side="right")))
            end = min(end, start + _SNAPSHOTS_AT_ONCE, last - first)
            yield from self._some(chunk, first + start, grids[start:end])
            start = end

    def bounds(self, chunk: Chunk) -> FloatArray:
        """Return the bounds (S, 4) of the search regions of all snapshots of a chunk, NaN without rows."""
        bounds = np.full((len(chunk.snapshot), 4), np.nan)
        for snapshot, batch in self.batches(chunk, 0, len(chunk.snapshot)):
            bounds[snapshot] = region_bounds(batch)
        return bounds

    def batches(self, chunk: Chunk, first: int, last: int) -> Iterator[tuple[IntArray, Any]]:
        """Yield the indices in the chunk of some snapshots with rows, and their batch."""
        alike = alike_blocks if self.kind == "arrivals" else by_height
        for snapshot, row in dense_blocks(chunk.offsets[first : last + 1], ~chunk.left_out, _SNAPSHOTS_AT_ONCE):
            if not row.shape[1]:
                continue
            for mine, rows in alike(chunk, snapshot + first, row):
                if self.kind == "arrivals":
                    lacks_reference(self.run.spec, chunk, int(mine[0]), rows)
                yield mine, self._batch(chunk, rows)

    def cost(self, batch: Any, *, with_prior: bool = True) -> BatchCost:
        """Return the cost of positions for a batch."""
        cost_at = self.run.spec.cost_at
        assert cost_at is not None  # noqa: S101 - other methods are refused before
        return BatchCost(cost_at, self.run.options, batch, self.prior if with_prior else None)

    def _batch(self, chunk: Chunk, rows: IntArray) -> Any:
        batch = dense_batch(
            self.kind, chunk.columns, rows, scene=self.scene, dimension=self.dimension, field=self.field
        )
        if self.dimension == 3 and batch.target_z_m is None:
            raise UsageError(
                "a map is in the plane, and the input is of three dimensions: it needs the height of the source; set "
                "`target_z_m`, give a column 'target_z_m', or set `dimensions` to 2"
            )
        return batch

    def _grids(self, chunk: Chunk, first: int, last: int) -> list[CellGrid | None]:
        bounds = np.full((last - first, 4), np.nan)
        for snapshot, batch in self.batches(chunk, first, last):
            bounds[snapshot - first] = region_bounds(batch)
        known: dict[tuple[float, ...], CellGrid] = {}
        grids: list[CellGrid | None] = []
        for index, row in enumerate(map(tuple, bounds.tolist())):
            if row[0] != row[0]:
                grids.append(None)
                continue
            if row not in known:
                what = f"snapshot {chunk.snapshot[first + index].as_py()!r}"
                known[row] = CellGrid.over(row, self.cell_m, self.max_cells, what)
            grids.append(known[row])
        return grids

    def _some(self, chunk: Chunk, first: int, grids: Sequence[CellGrid | None]) -> Iterator[SnapshotMap]:
        """Yield the maps of the snapshots from ``first`` with these grids."""
        found: dict[int, FloatArray] = {}
        for snapshot, batch in self.batches(chunk, first, first + len(grids)):
            cost = self.cost(batch)
            of_grid: dict[CellGrid, list[int]] = {}
            for index, number in enumerate(snapshot.tolist()):
                grid = grids[number - first]
                assert grid is not None  # noqa: S101 - a snapshot with rows has one
                of_grid.setdefault(grid, []).append(index)
            for grid, members in of_grid.items():
                found |= zip(
                    snapshot[members].tolist(), self._probabilities(cost, np.array(members), grid), strict=True
                )
        for number, grid in enumerate(grids, start=first):
            if grid is not None:
                yield SnapshotMap(number, grid, found[number])

    def _probabilities(self, cost: BatchCost, members: IntArray, grid: CellGrid) -> FloatArray:
        def of_members(rows: IntArray, points: Point, cell_m: float) -> FloatArray:
            return cost(members[rows], points, cell_m)

        x, y = grid.centers()
        return cell_probabilities(of_members, members.shape[0], x, y, grid.cell_m, grid.inside_share(self.field))
