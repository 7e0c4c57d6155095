"""Results of an evaluation: the metrics of each group of rows, and the names of the groups."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isnan
from typing import Any

from nlosctl.contract.tables import SCORES, SWEEP_PREFIX, is_swept
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.evaluation.detection import DetectionScores
from nlosctl.evaluation.estimates import EstimateScores
from nlosctl.evaluation.flags import FlagScores
from nlosctl.evaluation.residuals import ResidualScores
from nlosctl.evaluation.targets import TargetScores
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.reader import PlainReader

__all__ = ["Evaluation", "Readers", "group_title", "grouping_columns", "is_label", "key_of", "present", "with_columns"]

_LABELS = ("file", "source", "method")
_SHOWN_FIGURES, _SHOWN_GROUPS = 8, 20
"""A notebook shows so many columns and rows."""

Readers = Sequence[tuple[Input, PlainReader]]


@dataclass(frozen=True, kw_only=True, repr=False)
class Evaluation:
    """The metrics of each group of what was evaluated (``estimates``, ``flags`` or ``targets``), and of all rows.

    ``overall`` is None if there are several methods, whose pooled metrics mean nothing. NaN: undefined; infinite: the
    percentile falls on rows without an estimate. ``by`` are the columns that were asked for, whose values the groups
    have as text. ``notes`` are remarks on the input.
    """

    of: str
    groups: list[dict[str, Any]]
    overall: dict[str, Any] | None
    by: tuple[str, ...] = ()
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


def is_label(name: str) -> bool:
    """Return whether a key of a group is an identifier rather than a metric."""
    return name in _LABELS or is_swept(name)


def group_title(group: Mapping[str, Any]) -> str:
    """Return the file, source, method, ``sweep_*`` and other values of a group as text; empty for a single group."""
    labels = [str(group[label]) for label in _LABELS if label in group]
    labels += [f"{name}={value}" for name, value in group.items() if isinstance(value, str) and not is_label(name)]
    labels += [f"{name.removeprefix(SWEEP_PREFIX)}={value}" for name, value in group.items() if is_swept(name)]
    return " ".join(labels)


def grouping_columns(names: Sequence[str]) -> list[str]:
    """Return the columns that group the results: source, method, ``sweep_*``."""
    return [name for name in names if name in ("source", "method") or is_swept(name)]


def with_columns(grouping: Sequence[str], by: Sequence[str], names: Sequence[str], file: str) -> list[str]:
    """Return the grouping columns and those of ``by`` that are not among them, which have to be at the end.

    Raises DataError if the file has no such column, UsageError for a column with the name of a metric.
    """
    for name in by:
        if name not in names:
            near = did_you_mean(name, names)
            raise DataError(f"{file}: `by` {name}: no column {name!r}{near}. The file has: {', '.join(names)}")
        if name not in grouping and name in SCORES.names:
            raise UsageError(f"`by` {name}: evaluations have a figure {name!r} of their own; rename the column")
    return [*grouping, *dict.fromkeys(name for name in by if name not in grouping)]


def key_of(readers: Readers, source: Input, key: tuple[Any, ...], by: int = 0) -> tuple[Any, ...]:
    """Return the key of a group: the file if there are several, the values ``key``, the last ``by`` of them as text."""
    first = len(key) - by
    texts = ("" if value is None else str(value) for value in key[first:])
    return (*((source.name,) if len(readers) > 1 else ()), *key[:first], *texts)


def present(
    of: str,
    scores: EstimateScores | FlagScores | DetectionScores | ResidualScores | TargetScores,
    readers: Sequence[Any],
    grouping: Sequence[str],
    by: Sequence[str] = (),
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
    overall = None if several else _figures(scores.overall())
    return Evaluation(of=of, groups=groups, overall=overall, by=tuple(dict.fromkeys(by)))


def _figures(summary: Any) -> dict[str, Any]:
    """Return the figures of a summary, without those of space for positions in the plane."""
    values = summary if isinstance(summary, dict) else dataclasses.asdict(summary)
    return {name: value for name, value in values.items() if value is not None}
