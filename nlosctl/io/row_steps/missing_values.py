"""Values that stand for a missing measurement (``-999``, ``NA``): their rows are left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray
from nlosctl.contract.tables import ColumnType, measured_names
from nlosctl.errors import DataError
from nlosctl.io.readers.base import RecordBatch, plain
from nlosctl.io.row_steps.chosen_rows import kept_rows, normalized, text_cells

__all__ = ["MissingValues", "measurement_columns"]


def measurement_columns(names: Sequence[str], renames: Mapping[str, str]) -> list[str]:
    """Return the columns among a file's ``names`` that hold a measured value; ``renames`` are their other headers."""
    by_header = {header: name for name, header in renames.items()}
    return [name for name in names if by_header.get(name, name) in measured_names()]


class MissingValues:
    """A `Step` that leaves out the rows in which a measured value is one of ``values``.

    A value is compared as a number if it is one (``nan``: not a number), and with the original text of cells that are
    not numbers. An empty text stands for an empty cell. Raises DataError without a column of measured values.
    """

    names: tuple[str, ...] = ()
    replaces: Sequence[str] = ()

    def __init__(self, values: Sequence[str], names: Sequence[str], renames: Mapping[str, str], file: str) -> None:
        self._columns = measurement_columns(names, renames)
        if not self._columns:
            raise DataError(f"{file}: `missing`: there is no column of measured values. It has: {', '.join(names)}")
        self.texts = frozenset(map(normalized, values))
        self._numbers = [number for text in self.texts if (number := _number(text)) is not None]

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step."""
        wanted: dict[str, ColumnType] = dict(types)
        for name in self._columns:
            wanted.setdefault(name, "number")
        return wanted, columns if columns is None else list(dict.fromkeys([*columns, *self._columns]))

    def extend(self, schema: Any) -> Any:
        """See Step."""
        return schema

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        out = np.zeros(batch.table.num_rows, dtype=np.bool_)
        for name in self._columns:
            out |= self._is_missing(batch, name)
        return kept_rows(batch, ~out, "missing")

    def _is_missing(self, batch: RecordBatch, name: str) -> BoolArray:
        cells = plain(batch.table.column(name))
        values = cells.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        null = np.asarray(pc.is_null(cells).to_numpy(zero_copy_only=False), dtype=np.bool_)
        out = np.zeros(values.shape, dtype=np.bool_)
        for number in self._numbers:
            out |= ~null & (np.isnan(values) if np.isnan(number) else values == number)
        text = text_cells(batch, name)
        unreadable = {
            cell.index for cell in batch.cell_faults if cell.column in (name, _origin(batch, name, cell.index))
        }
        if "" in self.texts:
            empty = null.copy()
            empty[list(unreadable)] = False
            out |= empty
        for index in unreadable if text is not None else ():
            out[index] |= (text[index].as_py() or "").strip() in self.texts
        return out


def _origin(batch: RecordBatch, name: str, index: int) -> str:
    return str(batch.origins[name][index]) if name in batch.origins else name


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
