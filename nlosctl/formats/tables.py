"""Logs that are tables: a header and a record a line, separated by commas, tabs or semicolons, or JSON objects."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from nlosctl.contract.formats import BadLine, ForeignFile, Row, UnfitError
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.formats.fields import lines
from nlosctl.formats.json_objects import cells_of, json_objects

__all__ = ["LogTable", "Wide", "open_table"]

_SEPARATORS = (",", "\t", ";")

Record = tuple[int, BadLine | dict[str, str]]
"""The line of a record, and its cells or its fault."""


@dataclass(frozen=True, kw_only=True)
class Wide:
    """One column per sensor: of the columns that fit ``pattern`` each cell is a record of its own.

    Its cell has the name ``pattern`` and the sensor the name ``sensor``: what ``*`` matches, or the whole header if the
    sensor is ``known`` by it. Empty cells are no measurements.
    """

    pattern: str
    sensor: str
    known: Sequence[str]

    def names(self, columns: Sequence[str], others: Sequence[str]) -> dict[str, str]:
        """Return the sensor of each column that fits and is not one of the ``others``."""
        start, *ends = self.pattern.split("*")
        if len(ends) != 1:
            raise UsageError(f"one column per sensor: a name with one * is expected. Got {self.pattern!r} instead.")
        fitting = {}
        for column in columns:
            inner = column[len(start) : len(column) - len(ends[0])]
            if column not in others and inner and column == f"{start}{inner}{ends[0]}":
                fitting[column] = column if column in self.known else inner
        return fitting


class LogTable:
    """An open table: its ``columns``, and its ``records``, a line and cells or a fault, which are read once."""

    def __init__(self, file: ForeignFile, columns: Sequence[str], records: Iterator[Record]) -> None:
        self.columns, self.records = list(columns), records
        self._file = file

    def require(self, wanted: Sequence[str]) -> None:
        """Raise DataError if the header lacks one of the columns."""
        for name in wanted:
            if name not in self.columns:
                known = ", ".join(known if known.isprintable() else repr(known) for known in self.columns)
                raise DataError(
                    f"{self._file.name}: no column {name!r}{did_you_mean(name, self.columns)}. The file has: {known}; "
                    "set the column names with `parameters` (columns of one sensor each: a name with *)"
                )

    def rows(
        self, wanted: Sequence[str], parse: Callable[[int, Mapping[str, str]], Row | None], wide: Wide | None = None
    ) -> Iterator[Row | BadLine]:
        """Yield ``parse(line, cells)`` of each record unless None, or a `BadLine` where it raises UnfitError.

        Raises DataError if the header lacks one of the columns ``wanted``, or if no column fits ``wide``.
        """
        self.require(wanted)
        sensors = {} if wide is None else wide.names(self.columns, wanted)
        if wide is not None and not sensors:
            raise DataError(f"{self._file.name}: no column fits {wide.pattern!r}. It has: {', '.join(self.columns)}")
        for line, record in self.records:
            if isinstance(record, BadLine):
                yield record
                continue
            for column, cells in _narrow(record, sensors, wide):
                try:
                    row = parse(line, cells)
                except UnfitError as unfit:
                    text = ",".join(record.values())
                    name = column if wide is not None and unfit.column == wide.pattern else unfit.column
                    yield BadLine(line=line, fault=unfit.fault, column=name, text=text)
                else:
                    if row is not None:
                        yield row


def _narrow(
    record: dict[str, str], sensors: Mapping[str, str], wide: Wide | None
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the record, or for each filled column of ``wide`` its header and the record of its sensor."""
    if wide is None:
        yield "", record
        return
    for column, sensor in sensors.items():
        if record[column]:
            yield column, {**record, wide.sensor: sensor, wide.pattern: record[column]}


def open_table(file: ForeignFile) -> LogTable:
    """Return a table with a header, or of JSON objects; raise DataError if the file is empty or not text."""
    start = file.stream.read(64)
    file.stream.seek(0)
    if start.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"["):
        return _objects(file)
    numbered = lines(file)
    first = next(numbered, None)
    if first is None:
        raise DataError(f"{file.name}: no rows: the file is empty")
    separator = max(_SEPARATORS, key=first[1].count)
    columns: list[str] = []
    for name in _header(first[1], separator, file):
        if name in columns:
            raise DataError(f"{file.name}: column {name!r} occurs twice; rename or drop one")
        columns.append(name)
    return LogTable(file, columns, _split(numbered, separator, columns))


def _objects(file: ForeignFile) -> LogTable:
    """Return the table of JSON objects: its columns are all of their keys, with an empty cell where one is absent."""
    found = list(json_objects(file))
    columns: dict[str, None] = {}
    for _, value in found:
        if not isinstance(value, BadLine):
            columns.update(dict.fromkeys(cells_of(value)))
    empty = dict.fromkeys(columns, "")
    records = ((line, value if isinstance(value, BadLine) else {**empty, **cells_of(value)}) for line, value in found)
    return LogTable(file, list(columns), records)


def _header(text: str, separator: str, file: ForeignFile) -> list[str]:
    try:
        return [name.strip() for name in _cells(text, separator)]
    except UnfitError as unfit:
        raise DataError(f"{file.name}, line 1: the header can't be read: {unfit.fault}") from None


def _split(numbered: Iterator[tuple[int, str]], separator: str, columns: Sequence[str]) -> Iterator[Record]:
    for line, text in numbered:
        try:
            cells = _cells(text, separator)
            if len(cells) != len(columns):
                raise UnfitError(f"got {len(cells)} fields, expected {len(columns)} as in the header")
        except UnfitError as unfit:
            yield line, BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text)
        else:
            yield line, {name: cell.strip() for name, cell in zip(columns, cells, strict=True)}


def _cells(text: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([text], delimiter=separator, skipinitialspace=separator != "\t", strict=True))
    except (csv.Error, StopIteration):
        raise UnfitError("the quotes don't match") from None
