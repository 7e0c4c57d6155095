"""What is in measurements: read once, in bounded memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.plot_inputs import as_array
from nlosctl.pipeline.describe.arrival_spans import ArrivalSpans
from nlosctl.pipeline.describe.sensor_jumps import SensorJumps
from nlosctl.pipeline.describe.suspicions import Suspicion, of_cause, of_remarks
from nlosctl.pipeline.describe.times import RowTimes
from nlosctl.pipeline.describe.truth_directions import TruthDirections
from nlosctl.pipeline.describe.value_ranges import ValueRanges
from nlosctl.pipeline.solve.advice import Measured
from nlosctl.pipeline.solve.likely_causes import cause_remarks, fit_after_changes

__all__ = ["Description", "description_of"]

_ENOUGH_TRIED = 200
_LARGEST_SNAPSHOT = 1000


@dataclass
class Description:
    """The counts of measurements of one ``kind``, their values, times and suspicious things.

    ``repeats`` is the number of rows whose sensor has an earlier row, without a path number, in their snapshot,
    ``largest`` that of the rows in the largest snapshot, ``dimension`` that in which the rows are read.
    ``first_problem`` is the fault of the first bad row.
    """

    kind: str
    dimension: int = 2
    rows: int = 0
    bad_rows: int = 0
    snapshots: int = 0
    sensors: int = 0
    repeats: int = 0
    largest: int = 0
    values: ValueRanges = field(default_factory=ValueRanges)
    times: RowTimes = field(default_factory=RowTimes)
    jumps: SensorJumps = field(default_factory=SensorJumps)
    truth: TruthDirections = field(default_factory=TruthDirections)
    spans: ArrivalSpans = field(default_factory=ArrivalSpans)
    first_problem: str = ""
    suspicions: list[Suspicion] = field(default_factory=list)


def description_of(reader: MeasurementReader, progress: Callable[[int], None]) -> Description:
    """Read everything that a reader yields and return its description; bad rows are counted.

    ``progress`` receives the number of rows read so far.
    """
    found, tried = Description(kind=reader.kind, dimension=reader.dimension), Counter[str]()
    nodes: set[tuple[float, ...]] = set()
    for chunk in reader.chunks():
        progress(reader.report.rows_in_all)
        columns = {name: as_array(chunk.table.column(name)) for name in chunk.table.column_names}
        order = np.arange(len(chunk.left_out)) if chunk.windows is None else np.argsort(chunk.windows.origin)
        found.values.add(columns)
        sensors = _sensors(chunk, reader)
        in_file = {name: columns[name][order] for name in ("time", "time_s") if name in columns}
        found.times.add(in_file, [sensors[row] for row in order.tolist()])
        if "sensor_x_m" in chunk.columns:
            found.jumps.add(chunk.columns["sensor_x_m"], chunk.columns["sensor_y_m"], sensors)
        if found.kind == "triplets":
            places = np.stack([chunk.columns[name] for name in ("tx_x_m", "tx_y_m", "rx_x_m", "rx_y_m")], axis=1)
            nodes |= {tuple(place) for pair in np.unique(places, axis=0).tolist() for place in (pair[:2], pair[2:])}
        found.repeats += _repeats(chunk)
        found.largest = max(found.largest, int(np.diff(chunk.offsets).max()))
        found.truth.add(chunk, reader)
        found.spans.add(chunk, reader)
        if tried["tried"] < _ENOUGH_TRIED and np.diff(chunk.offsets).max() <= _LARGEST_SNAPSHOT:
            tried.update(fit_after_changes(chunk, reader))
    report = reader.report
    found.rows, found.bad_rows, found.snapshots = report.rows_taken, report.bad_rows, report.snapshots
    found.sensors = len(nodes) if found.kind == "triplets" else len(reader.sensor_names)
    found.first_problem = next(map(str, reader.log.first), "")
    measured = Measured.of(reader)
    causes = [] if found.truth.rows else cause_remarks(tried, measured)
    found.suspicions = [
        *found.values.suspicions(found.kind, found.sensors),
        *of_remarks(report.remarks, found.rows),
        *found.times.suspicions(),
        *found.jumps.suspicions(),
        *found.truth.suspicions(measured),
        *found.spans.suspicions(measured),
        *map(of_cause, causes),
    ]
    return found


def _sensors(chunk: Chunk, reader: MeasurementReader) -> Sequence[str]:
    """Return the name of each row's sensor (of triplets: of its path, as far as it has a number)."""
    codes = chunk.columns.get("sensor")
    if codes is not None:
        names = reader.sensor_names
        return [names[code] for code in codes.tolist()]
    return [str(number) for number in chunk.columns["path"].tolist()]


def _repeats(chunk: Chunk) -> int:
    codes: Any = chunk.columns.get("sensor")
    if codes is None or "path" not in chunk.columns:
        return 0
    snapshot = np.repeat(np.arange(chunk.offsets.shape[0] - 1), np.diff(chunk.offsets))
    rows = np.stack([snapshot, codes, chunk.columns["path"]], axis=1)
    return int(codes.shape[0] - np.unique(rows, axis=0).shape[0])
