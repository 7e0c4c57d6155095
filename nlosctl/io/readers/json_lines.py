"""Reader of JSON Lines, plain or gzipped: an object on each line, read in blocks."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import IO, Any

import msgspec
import numpy as np
import pyarrow as pa

from nlosctl.contract.limits import limit, refusal_hint, size
from nlosctl.contract.tables import ColumnType, contract_names
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import CellFault, LineFault, RecordBatch, closed_on_failure, readable
from nlosctl.io.readers.json_columns import NameSurvey, json_column, json_text
from nlosctl.io.readers.text_files import arrow_type_of, open_bytes, shown

__all__ = ["JsonBlock", "JsonLinesReader"]


class JsonBlock:
    """The objects on some lines, with their line numbers, and the faults of other lines."""

    def __init__(self, first_line: int, lines: Sequence[bytes]) -> None:
        self.objects: list[dict[str, Any]] = []
        self.numbers: list[int] = []
        self.faults: list[LineFault] = []
        for number, line in enumerate(lines, start=first_line):
            if line.strip():
                self._take(number, line)

    def _take(self, number: int, line: bytes) -> None:
        with suppress(msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            fast = msgspec.json.decode(line)
            if isinstance(fast, dict) and line.count(b":") == len(fast):  # then no name occurs twice
                self.objects.append(fast)
                self.numbers.append(number)
                return
        try:
            parsed = _DECODER.decode(line.decode("utf-8-sig" if number == 1 else "utf-8"))
            if b"\\u" in line and isinstance(parsed, dict):
                "".join(parsed).encode()
        except _TwiceError as error:
            self._refuse(number, line, f"duplicate name {shown(error.args[0])}, expected each name once")
        except UnicodeDecodeError as error:
            self._refuse(number, line, f"byte 0x{line[error.start]:02x} is not UTF-8; save the file as UTF-8")
        except UnicodeEncodeError:
            self._refuse(number, line, "a name contains half of a surrogate pair, expected Unicode text")
        except json.JSONDecodeError as error:
            self._refuse(number, line, f"not JSON at character {error.colno}: {error.msg}")
        except RecursionError:
            self._refuse(number, line, "brackets are nested too deeply, expected an object of plain values")
        except ValueError:
            self._refuse(number, line, "an integer has thousands of digits, expected a number within 1e308")
        else:
            if isinstance(parsed, dict):
                self.objects.append(parsed)
                self.numbers.append(number)
            else:
                self._refuse(number, line, f'got {shown(parsed)}, expected an object like {{"sensor": ...}}')

    def _refuse(self, number: int, line: bytes, fault: str) -> None:
        text = line.decode("utf-8", errors="backslashreplace").rstrip("\r\n")
        self.faults.append(LineFault(row=number, line=number, fault=fault, text=text))


class _TwiceError(ValueError):
    pass


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        names = [name for name, _ in pairs]
        raise _TwiceError(next(name for name in names if names.count(name) > 1))
    return members


_DECODER = json.JSONDecoder(object_pairs_hook=_object)

_BLOCK_BYTES = 64 << 20

_FEWEST_WRONG = 5


class JsonLinesReader:
    """A JSON Lines file; the number of a row is its line.

    A file of more than a block (32768 lines or 64 MiB) is read twice, first for the names and types in all of it. A
    stream can't be read twice: its first block determines them, and a later value of another type is a bad row in a
    column of the contract, an error in any other.
    """

    metadata: Mapping[bytes, bytes] = {}
    accepted_texts: Collection[str] = ()

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        with readable(part.name, "JSON Lines file"):
            self._stream: IO[bytes] = open_bytes(part)
        with readable(part.name, "JSON Lines file"), closed_on_failure(self._stream):
            self._blocks = _read_blocks(self._stream, part.name)
            self._first = next(self._blocks, None)
            if self._first is not None:
                self._check_format(self._first)
            self._second = next(self._blocks, None)
            self._guessed = self._second is not None and part.path is None
            self._surveys = self._survey()
        self.names: tuple[str, ...] = tuple(self._surveys)
        self._kept: list[str] = list(self.names)
        self._all_names = True
        self._contract: Mapping[str, ColumnType] = {}
        self._types: dict[str, ColumnType] = {}

    def _check_format(self, first: JsonBlock) -> None:
        if not first.faults or (first.numbers and first.faults[0].line > first.numbers[0]):
            return
        fault = first.faults[0]
        start = fault.text.lstrip("\ufeff \t")
        if start.startswith("[") and (start.rstrip() in ("[", "[]") or start.lstrip("[ ").startswith("{")):
            raise DataError(
                f"{self._part.name}: contains a JSON array, expected JSON Lines: an object on each line; "
                f"convert it: jq -c '.[]' FILE"
            )
        if not first.objects:
            hint = "; if this is CSV, give `input_format` csv" if "," in start and start[:1] not in "{[" else ""
            raise DataError(f"{self._part.name}, line {fault.line}: {fault.fault}{hint}")

    def _survey(self) -> dict[str, NameSurvey]:
        """Return the survey of each name, in the order of their first appearance."""
        surveys: dict[str, NameSurvey] = {}
        if self._second is None or self._guessed:
            _add(surveys, self._first)
            return surveys
        with open_bytes(self._part) as stream:
            for block in _read_blocks(stream, self._part.name):
                _add(surveys, block)
        return surveys

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See FormatReader."""
        self._kept = list(self.names if columns is None else columns)
        self._all_names = columns is None
        self._contract = types
        for name in self._kept:
            wanted = types.get(name)
            if wanted is None:
                wanted = self._surveys[name].own_type(name)
            elif wanted == "identifier":
                wanted = self._surveys[name].identifier_type()
            elif wanted == "exact":
                wanted = self._surveys[name].exact_type()
            self._types[name] = wanted
            if name in types:
                self._refuse_wrong_column(name)
        return pa.schema([(name, arrow_type_of(self._types[name])) for name in self._kept])

    def _refuse_wrong_column(self, name: str) -> None:
        rows = self._first.objects if self._first is not None else []
        values = [row[name] for row in rows[:100] if row.get(name) is not None and row[name] not in self.accepted_texts]
        if self._types[name] not in ("number", "integer", "boolean") or self._contract[name] == "identifier":
            return
        _, faults = json_column(values, self._types[name], name, self._contract[name])
        if len(values) >= _FEWEST_WRONG and len(faults) == len(values):
            raise DataError(
                f"{self._part.name}, column {name!r}: wrong type: in all of the first {len(values)} rows "
                f"{faults[0].fault}; convert the column, or read another under this name with `columns`"
            )

    def batches(self) -> Iterator[RecordBatch]:
        """See FormatReader."""
        with readable(self._part.name, "JSON Lines file"):
            block, later = self._first, self._second
            self._first = self._second = None
            while block is not None:
                yield from self._in_batches(block)
                block, later = later, next(self._blocks, None)

    def _in_batches(self, block: JsonBlock) -> Iterator[RecordBatch]:
        faults: Sequence[LineFault] = block.faults
        for start in range(0, max(len(block.objects), 1), self._batch_rows):
            stop = start + self._batch_rows
            yield self._converted(block, slice(start, stop), faults)
            faults = ()

    def _converted(self, block: JsonBlock, part: slice, bad_lines: Sequence[LineFault]) -> RecordBatch:
        objects = block.objects[part]
        numbers = np.array(block.numbers[part], dtype=np.int64)
        columns, faults = [], self._unknown_names(objects, numbers)
        for name in self._kept:
            values = [row.get(name) for row in objects]
            column, unfit = json_column(values, self._types[name], name, self._contract.get(name))
            if unfit and self._guessed and name not in self._contract:
                raise self._misguessed(name, unfit[0].fault, int(numbers[unfit[0].index]))
            columns.append(column)
            faults += unfit
        text = None
        if faults:
            texts = [pa.array([json_text(row.get(name)) for row in objects], pa.string()) for name in self._kept]
            text = pa.RecordBatch.from_arrays(texts, names=self._kept)
        return RecordBatch(
            table=pa.RecordBatch.from_arrays(columns, names=self._kept),
            first_row=0,
            rows=numbers,
            lines=numbers,
            text=text,
            cell_faults=faults,
            line_faults=bad_lines,
        )

    def _unknown_names(self, objects: Sequence[dict[str, Any]], numbers: Any) -> list[CellFault]:
        """Return the faults of rows with a new name of the contract; other new names are an error if all are wanted."""
        known = self._surveys.keys()
        faults = []
        for index, row in enumerate(objects):
            new = sorted(row.keys() - known) if not row.keys() <= known else []
            for name in new:
                if name in contract_names():
                    fault = f"the name is not among those of the first {size('json_block_lines')} lines"
                    faults.append(CellFault(index=index, column=name, fault=fault))
                    break
                if self._all_names:
                    raise self._misguessed(name, f"got {shown(row[name])} under a new name", int(numbers[index]))
        return faults

    def _misguessed(self, name: str, fault: str, line: int) -> DataError:
        return DataError(
            f"{self._part.name}, line {line}, column {name!r}: {fault}; columns that are not in the contract are "
            f"inferred from the first {size('json_block_lines')} lines of a stream: save it as a file to use all rows"
        )

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def _read_blocks(stream: IO[bytes], name: str) -> Iterator[JsonBlock]:
    line = 1
    while lines := list(_some_lines(stream, name, line)):
        yield JsonBlock(line, lines)
        line += len(lines)


def _some_lines(stream: IO[bytes], name: str, first: int) -> Iterator[bytes]:
    """Yield the lines of a block; raise DataError for one that is too long to be a row."""
    longest, taken = limit("line_bytes"), 0
    for number in range(first, first + size("json_block_lines")):
        line = stream.readline(longest + 1)
        if len(line) > longest:
            raise DataError(
                f"{name}, line {number}: the line is longer than {longest} bytes, expected a row; "
                f"{refusal_hint('line_bytes')}"
            )
        taken += len(line)
        if line:
            yield line
        if not line or taken > _BLOCK_BYTES:
            return


def _add(surveys: dict[str, NameSurvey], block: JsonBlock | None) -> None:
    objects = block.objects if block is not None else []
    for name in dict.fromkeys(name for row in objects for name in row):
        surveys.setdefault(name, NameSurvey()).add([row[name] for row in objects if name in row])
