"""Bearings compared with the directions to true positions: in another sense, or from another axis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.plot_inputs import as_array
from nlosctl.pipeline.describe.suspicions import Suspicion, of_cause
from nlosctl.pipeline.solve.advice import Measured
from nlosctl.pipeline.solve.likely_causes import change_text, changes

__all__ = ["TruthDirections"]

_FEWEST_ROWS = 3
_MOST = 0.5
_STDS = 3.0
_LEAST_RAD = 0.017453292519943295
_MOST_RAD = 0.5235987755982988
_TRUTH = ("truth_x_m", "truth_y_m")


@dataclass
class TruthDirections:
    """Counts the rows with a true position whose bearing leads there, as given and after each change of all rows.

    A bearing leads there within 3 standard deviations (at least 1 and at most 30 degrees).
    """

    rows: int = 0
    as_given: int = 0
    changed: Counter[str] = field(default_factory=Counter)

    def add(self, chunk: Chunk, reader: MeasurementReader) -> None:
        """Take the rows of a chunk; all but direct bearings with ``truth_x_m`` and ``truth_y_m`` are passed over."""
        columns, names = chunk.columns, {*chunk.table.column_names}
        if reader.kind != "bearings" or "reflector" in names or not names.issuperset(_TRUTH):
            return
        x_m, y_m = (as_array(chunk.table.column(name)) for name in _TRUTH)
        if x_m.dtype.kind not in "if" or y_m.dtype.kind not in "if":
            return
        east_m, north_m = x_m - columns["sensor_x_m"], y_m - columns["sensor_y_m"]
        known = np.isfinite(east_m + north_m) & (np.hypot(east_m, north_m) > 0.0) & ~chunk.left_out
        direction_rad = np.arctan2(north_m, east_m)[known]
        limit_rad = np.clip(_STDS * columns["bearing_std_rad"][known], _LEAST_RAD, _MOST_RAD)

        def leading(bearing_rad: FloatArray) -> int:
            error_rad = np.abs(np.angle(np.exp(1j * (bearing_rad[known] - direction_rad))))
            return int(np.count_nonzero(error_rad <= limit_rad))

        self.rows += direction_rad.size
        self.as_given += leading(columns["bearing_rad"])
        for name, other in changes(columns, Measured.of(reader)):
            self.changed[name] += leading(other["bearing_rad"])

    def suspicions(self, measured: Measured) -> Iterator[Suspicion]:
        """Yield the change after which most bearings lead to the true positions, if they do not as given."""
        if self.rows < _FEWEST_ROWS or self.as_given > _MOST * self.rows or not self.changed:
            return
        name, count = self.changed.most_common(1)[0]
        if count > _MOST * self.rows:
            fitting = f"{count} of {self.rows} bearings lead to the true positions ({self.as_given} as given)"
            yield of_cause(f"{fitting} {change_text(name, measured)}", self.rows)
