"""Compare estimates or flags with the truth, file by file; the memory grows by one error per row only."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from html import escape
from math import isnan
from typing import Any

import numpy as np

from nlosctl.contract.tables import ESTIMATES, FLAGS, SWEEP_PREFIX, is_swept
from nlosctl.errors import DataError, UsageError
from nlosctl.evaluation.detection import DetectionScores
from nlosctl.evaluation.estimates import EstimateRows, EstimateScores, nearest_alternatives
from nlosctl.evaluation.flags import FlagScores
from nlosctl.evaluation.targets import TargetScores
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.evaluation_arrays import (
    boolean_codes,
    estimate_arrays,
    group_codes,
    has_heights,
    numbers,
    whole_snapshots,
)
from nlosctl.io.results.reader import PlainReader
from nlosctl.io.results.truth_table import TruthTable

__all__ = ["Evaluation", "evaluate_inputs", "group_title", "grouping_columns", "is_label", "present"]

_LABELS = ("file", "source", "method")
_SHOWN_FIGURES, _SHOWN_GROUPS = 8, 20
"""A notebook shows so many columns and rows."""

Readers = Sequence[tuple[Input, PlainReader]]


@dataclass(frozen=True, kw_only=True, repr=False)
class Evaluation:
    """The metrics of each group of what was evaluated (``estimates``, ``flags`` or ``targets``), and of all rows.

    ``overall`` is None if there are several methods, whose pooled metrics mean nothing. NaN: undefined; infinite: the
    percentile falls on rows without an estimate. ``notes`` are remarks on the input.
    """

    of: str
    groups: list[dict[str, Any]]
    overall: dict[str, Any] | None
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        cells = [self._headings, *self._cells()]
        widths = [max(len(row[index]) for row in cells) for index in range(len(cells[0]))]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
        return "\n".join([f"Evaluation of {self.of}; all figures are in .groups and .overall", *lines, *self.notes])

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{'</td><td>'.join(map(escape, row))}</td></tr>" for row in self._cells())
        head = f"<tr><th>{'</th><th>'.join(map(escape, self._headings))}</th></tr>"
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>{notes}"

    @property
    def _headings(self) -> list[str]:
        """The heading of the groups, and the first figures that are single numbers."""
        first = self.groups[0] if self.groups else {}
        figures = [name for name, value in first.items() if isinstance(value, int | float) and not is_label(name)]
        return ["group", *figures[:_SHOWN_FIGURES]]

    def _cells(self) -> list[list[str]]:
        groups = [(group_title(group) or "all", group) for group in self.groups[:_SHOWN_GROUPS]]
        rows = [[title, *(_shown(group.get(name)) for name in self._headings[1:])] for title, group in groups]
        more = len(self.groups) - _SHOWN_GROUPS
        return [*rows, [f"and {more} more", *[""] * (len(self._headings) - 1)]] if more > 0 else rows


def _shown(value: object) -> str:
    if isinstance(value, float):
        return "-" if isnan(value) else f"{value:.4g}"
    return "-" if value is None else str(value)


def evaluate_inputs(inputs: Sequence[Input], *, truth: TruthTable | None, best_alternative: bool) -> Evaluation:
    """Evaluate files of estimates (or of flags) by method, ``sweep_*`` column and, if there are several, by file.

    ``truth`` replaces the truth columns of estimates. Without ``best_alternative`` only alternative 0 counts. Raises
    DataError for a file of another kind or without truth.
    """
    with ExitStack() as opened:
        readers = [(source, opened.enter_context(closing(PlainReader(source, ESTIMATES, FLAGS)))) for source in inputs]
        tables = {reader.table.name for _, reader in readers}
        if len(tables) > 1:
            raise DataError("the inputs are estimates and flags; evaluate them one by one")
        if tables == {FLAGS.name} and truth is not None:
            raise UsageError("`truth` is for estimates; the input is flags, whose rows have their truth")
        if tables == {FLAGS.name}:
            return _evaluate_flags(readers)
        return _evaluate_estimates(readers, truth, best_alternative)


def _evaluate_estimates(readers: Readers, truth: TruthTable | None, best_alternative: bool) -> Evaluation:
    scores = EstimateScores()
    grouping: list[str] = []
    _refuse_mixed_dimensions(readers)
    for source, reader in readers:
        grouping = grouping_columns(reader.schema.names)
        for table in whole_snapshots(reader.batches()):
            arrays = estimate_arrays(table, truth, source.name)
            rows = EstimateRows(
                position_m=arrays.position_m,
                covariance_m2=arrays.covariance_m2,
                status=arrays.status,
                truth_m=arrays.truth_m,
                used_share=arrays.used_share,
                fit_p_value=arrays.fit_p_value,
                std_dof=arrays.std_dof,
            )
            group, keys = group_codes(table, grouping)
            if best_alternative:
                same = [group_codes(table, ["snapshot", "target"])[0], group]
                counted = nearest_alternatives(rows.error_m, arrays.alternative, *same)
            else:
                counted = np.flatnonzero(arrays.alternative == 0)
            scores.add(rows.take(counted), group[counted], [_named(readers, source, key) for key in keys])
    evaluation = present("estimates", scores, readers, grouping)
    return evaluation if truth is None else dataclasses.replace(evaluation, notes=tuple(truth.remark()))


def _refuse_mixed_dimensions(readers: Readers) -> None:
    """Raise DataError for estimates with heights beside estimates without."""
    first, others = readers[0], readers[1:]
    for source, reader in others:
        if has_heights(reader.schema.names) != has_heights(first[1].schema.names):
            high, flat = (source, first[0]) if has_heights(reader.schema.names) else (first[0], source)
            raise DataError(
                f"{flat.name}: no column 'z_m', but {high.name} has one: estimates of two and of three dimensions; "
                "evaluate them one by one"
            )


def _evaluate_flags(readers: Readers) -> Evaluation:
    """Evaluate indirect-path flags if the first file has them with their truth, else line-of-sight flags."""
    if {"ip", "truth_ip"} <= set(readers[0][1].schema.names):
        return _evaluate_detection(readers)
    scores = FlagScores()
    grouping: list[str] = []
    for source, reader in readers:
        _require_columns(source, reader, "los", "truth_los")
        grouping = grouping_columns(reader.schema.names)
        for table in reader.batches():
            group, keys = group_codes(table, grouping)
            los, truth_los = boolean_codes(table.column("los")), boolean_codes(table.column("truth_los"))
            scores.add(los, truth_los, group, [_named(readers, source, key) for key in keys])
    return present("flags", scores, readers, grouping)


def _evaluate_detection(readers: Readers) -> Evaluation:
    scores = DetectionScores()
    grouping: list[str] = []
    for source, reader in readers:
        _require_columns(source, reader, "ip", "truth_ip")
        grouping = grouping_columns(reader.schema.names)
        for table in reader.batches():
            group, keys = group_codes(table, grouping)
            ip, truth_ip = boolean_codes(table.column("ip")), boolean_codes(table.column("truth_ip"))
            p_value = numbers(table.column("p_value")) if "p_value" in table.column_names else None
            scores.add(ip, truth_ip, p_value, group, [_named(readers, source, key) for key in keys])
    return present("flags", scores, readers, grouping)


def _require_columns(source: Input, reader: PlainReader, *names: str) -> None:
    for name in names:
        if name not in reader.schema.names:
            raise DataError(
                f"{source.name}: no column {name!r}: flags are evaluated by 'ip' against 'truth_ip', "
                "or by 'los' against 'truth_los'"
            )


def is_label(name: str) -> bool:
    """Return whether a key of a group is an identifier rather than a metric."""
    return name in _LABELS or is_swept(name)


def group_title(group: Mapping[str, Any]) -> str:
    """Return the file, source, method and ``sweep_*`` values of a group as text; empty for a single group."""
    labels = [str(group[label]) for label in _LABELS if label in group]
    labels += [f"{name.removeprefix(SWEEP_PREFIX)}={value}" for name, value in group.items() if is_swept(name)]
    return " ".join(labels)


def grouping_columns(names: Sequence[str]) -> list[str]:
    """Return the columns that group the results: source, method, ``sweep_*``."""
    return [name for name in names if name in ("source", "method") or is_swept(name)]


def _named(readers: Readers, source: Input, key: tuple[Any, ...]) -> tuple[Any, ...]:
    return (source.name, *key) if len(readers) > 1 else key


def present(
    of: str,
    scores: EstimateScores | FlagScores | DetectionScores | TargetScores,
    readers: Sequence[Any],
    grouping: Sequence[str],
) -> Evaluation:
    """Return the scores as plain values; their keys are the file, if there are several, and the grouping columns."""
    names = (["file"] if len(readers) > 1 else []) + list(grouping)
    groups: list[dict[str, Any]] = []
    for key, summary in scores.result().items():
        assert isinstance(key, tuple)  # noqa: S101 - made above
        groups.append({**dict(zip(names, key, strict=True)), **_figures(summary)})
    if not groups:
        raise DataError(f"{', '.join(source.name for source, _ in readers)}: no rows to evaluate")
    several = len({group.get("method") for group in groups}) > 1
    return Evaluation(of=of, groups=groups, overall=None if several else _figures(scores.overall()))


def _figures(summary: Any) -> dict[str, Any]:
    """Return the figures of a summary, without those of space for positions in the plane."""
    return {name: value for name, value in dataclasses.asdict(summary).items() if value is not None}
