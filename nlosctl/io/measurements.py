"""Measurement files as chunks of whole snapshots, every value checked, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.contract.batches import BoolArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import Table
from nlosctl.errors import DataError
from nlosctl.io.columns import SNAPSHOT, kind_of_columns, kind_table
from nlosctl.io.duplicates import find_duplicates
from nlosctl.io.inputs import Input
from nlosctl.io.normalize import RunNames
from nlosctl.io.open_part import open_part
from nlosctl.io.open_tables import OpenedPart, TableOptions, open_table, plan_table, unified_schema
from nlosctl.io.pieces import Piece, join_pieces, read_pieces
from nlosctl.io.problems import BadRow, BadRowSink, Problem, ProblemLog
from nlosctl.io.read_report import ReadReport
from nlosctl.io.runs import ReturnWatch, run_starts
from nlosctl.io.scenes import find_scene

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


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How to read. ``kind`` None: told by the columns. ``renames``: contract's name -> file's name.

    ``scene`` is given as it is, or found as `nlosctl.io.scenes.find_scene` says, ``scene_file`` first.
    ``constants`` (contract's name -> value in its unit) stand in for missing columns. ``extra_columns``: those
    to keep in ``Chunk.table`` beside the measurement's own; None: all.
    """

    kind: str | None = None
    renames: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    scene: Scene | None = None
    scene_file: str | None = None
    all_rows: bool = False
    chunk_rows: int = 131_072
    max_snapshot_rows: int = 1_000_000
    use_threads: bool = True
    extra_columns: Sequence[str] | None = None


class MeasurementReader:
    """Reads inputs of one kind; ``kind``, ``schema``, ``metadata`` and ``scene`` are there before the first chunk.

    Bad rows go to ``bad_rows`` if given; else no chunk follows the first bad row, the rest is read for further
    problems, and a DataError tells them at the end. Raises DataError or UsageError for faults of a whole file.
    """

    def __init__(
        self, inputs: Sequence[Input], options: ReadOptions | None = None, bad_rows: BadRowSink | None = None
    ) -> None:
        self._options = options or ReadOptions()
        self._inputs = tuple(inputs)
        self._log = ProblemLog(bad_rows)
        self.report = ReadReport()
        self._held: dict[str, OpenedPart] = {}
        self._table: Table | None = kind_table(self._options.kind) if self._options.kind else None
        self.metadata, self.scene = self._find_scene()
        self._names = RunNames(self.scene)
        self.schema: Any = self._look_ahead()

    @property
    def kind(self) -> str:
        """The kind of measurement."""
        return self._kind_table.name

    @property
    def sensor_names(self) -> Sequence[str]:
        """The names behind the codes in ``columns['sensor']``; grows while reading."""
        return self._names.codes("sensor").names

    @property
    def _kind_table(self) -> Table:
        if self._table is None:
            raise AssertionError("the kind is known after the first file is opened")
        return self._table

    @property
    def has_several_sources(self) -> bool:
        """Whether several inputs are named, so that results must tell theirs."""
        return len(self._inputs) > 1

    def set_bad_rows_aside(self, sink: BadRowSink) -> None:
        """Hand bad rows to ``sink`` from now on and go on with the rest; call it before the first chunk."""
        self._log = ProblemLog(sink)

    def _find_scene(self) -> tuple[Mapping[bytes, bytes], Scene]:
        """Open the first file for its metadata, and return these and the scene."""
        group = self._inputs[0]
        source = open_part(group.parts[0], self._options.chunk_rows, self._options.use_threads)
        self._first_source = source
        try:
            if self._options.scene is not None:
                return source.metadata, self._options.scene
            return source.metadata, find_scene(self._options.scene_file, source.metadata, group.path)
        except BaseException:
            source.close()
            raise

    def _look_ahead(self) -> Any:
        """Open every file, check its columns, and return the schema that holds them all."""
        parts = [part for group in self._inputs for part in group.parts]
        schemas = []
        for number, part in enumerate(parts):
            if number == 0:
                opened = plan_table(part, self._first_source, self._table, self._table_options())
                self._table = opened.plan.table
            else:
                opened = open_table(part, self._table, self._table_options())
                if self._options.kind is None and kind_of_columns(opened.names) != self.kind:
                    raise DataError(
                        f"{part.name}: holds {kind_of_columns(opened.names)}, but {parts[0].name} holds {self.kind}; "
                        f"give files of one kind, or say --kind"
                    )
            schemas.append(opened.schema)
            if len(parts) == 1 or part.stream is not None:
                self._held[part.name] = opened
            else:
                opened.source.close()
        self._remark_on_snapshots(parts[0].name, schemas)
        return unified_schema(schemas)

    def _table_options(self) -> TableOptions:
        options = self._options
        return TableOptions(
            renames=options.renames,
            constants=options.constants,
            scene=self.scene,
            batch_rows=options.chunk_rows,
            use_threads=options.use_threads,
            extra_columns=options.extra_columns,
        )

    def _remark_on_snapshots(self, name: str, schemas: Sequence[Any]) -> None:
        with_ids = [SNAPSHOT in schema.names for schema in schemas]
        if not all(with_ids):
            self.report.remarks.append("without a 'snapshot' column each input is taken as one snapshot")
        if any(with_ids) and not all(with_ids):
            raise DataError(f"{name}: some of the files have a 'snapshot' column and some don't; give all one")

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of all inputs, in order; call it once."""
        for group in self._inputs:
            rows_before = self.report.rows
            for chunk in self._group_chunks(group):
                if self._log.total == 0 or not self._log.stops_the_run:
                    self.report.snapshots += len(chunk.snapshot)
                    self.report.left_out_rows += int(chunk.left_out.sum())
                    yield chunk
            if self.report.rows == rows_before:
                raise DataError(f"{group.name}: no rows: the file has columns and nothing else")
        self._log.raise_if_stopping()

    def close(self) -> None:
        """Close what is open; needed only where the chunks are not read to their end."""
        for opened in self._held.values():
            opened.source.close()
        self._held.clear()

    def _group_chunks(self, group: Input) -> Iterator[Chunk]:
        watch = ReturnWatch(group.name)
        pending: list[Piece] = []
        last: Any = None
        for piece in self._pieces(group):
            starts = self._starts(piece, last, bool(pending))
            watch.add(piece.file, piece.ids.take(pa.array(starts)), piece.rows[starts])
            last = piece.ids[len(piece.ids) - 1].as_py()
            piece = piece.with_starts(starts)
            whole, pending = _split(pending, piece)
            if whole:
                yield self._chunk(whole, group)
            self._check_size(pending, group)
        if pending:
            yield self._chunk(pending, group)

    def _starts(self, piece: Piece, last: Any, follows: bool) -> IntArray:
        return run_starts(piece.ids, last if follows else None)

    def _pieces(self, group: Input) -> Iterator[Piece]:
        for part in group.parts:
            opened = self._held.pop(part.name, None) or open_table(part, self._table, self._table_options())
            before = self.report.rows
            all_rows = self._options.all_rows
            try:
                for piece in read_pieces(opened, self.schema, self._names, all_rows, self._log, self.report):
                    if len(piece.ids):
                        yield piece
            finally:
                opened.source.close()
            self.report.rows_by_file[part.name] = self.report.rows - before

    def _check_size(self, pending: Sequence[Piece], group: Input) -> None:
        rows = sum(len(piece.ids) for piece in pending)
        limit = self._options.max_snapshot_rows
        if rows > limit and sum(piece.starts.shape[0] for piece in pending) <= 1:
            reason = "" if SNAPSHOT in self.schema.names else " (there is no 'snapshot' column)"
            raise DataError(
                f"{group.name}: a snapshot has more than {limit} rows{reason}, expected at most max_snapshot_rows; "
                f"raise --max-snapshot-rows if that is meant"
            )

    def _chunk(self, pieces: Sequence[Piece], group: Input) -> Chunk:
        whole = join_pieces(pieces)
        offsets = np.append(whole.starts, len(whole.ids))
        key = [whole.columns[name] for name in self._kind_table.row_key if name in whole.columns]
        repeated, first = find_duplicates(offsets, key)
        if repeated.shape[0]:
            whole = self._without_duplicates(pieces, whole, repeated, first)
            offsets = np.append(whole.starts, len(whole.ids))
        return Chunk(
            table=whole.table,
            snapshot=whole.ids.take(pa.array(whole.starts)),
            offsets=offsets,
            columns=whole.columns,
            left_out=whole.left_out,
            source=group.name,
        )

    def _without_duplicates(self, pieces: Sequence[Piece], whole: Piece, repeated: IntArray, first: IntArray) -> Piece:
        ends = np.cumsum([len(piece.ids) for piece in pieces])
        key = ", ".join(name for name in self._kind_table.row_key if name in whole.columns)
        rows = []
        for place, earlier in list(zip(repeated, first, strict=True))[: self._log.wanted()]:
            piece = pieces[int(np.searchsorted(ends, place, side="right"))]
            fault = (
                f"duplicate measurement: same snapshot, {key} as row {whole.rows[earlier]}; "
                f"drop one, or number them in a 'path' column"
            )
            problem = Problem(
                file=piece.file,
                row=int(whole.rows[place]),
                line=piece.line_of(int(whole.rows[place])),
                column=None,
                fault=fault,
            )
            rows.append(BadRow(problem=problem, values=whole.texts(int(place))))
        self._log.add(rows, total=repeated.shape[0])
        self.report.bad_rows += repeated.shape[0]
        keep = np.ones(len(whole.ids), dtype=np.bool_)
        keep[repeated] = False
        return whole.kept(keep)


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
