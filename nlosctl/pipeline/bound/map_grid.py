"""The grid of positions of a map of bounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import UsageError

__all__ = ["POSITIONS_AT_ONCE", "MapGrid", "parse_map"]

POSITIONS_AT_ONCE = 4096
"""Bounds of so many positions are computed at a time."""

_MOST_VERTICES = 100_000_000


@dataclass(frozen=True, kw_only=True)
class MapGrid:
    """Positions (V,) on a grid, row by row from the smallest y; an end is included if the step reaches it."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float
    step_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """The number of vertices along x and along y."""
        return self._count(self.x_min_m, self.x_max_m), self._count(self.y_min_m, self.y_max_m)

    def blocks(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield x and y of the vertices, a block at a time."""
        along_x, along_y = self.shape
        for start in range(0, along_x * along_y, POSITIONS_AT_ONCE):
            number = np.arange(start, min(start + POSITIONS_AT_ONCE, along_x * along_y))
            x: FloatArray = self.x_min_m + self.step_m * (number % along_x).astype(np.float64)
            y: FloatArray = self.y_min_m + self.step_m * (number // along_x).astype(np.float64)
            yield x, y

    def _count(self, low: float, high: float) -> int:
        return int(np.floor((high - low) / self.step_m + 1e-9)) + 1


def parse_map(text: str) -> MapGrid:
    """Return the grid of ``xmin,xmax,ymin,ymax,step`` in metres; raises UsageError."""
    wanted = f"`map` takes xmin,xmax,ymin,ymax,step in metres, rising and step above 0. Got {text!r} instead."
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(wanted) from None
    if len(numbers) != 5 or not np.isfinite(numbers).all():
        raise UsageError(wanted)
    x_min, x_max, y_min, y_max, step = numbers
    if x_min > x_max or y_min > y_max or step <= 0.0:
        raise UsageError(wanted)
    grid = MapGrid(x_min_m=x_min, x_max_m=x_max, y_min_m=y_min, y_max_m=y_max, step_m=step)
    if grid.shape[0] * grid.shape[1] > _MOST_VERTICES:
        raise UsageError(f"`map` {text} has {grid.shape[0] * grid.shape[1]} vertices, more than {_MOST_VERTICES}")
    return grid
