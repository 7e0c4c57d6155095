"""Posterior maps as the page draws them: a picture of the highest-density regions for each snapshot."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.errors import DataError
from nlosctl.io.results.plot_inputs import SampledRows
from nlosctl.pipeline.report.plane_map import PlaneMap

__all__ = ["POSTERIOR_COLUMNS", "PosteriorMaps"]

POSTERIOR_COLUMNS = ("snapshot", "x_m", "y_m", "hpd")

_LEVELS = (0.5, 0.9, 0.95)
_MOST_CELLS = 2_000_000


class PosteriorMaps:
    """The maps of one file, each of one snapshot, or one of no snapshot (``ids`` is then empty).

    Create it before the map of the page is settled, which includes the cells of the region of 95 %.
    """

    def __init__(self, name: str, sample: SampledRows, plane: PlaneMap) -> None:
        columns = sample.columns
        self._name = name
        self._place = np.stack([np.asarray(columns[f"{axis}_m"], dtype=np.float64) for axis in "xy"], axis=1)
        self._hpd = np.asarray(columns["hpd"], dtype=np.float64)
        self.ids: list[str] = []
        self._starts: IntArray = np.zeros(1, dtype=np.int64)
        if "snapshot" in columns:
            values = columns["snapshot"]
            self._starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
            self.ids = [_id(value) for value in values[self._starts].tolist()]
        inside = self._place[self._hpd <= _LEVELS[-1]]
        if inside.size:
            plane.include(np.stack([inside.min(axis=0), inside.max(axis=0)]))

    def content(self, index: dict[str, int], plane: PlaneMap) -> Iterator[dict[str, Any]]:
        """Yield each map as plain values; ``index`` has the snapshots of the page, -1 is the map of no snapshot.

        ``levels`` are bytes in base 64, row by row from the north: 1, 2 and 3 in the regions of 50, 90 and 95 %, 0
        outside.
        """
        stops = [*self._starts[1:].tolist(), self._hpd.size]
        for number, (start, stop) in enumerate(zip(self._starts.tolist(), stops, strict=True)):
            place, hpd = self._place[start:stop], self._hpd[start:stop]
            cell, low, column, row = self._grid(place)
            shape = int(row.max()) + 1, int(column.max()) + 1
            levels = np.zeros(shape, dtype=np.uint8)
            levels[shape[0] - 1 - row, column] = (np.searchsorted(_LEVELS, hpd) + 1) % (len(_LEVELS) + 1)
            corner = low - 0.5 * cell - plane.origin_m
            yield {
                "snapshot": index[self.ids[number]] if self.ids else -1,
                "low": corner.tolist(),
                "high": (corner + cell * np.array(shape[::-1])).tolist(),
                "shape": list(shape),
                "levels": base64.b64encode(levels.tobytes()).decode("ascii"),
            }

    def _grid(self, place: FloatArray) -> tuple[float, FloatArray, IntArray, IntArray]:
        """Return the side of the cells, the centre (2,) of the first, and the column and row (N,) of each."""
        steps = [np.diff(np.unique(place[:, axis])) for axis in (0, 1)]
        cell = min((float(step.min()) for step in steps if step.size), default=1.0)
        low: FloatArray = place.min(axis=0)
        column, row = (np.rint((place[:, axis] - low[axis]) / cell).astype(np.int64) for axis in (0, 1))
        if (int(column.max()) + 1) * (int(row.max()) + 1) > max(_MOST_CELLS, 2 * place.shape[0]):
            raise DataError(f"{self._name}: the cells are not those of one grid; make the map again with 'posterior'")
        return cell, low, column, row


def _id(value: Any) -> str:
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
