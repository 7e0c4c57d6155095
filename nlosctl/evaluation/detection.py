"""Scores of indirect-path flags: error rates, ROC curve, calibration of the p-values."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import kolmogorov

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ThreeValuedArray
from nlosctl.evaluation.error_statistics import ratio, rows_by_group
from nlosctl.evaluation.summaries import DetectionSummary

__all__ = ["DetectionScores", "RocCurve", "kolmogorov_smirnov", "roc_curve"]


@dataclass(frozen=True)
class RocCurve:
    """P_d over P_fa as the threshold on the p-value rises from 0 to 1: corner points from (0, 0) to (1, 1)."""

    p_fa: FloatArray
    p_d: FloatArray

    @property
    def area(self) -> float:
        """The area under the curve, by trapezoids: ties count half, as in the Mann-Whitney statistic."""
        return float(np.sum(np.diff(self.p_fa) * 0.5 * (self.p_d[1:] + self.p_d[:-1])))

    def samples(self) -> dict[str, list[float]]:
        """Return ``p_fa`` (0, and 20 values per decade from 0.001 to 1) and ``p_d`` there; empty without a curve."""
        if not self.p_fa.size:
            return {"p_fa": [], "p_d": []}
        p_fa = [0.0, *np.logspace(-3.0, 0.0, 61).tolist()]
        return {"p_fa": p_fa, "p_d": [self.p_d_at(value) for value in p_fa]}

    def p_d_at(self, p_fa: float) -> float:
        """Return P_d on the curve at a P_fa, the upper end of a vertical step; NaN without a curve."""
        return float(np.interp(p_fa, self.p_fa, self.p_d)) if self.p_fa.size else math.nan


def roc_curve(p_value: FloatArray, indirect: BoolArray) -> RocCurve:
    """Return the curve of flags "p-value below a threshold" for paths (N,); a path without p-value is never flagged.

    Empty if all paths are direct, or all indirect.
    """
    positives = int(np.count_nonzero(indirect))
    if positives in (0, indirect.size):
        return RocCurve(np.empty(0), np.empty(0))
    score = np.where(np.isnan(p_value), 1.0, p_value)
    order = np.argsort(score, kind="stable")
    ends = np.append(np.flatnonzero(np.diff(score[order])), score.size - 1)
    hits = np.cumsum(indirect[order])[ends]
    flagged = ends + 1
    p_fa = np.concatenate([[0.0], (flagged - hits) / (indirect.size - positives)])
    return RocCurve(p_fa, np.concatenate([[0.0], hits / positives]))


def kolmogorov_smirnov(p_value: FloatArray) -> tuple[float, float]:
    """Return the Kolmogorov-Smirnov distance of p-values (N,) from the uniform law, and the p-value of that distance.

    NaN are left out; NaN, NaN without p-values. The asymptotic law with Stephens' correction for N.
    """
    values = np.sort(p_value[~np.isnan(p_value)])
    count = values.size
    if not count:
        return math.nan, math.nan
    steps = np.arange(count + 1) / count
    distance = float(max(np.max(steps[1:] - values), np.max(values - steps[:-1])))
    root = math.sqrt(count)
    return distance, float(kolmogorov((root + 0.12 + 0.11 / root) * distance))


@dataclass
class _Tally:
    """The running sums of one group; ``counts`` (3, 3) by truth, then flag: unknown, false, true."""

    counts: IntArray = field(default_factory=lambda: np.zeros((3, 3), dtype=np.int64))
    p_values: list[FloatArray] = field(default_factory=list)
    indirect: list[BoolArray] = field(default_factory=list)

    def include(self, other: _Tally) -> None:
        self.counts = self.counts + other.counts
        self.p_values += other.p_values
        self.indirect += other.indirect


class DetectionScores:
    """``ip`` and ``p_value`` against ``truth_ip``, by group, in one pass, with 9 bytes of memory per row."""

    def __init__(self) -> None:
        self._groups: dict[Hashable, _Tally] = {}

    def add(
        self,
        ip: ThreeValuedArray,
        truth_ip: ThreeValuedArray,
        p_value: FloatArray | None,
        group: IntArray,
        keys: Sequence[Hashable],
    ) -> None:
        """Add rows (N,): flags are 1 true, 0 false, -1 unknown; ``group`` and ``keys`` as in `rows_by_group`."""
        cell = 3 * (truth_ip.astype(np.int64) + 1) + ip + 1
        for key, rows in rows_by_group(group, keys):
            tally = self._groups.setdefault(key, _Tally())
            tally.counts += np.bincount(cell[rows], minlength=9).reshape(3, 3)
            if p_value is not None:
                judged = rows & (truth_ip >= 0) & (ip >= 0)
                tally.p_values.append(p_value[judged])
                tally.indirect.append(truth_ip[judged] == 1)

    def result(self) -> dict[Hashable, DetectionSummary]:
        """Return the summary of each group, in order of first appearance."""
        return {key: _summary(tally) for key, tally in self._groups.items()}

    def overall(self) -> DetectionSummary:
        """Return the summary of all rows of all groups."""
        total = _Tally()
        for tally in self._groups.values():
            total.include(tally)
        return _summary(total)


def _summary(tally: _Tally) -> DetectionSummary:
    table = tally.counts
    (dp_dp, dp_ip), (ip_dp, ip_ip) = ((int(n) for n in row) for row in table[1:, 1:])
    p_value = np.concatenate(tally.p_values) if tally.p_values else np.empty(0)
    indirect = np.concatenate(tally.indirect) if tally.indirect else np.empty(0, dtype=bool)
    curve = roc_curve(p_value, indirect)
    ks, ks_p_value = kolmogorov_smirnov(p_value[~indirect])
    rows = dp_dp + dp_ip + ip_dp + ip_ip
    return DetectionSummary(
        rows=rows,
        without_flag=int(table[1:, 0].sum()),
        without_truth=int(table[0].sum()),
        direct_called_direct=dp_dp,
        direct_called_indirect=dp_ip,
        indirect_called_direct=ip_dp,
        indirect_called_indirect=ip_ip,
        p_fa=ratio(dp_ip, dp_dp + dp_ip),
        p_d=ratio(ip_ip, ip_dp + ip_ip),
        accuracy=ratio(dp_dp + ip_ip, rows),
        auc=curve.area if curve.p_fa.size else math.nan,
        p_d_at_5=curve.p_d_at(0.05),
        p_d_at_1=curve.p_d_at(0.01),
        ks=ks,
        ks_p_value=ks_p_value,
        roc=curve.samples(),
    )
