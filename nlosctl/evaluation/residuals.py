"""Figures of standardized residuals by group, such as by sensor: what shows the need of a calibration.

All sums are exact (`nlosctl.geometry.exact_sums`), so that the figures do not depend on how a file is cut.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.evaluation.error_statistics import ratio
from nlosctl.geometry.exact_sums import ExactSums

__all__ = ["OUTLIER_STDS", "ResidualScores"]

OUTLIER_STDS = 3.0
"""A row with a residual beyond so many of its stds is an outlier."""


@dataclass
class _Series:
    """Sums of one kind of residual of each group: number, sum, squares, and products of consecutive residuals.

    ``ends`` has the first and the last residual of each group.
    """

    sums: ExactSums = field(default_factory=ExactSums)
    ends: dict[Hashable, tuple[float, float]] = field(default_factory=dict)

    def add(self, value: FloatArray, group: IntArray, keys: Sequence[Hashable]) -> None:
        """Add residuals (N,) of the groups that ``group`` (N,) indexes, each group's in order."""
        order = np.argsort(group, kind="stable")
        value, group = value[order], group[order]
        before = np.concatenate([[0.0], value[:-1]])
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        stops = np.append(starts[1:], value.size) - 1
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
            key = keys[group[start]]
            first, last = self.ends.get(key, (float(value[start]), 0.0))
            before[start] = last
            self.ends[key] = first, float(value[stop])
        terms = np.stack([np.ones(value.size), value, value * value, value * before], axis=1)
        present, codes = np.unique(group, return_inverse=True)
        self.sums.add_groups([keys[number] for number in present.tolist()], codes, terms)

    def figures(self, groups: Sequence[Hashable]) -> tuple[float, float, float]:
        """Return mean, std and autocorrelation at lag 1 of the residuals of ``groups``; NaN where it is undefined.

        The autocorrelation is the sum of products of consecutive deviations from the mean over that of their squares.
        """
        groups = [key for key in groups if key in self.ends]
        pooled = ExactSums()
        for key in groups:
            pooled.merge(ExactSums({"": self.sums.totals[key]}))
        count, total, squares, products = pooled.sums("") or [0.0] * 4
        if count < 1.0:
            return math.nan, math.nan, math.nan
        mean = total / count
        spread = max(squares - count * mean * mean, 0.0)
        std = math.sqrt(spread / (count - 1.0)) if count > 1.0 else math.nan
        inner = 2.0 * total - math.fsum(end for key in groups for end in self.ends[key])
        together = products - mean * inner + (count - len(groups)) * mean * mean
        return mean, std, together / spread if spread > 0.0 and count > len(groups) else math.nan


class ResidualScores:
    """Standardized residuals by group, in one pass, with a few sums for each group."""

    def __init__(self) -> None:
        self._series: dict[str, _Series] = {}
        self._counts: dict[Hashable, IntArray] = {}

    def add(
        self, residuals: Mapping[str, FloatArray], used: BoolArray, group: IntArray, keys: Sequence[Hashable]
    ) -> None:
        """Add rows (N,) in the order of the snapshots: standardized residuals by name, NaN for a missing one.

        Means, scatter and autocorrelation are of rows ``used`` by a fix. ``group`` (N,) indexes ``keys``.
        """
        largest = np.full(used.shape, np.nan)
        for name, values in residuals.items():
            largest = np.fmax(largest, np.abs(values))
            chosen = np.flatnonzero(used & np.isfinite(values))
            self._series.setdefault(name, _Series()).add(values[chosen], group[chosen], keys)
        known = ~np.isnan(largest)
        parts = (known, known & used, known & (largest > OUTLIER_STDS))
        counts = np.stack([np.bincount(group[part], minlength=len(keys)) for part in parts], axis=1)
        for key, row in zip(keys, counts, strict=True):
            self._counts[key] = self._counts.get(key, 0) + row

    def result(self) -> dict[Hashable, dict[str, float]]:
        """Return the figures of each group, in order of first appearance."""
        return {key: self._figures([key]) for key in self._counts}

    def overall(self) -> dict[str, float]:
        """Return the figures of all rows; a group's residuals follow only those of the same group."""
        return self._figures(list(self._counts))

    def _figures(self, groups: Sequence[Hashable]) -> dict[str, float]:
        rows, used, outliers = (int(count) for count in sum((self._counts[key] for key in groups), np.zeros(3)))
        figures: dict[str, float] = {"rows": rows, "rows_used": used}
        for name, series in self._series.items():
            mean, std, autocorrelation = series.figures(groups)
            figures |= {f"{name}_mean": mean, f"{name}_std": std, f"{name}_autocorrelation": autocorrelation}
        return {**figures, "outlier_share": ratio(outliers, rows)}
