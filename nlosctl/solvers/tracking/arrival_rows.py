"""Arrivals along a path: the offset that those of a snapshot have in common is the likeliest one, and eliminated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, Point, ignoring_overflow
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.models.arrivals import ArrivalRows, arrival_rows
from nlosctl.solvers.arrivals.late_arrivals import LateArrivals
from nlosctl.solvers.arrivals.outlier_model import arrival_outlier_model
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.tracking.path_rows import RowTerms, mixed_terms, trusted_terms

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


def trusted_arrivals(batch: ArrivalBatch) -> ArrivalPathRows:
    """Return arrivals that are all direct; raises UsageError for differences of several references."""
    return ArrivalPathRows(LateArrivals(_checked(batch, arrival_rows(batch)), None), None)


def late_arrivals(batch: ArrivalBatch, *, alpha: float, late_m: float | None) -> ArrivalPathRows:
    """Return arrivals, some of them late; raises UsageError for differences of several references."""
    model = arrival_outlier_model(batch, alpha=alpha, late_m=late_m)
    _checked(batch, model.arrivals)
    rows = model.mixture.rows
    assert isinstance(rows, LateArrivals)  # noqa: S101 - those of arrivals
    return ArrivalPathRows(rows, model.mixture)


def _checked(batch: ArrivalBatch, arrivals: ArrivalRows) -> ArrivalRows:
    if arrivals.of_pairs or batch.speed_std is not None:
        raise UsageError("tracks are of arrivals with one offset a snapshot, at a speed that is exactly known")
    return arrivals
