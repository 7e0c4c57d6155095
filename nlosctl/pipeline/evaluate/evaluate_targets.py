"""Compare the flags of unlabelled echoes, and the estimates of their targets, with the truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import ESTIMATES, FLAGS, TRACK
from nlosctl.errors import DataError
from nlosctl.evaluation.targets import EchoRows, TargetScores
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.evaluation_arrays import boolean_codes, fit_arrays, group_codes, numbers, whole_snapshots
from nlosctl.io.results.reader import PlainReader
from nlosctl.pipeline.evaluate.groups import Evaluation, grouping_columns, present

__all__ = ["evaluate_targets"]


_COLUMNS = ("los", "truth_los", "target", "truth_target", "truth_x_m", "truth_y_m")
_TRUTH_HEIGHT = "truth_z_m"
_NO_TARGET = -1


@dataclass
class _TargetEstimates:
    """The estimated targets (T, D + 2) of each snapshot, by its id and the ``shared`` grouping values as text.

    Their columns are x, y and in space z, the share of rows used and the p-value of the fit, NaN if unknown. ``other``
    has the values of the grouping columns that only the flags have, by snapshot. Targets in tracks have their number as
    one more column.
    """

    by_snapshot: Mapping[tuple[str, ...], FloatArray]
    shared: tuple[str, ...]
    other: dict[tuple[str, ...], dict[str, Any]] = field(default_factory=dict)


def evaluate_targets(flags: Input, estimates: Sequence[Input], *, order: float, cutoff_m: float) -> Evaluation:
    """Evaluate flags of ``identify-los`` with its estimates, by method and ``sweep_*`` column.

    ``order`` and ``cutoff_m`` are those of OSPA and GOSPA, in space where estimates and truth have heights. Raises
    DataError for a missing column, if the estimates have no row for a snapshot, or if those of a snapshot are not
    unique.
    """
    with closing(PlainReader(flags, FLAGS)) as reader:
        missing = [name for name in _COLUMNS if name not in reader.schema.names]
        if missing:
            raise DataError(f"{flags.name}: no column {missing[0]!r}: targets are evaluated by {', '.join(_COLUMNS)}")
        grouping = grouping_columns(reader.schema.names)
        tables = [(source.name, PlainReader(source, ESTIMATES).read_all()) for source in estimates]
        heights = _TRUTH_HEIGHT in reader.schema.names and all("z_m" in table.column_names for _, table in tables)
        axes = "xyz" if heights else "xy"
        targets = _read_estimates(tables, grouping, axes)
        scores = TargetScores(order=order, cutoff_m=cutoff_m)
        for table in whole_snapshots(reader.batches()):
            by_group, keys = group_codes(table, grouping)
            by_snapshot, snapshots = group_codes(table, ["snapshot", *grouping])
            rows = _rows(table, axes)
            order_of_rows = np.argsort(by_snapshot, kind="stable")
            ends = np.cumsum(np.bincount(by_snapshot, minlength=len(snapshots)))
            for number, index in enumerate(np.split(order_of_rows, ends[:-1])):
                estimated = _look_up(targets, snapshots[number], grouping, flags.name)
                scores.add(_take(rows, index), estimated, keys[by_group[index[0]]])
        return present("targets", scores, [(flags, reader)], grouping)


def _rows(table: Any, axes: str) -> EchoRows:
    def labels(name: str) -> IntArray:
        values = numbers(table.column(name))
        return np.where(np.isnan(values), _NO_TARGET, values).astype(np.int64)

    return EchoRows(
        target=labels("target"),
        true_target=labels("truth_target"),
        los=boolean_codes(table.column("los")) == 1,
        true_los=boolean_codes(table.column("truth_los")) == 1,
        true_m=np.stack([numbers(table.column(f"truth_{axis}_m")) for axis in axes], axis=1),
    )


def _take(rows: EchoRows, index: IntArray) -> EchoRows:
    return EchoRows(
        target=rows.target[index],
        true_target=rows.true_target[index],
        los=rows.los[index],
        true_los=rows.true_los[index],
        true_m=rows.true_m[index],
    )


def _read_estimates(tables: Sequence[tuple[str, Any]], grouping: list[str], axes: str) -> _TargetEstimates:
    """Return the positions of all targets; a snapshot without a target has an empty array."""
    shared = tuple(name for name in grouping if all(name in table.column_names for _, table in tables))
    by_snapshot: dict[tuple[str, ...], FloatArray] = {}
    files: dict[tuple[str, ...], str] = {}
    for name, table in tables:
        if "method" not in shared and len(table.column("method").unique()) > 1:
            raise DataError(f"{name}: estimates of several methods, but the flags have no column 'method'")
        for key, positions in _positions(table, shared, axes):
            if files.setdefault(key, name) != name:
                raise DataError(
                    f"{name}: snapshot {key[0]!r} has estimates in {files[key]} too, expected those of one run; "
                    "evaluate run by run"
                )
            by_snapshot[key] = positions
    return _TargetEstimates(by_snapshot, shared)


def _positions(table: Any, shared: Sequence[str], axes: str) -> Iterator[tuple[tuple[str, ...], FloatArray]]:
    """Yield the key and the targets (T, D + 2) of each snapshot of a table of estimates."""
    by_snapshot, snapshots = group_codes(table, ["snapshot", *shared])
    fit = [np.full(table.num_rows, np.nan) if values is None else values for values in fit_arrays(table).values()]
    fit += [numbers(table.column(TRACK.name))] if TRACK.name in table.column_names else []
    targets = np.stack([*(numbers(table.column(f"{axis}_m")) for axis in axes), *fit], axis=1)
    statuses = np.array(table.column("status").to_pylist(), dtype=object)
    counted = (numbers(table.column("alternative")) == 0.0) & ~np.isin(statuses, _WITHOUT_TARGET)
    rows = np.flatnonzero(counted)
    rows = rows[np.argsort(by_snapshot[rows], kind="stable")]
    ends = np.cumsum(np.bincount(by_snapshot[rows], minlength=len(snapshots)))
    for key, positions in zip(snapshots, np.split(targets[rows], ends[:-1]), strict=True):
        yield tuple(str(value) for value in key), positions


_WITHOUT_TARGET = [
    status.word
    for status in (
        Status.NO_TARGET,
        Status.TOO_FEW,
        Status.NOT_CONVERGED,
        Status.NO_CANDIDATE,
        Status.NO_CONSENSUS,
        Status.OUTSIDE_FIELD,
    )
]


def _look_up(targets: _TargetEstimates, key: tuple[Any, ...], grouping: list[str], name: str) -> FloatArray:
    values = dict(zip(["snapshot", *grouping], key, strict=True))
    wanted = (str(values["snapshot"]), *(str(values[column]) for column in targets.shared))
    if wanted not in targets.by_snapshot:
        raise DataError(f"{name}: the estimates have no row of snapshot {values['snapshot']!r}; are they of this run?")
    other = {column: values[column] for column in grouping if column not in targets.shared}
    before = targets.other.setdefault(wanted, other)
    differing = [column for column in other if before[column] != other[column]]
    if differing:
        raise DataError(
            f"{name}: snapshot {values['snapshot']!r} has flags of {differing[0]} {before[differing[0]]} and "
            f"{other[differing[0]]}, but the estimates have no column {differing[0]!r}; are they of this run?"
        )
    return targets.by_snapshot[wanted]
