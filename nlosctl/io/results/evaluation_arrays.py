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
from nlosctl.contract.scene import parse_frame
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import TRUTH_HEIGHT, has_states
from nlosctl.errors import DataError
from nlosctl.io.results.layouts import COVARIANCE, OF_SPACE, POSITION, TRUTH_NAMES
from nlosctl.io.results.truth_table import TruthTable
from nlosctl.io.scenes.places import errors_in

__all__ = [
    "EstimateArrays",
    "boolean_codes",
    "estimate_arrays",
    "fit_arrays",
    "group_codes",
    "has_heights",
    "numbers",
    "whole_snapshots",
]


_STATUSES = pa.array([status.word for status in Status])


@dataclass(frozen=True, kw_only=True)
class EstimateArrays:
    """N estimates: position and truth (N, D), covariance (N, D (D + 1) / 2) as xx, xy, yy, xz, yz, zz; columns (N,).

    ``used_share``, ``fit_p_value`` and ``std_dof`` are None where the table does not have them, ``time_s`` where the
    estimates are not states of tracks.
    """

    position_m: FloatArray
    covariance_m2: FloatArray
    status: npt.NDArray[np.uint8]
    truth_m: FloatArray
    alternative: IntArray
    used_share: FloatArray | None
    fit_p_value: FloatArray | None
    std_dof: FloatArray | None
    time_s: FloatArray | None


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
    dimension = 3 if has_heights(table.column_names) else 2
    truth_names = (*TRUTH_NAMES, TRUTH_HEIGHT.name)[:dimension]
    for column in truth_names:
        if truth is None and column not in table.column_names:
            raise DataError(f"{name}: no column {column!r}; add it, or pass a file that has it as `truth`")
    position = _stack(table, POSITION[:dimension], name)
    true = _stack(table, truth_names, name) if truth is None else truth.look_up(table, name, dimension)
    return EstimateArrays(
        position_m=position,
        covariance_m2=_stack(table, COVARIANCE[: dimension * (dimension + 1) // 2], name, LARGEST_NUMBER**2),
        status=np.asarray(status).astype(np.uint8),
        truth_m=_in_local_axes(table, position, true) if dimension == 3 and "frame" in table.column_names else true,
        alternative=np.asarray(table.column("alternative")).astype(np.int64),
        **fit_arrays(table),
        std_dof=numbers(table.column("std_dof")) if "std_dof" in table.column_names else None,
        time_s=numbers(table.column("time_s")) if has_states(table.column_names) else None,
    )


def _in_local_axes(table: Any, position_m: FloatArray, truth_m: FloatArray) -> FloatArray:
    """Return the truths (N, 3), of places on an ellipsoid so that errors are in local east, north and up."""
    truth_m, frames = truth_m.copy(), np.asarray(table.column("frame").to_pylist(), dtype=object)
    for words in {words for words in frames.tolist() if words}:
        frame, rows = parse_frame(words, "column 'frame'"), np.flatnonzero(frames == words)
        truth_m[rows] = position_m[rows] - errors_in(frame, position_m[rows], truth_m[rows])
    return truth_m


def has_heights(names: Sequence[str]) -> bool:
    """Return whether estimates with the columns ``names`` are of three dimensions."""
    return set(OF_SPACE) <= set(names)


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
