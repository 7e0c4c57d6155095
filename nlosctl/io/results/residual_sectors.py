"""Residuals of each sensor and of each direction, from flags, for the picture of a calibration; in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import FloatArray, ignoring_invalid
from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.completion.array_deviations import HEADING
from nlosctl.io.measurements.completion.sensor_keys import sensor_keys
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.evaluation_arrays import numbers
from nlosctl.io.results.layouts import TRUTH_NAMES
from nlosctl.io.results.plot_inputs import PlotInput, read_sampled

__all__ = ["BINS", "SensorResiduals", "read_residuals"]

BINS = 36
"""Sectors of ten degrees."""

_RESIDUALS = {"bearings": "residual_rad", "ranges": "residual_m", "arrivals": "residual_m"}

Key = tuple[str, ...]


@dataclass
class SensorResiduals:
    """Residuals of the rows used, in degrees or metres, by sensor and group: number, sum and sum of squares.

    ``sectors`` has the numbers and sums (2, BINS) by direction: the bearing, or that from the sensor to the position,
    counter-clockwise from +x (from the heading, where the options of reading ask for it); empty where the directions
    are not known.
    """

    label: str
    sums: dict[Key, FloatArray] = field(default_factory=dict)
    sectors: dict[Key, FloatArray] = field(default_factory=dict)

    def mean_and_std(self, key: Key) -> tuple[float, float]:
        """Return the mean and the standard deviation of a sensor's residuals; NaN without any."""
        count, total, squares = self.sums.get(key, np.zeros(3))
        with ignoring_invalid():
            mean = np.divide(total, count)
            return float(mean), float(np.sqrt(np.maximum(np.divide(squares, count) - mean * mean, 0.0)))

    def by_direction(self, key: Key) -> tuple[FloatArray, FloatArray]:
        """Return the middles (BINS,) of the sectors in degrees, and the mean residual in each, NaN without any."""
        count, total = self.sectors.get(key, np.zeros((2, BINS)))
        with ignoring_invalid():
            mean: FloatArray = np.divide(total, count)
        middle: FloatArray = np.linspace(-180.0, 180.0, 2 * BINS + 1)[1::2]
        return middle, mean

    def add(self, key: Key, value: FloatArray, direction_rad: FloatArray | None) -> None:
        """Add residuals (N,) of a sensor with their directions, None: not known."""
        known = np.isfinite(value)
        value = value[known]
        terms = np.array([value.size, value.sum(), (value * value).sum()], dtype=np.float64)
        self.sums[key] = self.sums.get(key, np.zeros(3)) + terms
        if direction_rad is not None:
            direction = direction_rad[known]
            placed = np.isfinite(direction)
            share = (direction[placed] + np.pi) / (2.0 * np.pi) % 1.0
            sector = np.minimum((share * BINS).astype(np.int64), BINS - 1)
            counts = [np.bincount(sector, weights, BINS) for weights in (np.ones(sector.size), value[placed])]
            self.sectors[key] = self.sectors.get(key, np.zeros((2, BINS))) + np.stack(counts)


def read_residuals(
    file: PlotInput, label: str, by: Sequence[str], read: InputOptions, estimates: PlotInput | None, limit: int
) -> SensorResiduals:
    """Return the residuals in flags, by sensor and the columns ``by`` that the flags have.

    Directions of ranges and arrivals are those to the positions of ``estimates`` (of about ``limit`` rows of them), or
    of the truth columns. Raises DataError for a file without residuals.
    """
    column = _RESIDUALS[file.kind]
    if column not in file.names:
        raise DataError(
            f"{file.name}: no column {column!r}; localize with flags_out writes flags that have it, or name the "
            "measurements"
        )
    places = {} if estimates is None else _places(estimates, limit)
    residuals, scale = SensorResiduals(label), np.degrees(1.0) if file.kind == "bearings" else 1.0
    groups = [name for name in by if name in file.names]
    options = replace(read, extra_columns=(column, "used", "snapshot", "sensor", *groups, *TRUTH_NAMES))
    with closing(MeasurementReader([file.input()], options)) as reader:
        for chunk in reader.chunks():
            codes, keys = sensor_keys(chunk, groups)
            used = np.asarray(chunk.table.column("used").cast(pa.bool_()).fill_null(False)).astype(bool)
            value = np.where(used, _numbers(chunk.table.column(column)) * scale, np.nan)
            direction = _directions(chunk, file.kind, places)
            for code, key in enumerate(keys):
                mine = codes == code
                residuals.add(key, value[mine], None if direction is None else direction[mine])
    return residuals


def _numbers(column: Any) -> FloatArray:
    """Return a column of numbers, or of their text, NaN where it is empty."""
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        column = pc.if_else(pc.equal(column, ""), None, column)
    return numbers(column)


def _places(estimates: PlotInput, limit: int) -> dict[str, tuple[float, float]]:
    """Return the positions of best alternatives by snapshot."""
    rows = read_sampled(estimates, ("snapshot", "alternative", "x_m", "y_m"), limit).columns
    best = np.flatnonzero((rows["alternative"] == 0) & np.isfinite(rows["x_m"]))
    ids = [_id(value) for value in rows["snapshot"][best].tolist()]
    return dict(zip(ids, zip(rows["x_m"][best].tolist(), rows["y_m"][best].tolist(), strict=True), strict=True))


def _id(value: Any) -> str:
    return str(int(value)) if isinstance(value, float) else str(value)


def _directions(chunk: Chunk, kind: str, places: Mapping[str, tuple[float, float]]) -> FloatArray | None:
    """Return the directions (N,) of a chunk's rows from their sensors; None where they are not known."""
    if kind == "bearings":
        heading_rad = chunk.columns.get(HEADING)
        bearing_rad = np.asarray(chunk.columns["bearing_rad"])
        return bearing_rad if heading_rad is None else bearing_rad - (0.5 * np.pi - heading_rad)
    positions = _positions(chunk, places)
    if positions is None:
        return None
    away = [positions[:, axis] - chunk.columns[name] for axis, name in enumerate(("sensor_x_m", "sensor_y_m"))]
    return np.asarray(np.arctan2(away[1], away[0]))


def _positions(chunk: Chunk, places: Mapping[str, tuple[float, float]]) -> FloatArray | None:
    if places:
        found = np.array([places.get(str(name), (np.nan, np.nan)) for name in _names(chunk)])
        return np.repeat(found, np.diff(chunk.offsets), axis=0)
    if set(TRUTH_NAMES) <= set(chunk.table.column_names):
        return np.stack([_numbers(chunk.table.column(name)) for name in TRUTH_NAMES], axis=1)
    return None


def _names(chunk: Chunk) -> Iterator[str]:
    return (str(name) for name in chunk.snapshot.to_pylist())
