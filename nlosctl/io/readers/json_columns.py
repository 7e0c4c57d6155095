"""JSON values converted to columns of the contract's types; every value that does not fit is a fault of its row."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import pyarrow as pa

from nlosctl.contract.tables import ColumnType, declared_type
from nlosctl.io.readers.base import CellFault
from nlosctl.io.readers.text_files import EXPECTED, arrow_type_of, shown

__all__ = ["NameSurvey", "json_column", "json_text"]

_EXACT_FLOAT = 2**53
_IDS = (int, float, str)
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


class NameSurvey:
    """The values of one name: their types, and whether the integers fit 64 bits and a float."""

    def __init__(self) -> None:
        self._kinds: set[type] = set()
        self._first: type | None = None
        self._in_int64 = self._in_float = True

    def add(self, values: Sequence[Any]) -> None:
        """Add values."""
        kinds = {type(value) for value in values} - {type(None)}
        if self._first is None and kinds & {int, float, str}:
            self._first = next(str if type(value) is str else int for value in values if type(value) in _IDS)
        if int in kinds:
            integers = [value for value in values if type(value) is int]
            largest = max(max(integers), -min(integers))
            self._in_int64 &= min(integers) >= -(2**63) and max(integers) < 2**63
            self._in_float &= largest <= _EXACT_FLOAT
        self._kinds |= kinds

    def identifier_type(self) -> ColumnType:
        """Return integer if the first text or number is a number, text if one is beyond 64 bits, else identifier."""
        if self._first is not int:
            return "identifier"
        return "integer" if self._in_int64 else "text"

    def exact_type(self) -> ColumnType:
        """Return integer if all numbers are 64-bit integers, else number."""
        return "integer" if int in self._kinds and float not in self._kinds and self._in_int64 else "number"

    def own_type(self, name: str) -> ColumnType:
        """Return the narrowest type for all values without loss, for a column ``name`` that is not in the table.

        Without values it is that of other tables of the contract, else text.
        """
        if not self._kinds:
            return declared_type(name) or "text"
        if self._kinds == {int} and self._in_int64:
            return "integer"
        if self._kinds in ({float}, {int, float}) and self._in_float:
            return "number"
        return "boolean" if self._kinds == {bool} else "text"


def json_column(
    values: Sequence[Any], wanted: ColumnType, name: str, contract: ColumnType | None
) -> tuple[Any, list[CellFault]]:
    """Return values as a column of type ``wanted``, null where they don't fit, and the faults of those.

    ``contract`` is the contract's type of the column, None if it has no such column: any value then fits text, as JSON.
    """
    read = _read_any if wanted == "text" and contract is None else _READERS[wanted]
    read_values, faults = [], []
    for index, value in enumerate(values):
        try:
            read_values.append(None if value is None else read(value))
        except (ValueError, OverflowError):
            read_values.append(None)
            fault = f"got {shown(value)}, expected {_expected(value, wanted, contract)}"
            faults.append(CellFault(index=index, column=name, fault=fault))
    return pa.array(read_values, type=arrow_type_of(wanted)), faults


def _expected(value: Any, wanted: ColumnType, contract: ColumnType | None) -> str:
    if isinstance(value, str) and not _is_unicode(value):
        return "Unicode text without half a surrogate pair"
    if type(value) is int and not -(2**63) <= value < 2**63 and wanted != "number":
        return "an integer within 64 bits; store it as text"
    if type(value) is int and wanted == "number":
        return "a number within 1e308"
    if contract == "identifier":
        here = f"{EXPECTED[wanted]} as before: " if isinstance(value, str | int) and not isinstance(value, bool) else ""
        return f"{here}text or an integer, the same in all rows" if here else "text or an integer"
    return EXPECTED[wanted]


def _read_number(value: Any) -> float:
    if type(value) not in (float, int):
        raise ValueError
    return float(value)


def _read_integer(value: Any) -> int:
    if type(value) is float and value.is_integer() and abs(value) <= _EXACT_FLOAT:
        return int(value)
    if type(value) is not int or not -(2**63) <= value < 2**63:
        raise ValueError
    return value


def _read_boolean(value: Any) -> bool:
    word = value.strip().lower() if isinstance(value, str) else None
    if word in _BOOLEANS:
        return _BOOLEANS[word]
    if type(value) is bool or (type(value) is int and value in (0, 1)):
        return bool(value)
    raise ValueError


def _read_name(value: Any) -> str | None:
    if not isinstance(value, str) or not _is_unicode(value):
        raise ValueError
    return value or None


def _read_text(value: Any) -> str | None:
    return str(value) if type(value) is int else _read_name(value)


def _read_any(value: Any) -> str | None:
    return _read_name(value) if isinstance(value, str) else json_text(value)


def _is_unicode(text: str) -> bool:
    if text.isascii():
        return True
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


_READERS: dict[str, Callable[[Any], Any]] = {
    "number": _read_number,
    "integer": _read_integer,
    "boolean": _read_boolean,
    "text": _read_text,
    "identifier": _read_name,
}


def json_text(value: Any) -> str | None:
    """Return text as it is and other values as JSON; lone surrogates, which UTF-8 has not, are escaped."""
    if value is None:
        return None
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if text.isascii() else text.encode("utf-8", "backslashreplace").decode("utf-8")
