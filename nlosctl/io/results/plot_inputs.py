"""Inputs of plots: the content of a file, and its rows as plain arrays, sampled if there are many."""

from __future__ import annotations

import dataclasses
import io
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.calibration import Calibration
from nlosctl.contract.random_streams import GOLDEN_RATIO
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import BOUND, ESTIMATES, FLAGS, POSTERIOR, SCORES, TRACE, result_table
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import kind_of_columns
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.readers.base import as_text
from nlosctl.io.readers.open_file import open_part
from nlosctl.io.results.evaluation_arrays import boolean_codes, numbers
from nlosctl.io.results.reader import PlainReader
from nlosctl.io.scenes.scene_file import find_scene

__all__ = [
    "PlotInput",
    "PlotSnapshot",
    "SampledRows",
    "as_array",
    "is_sampled",
    "open_plot_input",
    "read_rows_of_snapshot",
    "read_sampled",
    "read_snapshot",
    "with_missing_constants",
]

Columns = dict[str, npt.NDArray[Any]]

_TABLES = {table.name: table for table in (SCORES, BOUND, POSTERIOR, ESTIMATES, FLAGS)}


@dataclass(frozen=True, kw_only=True)
class PlotInput:
    """An input: its ``content`` (scores, bound, estimates, flags, measurements), kind of measurement and columns.

    That of a ``calibration`` has no columns, and the name of the ``method`` that made it.
    """

    content: str
    kind: str
    names: tuple[str, ...]
    scene: Scene
    source: Input
    spool: IO[bytes] | None = None
    calibration: Calibration | None = None
    method: str = ""
    metadata: Mapping[bytes, bytes] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name as the user specified it."""
        return self.source.name

    def input(self) -> Input:
        """Return the input, to be read from its beginning; it can be read again, standard input too."""
        if self.spool is None:
            return self.source
        return _rewound(self.source, self.spool)

    def close(self) -> None:
        """Discard the copy of standard input."""
        if self.spool is not None:
            self.spool.close()


@dataclass(frozen=True, kw_only=True)
class SampledRows:
    """Columns (N,) of some rows by name: numbers, text as objects, booleans as 1, 0 and -1 (null).

    ``total`` is the number of rows in the file; the sample has one in ``step`` snapshots.
    """

    columns: Columns
    total: int
    step: int

    @property
    def count(self) -> int:
        """The number of rows in the sample."""
        return len(next(iter(self.columns.values())))


@dataclass(frozen=True, kw_only=True)
class PlotSnapshot:
    """One snapshot of measurements: the contract's columns (K,), ``sensor`` as names, and all columns of the file.

    ``reference`` are the names of the references of differences, empty without. ``left_out`` (K,) marks rows that an
    earlier step flagged; ``dimension`` is that of the positions to estimate.
    """

    id: str
    kind: str
    scene: Scene
    columns: Columns
    sensor: Sequence[str]
    left_out: BoolArray
    reference: Sequence[str] = ()
    dimension: int = 2
    file_columns: Columns = field(default_factory=dict)


def open_plot_input(source: Input, read: InputOptions) -> PlotInput:
    """Return the content of an input, detected from its columns; raises DataError if it can't be read.

    Options that change rows are for measurements; other contents are read as they are.
    """
    spool = None
    if source.parts[0].stream is not None:
        spool = _spooled(source)
        opened = _rewound(source, spool)
    else:
        opened = source
    file = open_part(opened.parts[0], 1024, False)
    with closing(file):
        content = result_table(file.names)
        if read.changes_rows and content in (None, FLAGS):
            from nlosctl.io.row_steps.added_steps import add_row_steps

            add_row_steps(file, read, source.name)
        names, metadata = tuple(file.names), file.metadata
    return PlotInput(
        content="measurements" if content is None or content is TRACE else content.name,
        kind=read.kind or kind_of_columns(names),
        names=names,
        scene=find_scene(read.scene if isinstance(read.scene, str) else None, metadata, opened.path),
        source=source,
        spool=spool,
        metadata=metadata,
    )


def read_sampled(file: PlotInput, wanted: Sequence[str], limit: int | None) -> SampledRows:
    """Return those ``wanted`` columns that the file has, of at most ``limit`` rows: whole snapshots, evenly sampled.

    A name in ``wanted`` may end in ``*``. A snapshot ends where the id changes, so that the rows of several methods or
    targets stay together.
    """
    reader = PlainReader(file.input(), _TABLES[file.content])
    names = [name for name in reader.schema.names if _is_wanted(name, wanted)]
    kept: list[Columns] = []
    step, total, number, last = 1, 0, -1, None
    for table in reader.batches():
        if not table.num_rows:
            continue
        total += table.num_rows
        numbers_of_rows, number, last = _snapshot_numbers(table, number, last)
        chosen = is_sampled(numbers_of_rows, step)
        rows = table.select(names).filter(pa.array(chosen))
        kept.append({"": numbers_of_rows[chosen], **{name: as_array(rows.column(name)) for name in names}})
        while limit is not None and sum(part[""].shape[0] for part in kept) > limit and number >= step:
            step *= 2
            kept = [_only(part, is_sampled(part[""], step)) for part in kept]
    if not total:
        raise DataError(f"{file.name}: no rows")
    columns = {name: np.concatenate([part[name] for part in kept]) for name in names}
    return SampledRows(columns=columns, total=total, step=step)


def read_snapshot(file: PlotInput, options: InputOptions, snapshot: str | None) -> PlotSnapshot:
    """Return the measurements of one snapshot (default: the first); raises DataError if it does not exist."""
    reader = MeasurementReader([file.input()], with_missing_constants(options))
    try:
        for chunk in reader.chunks():
            ids = [str(word) for word in chunk.snapshot.to_pylist()]
            if snapshot is not None and snapshot not in ids:
                continue
            index = 0 if snapshot is None else ids.index(snapshot)
            rows = slice(int(chunk.offsets[index]), int(chunk.offsets[index + 1]))
            table = chunk.table.slice(rows.start, rows.stop - rows.start)
            columns = {name: values[rows] for name, values in chunk.columns.items()}
            return PlotSnapshot(
                id=ids[index],
                kind=reader.kind,
                scene=reader.scene,
                columns=columns,
                sensor=[reader.sensor_names[code] for code in columns.get("sensor", ())],
                left_out=chunk.left_out[rows],
                reference=[reader.sensor_names[code] for code in columns.get("reference", ())],
                dimension=reader.dimension,
                file_columns={name: as_array(table.column(name)) for name in table.column_names},
            )
    finally:
        reader.close()
    raise DataError(f"{file.name}: no snapshot {snapshot!r}")


def with_missing_constants(options: InputOptions) -> InputOptions:
    """Return the options with constants that give way to columns: all files of a figure share the options."""
    defaults = {**options.default_constants, **options.constants}
    return dataclasses.replace(options, constants={}, default_constants=defaults, unlabelled="marked")


def read_rows_of_snapshot(file: PlotInput, snapshot: str | None) -> tuple[str, Columns]:
    """Return the id and the columns (N,) of one snapshot of results (default: the first)."""
    reader = PlainReader(file.input(), _TABLES[file.content])
    tables: list[Any] = []
    wanted = snapshot
    for table in reader.batches():
        ids = table.column("snapshot").cast(pa.string())
        if wanted is None and table.num_rows:
            wanted = ids[0].as_py()
        mine = table.filter(pc.equal(ids, wanted))
        if mine.num_rows:
            tables.append(mine)
        elif tables:
            break
    if wanted is None or not tables:
        raise DataError(f"{file.name}: no snapshot {snapshot!r}")
    rows = pa.concat_tables(tables)
    return wanted, {name: as_array(rows.column(name)) for name in rows.column_names}


def as_array(column: Any) -> npt.NDArray[Any]:
    """Return a column (N,) as numbers (null: NaN), booleans as 1, 0 and -1 (null), the rest as text (null: empty)."""
    if pa.types.is_boolean(column.type):
        return boolean_codes(column)
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return numbers(column)
    encoded = as_text(pa.chunked_array(column).combine_chunks()).dictionary_encode()
    words = np.array([*encoded.dictionary.to_pylist(), ""], dtype=object)
    text: npt.NDArray[Any] = words[np.asarray(encoded.indices.fill_null(len(words) - 1))]
    return text


def _is_wanted(name: str, wanted: Sequence[str]) -> bool:
    return any(name == word or (word.endswith("*") and name.startswith(word[:-1])) for word in wanted)


def _snapshot_numbers(table: Any, number: int, last: Any) -> tuple[IntArray, int, Any]:
    """Return the snapshot number of each row, counted through the file, and the last number and id."""
    if "snapshot" not in table.column_names:
        rows = np.arange(number + 1, number + 1 + table.num_rows)
        return rows, int(rows[-1]), None
    ids = table.column("snapshot").combine_chunks()
    starts = np.ones(table.num_rows, dtype=np.int64)
    starts[1:] = np.asarray(pc.not_equal(ids[1:], ids[:-1]).fill_null(True))
    starts[0] = number < 0 or ids[0].as_py() != last
    rows = number + np.cumsum(starts)
    return rows, int(rows[-1]), ids[table.num_rows - 1].as_py()


def is_sampled(number: IntArray, step: int) -> BoolArray:
    """Return which snapshots are in a sample of one in ``step`` (a power of 2).

    Those whose number times the golden ratio has a fraction below 1 / step: evenly spread, and without the aliasing of
    every step-th snapshot.
    """
    fraction = number.astype(np.uint64) * GOLDEN_RATIO
    kept: BoolArray = fraction <= np.uint64(2**64 // step - 1)
    return kept


def _only(part: Columns, chosen: BoolArray) -> Columns:
    return {name: values[chosen] for name, values in part.items()}


def _spooled(source: Input) -> IO[bytes]:
    stream = source.parts[0].stream
    spool = tempfile.TemporaryFile()  # noqa: SIM115 - PlotInput.close closes it
    assert stream is not None  # noqa: S101 - asked before
    shutil.copyfileobj(stream, spool)
    stream.close()
    spool.flush()
    return spool


def _rewound(source: Input, spool: IO[bytes]) -> Input:
    spool.seek(0)
    stream = io.BufferedReader(io.FileIO(os.dup(spool.fileno())))
    return dataclasses.replace(source, parts=(dataclasses.replace(source.parts[0], stream=stream),))
