"""Measurement files as chunks of whole snapshots, every value checked, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import SNAPSHOT, NameCodes, are_flags_by_method
from nlosctl.io.measurements.duplicates import drop_duplicates, refuse_several_methods
from nlosctl.io.measurements.part_boundaries import PartBoundaries
from nlosctl.io.measurements.returned_ids import rejoined, returned_id
from nlosctl.io.measurements.row_batch import ReadReport, RowBatch, RowConverter, RowTally, join_rows, split_whole
from nlosctl.io.measurements.row_checks import TICKS, BadRowSink, ProblemLog, refuse_no_rows
from nlosctl.io.measurements.snapshot_ids import IdSpan, LostSnapshots, SnapshotIndex, id_type, integer_ids, run_starts
from nlosctl.io.measurements.survey import InputSurvey, open_table, survey_inputs
from nlosctl.io.measurements.windows.chunk_windows import WindowRows
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.parquet_arrow import parquet_end_value

__all__ = ["WHOLE", "Chunk", "MeasurementReader", "ReadReport", "refuse_no_rows"]

WHOLE = -1  # the index of a part that stands for all parts of an input


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Whole snapshots, in input order.

    ``table`` has the good rows (N,) with the input's columns and types, renamed columns under their new names,
    ``snapshot`` (S,) the ids as an Arrow array, ``offsets`` (S+1,) the rows of each; ``columns`` are the contract's
    flat columns (N,) in its units: float64, or int64 codes for ``sensor``, ``path`` and ``reflector``. ``left_out``
    (N,) marks rows that take no part: an earlier step flagged them, or a window does not keep them. ``source`` names
    the input. ``windows`` is there if the snapshots are windows of time.
    """

    table: Any
    snapshot: Any
    offsets: IntArray
    columns: Mapping[str, npt.NDArray[Any]]
    left_out: BoolArray
    source: str
    windows: WindowRows | None = None

    def snapshot_ids(self) -> IntArray | list[str]:
        """Return the snapshot ids as integers or text."""
        if pa.types.is_integer(self.snapshot.type):
            return integer_ids(self.snapshot)
        return [str(text) for text in self.snapshot.to_pylist()]


class MeasurementReader:
    """Reads inputs of one kind; ``kind``, ``schema``, ``metadata`` and ``scene`` are known before the first chunk.

    ``dimension`` is that of the positions to estimate, ``measured_columns`` are the contract's columns that the inputs
    have. ``table_schema`` is the schema of the tables of chunks, with ``snapshot`` if windows make it.
    Bad rows go to the sink ``bad_rows``. Without it no chunk follows the first bad row, the rest is read for further
    problems, and a DataError lists them at the end. Raises DataError or UsageError for a fault of a whole file.

    ``survey`` is that of an earlier reader of the same inputs, which is not repeated. ``only`` (index of the
    input, index of the part within) restricts the reader to snapshots that begin in that part, or (`WHOLE`) input.
    """

    def __init__(
        self,
        inputs: Sequence[Input],
        options: InputOptions | None = None,
        bad_rows: BadRowSink | None = None,
        *,
        survey: InputSurvey | None = None,
        only: tuple[int, int] | None = None,
    ) -> None:
        self.options = options or InputOptions()
        self._inputs = tuple(inputs)
        self._only = only
        self._survey = survey or survey_inputs(self._inputs, self.options)
        self.spans: list[IdSpan] = []
        self.report = ReadReport(remarks=list(self._survey.remarks))
        self._tally = RowTally(log=ProblemLog(bad_rows), report=self.report)
        self.metadata, self.scene = self._survey.metadata, self._survey.scene
        self.kind, self.dimension = self._survey.table.name, self._survey.table.dimension
        self.measured_columns = self._survey.measured_columns
        self.schema: Any = self._survey.schema
        named = self.options.window is not None
        self.table_schema: Any = self.schema.insert(0, pa.field(SNAPSHOT, pa.string())) if named else self.schema
        self._names: dict[str, NameCodes] = {}

    @property
    def sensor_names(self) -> Sequence[str]:
        """The names for the codes in ``columns['sensor']``; complete after the last chunk."""
        return self._names["sensor"].names if "sensor" in self._names else ()

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants in use, by the column that a file lacks."""
        return self._survey.constants

    @property
    def column_names(self) -> tuple[str, ...]:
        """All columns of the inputs, after renaming, whether they are read or not."""
        return self._survey.column_names

    @property
    def has_several_sources(self) -> bool:
        """Whether there are several inputs, so that results must name theirs."""
        return len(self._inputs) > 1

    @property
    def log(self) -> ProblemLog:
        """The log of the bad rows."""
        return self._tally.log

    @property
    def reads_one_part(self) -> bool:
        """Whether only the snapshots that begin in one part are read."""
        return self._only is not None

    @property
    def sets_bad_rows_aside(self) -> bool:
        """Whether bad rows go to a sink and don't stop the run."""
        return not self._tally.log.stops_the_run

    def set_bad_rows_aside(self, sink: BadRowSink) -> None:
        """Send bad rows to ``sink`` and continue with the others; call it before the first chunk."""
        self._tally.log = ProblemLog(sink)

    def survey(self) -> InputSurvey:
        """Return the survey of the inputs, without open files, for further readers of them."""
        self.close()
        return self._survey

    def close(self) -> None:
        """Close open files; needed only if the chunks are not read to their end."""
        self._survey.close()

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of all inputs (or of one part), in order; call it once."""
        for given in self._inputs if self._only is None else (self._inputs[self._only[0]],):
            rows_before = self.report.rows_in_all
            if self.options.window is not None:
                yield from filter(None, map(self._wanted, self._windows(given)))
                self._require_rows(given, rows_before)
                continue
            snapshots = _Snapshots(given, self._survey, self.options, self._tally, self._names)
            # no variable refers to a chunk or its rows while it is solved, so that one of them is in memory at a time
            yield from filter(None, map(self._wanted, map(snapshots.add, self._row_batches(given))))
            yield from filter(None, map(self._wanted, (snapshots.rest(),)))
            self.spans.append(snapshots.span)
            self._require_rows(given, rows_before)
        self._tally.log.raise_if_stopping()
        if self._only is None:
            refuse_no_rows(self._inputs, self.report.rows_taken, self.report)
            self.report.remarks += self.report.remarks_on_all(self.scene)
        if self.report.snapshots_lost:
            self.report.remarks.append(f"all rows of {self.report.snapshots_lost} snapshots are bad: they are left out")

    def _require_rows(self, given: Input, rows_before: int) -> None:
        if self.report.rows_in_all == rows_before and self._only is None:
            raise DataError(f"{given.name}: no rows: the file has columns only")

    def _wanted(self, chunk: Chunk | None) -> Chunk | None:
        """Return the chunk with what its columns imply, counted; None without one, or if a fault stops the run."""
        if chunk is None or (self._tally.log.total and self._tally.log.stops_the_run):
            return None
        self.report.snapshots += len(chunk.snapshot)
        left_out = chunk.left_out if chunk.windows is None else chunk.left_out & chunk.windows.leads
        self.report.left_out_rows += int(left_out.sum())
        if self.options.speed_std_m_s or self.options.calibration or {"target_z_m", "reference"} & chunk.columns.keys():
            from nlosctl.io.measurements.completion.completed_rows import completed_chunk

            chunk = completed_chunk(chunk, self.sensor_names, self.scene, self.options, self.report)
        return chunk

    def _row_batches(self, given: Input) -> Iterator[RowBatch]:
        """Yield the good rows of an input, or of the snapshots that begin in one part."""
        self._tally.lost = LostSnapshots()
        if self._only is None:
            for part in given.parts:
                yield from self._rows(part, self._tally)
        else:
            index = self._only[1]
            others = PartBoundaries(parts=given.parts, index=index, read=self._uncounted_rows, end_id=self._end_id)
            preceding = others.preceding_id()
            self._tally.lost = LostSnapshots(None if preceding is None else preceding.as_py())
            yield from others.rows(self._rows(given.parts[index], self._tally), preceding)
        self.report.snapshots_lost += self._tally.lost.count

    def _windows(self, given: Input) -> Iterator[Chunk]:
        """Yield the windows of an input, or those whose first row is in one part."""
        from nlosctl.io.measurements.windows.window_rows import WindowedRows

        own = None if self._only is None or self._only[1] == WHOLE else self._only[1]
        self.spans.append(IdSpan(first=None, last=None, ordered=True))  # no window is in two parts
        names = self._names.setdefault("sensor", NameCodes())
        windows = WindowedRows(given, self._survey.time_column, self.options, self._tally, names)
        batches = (
            (index, rows)
            for index, part in enumerate(given.parts)
            for rows in (self._rows(part, self._tally) if own in (None, index) else self._uncounted_rows(part))
        )
        yield from windows.chunks(batches, self._survey.table.row_key, own)

    def _rows(self, part: Part, tally: RowTally) -> Iterator[RowBatch]:
        tally.report.rows_by_file.setdefault(part.name, 0)
        opened = self._survey.open_tables.pop(part.name, None)
        opened = opened or open_table(part.again(), self._survey.table, self.options, self.scene)
        try:
            rows = RowConverter(opened, self.schema, self.scene, self._names, tally, all_rows=self.options.all_rows)
            yield from filter(len, map(rows.convert, opened.file.batches()))
            rows.checks.refuse_other_units()
        finally:
            opened.file.close()

    def _uncounted_rows(self, part: Part) -> Iterator[RowBatch]:
        return self._rows(part, RowTally(log=ProblemLog(lambda rows: None)))

    def _end_id(self, part: Part, index: int) -> Any:
        """See PartBoundaries: None if rows are left out or set aside, since the row at the end may be one of them."""
        if self.sets_bad_rows_aside or self.options.drops_rows or SNAPSHOT not in self.schema.names:
            return None
        value = parquet_end_value(part, self.options.columns.get(SNAPSHOT, SNAPSHOT), index)
        if value is None:
            return None
        kind = id_type(self.schema)
        return pa.scalar(str(value) if pa.types.is_string(kind) else int(value), kind)


class _Snapshots:
    """Joins the row batches of one input to chunks of whole snapshots."""

    def __init__(
        self, given: Input, survey: InputSurvey, options: InputOptions, tally: RowTally, names: Mapping[str, NameCodes]
    ) -> None:
        self._input, self._survey, self._tally, self._names = given, survey, tally, names
        self._column = options.columns.get(SNAPSHOT, SNAPSHOT)
        self._most_rows, self._keeps_times = options.max_snapshot_rows, bool(options.keep_times)
        self._index = SnapshotIndex()
        self._pending: list[RowBatch] = []
        self._last: Any = None

    @property
    def span(self) -> IdSpan:
        """The span of the snapshot ids."""
        return self._index.span

    def add(self, rows: RowBatch) -> Chunk | None:
        """Return the snapshots that the rows complete, if any; the last one waits for more rows."""
        starts = run_starts(rows.ids, self._last)
        seen = self._index.add(rows.file, rows.ids.take(pa.array(starts)), rows.rows[starts])
        if seen is not None:
            raise DataError(returned_id(rows, int(starts[seen.at]), seen, self._input, self._column))
        self._last = rows.ids[len(rows) - 1].as_py()
        whole, self._pending = split_whole(self._pending, replace(rows, starts=starts))
        chunk = self._chunk(whole) if whole else None
        if sum(batch.starts.shape[0] for batch in self._pending) <= 1:
            self._refuse_huge(sum(map(len, self._pending)))
        return chunk

    def rest(self) -> Chunk | None:
        """Return the last snapshot, if any."""
        return self._chunk(self._pending) if self._pending else None

    def _chunk(self, batches: Sequence[RowBatch]) -> Chunk:
        whole = join_rows(batches)
        if are_flags_by_method(self._survey.column_names) and "method" in whole.table.column_names:
            refuse_several_methods(whole.table, whole.starts, self._input.name)
        table = self._survey.table
        if batches[0].file != batches[-1].file:
            self._tally.report.rejoined += rejoined(batches, whole, table.measurement_name or "sensor")
        key = (*table.row_key, *([TICKS] if self._keeps_times and table.row_key else []))
        if key and self._survey.one_station:
            from nlosctl.io.measurements.one_station import number_repeats

            whole = number_repeats(whole, key, self._names["sensor"])
        elif key and not whole.rises(key[0]):
            whole = drop_duplicates(batches, whole, key, self._tally)
        self._refuse_huge(int(np.diff(whole.starts, append=len(whole)).max()))
        return Chunk(
            table=whole.table,
            snapshot=whole.ids.take(pa.array(whole.starts)),
            offsets=np.append(whole.starts, len(whole)),
            columns={name: values for name, values in whole.columns.items() if self._keeps_times or name != TICKS},
            left_out=whole.left_out,
            source=self._input.name,
        )

    def _refuse_huge(self, rows: int) -> None:
        if rows > self._most_rows:
            reason = "" if SNAPSHOT in self._survey.schema.names else " (there is no 'snapshot' column)"
            raise DataError(
                f"{self._input.name}: a snapshot has more than {self._most_rows} rows{reason}, expected at most "
                f"max_snapshot_rows; raise `max_snapshot_rows` if that is meant"
            )
