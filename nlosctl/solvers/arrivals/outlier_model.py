"""Arrivals of one source, some of them late: the mixture of their rows, its search region and its evidence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi, sqrt

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.regions import Ball, PrismRegion, Region, box_diagonal
from nlosctl.models.arrivals import ArrivalRows, arrival_rows
from nlosctl.models.search_regions import limit_height, search_region
from nlosctl.solvers.arrivals.late_arrivals import LateArrivals
from nlosctl.solvers.mixture.consensus import bonus_of_agreement, log_evidence, volume_with
from nlosctl.solvers.mixture.initial_estimates import Mode
from nlosctl.solvers.mixture.likelihood import Mixture

__all__ = ["ArrivalOutlierModel", "arrival_outlier_model"]

_PLAUSIBLE_SHARE = 0.25
"""The share of the default search region, which is generous, in which a source is expected."""

_HEIGHT_STDS = 5.0
"""The search region ends so many standard deviations above and below a measured height."""

_OFFSET_STDS = 8.0
"""No arrival is earlier than the source at its sensor by more than so many standard deviations."""

_OFFSET_STEPS = 12
"""Newton steps of at most a standard deviation to the likeliest offset at a known position."""

_WITHIN_STDS = 6.0
"""A row agrees with a position by chance if it is in an interval of so many standard deviations, out of the window."""

_OUTLIER_PRICE = 0.5
"""Of the nats that an outlier costs a source, log(1 / alpha), no consensus counts this share for each row that agrees
with a position only if there is a source: with 1.8 nats uniform arrivals of 4 to 50 rows are no fix in 98 %."""


@dataclass(frozen=True)
class ArrivalOutlierModel(RowBlock):
    """A block of arrivals with all that the mixture needs; shapes (B,) and (B, K).

    Points of the ``mixture`` and its search ``region`` have the offset as their last coordinate. ``uniform`` is the
    mixture whose outliers are uniform over the ``window_m`` (B,) that contains the snapshot's arrivals: the law of
    arrivals without a source. ``volume`` (B,) is that in which a source is expected, without the offset.
    """

    arrivals: ArrivalRows
    mixture: Mixture
    uniform: Mixture
    region: PrismRegion
    volume: FloatArray
    window_m: FloatArray

    def log_evidence(self, mode: Mode) -> FloatArray:
        """Return the logarithm of the evidence of modes (B,) over that of "no source", in nats.

        Without a source arrivals are anything in the window of the snapshot. That is denser than up to the largest
        delay, and holds for the outliers of a source too. It is the evidence that no row is an outlier, with the
        `bonus_of_agreement`, where that is more.
        """
        uniform = self.uniform
        with ignoring_invalid():
            cost = uniform.score(*(part[:, None] for part in mode.point))[:, 0]
            probability, _ = uniform.responsibilities(*mode.point)
        evidence = log_evidence(uniform, cost, probability, mode.hessian, self.volume * self.window_m)
        log_width = sum_measurements(np.log(_WITHIN_STDS * self.arrivals.std_m)) / uniform.count
        bonus = bonus_of_agreement(uniform, probability, log_width - np.log(self.window_m), uniform.dimension)
        spare = max(uniform.count - uniform.dimension - 1, 0)
        return np.maximum(evidence, evidence + bonus) - _OUTLIER_PRICE * spare * np.log(uniform.obstructed)

    def log_evidence_outside(self, mode: Mode, rows: IntArray) -> FloatArray:
        """Return the evidence (N,) of modes (B,) outside the search region in some snapshots, which is enlarged."""
        part, outside = self.take(rows), mode.take(rows)
        return replace(part, volume=volume_with(part.region.base, outside.point[:-1])).log_evidence(outside)

    def likeliest_offset(self, *point: FloatArray) -> FloatArray:
        """Return the likeliest offset (B,) at positions (B,): the best with one exact row, then Newton steps."""
        excess = self.arrivals.arrival_m - self.arrivals.distance_m(*point)
        mixture, limit = self.mixture, -max_measurements(-self.arrivals.std_m)
        with ignoring_invalid():
            cost = mixture.score(*(np.broadcast_to(part[:, None], excess.shape) for part in point), excess)
            offset: FloatArray = excess[np.arange(excess.shape[0]), np.argmin(cost, axis=1)]
            for _ in range(_OFFSET_STEPS):
                at = mixture.evaluate(*point, offset)
                offset = offset - np.clip(at.gradient[-1] / at.hessian.diagonal[-1], -limit, limit)
        return offset

    def too_few(self) -> BoolArray:
        """Return which snapshots (B,) have sensors at a single point only, or fewer scalars than unknowns."""
        few: BoolArray = self.arrivals.single_origin() | (self.arrivals.degrees_of_freedom < 0)
        return few


def arrival_outlier_model(batch: ArrivalBatch, *, alpha: float, late_m: float | None) -> ArrivalOutlierModel:
    """Return the model of a batch: a share ``alpha`` of rows is late by up to ``late_m`` metres, uniformly.

    Default: by any magnitude up to the diagonal of the search region, see `LateArrivals`.
    """
    arrivals = arrival_rows(batch)
    region = _region(batch, arrivals)
    least = max_measurements(arrivals.std_m)
    extent = np.maximum(box_diagonal(*region.bounds_m), least)
    spread, count = max_measurements(arrivals.arrival_m) + max_measurements(-arrivals.arrival_m), batch.measurements
    window = np.minimum(spread * (count + 1.0) / max(count - 1.0, 1.0), extent)  # the first factor: without bias
    window = np.maximum(window, least)
    volume = region.volume * (_PLAUSIBLE_SHARE if isinstance(batch.field, SensorsField) else 1.0)
    if arrivals.level is not None:  # a measured height counts as its Gaussian
        volume = volume * np.where(arrivals.level.known, sqrt(2.0 * pi) / (2.0 * _HEIGHT_STDS), 1.0)
    latest = extent if late_m is None else np.full(extent.shape, late_m)
    return ArrivalOutlierModel(
        arrivals,
        _mixture(LateArrivals.of(arrivals, latest, uniform=late_m is not None), latest, alpha),
        _mixture(LateArrivals.of(arrivals, window, uniform=True), window, alpha),
        _with_offsets(arrivals, region),
        volume,
        window,
    )


def _mixture(rows: LateArrivals, late_m: FloatArray, alpha: float) -> Mixture:
    arrivals = rows.arrivals
    log_direct = log(1.0 - alpha) + np.log(late_m)[:, None] - np.log(arrivals.std_m * sqrt(2.0 * pi))
    log_nlos = -arrivals.std_m.shape[1] * np.log(late_m)
    return Mixture.of(rows, log_direct, np.full(late_m.shape, alpha), None, log_nlos, rows, arrivals.level)


def _region(batch: ArrivalBatch, rows: ArrivalRows) -> Region:
    """Return the search regions of positions; in space about as high as a measured height may be."""
    sensors = tuple(part + middle[:, None] for part, middle in zip(rows.sensor, rows.center, strict=True))
    region = search_region(batch.field, sensors, rows.center)
    if rows.level is None:
        return region
    with ignoring_division():
        return limit_height(region, rows.level.z_m, _HEIGHT_STDS / rows.level.inverse_std)


def _with_offsets(rows: ArrivalRows, region: Region) -> PrismRegion:
    """Return search regions of position and offset: no row is early, and one at least is direct."""
    ball = Ball.about(region, np.arange(rows.origin_m.size))
    farthest = rows.distance_m(*ball.center) + ball.radius[:, None]
    slack = _OFFSET_STDS * rows.std_m
    latest = -max_measurements(-(rows.arrival_m + slack))
    earliest = -max_measurements(farthest + slack - rows.arrival_m)
    return PrismRegion(region, earliest, latest)
