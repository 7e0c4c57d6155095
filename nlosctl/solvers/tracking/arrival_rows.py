"""Arrivals along a path: the offset that those of a snapshot have in common is the likeliest one, and eliminated.

Independent differences of pairs of sensors have no offset: they are rows as any other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows, arrival_rows
from nlosctl.solvers.arrivals.late_arrivals import LateArrivals
from nlosctl.solvers.arrivals.outlier_model import arrival_outlier_model
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.optimization.problem import RowDerivatives
from nlosctl.solvers.tracking.path_rows import PathRows, RowTerms, mixed_terms, trusted_terms

__all__ = ["ArrivalPathRows", "late_arrivals", "trusted_arrivals"]

_STEPS = 40
_SETTLED_NATS = 1e-13
"""The offset has settled when a step gains less than this."""


@dataclass(frozen=True)
class ArrivalPathRows(RowBlock):
    """Arrivals (B, K) as `PathRows`; the terms of rows have the offset as their last unknown.

    ``mixture`` is None where every row is trusted.
    """

    late: LateArrivals
    mixture: Mixture | None

    order: None = None
    residuals: None = None

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The local origin, D arrays (B,)."""
        return self.late.arrivals.center

    @property
    def count(self) -> int:
        """The number of rows of each snapshot, K."""
        return int(self.late.arrivals.std_m.shape[1])

    def in_order(self, values: FloatArray) -> FloatArray:
        """Return values (B, K) of the file's rows in the order of these."""
        return values

    def in_file_order(self, values: FloatArray) -> FloatArray:
        """Return values (B, K) of these rows in the order of the file."""
        return values

    def compare(self, point_of: Callable[[int], Point], tempering: float = 1.0) -> RowTerms:
        """Return the terms of the rows, row ``k`` at the points ``point_of(k)`` (B,), at the likeliest offset (B,)."""
        points = [point_of(k) for k in range(self.count)]
        excess = self._excess_m(points)
        precision = 1.0 / self.late.arrivals.std_m**2
        with ignoring_overflow():
            if self.mixture is None:
                offset = sum_measurements(precision * excess) / sum_measurements(precision)
                found = self._terms(points, offset, tempering)
            else:
                found, offset = self._likeliest(points, excess, tempering)
        return RowTerms(found.cost, found.rows, found.weight, {"residual_m": excess - offset[:, None]})

    def _likeliest(self, points: list[Point], excess: FloatArray, tempering: float) -> tuple[RowTerms, FloatArray]:
        """Return the terms at the likeliest offset: from the best with one exact row, by steps of the EM algorithm."""
        offset, cost = excess[:, 0].copy(), np.full(excess.shape[0], np.inf)
        for k in range(self.count):
            other = self._terms(points, excess[:, k], tempering).cost
            offset, cost = np.where(other < cost, excess[:, k], offset), np.minimum(other, cost)
        limit = -max_measurements(-self.late.arrivals.std_m) * tempering
        found = self._terms(points, offset, tempering)
        for _ in range(_STEPS):
            slope, bend = _by_offset(found)
            step = np.clip(slope / np.maximum(bend, np.finfo(np.float64).tiny), -limit, limit)
            if (np.abs(step * slope) <= _SETTLED_NATS).all():
                break
            trial = self._terms(points, offset - step, tempering)
            better = trial.cost <= found.cost
            if not better.any():
                break
            offset = np.where(better, offset - step, offset)
            found = self._terms(points, offset, tempering)
        return found, offset

    def _terms(self, points: list[Point], offset: FloatArray, tempering: float) -> RowTerms:
        rows = [self.late.derivatives(k, *point, offset) for k, point in enumerate(points)]
        if self.mixture is None:
            return trusted_terms([row.direct() for row in rows], tempering)
        return mixed_terms(self.mixture, rows, np.ones(self.late.arrivals.std_m.shape), tempering)

    def _excess_m(self, points: list[Point]) -> FloatArray:
        """Return the arrivals less the distances of the points, (B, K)."""
        arrivals = self.late.arrivals
        distance = [
            np.sqrt(np.sum([(part - own[:, k]) ** 2 for part, own in zip(point, arrivals.sensor, strict=True)], axis=0))
            for k, point in enumerate(points)
        ]
        return np.asfortranarray(arrivals.arrival_m - np.stack(distance, axis=1))


def _by_offset(found: RowTerms) -> tuple[FloatArray, FloatArray]:
    """Return the derivative (B,) of the cost by the offset, and the expected second one."""
    slope, bend = np.zeros(found.cost.shape), np.zeros(found.cost.shape)
    for k, row in enumerate(found.rows):
        slope += found.weight[:, k] * row.gradient[-1]
        bend += found.weight[:, k] * row.gauss.parts[-1]
        if row.outlier is not None:
            slope += row.outlier.gradient[-1]
            bend += row.outlier.gauss.parts[-1]
    return slope, bend


@dataclass(frozen=True)
class _Differences(RowBlock):
    """Independent differences (B, K) of pairs of sensors: (t - |x - a_i| + |x - a_j|) / s."""

    arrivals: ArrivalRows

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,) and its derivatives, those of Gauss and Newton."""
        rows = self.arrivals
        (first, along), (second, back) = (self._from(at, point) for at in (k, rows.arrival_m.shape[1] + k))
        scaled = (rows.arrival_m[:, k] - first + second) / rows.std_m[:, k]
        slopes = [(other - one) / rows.std_m[:, k] for one, other in zip(along, back, strict=True)]
        gauss = SymmetricMatrix.outer(*slopes)
        return RowDerivatives(0.5 * scaled * scaled, tuple(scaled * slope for slope in slopes), gauss, gauss)

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: one."""
        return np.ones(self.arrivals.std_m.shape, dtype=np.int64)

    def _from(self, at: int, point: Point) -> tuple[FloatArray, list[FloatArray]]:
        """Return the distance (B,) of points from a sensor or reference, and its derivatives."""
        away = [part - own[:, at] for part, own in zip(point, self.arrivals.sensor, strict=True)]
        squared = np.sum([part * part for part in away], axis=0)
        if self.arrivals.height is not None:
            squared += self.arrivals.height[:, at] ** 2
        distance = np.sqrt(squared)
        return distance, [part / distance for part in away]


def trusted_arrivals(batch: ArrivalBatch) -> ArrivalPathRows | PathRows:
    """Return arrivals that are all direct, or independent differences; raises UsageError for an uncertain speed."""
    rows = _checked(batch)
    if not rows.of_pairs:
        return ArrivalPathRows(LateArrivals(rows, None), None)
    return PathRows.trusted(_Differences(rows), rows.center, lambda *point: {"residual_m": rows.residual_m(*point)})


def late_arrivals(batch: ArrivalBatch, *, alpha: float, late_m: float | None) -> ArrivalPathRows:
    """Return arrivals, some of them late; raises UsageError for an uncertain speed."""
    _checked(batch)
    model = arrival_outlier_model(batch, alpha=alpha, late_m=late_m)
    rows = model.mixture.rows
    assert isinstance(rows, LateArrivals)  # noqa: S101 - those of arrivals
    return ArrivalPathRows(rows, model.mixture)


def _checked(batch: ArrivalBatch) -> ArrivalRows:
    if batch.speed_std is not None:
        raise UsageError("a track takes the speed of the wave as exactly known; leave `speed_std_m_s` out")
    return arrival_rows(batch)
