"""Measurement files as chunks of whole snapshots, every value checked, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.errors import DataError
from nlosctl.io.measurements.bad_rows import BadRowSink, ProblemLog
from nlosctl.io.measurements.column_mapping import SNAPSHOT
from nlosctl.io.measurements.duplicates import drop_duplicates
from nlosctl.io.measurements.mapped_file import open_table
from nlosctl.io.measurements.method_flags import METHOD, are_flags_by_method, refuse_several_methods
from nlosctl.io.measurements.normalize import Normalizer, RunNames
from nlosctl.io.measurements.options import ReadOptions, ReadReport
from nlosctl.io.measurements.part_boundaries import Neighbours, pieces_beginning_in
from nlosctl.io.measurements.row_batch import Piece, join_pieces, read_pieces
from nlosctl.io.measurements.snapshot_ids import IdSpan, LostSnapshots, ReturnWatch, run_starts, sort_hint
from nlosctl.io.measurements.survey import LookAhead, look_ahead
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.parquet_arrow import parquet_end_value

__all__ = ["Chunk", "MeasurementReader", "ReadOptions", "ReadReport"]


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Whole snapshots, in input order.

    ``table`` has the good rows (N,) with the input's columns as they came (renamed by ``--column`` only),
    ``snapshot`` (S,) the ids as an Arrow array, ``offsets`` (S+1,) the rows of each; ``columns`` are the contract's
    flat columns (N,) in its units: float64, or int64 codes for ``sensor``, ``path`` and ``reflector``. ``left_out``
    (N,) marks rows that an earlier step flagged. ``source`` names the input.
    """

    table: Any
    snapshot: Any
    offsets: IntArray
    columns: Mapping[str, npt.NDArray[Any]]
    left_out: BoolArray
    source: str

    def snapshot_ids(self) -> IntArray | list[str]:
        """Return the snapshot ids as integers or text."""
        if pa.types.is_integer(self.snapshot.type):
            ids: IntArray = self.snapshot.cast(pa.int64()).to_numpy()
            return ids
        return [str(text) for text in self.snapshot.to_pylist()]


class MeasurementReader:
    """Reads inputs of one kind; ``kind``, ``schema``, ``metadata`` and ``scene`` are there before the first chunk.

    Bad rows go to ``bad_rows`` if given; else no chunk follows the first bad row, the rest is read for further
    problems, and a DataError tells them at the end. Raises DataError or UsageError for faults of a whole file.

    With ``found``, what an earlier reader of the same inputs learnt, nothing is looked at again; ``only`` (place of
    the input, place of the part within) then reads the snapshots that begin in this part, with their rows in
    parts that follow.
    """

    def __init__(
        self,
        inputs: Sequence[Input],
        options: ReadOptions | None = None,
        bad_rows: BadRowSink | None = None,
        *,
        found: LookAhead | None = None,
        only: tuple[int, int] | None = None,
    ) -> None:
        self._options = options or ReadOptions()
        self._inputs = tuple(inputs)
        self._log = ProblemLog(bad_rows)
        self._only = only
        self._found = found or look_ahead(self._inputs, self._options)
        self.spans: list[IdSpan] = []
        self.report = ReadReport(remarks=list(self._found.remarks))
        self.metadata, self.scene = self._found.metadata, self._found.scene
        self.schema: Any = self._found.schema
        self._names = RunNames(self.scene)

    @property
    def kind(self) -> str:
        """The kind of measurement."""
        return self._found.table.name

    @property
    def sensor_names(self) -> Sequence[str]:
        """The names behind the codes in ``columns['sensor']``; grows while reading."""
        return self._names.codes("sensor").names

    @property
    def column_names(self) -> tuple[str, ...]:
        """All columns that the inputs have, also those that are not kept; ``--column`` is applied."""
        return self._found.column_names

    @property
    def constants(self) -> Mapping[str, float]:
        """The values that stand in for missing columns, by the contract's names and in its units."""
        return self._options.constants

    @property
    def has_several_sources(self) -> bool:
        """Whether several inputs are named, so that results must tell theirs."""
        return len(self._inputs) > 1

    def set_bad_rows_aside(self, sink: BadRowSink) -> None:
        """Hand bad rows to ``sink`` from now on and go on with the rest; call it before the first chunk."""
        self._log = ProblemLog(sink)

    @property
    def options(self) -> ReadOptions:
        """How the inputs are read."""
        return self._options

    @property
    def reads_one_part(self) -> bool:
        """Whether only the snapshots that begin in one part are read."""
        return self._only is not None

    @property
    def sets_bad_rows_aside(self) -> bool:
        """Whether bad rows are handed on, rather than ending the run."""
        return not self._log.stops_the_run

    def found(self) -> LookAhead:
        """Return what is known of the inputs, without open files, for further readers of them."""
        self.close()
        return self._found

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of all inputs (or of one part), in order; call it once."""
        for group in self._inputs if self._only is None else (self._inputs[self._only[0]],):
            rows_before = self.report.rows_in_all
            yield from filter(self._goes_out, self._group_chunks(group))
            if self.report.rows_in_all == rows_before and self._only is None:
                raise DataError(f"{group.name}: no rows: the file has columns and nothing else")
        self._log.raise_if_stopping()
        if self.report.snapshots_lost:
            self.report.remarks.append(f"all rows of {self.report.snapshots_lost} snapshots are bad: they are left out")

    def _goes_out(self, chunk: Chunk) -> bool:
        """Return whether the run has no fault that stops it so far; the chunk is counted then."""
        if self._log.total and self._log.stops_the_run:
            return False
        self.report.snapshots += len(chunk.snapshot)
        self.report.left_out_rows += int(chunk.left_out.sum())
        return True

    def close(self) -> None:
        """Close what is open; needed only where the chunks are not read to their end."""
        for opened in self._found.held.values():
            opened.source.close()
        self._found.held.clear()

    def _group_chunks(self, group: Input) -> Iterator[Chunk]:
        column = self._options.renames.get(SNAPSHOT, SNAPSHOT)
        watch = ReturnWatch(column, sort_hint(group, column))
        pending: list[Piece] = []
        last: Any = None
        for piece in self._pieces(group):
            starts = self._starts(piece, last, bool(pending))
            watch.add(piece.file, piece.ids.take(pa.array(starts)), piece.rows[starts])
            last = piece.ids[len(piece.ids) - 1].as_py()
            piece = piece.with_starts(starts)
            whole, pending = _split(pending, piece)
            if whole:
                ready = [self._chunk(whole, group)]
                del whole, piece  # not held while the chunk is solved
                yield ready.pop()
            self._check_size(pending, group)
        if pending:
            yield self._chunk(pending, group)
        self.spans.append(watch.span)

    def _starts(self, piece: Piece, last: Any, follows: bool) -> IntArray:
        return run_starts(piece.ids, last if follows else None)

    def _pieces(self, group: Input) -> Iterator[Piece]:
        lost = LostSnapshots()

        def read(part: Part) -> Iterator[Piece]:
            before = self.report.rows_in_all
            yield from self._read(part, self._log, lost, self.report)
            rows = self.report.rows_by_file.get(part.name, 0)
            self.report.rows_by_file[part.name] = rows + self.report.rows_in_all - before

        def read_quietly(part: Part) -> Iterator[Piece]:
            return self._read(part, ProblemLog(lambda rows: None), LostSnapshots(), ReadReport())

        def read_own(part: Part, begun: Any) -> Iterator[Piece]:
            nonlocal lost
            lost = LostSnapshots(begun)
            return read(part)

        if self._only is not None:
            others = Neighbours(read=read_quietly, end_id=self._end_id)
            yield from pieces_beginning_in(group.parts, self._only[1], read_own, others)
        else:
            for part in group.parts:
                yield from read(part)
        self.report.snapshots_lost += lost.count

    def _end_id(self, part: Part, place: int) -> Any:
        """See Neighbours; a row that is set aside is no end of a snapshot."""
        if not self._log.stops_the_run or SNAPSHOT not in self.schema.names:
            return None
        value = parquet_end_value(part, self._options.renames.get(SNAPSHOT, SNAPSHOT), place)
        if value is None:
            return None
        is_integer = pa.types.is_integer(self.schema.field(SNAPSHOT).type)
        return pa.scalar(int(value), pa.int64()) if is_integer else pa.scalar(str(value), pa.string())

    def _read(self, part: Part, log: ProblemLog, lost: LostSnapshots, report: ReadReport) -> Iterator[Piece]:
        opened = self._found.held.pop(part.name, None) or open_table(part, self._found.table, self._found.options)
        normalizer = Normalizer(opened.plan, self._names, part.name, self._options.all_rows)
        try:
            for piece in read_pieces(opened, self.schema, normalizer, log, lost, report):
                if len(piece.ids):
                    yield piece
        finally:
            opened.source.close()

    def _check_size(self, pending: Sequence[Piece], group: Input) -> None:
        if sum(piece.starts.shape[0] for piece in pending) <= 1:
            self._refuse_huge(sum(len(piece.ids) for piece in pending), group)

    def _refuse_huge(self, rows: int, group: Input) -> None:
        limit = self._options.max_snapshot_rows
        if rows > limit:
            reason = "" if SNAPSHOT in self.schema.names else " (there is no 'snapshot' column)"
            raise DataError(
                f"{group.name}: a snapshot has more than {limit} rows{reason}, expected at most max_snapshot_rows; "
                f"raise --max-snapshot-rows if that is meant"
            )

    def _chunk(self, pieces: Sequence[Piece], group: Input) -> Chunk:
        joined = join_pieces(pieces)
        if METHOD in joined.table.column_names and are_flags_by_method(self.column_names):
            refuse_several_methods(joined.table, joined.starts, group.name)
        whole = drop_duplicates(pieces, joined, self._found.table.row_key, self._log, self.report)
        self._refuse_huge(int(np.diff(whole.starts, append=len(whole.ids)).max()), group)
        return Chunk(
            table=whole.table,
            snapshot=whole.ids.take(pa.array(whole.starts)),
            offsets=np.append(whole.starts, len(whole.ids)),
            columns=whole.columns,
            left_out=whole.left_out,
            source=group.name,
        )


def _split(pending: list[Piece], piece: Piece) -> tuple[list[Piece], list[Piece]]:
    """Return the pieces that are whole snapshots now, and those that wait for more rows."""
    if not pending:
        return [], [piece]
    if piece.starts.shape[0] and piece.starts[0] == 0:
        return pending, [piece]
    with_starts = [place for place, held in enumerate(pending) if held.starts.shape[0]]
    last = with_starts[-1]
    cut = int(pending[last].starts[-1])
    head = [*pending[:last], *([pending[last].slice(0, cut)] if cut else [])]
    if head:
        return head, [pending[last].slice(cut, len(pending[last].ids)), *pending[last + 1 :], piece]
    return [], [*pending, piece]
