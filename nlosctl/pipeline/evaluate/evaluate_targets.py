"""Flags of unlabelled echoes, and the estimates of their targets, held against the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import ESTIMATES, FLAGS
from nlosctl.errors import DataError
from nlosctl.evaluation.targets import EchoRows, TargetScores
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.evaluation_arrays import boolean_codes, group_codes, numbers, whole_snapshots
from nlosctl.io.results.reader import PlainReader
from nlosctl.pipeline.evaluate.evaluate import Evaluation, grouping_columns, present

__all__ = ["evaluate_targets"]


_COLUMNS = ("los", "truth_los", "target", "truth_target", "truth_x_m", "truth_y_m")
_NOBODY = -1


@dataclass(frozen=True)
class _Found:
    """The positions (T, 2) of the targets found in each snapshot, by its id and the grouping values as text."""

    by_snapshot: Mapping[tuple[str, ...], FloatArray]
    grouping: tuple[str, ...]


def evaluate_targets(flags: Input, estimates: Input | None, *, order: float, cutoff_m: float) -> Evaluation:
    """Evaluate flags of ``identify-los`` with its estimates, by method and ``sweep_*`` column.

    ``order`` and ``cutoff_m`` are those of OSPA and GOSPA, which need the estimates. Raises DataError where a column
    is missing, or the estimates have no row for a snapshot.
    """
    reader = PlainReader(flags, FLAGS)
    missing = [name for name in _COLUMNS if name not in reader.schema.names]
    if missing:
        raise DataError(f"{flags.name}: no column {missing[0]!r}: targets are evaluated by {', '.join(_COLUMNS)}")
    grouping = grouping_columns(reader.schema.names)
    found = None if estimates is None else _read_estimates(estimates, grouping)
    scores = TargetScores(order=order, cutoff_m=cutoff_m)
    for table in whole_snapshots(reader.batches()):
        by_group, keys = group_codes(table, grouping)
        by_snapshot, snapshots = group_codes(table, ["snapshot", *grouping])
        rows = _rows(table)
        order_of_rows = np.argsort(by_snapshot, kind="stable")
        ends = np.cumsum(np.bincount(by_snapshot, minlength=len(snapshots)))
        for number, places in enumerate(np.split(order_of_rows, ends[:-1])):
            positions = None if found is None else _look_up(found, snapshots[number], grouping, flags.name)
            scores.add(_take(rows, places), positions, keys[by_group[places[0]]])
    return present("targets", scores, [(flags, reader)], grouping)


def _rows(table: Any) -> EchoRows:
    def labels(name: str) -> IntArray:
        values = numbers(table.column(name))
        return np.where(np.isnan(values), _NOBODY, values).astype(np.int64)

    return EchoRows(
        target=labels("target"),
        true_target=labels("truth_target"),
        los=boolean_codes(table.column("los")) == 1,
        true_los=boolean_codes(table.column("truth_los")) == 1,
        true_m=np.stack([numbers(table.column(name)) for name in ("truth_x_m", "truth_y_m")], axis=1),
    )


def _take(rows: EchoRows, places: IntArray) -> EchoRows:
    return EchoRows(
        target=rows.target[places],
        true_target=rows.true_target[places],
        los=rows.los[places],
        true_los=rows.true_los[places],
        true_m=rows.true_m[places],
    )


def _read_estimates(given: Input, grouping: list[str]) -> _Found:
    """Return the positions of all targets; a snapshot without a target has none."""
    table = PlainReader(given, ESTIMATES).read_all()
    shared = tuple(name for name in grouping if name in table.column_names)
    if "method" not in shared and len(table.column("method").unique()) > 1:
        raise DataError(f"{given.name}: estimates of several methods, but the flags have no column 'method'")
    by_snapshot, snapshots = group_codes(table, ["snapshot", *shared])
    position = np.stack([numbers(table.column(name)) for name in ("x_m", "y_m")], axis=1)
    words = np.array(table.column("status").to_pylist(), dtype=object)
    counted = (numbers(table.column("alternative")) == 0.0) & ~np.isin(words, _WITHOUT_TARGET)
    places = np.flatnonzero(counted)
    places = places[np.argsort(by_snapshot[places], kind="stable")]
    ends = np.cumsum(np.bincount(by_snapshot[places], minlength=len(snapshots)))
    keys = [tuple(str(value) for value in key) for key in snapshots]
    return _Found(dict(zip(keys, np.split(position[places], ends[:-1]), strict=True)), shared)


_WITHOUT_TARGET = [
    status.word for status in (Status.NO_TARGET, Status.TOO_FEW, Status.NOT_CONVERGED, Status.NO_CANDIDATE)
]


def _look_up(found: _Found, key: tuple[Any, ...], grouping: list[str], name: str) -> FloatArray:
    values = dict(zip(["snapshot", *grouping], key, strict=True))
    wanted = (str(values["snapshot"]), *(str(values[name]) for name in found.grouping))
    if wanted not in found.by_snapshot:
        raise DataError(f"{name}: the estimates have no row of snapshot {values['snapshot']!r}; are they of this run?")
    return found.by_snapshot[wanted]
