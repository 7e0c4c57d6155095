"""What is expected of a source among unlabelled bearings: where it may be, and how likely it gives which rows.

Against the hypothesis that its rows are clutter, a set of rows with its maximum-likelihood position weighs, in nats,

    L = sum over the rows seen (ln(P_D / lambda) - ln(sqrt(2 pi) s)) - chi^2 / 2 + n_missed ln(1 - P_D)
        + ln(beta) + D/2 ln(2 pi) - 1/2 ln det J

with the probability P_D that a sensor sees a source, lambda the density of clutter of a sensor per radian (per square
radian for a row with an elevation), s the standard deviation of a scalar, beta the density of sources and J the Fisher
information of the D coordinates. The last terms integrate the position out: otherwise the wide crossings of
two nearly parallel rays would weigh as much as sharp fixes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, log1p, pi
from typing import Any, NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock, rows_of, sum_measurements
from nlosctl.geometry.regions import Region
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import bearing_lines, has_geodesics
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.association.sensor_rows import SensorRows
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.bearings.space_row_terms import DirectDirections
from nlosctl.solvers.mixture.outlier_model import bearing_region, source_volume

__all__ = ["Hypotheses", "RowsAtPoints", "SourceModel", "set_weights", "source_model"]

_MARGIN_SHARE = 0.05
"""Default margin around the search region, in units of its larger side."""

_MINIMUM_RANGE_SHARE = 0.005
"""Default least distance of a source from a sensor that sees it, in units of the larger side of the sensors' box."""


@dataclass(frozen=True, kw_only=True)
class Hypotheses:
    """What is known before the rows are seen.

    ``detection_probability`` is that with which a sensor sees a source; ``clutter_density`` (1/rad) that of clutter of
    a sensor, None for that of all rows; ``reward`` (nats) the log of the number of sources to expect, in the search
    region or, if that is about the sensors, in their box; ``margin_m`` how far outside of the search region a source
    may be, and ``min_range_m`` how near to a sensor that sees it, None for shares of their sizes.
    """

    detection_probability: float
    clutter_density: float | None
    reward: float
    margin_m: float | None
    min_range_m: float | None


class RowsAtPoints(NamedTuple):
    """Half the chi-square (C, K) of all rows at points, its D derivatives and Gauss-Newton matrices (C, K)."""

    half: FloatArray
    gradient: tuple[FloatArray, ...]
    gauss: SymmetricMatrix


@dataclass(frozen=True)
class SourceModel(RowBlock):
    """The rows (B, K) of snapshots, and what is expected of a source.

    ``lines`` are the unfolded rays, ``direct`` compares rows with points about the local origins, ``log_seen`` (B, K)
    is what a row adds to the weight of a set besides its chi-square, ``scalars`` (B, K) the number of its angles,
    ``log_missed`` the weight of a sensor that does not see the source, ``log_density`` (B,) that of sources,
    ``margin_m`` (B,) is the width of the border around the search ``region``.
    """

    lines: Any
    direct: DirectBearings | DirectDirections
    log_seen: FloatArray
    scalars: IntArray
    log_missed: float
    log_density: FloatArray
    region: Region
    margin_m: FloatArray

    @property
    def unknowns(self) -> int:
        """The number of unknown coordinates, D."""
        return self.direct.dimension

    def contains(self, snapshot: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (C,) of snapshots (C,) are in the search region or its margin; NaN is not."""
        inside: BoolArray = rows_of(self.region, snapshot).edge_distance_m(*point) >= -self.margin_m[snapshot]
        return inside

    def terms(self, snapshot: IntArray, point: Point) -> RowsAtPoints:
        """Return the terms of all rows of snapshots (C,) at points about their local origins, D arrays (C,)."""
        direct = self.direct.take(snapshot)
        with ignoring_overflow():
            rows = [direct.derivatives(k, *point) for k in range(self.scalars.shape[1])]
        gradient = tuple(np.stack(parts).T for parts in zip(*(row.gradient for row in rows), strict=True))
        gauss = SymmetricMatrix(*(np.stack(parts).T for parts in zip(*(row.gauss.parts for row in rows), strict=True)))
        return RowsAtPoints(np.stack([row.half_chi_square for row in rows]).T, gradient, gauss)

    def height_terms(self, snapshot: IntArray, point: Point) -> tuple[FloatArray, Point, SymmetricMatrix]:
        """Return half the chi-square (C,) of a measured height, its derivatives and Gauss-Newton matrix; or zeros."""
        height = getattr(self.lines, "height", None)
        if height is None:
            zero = np.zeros(snapshot.shape)
            return zero, (zero,) * self.unknowns, SymmetricMatrix.full(snapshot.shape, 0.0, self.unknowns)
        height = height.take(snapshot)
        scaled, slopes = height.scaled_residual(*point), height.scaled_slopes(*point)
        return 0.5 * scaled * scaled, tuple(scaled * slope for slope in slopes), SymmetricMatrix.outer(*slopes)

    def height_scalars(self) -> IntArray:
        """Return 1 for snapshots (B,) with a measured height that is not exact, else 0."""
        height = getattr(self.lines, "height", None)
        return np.zeros(self.margin_m.shape, dtype=np.int64) if height is None else height.known.astype(np.int64)


def source_model(table: SensorRows, hypotheses: Hypotheses) -> SourceModel:
    """Return the model of a batch; raises UsageError for azimuths of geodesics on the earth, which have none."""
    batch = table.batch
    if has_geodesics(batch):
        raise UsageError(
            "several sources by azimuths alone on the earth have no model in three dimensions; set `dimensions` to 2"
        )
    lines: Any = bearing_lines(batch)
    region = bearing_region(batch, lines, None)
    lower, upper = region.bounds_m
    side = np.max([most - least for least, most in zip(lower, upper, strict=True)], axis=0)
    margin = _MARGIN_SHARE * side if hypotheses.margin_m is None else np.full(side.shape, hypotheses.margin_m)
    minimum = _minimum_range_m(batch, side, hypotheses.min_range_m)
    if isinstance(lines, SpaceLines):
        direct: DirectBearings | DirectDirections = DirectDirections.of(lines, minimum * minimum)
    else:
        direct = DirectBearings.of(lines, minimum)
    density = hypotheses.clutter_density
    clutter = np.maximum(batch.measurements / table.sensors, 1.0) / (2.0 * pi) if density is None else density
    log_seen = log(hypotheses.detection_probability) - np.broadcast_to(np.log(clutter), side.shape)[:, None]
    log_seen = log_seen - 0.5 * log(2.0 * pi) - np.log(lines.std[:, : batch.measurements])
    if isinstance(lines, SpaceLines):
        std = lines.std[:, batch.measurements : 2 * batch.measurements]
        log_seen += lines.angles.has_elevation * (log(pi) - 0.5 * log(2.0 * pi) - np.log(std))
    with ignoring_overflow():
        log_density = hypotheses.reward - np.log(source_volume(lines, _expected_region(batch, lines)))
    log_missed = log1p(-hypotheses.detection_probability)
    return SourceModel(lines, direct, log_seen, direct.scalars(), log_missed, log_density, region, margin)


def _expected_region(batch: BearingBatch, lines: Any) -> Region:
    """Return the regions (B,) where sources are expected: of a search region about the sensors their own box."""
    field = batch.field
    if isinstance(field, SensorsField):
        field = SensorsField(factor=min(field.factor, _MARGIN_SHARE))
    return bearing_region(replace(batch, field=field), lines, None)


def _minimum_range_m(batch: BearingBatch, side_m: FloatArray, least_m: float | None) -> FloatArray:
    """Return the least distance (B,) of a source from a sensor that sees it."""
    x, y = batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]
    extent = np.maximum(np.ptp(x, axis=1), np.ptp(y, axis=1))
    share = _MINIMUM_RANGE_SHARE * extent if least_m is None else np.full(side_m.shape, least_m)
    return np.asarray(np.maximum(share, 1e-9 * side_m + np.finfo(np.float64).tiny ** 0.25))


def set_weights(
    model: SourceModel, sensors: IntArray, snapshot: IntArray, rows: IntArray, chi_square: FloatArray,
    information: SymmetricMatrix,
) -> FloatArray:  # fmt: skip
    """Return the weights L (C,) of sets of rows (C, N), -1 where a sensor has none, of snapshots (C,).

    ``sensors`` (B,) is the number of sensors of each snapshot; -inf where the information is singular.
    """
    seen = rows >= 0
    log_seen = np.where(seen, model.log_seen[snapshot[:, None], np.maximum(rows, 0)], 0.0)
    missed = sensors[snapshot] - np.count_nonzero(seen, axis=1)
    with ignoring_overflow():
        spread = 0.5 * model.unknowns * log(2.0 * pi) - 0.5 * np.log(information.determinant)
        weight = sum_measurements(log_seen) + missed * model.log_missed - 0.5 * chi_square
        weight += model.log_density[snapshot] + spread
    return np.where(np.isfinite(weight), weight, -np.inf)
