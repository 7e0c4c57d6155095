"""Arrival times in another unit or of another wave, and heights that ask for three dimensions."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.tables import KINDS
from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.plot_inputs import as_array
from nlosctl.models.arrivals import ArrivalRows, arrival_rows
from nlosctl.pipeline.describe.suspicions import Suspicion
from nlosctl.pipeline.solve.advice import Measured
from nlosctl.pipeline.solve.reference_rows import alike_blocks
from nlosctl.pipeline.solve.solve_chunk import dense_batch, dense_blocks

__all__ = ["SOUND_M_S", "ArrivalSpans"]

SOUND_M_S = 343.0
_SOUND = "sound"
_MOST, _FEW = 0.5, 0.1
_BLOCK, _MOST_ROWS = 4096, 200
_FEWEST_IN_SPACE = 5
_TALL = 0.1
"""Sensors whose heights spread over a larger share of their extent are not taken as in one plane."""

_LEAST_SHARE = 0.02
"""The quartiles of a snapshot's arrivals are at least this share of the array's size apart in the right unit."""

_HEIGHTS, _TARGETS = ("sensor_z_m", "sensor_height_m"), ("target_z_m", "target_height_m")


@dataclass
class ArrivalSpans:
    """Counts the ``snapshots`` of two or more arrivals, and those with a difference ``longer`` than its baseline.

    ``fitting`` counts those of the latter without one under another speed or unit, by its name. ``low`` and ``high``
    are the limits of the sensors' x, y and height.
    """

    snapshots: int = 0
    longer: int = 0
    fitting: Counter[str] = field(default_factory=Counter)
    low: list[float] = field(default_factory=lambda: [np.inf] * 3)
    high: list[float] = field(default_factory=lambda: [-np.inf] * 3)
    has_target_heights: bool = False

    def add(self, chunk: Chunk, reader: MeasurementReader) -> None:
        """Take the rows of a chunk; those of other kinds are passed over."""
        if reader.kind != "arrivals":
            return
        self._add_heights(chunk)
        factors, scales_std = _factors(Measured.of(reader), reader.options), not reader.constants
        for snapshot, row in dense_blocks(chunk.offsets, ~chunk.left_out, _BLOCK):
            if not 2 <= row.shape[1] <= _MOST_ROWS:
                continue
            for _, rows in alike_blocks(chunk, snapshot, row):
                batch: Any = dense_batch(
                    "arrivals", chunk.columns, rows, scene=reader.scene, dimension=reader.dimension
                )
                longer = arrival_rows(batch).far_apart()
                self.snapshots += longer.size
                self.longer += int(np.count_nonzero(longer))
                for name, factor in factors.items() if longer.any() else ():
                    std_m = batch.arrival_std_m * (factor if scales_std else 1.0)
                    other = dataclasses.replace(batch, arrival_m=batch.arrival_m * factor, arrival_std_m=std_m)
                    self.fitting[name] += int(np.count_nonzero(longer & _is_plausible(arrival_rows(other))))

    def _add_heights(self, chunk: Chunk) -> None:
        names = chunk.table.column_names
        height = next((as_array(chunk.table.column(name)) for name in _HEIGHTS if name in names), None)
        axes = [chunk.columns["sensor_x_m"], chunk.columns["sensor_y_m"], *([] if height is None else [height])]
        for axis, values in enumerate(axes):
            finite = values[np.isfinite(values)]
            if finite.size:
                self.low[axis] = min(self.low[axis], float(finite.min()))
                self.high[axis] = max(self.high[axis], float(finite.max()))
        self.has_target_heights |= any(name in names for name in _TARGETS)

    def settings(self, options: InputOptions, largest: int) -> dict[str, Any]:
        """Return the settings of reading that the values ask for, where they are not given: speed and dimensions.

        ``largest`` is the number of rows in the largest snapshot.
        """
        found: dict[str, Any] = {}
        if options.speed_m_s == LIGHT_M_S and self._cures(_SOUND):
            found["speed_m_s"] = SOUND_M_S
        width, depth, rise = (high - low for low, high in zip(self.low, self.high, strict=True))
        tall = rise > _TALL * np.hypot(width, depth) and largest >= _FEWEST_IN_SPACE
        if options.dimensions is None and rise >= 0.0 and (self.has_target_heights or tall):
            found["dimensions"] = 3
        return found

    def _cures(self, name: str) -> bool:
        most = self.longer > _MOST * self.snapshots
        return most and self.fitting[name] >= (1.0 - _FEW) * self.longer

    def suspicions(self, measured: Measured) -> Iterator[Suspicion]:
        """Yield that most snapshots have differences longer than their baselines, and what would shorten them."""
        if not self.longer > _MOST * self.snapshots:
            return
        text = (
            f"in {self.longer} of {self.snapshots} snapshots arrivals differ by more than the distance of their sensors"
        )
        units = [name for name in self.fitting if name != _SOUND and self._cures(name)]
        cure = ": are positions in metres, the unit that of the column, and `speed_m_s` that of the wave?"
        if units:
            cure = f", but not if they are read as {units[0]}: {measured.option(_given(measured), units[0])}"
        yield Suspicion(what="longer_than_baseline", column=_given(measured), rows=None, text=text + cure)


def _is_plausible(rows: ArrivalRows) -> BoolArray:
    """Return in which snapshots (B,) no difference is longer than its baseline, and most are not next to nothing."""
    middle = np.subtract(*np.percentile(rows.arrival_m, [75.0, 25.0], axis=1))
    plausible: BoolArray = ~rows.far_apart() & (middle > _LEAST_SHARE * rows.size_m())
    return plausible


def _given(measured: Measured) -> str:
    """Return the name under which the file has its arrivals."""
    column = KINDS["arrivals"].column("arrival_m")
    return next((name for name in column.accepted_names if name in measured.names), column.name)


def _factors(measured: Measured, options: InputOptions) -> dict[str, float]:
    """Return by how much the arrivals are shorter under the speed of sound, or in a smaller unit of their column."""
    given = _given(measured)
    spellings = KINDS["arrivals"].column("arrival_m").spellings
    seconds = {spelling.name: spelling.seconds for spelling in spellings if spelling.seconds}
    if given not in seconds:
        return {}
    stem = given.rpartition("_")[0]
    units = {
        name: unit / seconds[given]
        for name, unit in seconds.items()
        if unit < seconds[given] and name.rpartition("_")[0] == stem
    }
    return {_SOUND: SOUND_M_S / options.speed_m_s, **units}
