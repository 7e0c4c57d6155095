"""Grids of square cells over search regions, and the largest number of cells."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import BearingBatch, RangeBatch, TripletBatch
from nlosctl.contract.fields import CircleField, PolygonField, SensorsField
from nlosctl.errors import DataError, UsageError
from nlosctl.geometry.blocks import max_measurements
from nlosctl.models.search_regions import reach_region, search_region
from nlosctl.models.triplets import node_positions

__all__ = ["Bounds", "CellGrid", "region_bounds"]

Bounds = tuple[float, float, float, float]
"""xmin, xmax, ymin, ymax in metres."""

_CELLS_ACROSS = 100
"""By default about so many cells are along the longer side."""

_RANGE_STDS = 4.0
"""Beyond the longest range by so many of its standard deviations no source is expected."""

_ROUNDING = 1e-9
_PARTS = 4
"""The share of a cell within a round or polygonal region is that of so many by so many points."""


@dataclass(frozen=True, kw_only=True)
class CellGrid:
    """A grid of ``columns`` by ``rows`` square cells from its south-west corner, row by row from the south.

    The centre of cell (i, j), whose index is j columns + i, is x_min_m + (i + 1/2) cell_m, y_min_m + (j + 1/2) cell_m.
    """

    x_min_m: float
    y_min_m: float
    cell_m: float
    columns: int
    rows: int

    @classmethod
    def over(cls, bounds: Bounds, cell_m: float | None, most: int, what: str) -> CellGrid:
        """Return the grid that covers bounds; None: with cells of about a hundredth of the longer side.

        Raises UsageError for more than ``most`` cells, DataError for bounds without extent, of ``what``.
        """
        x_min, x_max, y_min, y_max = bounds
        longer = max(x_max - x_min, y_max - y_min)
        if not 0.0 < longer < np.inf:
            raise DataError(
                f"{what}: the search region is a single point, so there is nothing to show; set `field`, such as "
                "xmin,xmax,ymin,ymax"
            )
        cell = _round_cell(longer) if cell_m is None else cell_m
        columns, rows = (max(1.0, np.ceil(side / cell - _ROUNDING)) for side in (x_max - x_min, y_max - y_min))
        if columns * rows > most:
            raise UsageError(
                f"{what}: {columns * rows:.0f} cells of {cell:g} m, more than `max_cells` {most}; set a larger `cell`, "
                "a smaller `field`, or a larger `max_cells`"
            )
        return cls(x_min_m=x_min, y_min_m=y_min, cell_m=cell, columns=int(columns), rows=int(rows))

    @property
    def count(self) -> int:
        """The number of cells."""
        return self.columns * self.rows

    def centers(self) -> tuple[FloatArray, FloatArray]:
        """Return x and y of the cells (P,), row by row from the south, each from the west."""
        x = self.x_min_m + (np.arange(self.columns) + 0.5) * self.cell_m
        y = self.y_min_m + (np.arange(self.rows) + 0.5) * self.cell_m
        return np.tile(x, self.rows), np.repeat(y, self.columns)

    def inside_share(self, field: Any) -> FloatArray | None:
        """Return the share of each cell (P,) that is within a search region; None: all are, as in any box.

        A box is covered by whole cells: the last ones may reach beyond it.
        """
        if not isinstance(field, CircleField | PolygonField):
            return None
        x, y = self.centers()
        region = search_region(field, (), (np.zeros(1), np.zeros(1)))
        share = np.zeros(self.count)
        offsets = ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5) * self.cell_m
        for dx in offsets:
            for dy in offsets:
                share += region.contains((x + dx)[None], (y + dy)[None])[0]
        return share / _PARTS**2


def _round_cell(longer_m: float) -> float:
    """Return 1, 2 or 5 times a power of ten, such that at most a hundred cells are along a side."""
    least = longer_m / _CELLS_ACROSS
    power = 10.0 ** floor(log10(least))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if ceil(longer_m / (step * power)) <= _CELLS_ACROSS)


def region_bounds(batch: Any) -> FloatArray:
    """Return the bounds (B, 4) of each snapshot's search region in the plane: xmin, xmax, ymin, ymax.

    The region of the sensors is enlarged so that it contains what the ranges, or the ellipses of path lengths, reach.
    """
    sensors, reach = _sensors(batch)[:2], _reach_m(batch)
    zero = np.zeros(batch.size)
    region = search_region(batch.field, sensors, (zero, zero))
    if reach is not None and isinstance(batch.field, SensorsField):
        region = reach_region(region, sensors, reach)
    (x_min, y_min), (x_max, y_max) = region.bounds_m
    return np.stack(np.broadcast_arrays(x_min, x_max, y_min, y_max, zero)[:4], axis=1)


def _sensors(batch: Any) -> Point:
    if isinstance(batch, TripletBatch):
        tx, rx = node_positions(batch)
        return tuple(np.concatenate([one, other], axis=1) for one, other in zip(tx, rx, strict=True))
    return batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]


def _reach_m(batch: Any) -> FloatArray | None:
    """Return how far (B,) beyond the box of the sensors a source may be; None: not known."""
    if isinstance(batch, TripletBatch):  # half the axis of an ellipse from its middle
        return max_measurements(0.5 * (batch.path_length_m + _RANGE_STDS * batch.path_length_std_m))
    if isinstance(batch, RangeBatch):
        return max_measurements(batch.range_m + _RANGE_STDS * batch.range_std_m)
    if isinstance(batch, BearingBatch) and batch.range_m is not None and batch.range_std_m is not None:
        reach = batch.range_m + _RANGE_STDS * batch.range_std_m
        return np.asarray(np.maximum(max_measurements(np.where(np.isnan(reach), 0.0, reach)), 0.0))
    return None
