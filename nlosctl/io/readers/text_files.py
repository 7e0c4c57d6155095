"""Text files: their bytes, uncompressed within limits, and their cells converted to the contract's types."""

from __future__ import annotations

import bz2
import gzip
import io
import re
from collections.abc import Callable, Collection
from typing import IO, Any, Literal, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.limits import limit
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.arrow_columns import ARROW_TYPES
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import Location
from nlosctl.io.readers.base import CellFault, expansion_fault

__all__ = [
    "EXPECTED",
    "arrow_type_of",
    "convert_text",
    "decode_utf8",
    "identifier_type",
    "infer_type",
    "names",
    "open_bytes",
    "refuse_wrong_column",
    "shown",
    "wider_type",
]

EXPECTED = {
    "number": "a number",
    "exact": "a number",
    "integer": "an integer",
    "boolean": "true/false or 1/0",
    "text": "text",
    "identifier": "text",
}

_EXPECTED_ALL = {"number": "numbers", "exact": "numbers", "integer": "integers", "boolean": "true/false or 1/0"}
_BUFFER_BYTES = 1 << 17
_FEWEST_WRONG = 5
_TRIED = 100

_BLANKS = " \t\r\n\u00a0\u2007\u2009\u202f\u3000"

_ARROW_TYPES = {**ARROW_TYPES, "identifier": pa.string()}


def open_bytes(part: Part) -> IO[bytes]:
    """Open a file as bytes, uncompressed if its format is compressed; raises OSError if it can't be opened."""
    stream: Any = part.stream if part.stream is not None else cast(Location, part.path).open("rb")
    if part.format.compression:
        stream = io.BufferedReader(_Unpacked(stream, part), _BUFFER_BYTES)
    return cast(IO[bytes], stream)


class _Unpacked(io.RawIOBase):
    """The content of a compressed stream; raises DataError if it is larger than the limit ``expansion`` allows."""

    def __init__(self, packed: IO[bytes], part: Part) -> None:
        self._counted = _Counted(packed)
        self._file = _DECOMPRESSED[part.format.compression](cast(Any, self._counted))
        self._name, self._most, self._unpacked = part.name, limit("expansion"), 0
        self._unchecked = limit("unchecked_expansion_mb") << 20

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        read: Any = getattr(self._file, "read1", self._file.read)
        got: bytes = read(len(buffer))
        buffer[: len(got)] = got
        self._unpacked += len(got)
        if self._unpacked > self._unchecked and self._unpacked > self._most * self._counted.taken:
            raise DataError(expansion_fault(self._name, self._most))
        return len(got)

    def close(self) -> None:
        super().close()
        self._file.close()
        self._counted.packed.close()


_DECOMPRESSED: dict[str, Callable[[Any], Any]] = {
    "gz": lambda packed: gzip.GzipFile(fileobj=packed),
    "bz2": bz2.BZ2File,
    "zst": lambda packed: pa.CompressedInputStream(pa.PythonFile(packed, mode="r"), "zstd"),
}


class _Counted(io.RawIOBase):
    """A stream that counts the bytes read from it, and stays open."""

    def __init__(self, packed: IO[bytes]) -> None:
        self.packed = packed
        self.taken = 0

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        got = self.packed.read(size)
        self.taken += len(got)
        return got


def arrow_type_of(wanted: ColumnType) -> Any:
    """Return the Arrow type for a text column of this contract type."""
    return _ARROW_TYPES[wanted]


def shown(value: object) -> str:
    """Return a value for messages: text in quotes, long values shortened."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def identifier_type(cells: Any) -> ColumnType:
    """Return integer if all ``cells`` (see `names`) are integers without leading zero or plus sign, else identifier."""
    filled = names(cells, "integer").drop_null()
    return "integer" if len(filled) and _integers(filled) == "plain" else "identifier"


def names(cells: Any, wanted: ColumnType) -> Any:
    """Return ids and names without surrounding blanks, null where nothing is left; integers without a zero fraction."""
    text = _trimmed(cells)
    text = pc.if_else(pc.equal(text, ""), pa.scalar(None, pa.string()), text)
    return pc.replace_substring_regex(text, r"^([+-]?\d+)\.0*$", r"\1") if wanted == "integer" else text


def infer_type(cells: Any) -> ColumnType | None:
    """Return the narrowest type for all ``cells`` (text, null where empty) without loss; None if all are null.

    Numbers with leading zeros and integers that a float can't represent are text.
    """
    filled = cells.drop_null()
    if len(filled) == 0:
        return None
    inferred = _infer(filled)
    return inferred if inferred != "text" else _infer(_trimmed(filled))


def _infer(filled: Any) -> ColumnType:
    integers = _integers(filled)
    if integers is not None:
        return "integer" if integers == "plain" else "text"
    if _cast(filled, pa.float64()) is not None:
        whole = filled.filter(pc.invert(pc.match_substring(filled, ".")))
        changed = pc.any(pc.match_substring_regex(whole, r"^[+-]?(0[0-9]|[0-9]{16})")).as_py()
        return "text" if changed else "number"
    words = pc.is_in(pc.utf8_lower(filled), value_set=pa.array(["true", "false"]))
    return "boolean" if pc.all(words).as_py() else "text"


def wider_type(one: ColumnType | None, other: ColumnType | None) -> ColumnType | None:
    """Return the type for the values of both types; None stands for no values."""
    if one is None or other is None or one == other:
        return one or other
    return "number" if {one, other} == {"integer", "number"} else "text"


def refuse_wrong_column(
    cells: Any, wanted: ColumnType, file: str, column: str, accepted_texts: Collection[str] = ()
) -> None:
    """Raise DataError if there are several ``cells`` and none fits the contract's type or is an accepted text."""
    if wanted in ("text", "identifier"):
        return
    if accepted_texts:
        cells = cells.filter(pc.invert(pc.is_in(_trimmed(cells), value_set=pa.array(sorted(accepted_texts)))))
    for some in (cells.slice(0, _TRIED), cells):
        if len(some) - some.null_count < _FEWEST_WRONG or len(convert_text(some, wanted, column)[0].drop_null()):
            return
    example = cells.drop_null()[0].as_py()
    raise DataError(
        f"{file}, column {column!r}: wrong type: contains text such as {shown(example)}, "
        f"expected {_EXPECTED_ALL[wanted]}{_comma(example)}; convert the column, "
        f"or read another under this name with `columns`"
    )


def _comma(text: str) -> str:
    return " with a decimal point" if re.fullmatch(r"\s*[+-]?\d+,\d+\s*", text) else ""


def convert_text(cells: Any, wanted: ColumnType, column: str, hint: str = "") -> tuple[Any, list[CellFault]]:
    """Return the cells as the wanted type, null where they don't fit, and the faults of those."""
    target = _ARROW_TYPES[wanted]
    if wanted in ("text", "identifier"):
        return cells, []
    if wanted == "boolean":
        converted = _booleans(cells)
    else:
        whole = _cast(cells, target)
        if whole is not None:
            return whole, []
        cells = _trimmed(cells)
        whole = _cast(cells, target)
        if whole is not None:
            return whole, []
        converted = pa.array([_one(value, target) for value in cells.to_pylist()], type=target)
    unfit = pc.and_(pc.is_valid(cells), pc.is_null(converted))
    faults = [
        CellFault(
            index=index,
            column=column,
            fault=f"got {shown(cells[index].as_py())}, expected {EXPECTED[wanted]}{hint}{_comma(cells[index].as_py())}",
        )
        for index in np.flatnonzero(unfit.to_numpy(zero_copy_only=False)).tolist()
    ]
    return converted, faults


def decode_utf8(cells: Any, column: str) -> tuple[Any, list[CellFault]]:
    """Return binary cells as text, null where they are not UTF-8, and the faults of those."""
    try:
        return cells.cast(pa.string()), []
    except pa.ArrowInvalid:
        pass
    decoded: list[str | None] = []
    faults = []
    for index, value in enumerate(cells.to_pylist()):
        try:
            decoded.append(None if value is None else value.decode("utf-8"))
        except UnicodeDecodeError as error:
            decoded.append(None)
            fault = f"got {shown(value)}, byte 0x{value[error.start]:02x} is not UTF-8; save the file as UTF-8"
            faults.append(CellFault(index=index, column=column, fault=fault))
    return pa.array(decoded, type=pa.string()), faults


def _integers(filled: Any) -> Literal["plain", "odd"] | None:
    """Return plain if all cells are 64-bit integers in decimal, odd if other text of integers; None if not integers."""
    integers = _cast(filled, pa.int64())
    if integers is None:
        return None
    return "plain" if integers.cast(pa.string()).equals(filled) else "odd"


def _cast(cells: Any, target: Any) -> Any:
    try:
        converted = cells.cast(target)
    except pa.ArrowInvalid:
        return None
    if target == pa.int64() and pc.any(pc.match_substring(cells, "x", ignore_case=True)).as_py():
        return None  # pyarrow reads 0x10 as 16, unlike other readers of CSV
    return converted


def _one(value: str | None, target: Any) -> Any:
    if value is None:
        return None
    converted = _cast(pa.array([value]), target)
    return None if converted is None else converted[0].as_py()


def _trimmed(cells: Any) -> Any:
    """Return text without surrounding blanks; control characters, which Unicode counts as blanks, are kept."""
    return pc.utf8_trim(cells, _BLANKS)


def _booleans(cells: Any) -> Any:
    lower = pc.utf8_lower(_trimmed(cells))
    yes = pc.is_in(lower, value_set=pa.array(["true", "1"]))
    known = pc.or_(yes, pc.is_in(lower, value_set=pa.array(["false", "0"])))
    return pc.if_else(known, yes, pa.scalar(None, pa.bool_()))
