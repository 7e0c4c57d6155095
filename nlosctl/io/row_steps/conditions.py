"""Conditions on rows (``snr_db >= 10``): the rows that do not meet all of them are left out."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.readers.base import RecordBatch, as_text, plain, plain_type
from nlosctl.io.row_steps.chosen_rows import kept_rows, normalized

__all__ = ["Condition", "RowConditions", "parse_condition"]

_COMPARISONS = {
    "<=": pc.less_equal,
    ">=": pc.greater_equal,
    "==": pc.equal,
    "!=": pc.not_equal,
    "<": pc.less,
    ">": pc.greater,
}
_SYNTAX = re.compile(r"\s*([^<>=!]*[^<>=!\s])\s*(<=|>=|==|!=|<|>)\s*([^<>=!\s].*?)\s*")
_LONGEST_EXACT = 2**53


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A comparison of a column with a value; ``text`` is the whole as given."""

    column: str
    operator: str
    value: str
    text: str


def parse_condition(text: str) -> Condition:
    """Return the condition ``COLUMN OP VALUE``; raises UsageError for another form."""
    match = _SYNTAX.fullmatch(text)
    if match is None:
        raise UsageError(f"`where` takes COLUMN OP VALUE with OP one of < <= > >= == !=. Got {text!r} instead.")
    return Condition(column=match[1], operator=match[2], value=normalized(match[3]), text=text.strip())


class RowConditions:
    """A `Step` that leaves out the rows which do not meet all conditions.

    Numbers are compared as numbers, times as times, truth values as such, anything else as text. An empty cell differs
    from every value: only ``!=`` keeps it (and ``== ""`` of text). Rows whose cell can't be read stay, as faults.
    ``renames`` are the file's names of the contract's columns; either name will do.
    """

    names: tuple[str, ...] = ()
    replaces: Sequence[str] = ()

    def __init__(self, texts: Sequence[str], names: Sequence[str], renames: Mapping[str, str], file: str) -> None:
        self._file = file
        self._conditions = []
        for condition in map(parse_condition, texts):
            name = condition.column if condition.column in names else renames.get(condition.column, "")
            if name not in names:
                near = did_you_mean(condition.column, names)
                raise DataError(
                    f"{file}: `where` {condition.text!r}: no column {condition.column!r}{near}. "
                    f"The file has: {', '.join(names)}"
                )
            self._conditions.append((name, condition))
        self._values: list[Any] = []
        self.remarks: list[str] = []

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step."""
        own = [name for name, _ in self._conditions]
        return types, columns if columns is None else list(dict.fromkeys([*columns, *own]))

    def extend(self, schema: Any) -> Any:
        """See Step; raises DataError for a value of another type than its column."""
        self._values = [self._value(condition, schema.field(name).type) for name, condition in self._conditions]
        for (_, condition), value in zip(self._conditions, self._values, strict=True):
            of_text = pa.types.is_string(value.type) and _is_number(condition.value)
            if of_text and condition.operator not in ("==", "!="):
                column = f"column {condition.column!r}"
                self.remarks.append(
                    f"{self._file}: `where` {condition.text!r} compares texts, as {column} contains: '10' is before '9'"
                )
        return schema

    def _value(self, condition: Condition, arrow_type: Any) -> Any:
        """Return the value of a condition as a scalar that the column is compared with."""
        kind, text = plain_type(arrow_type), condition.value
        try:
            if pa.types.is_boolean(kind):
                return pa.scalar({"true": True, "1": True, "false": False, "0": False}[text.lower()])
            if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
                return _number(text)
            if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
                return pa.scalar(text).cast(kind)
        except (ValueError, KeyError, pa.ArrowInvalid) as error:
            expected = "true or false" if pa.types.is_boolean(kind) else "a number"
            expected = "a time such as 2024-06-10T06:00:00" if pa.types.is_temporal(kind) else expected
            raise DataError(
                f"{self._file}, column {condition.column!r}: `where` {condition.text!r}: got {text!r}, "
                f"expected {expected}, as the column contains"
            ) from error
        return pa.scalar(text)

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        keep = np.ones(batch.table.num_rows, dtype=np.bool_)
        for (name, condition), value in zip(self._conditions, self._values, strict=True):
            met = _is_met(plain(batch.table.column(name)), condition.operator, value)
            for cell in batch.cell_faults:
                if cell.column == name or (name in batch.origins and cell.column == batch.origins[name][cell.index]):
                    met[cell.index] = True
            keep &= met
        return kept_rows(batch, keep, "where")


def _is_number(text: str) -> bool:
    try:
        return not math.isnan(float(text))
    except ValueError:
        return False


def _number(text: str) -> Any:
    """Return an integer or a float as a scalar; raises ValueError."""
    try:
        return pa.scalar(int(text), pa.int64()) if abs(int(text)) >= _LONGEST_EXACT else pa.scalar(float(text))
    except (ValueError, OverflowError, pa.ArrowInvalid):
        number = float(text)
        if math.isnan(number):
            raise ValueError(text) from None
        return pa.scalar(number)


def _is_met(cells: Any, operator: str, value: Any) -> BoolArray:
    """Return where cells (N,) meet a comparison."""
    if pa.types.is_string(value.type):
        cells = as_text(cells)
        if value.as_py() == "":
            cells = cells.fill_null("")
    elif pa.types.is_floating(value.type) or pa.types.is_integer(value.type):
        exact = pa.types.is_integer(cells.type) and pa.types.is_integer(value.type)
        cells = cells if exact else cells.cast(pa.float64(), safe=False)
    met = pc.fill_null(_COMPARISONS[operator](cells, value), operator == "!=")
    return np.array(met.to_numpy(zero_copy_only=False), dtype=np.bool_)
