"""A run of an engine into single files: its part files are gathered in order, for the bytes to be those of one go."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from nlosctl.contract.limits import size
from nlosctl.errors import DataError, UsageError
from nlosctl.io.parts.row_group_slices import sliced
from nlosctl.io.parts.scratch import read_part
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat, location
from nlosctl.pipeline.engine.folder_run import Engine
from nlosctl.pipeline.engine.id_order import IdOrder
from nlosctl.pipeline.engine.parts import PartWork
from nlosctl.pipeline.engine.writing import ChunkTables, Run

__all__ = ["gathered_tables"]


def gathered_tables(
    run: Run, inputs: Sequence[Input], tables: Sequence[str], engine: Engine, scratch: str
) -> Iterator[ChunkTables]:
    """Yield the tables of a run that ``engine`` makes, in input order, by way of part files in the folder ``scratch``.

    Raises UsageError where an input is a stream or bad rows are set aside.
    """
    reader = run.reader
    if any(part.path is None for given in inputs for part in given.parts):
        raise UsageError("standard input can't be shared out: save it as a file, or leave --engine out")
    if reader.sets_bad_rows_aside:
        raise UsageError("--engine with --bad-rows FILE: give -o and --bad-rows a folder each")
    pieces = sliced(inputs, size("task_rows"))
    places = [(group, place) for group, given in enumerate(pieces) for place in range(len(given.parts))]
    work = PartWork(
        command="",
        inputs=pieces,
        options=reader.options,
        found=reader.found(),
        start=run.again(),
        roots={table: str(location(scratch) / table) for table in tables},
        names=tuple(f"{number}.arrow" for number in range(len(places))),
        places=tuple(places),
        format=FileFormat.ARROW,
        with_hash=False,
    )
    order = IdOrder(pieces, reader)
    waiting: dict[int, dict[str, Any]] = {}
    rows = reader.report.rows_by_file
    awaited = 0
    for number, record in engine(work, range(len(places))):
        waiting[number] = record
        while awaited in waiting:
            record = waiting.pop(awaited)
            order.add(places[awaited][0], record["span"])
            run.report.take(record["counts"])
            rows[record["input"]] = rows.get(record["input"], 0) + record["rows"]
            named = {table: read_part(str(location(root) / work.names[awaited])) for table, root in work.roots.items()}
            yield ChunkTables(named=named, rows=record["rows"])
            awaited += 1
    for given in inputs:
        if not sum(rows[part.name] for part in given.parts):
            raise DataError(f"{given.name}: no rows: the file has columns and nothing else")
    run.add_notes(reader.report.remarks)
