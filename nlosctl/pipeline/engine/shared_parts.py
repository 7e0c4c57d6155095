"""Long parts of a folder output made from slices: an engine shares out row groups, this process joins the answers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from nlosctl.contract.limits import size
from nlosctl.errors import DataError, MethodError
from nlosctl.io.parts.row_group_slices import sliced
from nlosctl.io.parts.scratch import read_part, scratch_folder
from nlosctl.io.paths.locations import FileFormat, location
from nlosctl.pipeline.engine.folder_run import Engine, Records
from nlosctl.pipeline.engine.id_order import IdOrder
from nlosctl.pipeline.engine.parts import BAD_ROWS, PartWork
from nlosctl.pipeline.engine.writing import ChunkTables

__all__ = ["sharing_long_parts"]


def sharing_long_parts(engine: Engine) -> Engine:
    """Return an engine that makes parts as ``engine`` does, but long ones slice by slice.

    Long is a part of more slices than there are parts to make, where no bad rows are set aside. The bytes are the same.
    What goes wrong in a slice is found again in the whole part, to be told as it is there.
    """

    def make(work: PartWork, numbers: Sequence[int]) -> Records:
        if BAD_ROWS in work.roots:  # their order depends on how the rows are read
            yield from engine(work, numbers)
            return
        slices, of_part = _slices(work)
        long = [number for number in numbers if len(of_part[number]) > len(numbers)]
        short = [number for number in numbers if number not in long]
        yield from engine(work, short) if short else ()
        if long:
            with scratch_folder(next(iter(work.roots.values()))) as scratch:
                roots = {table: str(location(scratch) / table) for table in work.roots}
                yield from _joined(engine, work, replace(slices, roots=roots), {part: of_part[part] for part in long})

    return make


def _slices(work: PartWork) -> tuple[PartWork, list[list[int]]]:
    """Return the work on slices of the parts, and the numbers of those of each part."""
    places: list[tuple[int, int]] = []
    of_part: list[list[int]] = []
    behind = [0] * len(work.inputs)
    for group, place in work.places:
        given = work.inputs[group]
        count = len(sliced([replace(given, parts=(given.parts[place],))], size("task_rows"))[0].parts)
        of_part.append(list(range(len(places), len(places) + count)))
        places += [(group, behind[group] + number) for number in range(count)]
        behind[group] += count
    slices = replace(
        work,
        inputs=sliced(work.inputs, size("task_rows")),
        names=tuple(f"{number}.arrow" for number in range(len(places))),
        places=tuple(places),
        format=FileFormat.ARROW,
        with_hash=False,
    )
    return slices, of_part


def _joined(
    engine: Engine, work: PartWork, slices: PartWork, of_part: Mapping[int, Sequence[int]]
) -> Iterator[tuple[int, dict[str, Any]]]:
    order = IdOrder(slices.inputs, work.reader(next(iter(of_part))))
    part_of = {number: part for part, numbers in of_part.items() for number in numbers}
    records: dict[int, dict[str, Any]] = {}
    done = set()
    try:
        for number, record in engine(slices, list(part_of)):
            records[number] = record
            part = part_of[number]
            if all(number in records for number in of_part[part]):
                order_of = slices.places[number][0]
                for each in of_part[part]:
                    order.add(order_of, records[each]["span"])
                done.add(part)
                yield part, _join(work, part, slices, of_part[part], records)
    except (DataError, MethodError):
        yield from ((part, work.make(part)) for part in of_part if part not in done)


def _join(
    work: PartWork, part: int, slices: PartWork, numbers: Sequence[int], records: Mapping[int, Mapping[str, Any]]
) -> dict[str, Any]:
    """Write the files of a part from those of its slices, and return its record."""
    reader = work.reader(part)
    run = work.start(reader)
    name = records[numbers[0]]["input"]

    def tables() -> Iterator[ChunkTables]:
        for number in numbers:
            record = records[number]
            run.report.take(record["counts"])
            named = {
                table: read_part(str(location(root) / slices.names[number])) for table, root in slices.roots.items()
            }
            yield ChunkTables(named=named, rows=record["rows"])
        reader.report.rows_by_file[name] = sum(records[number]["rows"] for number in numbers)

    span = _span([records[number]["span"] for number in numbers])
    return work.write(part, reader, run, tables(), lambda: span)


def _span(spans: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the span of the ids of several slices that follow each other, as one reading of them tells it."""
    ends = [end for span in spans if span["first"] is not None for end in {span["first"]: 0, span["last"]: 0}]
    if not ends:
        return {"first": None, "last": None, "ordered": True}
    steps = list(pairwise(ends))
    sorted_ends = all(a < b for a, b in steps) or all(a > b for a, b in steps)
    return {"first": ends[0], "last": ends[-1], "ordered": sorted_ends and all(span["ordered"] for span in spans)}
