"""Estimates, flags and truth of Arrow tables as arrays for the evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import TRUTH
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.layouts import TRUTH_NAMES
from nlosctl.io.results.reader import PlainReader

__all__ = [
    "EstimateArrays",
    "TruthTable",
    "boolean_codes",
    "estimate_arrays",
    "fit_arrays",
    "group_codes",
    "numbers",
    "whole_snapshots",
]


_STATUSES = pa.array([status.word for status in Status])


@dataclass(frozen=True, kw_only=True)
class EstimateArrays:
    """N estimates: position and truth (N, 2), covariance (N, 3) as xx, xy, yy, and columns (N,).

    ``used_share`` and ``fit_p_value`` are None where the table does not have them.
    """

    position_m: FloatArray
    covariance_m2: FloatArray
    status: npt.NDArray[np.uint8]
    truth_m: FloatArray
    alternative: IntArray
    used_share: FloatArray | None
    fit_p_value: FloatArray | None


class TruthTable:
    """True positions by snapshot id from a separate file, in any number of equal rows; those without one are left out.

    ``snapshots`` and ``matched`` count the snapshots looked up, and those of them with a truth. Raises DataError if
    the rows of a snapshot contradict each other.
    """

    def __init__(self, source: Input) -> None:
        reader = PlainReader(source, TRUTH)
        table = reader.read_all()
        truth_m = _stack(table, TRUTH_NAMES, source.name)
        given = np.flatnonzero(~np.isnan(truth_m).any(axis=1))
        self._ids = _as_text(table.column("snapshot")).take(pa.array(given))
        self._truth_m = truth_m[given]
        self.name = source.name
        self.snapshots = self.matched = 0
        self._refuse_contradictions(given)

    def _refuse_contradictions(self, rows: IntArray) -> None:
        first = np.asarray(pc.index_in(self._ids, value_set=self._ids))
        other = np.flatnonzero((self._truth_m != self._truth_m[first]).any(axis=1))
        if other.size:
            pair = (int(first[other[0]]), int(other[0]))
            (x, y), (other_x, other_y) = self._truth_m[list(pair)].tolist()
            raise DataError(
                f"{self.name}, row {rows[pair[1]] + 1}: got truth_x_m, truth_y_m {other_x:.12g}, {other_y:.12g} for "
                f"snapshot {self._ids[pair[0]].as_py()!r}, which has {x:.12g}, {y:.12g} in row {rows[pair[0]] + 1}; "
                "expected one true position per snapshot"
            )

    def remark(self) -> list[str]:
        """Return a line on the snapshots without a truth; raise DataError if none of those looked up has one."""
        if self.snapshots and not self.matched:
            some = f" (the first is {self._ids[0].as_py()!r})" if len(self._ids) else ""
            raise DataError(
                f"{self.name}: none of its snapshots{some} is one of the {self.snapshots} snapshots of the estimates; "
                "the truth is joined by the column 'snapshot'"
            )
        if self.matched == self.snapshots:
            return []
        return [f"{self.name} has the truth of {self.matched} of {self.snapshots} snapshots; the others are not scored"]

    def look_up(self, ids: Any) -> FloatArray:
        """Return the truth (N, 2) of snapshot ids (N,) of whole snapshots; NaN without a truth."""
        known = pc.is_in(pc.unique(_as_text(ids)), value_set=self._ids)
        self.snapshots += len(known)
        self.matched += int(pc.sum(known).as_py() or 0)
        index = pc.index_in(_as_text(ids), value_set=self._ids).combine_chunks()
        known = np.asarray(index.is_valid())
        truth_m = np.full((len(index), 2), np.nan)
        truth_m[known] = self._truth_m[np.asarray(index.drop_null())]
        return truth_m


def estimate_arrays(table: Any, truth: TruthTable | None, name: str) -> EstimateArrays:
    """Return the arrays of a table of estimates; ``truth`` replaces its truth columns.

    Raises DataError for an unknown status, a missing alternative, a number that is too large, or without any truth.
    """
    status = pc.index_in(table.column("status"), value_set=_STATUSES)
    if status.null_count:
        word = table.column("status").filter(pc.is_null(status))[0].as_py()
        raise DataError(f"{name}, column 'status': got {word!r}, expected one of {', '.join(_STATUSES.to_pylist())}")
    if table.column("alternative").null_count:
        raise DataError(f"{name}, column 'alternative': got empty cells, expected a number in every row")
    for column in TRUTH_NAMES:
        if truth is None and column not in table.column_names:
            raise DataError(f"{name}: no column {column!r}; add it, or pass a file that has it as `truth`")
    return EstimateArrays(
        position_m=_stack(table, ("x_m", "y_m"), name),
        covariance_m2=_stack(table, ("cov_xx_m2", "cov_xy_m2", "cov_yy_m2"), name, LARGEST_NUMBER**2),
        status=np.asarray(status).astype(np.uint8),
        truth_m=_stack(table, TRUTH_NAMES, name) if truth is None else truth.look_up(table.column("snapshot")),
        alternative=np.asarray(table.column("alternative")).astype(np.int64),
        **fit_arrays(table),
    )


def fit_arrays(table: Any) -> dict[str, FloatArray | None]:
    """Return the columns ``used_share`` and ``fit_p_value`` (N,) of estimates, None where the table has none."""
    names = ("used_share", "fit_p_value")
    return {name: numbers(table.column(name)) if name in table.column_names else None for name in names}


def boolean_codes(column: Any) -> npt.NDArray[np.int8]:
    """Return a boolean column (N,) as 1 true, 0 false, -1 null."""
    return np.asarray(pc.fill_null(column.cast(pa.int8()), -1))


def numbers(column: Any) -> FloatArray:
    """Return a column of numbers (N,), null as NaN; integers beyond 2^53 are rounded."""
    return np.asarray(column.cast(pa.float64(), safe=False), dtype=np.float64)


def group_codes(table: Any, columns: Sequence[str]) -> tuple[IntArray, list[tuple[Any, ...]]]:
    """Return the index (N,) of each row's group, and the values of ``columns`` of each group."""
    if not columns:
        return np.zeros(table.num_rows, dtype=np.int64), [()]
    keys = table.select(columns).append_column("", pa.array(np.arange(table.num_rows)))
    groups = keys.group_by(list(columns), use_threads=False).aggregate([("", "min"), ("", "list")])
    groups = groups.sort_by("_min")
    codes = np.empty(table.num_rows, dtype=np.int64)
    for number, rows in enumerate(groups.column("_list")):
        codes[np.asarray(rows.values)] = number
    return codes, [tuple(row[name] for name in columns) for row in groups.select(columns).to_pylist()]


def whole_snapshots(batches: Iterator[Any]) -> Iterator[Any]:
    """Yield the rows of ``batches`` in tables that do not split a snapshot."""
    waiting: Any = None
    for batch in batches:
        table = batch if waiting is None else pa.concat_tables([waiting, batch]).combine_chunks()
        ids = table.column("snapshot")
        last = max(table.num_rows - 1, 0)
        while last > 0 and ids[last - 1].equals(ids[table.num_rows - 1]):
            last -= 1
        if last > 0:
            yield table.slice(0, last)
        waiting = table.slice(last)
    if waiting is not None and waiting.num_rows:
        yield waiting


def _stack(table: Any, names: Sequence[str], file: str, largest: float = LARGEST_NUMBER) -> FloatArray:
    columns = [numbers(table.column(name)) for name in names]
    for name, values in zip(names, columns, strict=True):
        beyond = values[np.abs(values) > largest]
        if beyond.size:
            raise DataError(f"{file}, column {name!r}: got {beyond[0]:g}, expected numbers within {largest:g}")
    return np.stack(columns, axis=1)


def _as_text(ids: Any) -> Any:
    return ids.cast(pa.string())
