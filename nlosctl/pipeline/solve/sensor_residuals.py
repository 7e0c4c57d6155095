"""Mean residuals of the sensors of a run: an unsynchronized clock, a wrong heading or position shows in them.

Of the rows used by fixes that are ``ok`` and have more scalars than unknowns. A sensor is named if its mean is far from
zero: more than half of the scatter of its residuals, and more than six standard errors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray
from nlosctl.contract.statuses import Status
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.completion.references import FORM, Form
from nlosctl.io.measurements.completion.sensor_keys import sensor_texts
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.pipeline.solve.method_runs import MethodTally
from nlosctl.pipeline.solve.solve_chunk import ChunkSolution

__all__ = ["Residuals", "add_residuals", "sensor_entries", "sensor_remarks"]

Residuals = dict[str, ExactSums]
"""By flag column: number, sum and sum of squares of the residuals, by the name of the sensor."""

_COLUMNS = {"residual_m": "m", "residual_rad": "rad", "residual_elevation_rad": "rad"}
_LEAST_SCATTER, _LEAST_ERRORS = 0.5, 6.0
_CAUSES = {"arrivals": "its clock", "ranges": "the offset of its ranges", "bearings": "its heading"}


@dataclass(frozen=True, kw_only=True)
class _SensorMean:
    """The mean of ``rows`` residuals of a sensor in a flag column, and their standard deviation (NaN of one row)."""

    name: str
    column: str
    rows: int
    mean: float
    std: float

    @property
    def is_far_from_zero(self) -> bool:
        """Whether chance does not explain the mean, and it matters beside the scatter."""
        error = self.std / math.sqrt(self.rows)
        return abs(self.mean) > max(_LEAST_SCATTER * self.std, _LEAST_ERRORS * error)


def add_residuals(sums: Residuals, chunk: Chunk, solution: ChunkSolution, method: int, kind: str) -> None:
    """Add the number, the sum and the sum of squares of the residuals of a chunk, by sensor.

    The residual of a difference of a pair counts for its sensor, and with the other sign for its reference, as their
    clocks enter it. The ``method`` is that with this index among the estimates and flags of the ``solution``.
    """
    assert solution.estimates is not None  # noqa: S101 - methods that localize make them
    flags = solution.flags[method]
    rows = _counted_rows(chunk, solution.estimates, method, kind) & flags.used
    by_sensor = [(rows, 1.0, *sensor_texts(chunk))]
    if FORM in chunk.columns:
        pairs = rows & (chunk.columns[FORM] == Form.OF_PAIRS)
        by_sensor.append((pairs, -1.0, *sensor_texts(chunk, "reference")))
    for column in (name for name in _COLUMNS if name in flags.columns):
        residual = np.asarray(flags.columns[column], dtype=np.float64)
        for counted, sign, codes, names in by_sensor:
            some = np.flatnonzero(counted & np.isfinite(residual))
            own = sign * residual[some]
            values = np.stack([np.ones(own.size), own, own * own])
            sums.setdefault(column, ExactSums()).add_groups(names, codes[some], values.T)


def _counted_rows(chunk: Chunk, estimates: ChunkEstimates, method: int, kind: str) -> BoolArray:
    """Return which rows (N,) are of a snapshot with a usual fix and a spare scalar, merged ones once."""
    unknowns = estimates.position_m.shape[1] + (kind == "arrivals")
    spare = (estimates.n_used > unknowns) | ~np.isnan(estimates.fit_p_value)
    usual = (estimates.method == method) & (estimates.alternative == 0) & (estimates.status == Status.OK) & spare
    fixed = np.zeros(chunk.offsets.size - 1, dtype=bool)
    fixed[estimates.snapshot[usual]] = True
    rows = np.repeat(fixed, np.diff(chunk.offsets))
    if chunk.windows is not None:
        rows &= chunk.windows.leader == np.arange(rows.size)
    return rows


def sensor_entries(tallies: Mapping[str, MethodTally]) -> list[dict[str, Any]]:
    """Return the entries of the report: a dict for each method and sensor, by name."""
    entries: dict[tuple[str, str], dict[str, Any]] = {}
    for method, tally in tallies.items():
        for mean in sorted(_means(tally.residuals or {}), key=lambda mean: mean.name):
            entry = entries.setdefault((method, mean.name), {"method": method, "name": mean.name, "rows": mean.rows})
            unit = _COLUMNS[mean.column]
            stem = mean.column.removesuffix(f"_{unit}")
            entry[f"{stem}_mean_{unit}"] = mean.mean
            entry[f"{stem}_std_{unit}"] = None if math.isnan(mean.std) else mean.std
    return list(entries.values())


def sensor_remarks(kind: str, tallies: Mapping[str, MethodTally]) -> list[str]:
    """Return a line for each method that names the sensor with the largest of the means that are far from zero."""
    if any(tally.lacks_residuals for tally in tallies.values()):
        return ["no mean residuals of sensors: a part of the results is of an earlier run that did not count them"]
    lines = []
    for method, tally in tallies.items():
        far = [entry for entry in _means(tally.residuals or {}) if entry.is_far_from_zero]
        if far:
            worst = max(far, key=lambda entry: (abs(entry.mean), entry.name))
            others = f" ({len(far) - 1} other means are far from zero too)" if len(far) > 1 else ""
            lines.append(
                f"{method}: the residuals of sensor {worst.name!r} are {_shown(worst)} on average over {worst.rows} "
                f"rows: {_CAUSES[kind]} or its position may be wrong{others}"
            )
    return lines


def _means(sums: Residuals) -> Iterator[_SensorMean]:
    for column, by_sensor in sums.items():
        for name in by_sensor.totals:
            count, total, squares = by_sensor.sums(name)
            if not count:
                continue
            mean = total / count
            spread = math.sqrt(max(squares - count * mean * mean, 0.0) / (count - 1.0)) if count > 1.0 else math.nan
            yield _SensorMean(name=str(name), column=column, rows=int(count), mean=mean, std=spread)


def _shown(entry: _SensorMean) -> str:
    if _COLUMNS[entry.column] == "m":
        return f"{entry.mean:.4g} m"
    return f"{math.degrees(entry.mean):.4g} deg{' in elevation' if 'elevation' in entry.column else ''}"
