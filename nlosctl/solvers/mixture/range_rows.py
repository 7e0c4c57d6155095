"""Ranges of one source, some of them outliers: the rows of the mixture, its model, and initial estimates."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from math import exp, log, pi, sqrt
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_division
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.regions import Ball, Region, box_diagonal
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.spheres import RangeRows, RangeSpheres, range_rows
from nlosctl.models.search_regions import limit_height, reach_region, search_region
from nlosctl.solvers.mixture.consensus import bonus_of_agreement, log_evidence, rival_mass
from nlosctl.solvers.mixture.late_ranges import LateRanges
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.path_groups import PathGroups, group_paths, path_shares, sort_rows
from nlosctl.solvers.mixture.ranked_estimates import RankedFixes
from nlosctl.solvers.optimization.problem import RowDerivatives
from nlosctl.solvers.ranges.rings import ring_density, sample_ring

__all__ = ["BiasLaw", "DirectRanges", "RangeOutlierModel", "grouped_ranges", "range_outlier_model"]


_PLAUSIBLE_SHARE = 0.25
"""The share of the default search region, which is generous, in which a source is expected."""

_WITHIN_STDS = 6.0
"""A row agrees with a position by chance if it is in an interval of so many standard deviations about the distance, out
of the side of the area in which a source is expected."""

_HEIGHT_STDS = 5.0
"""The search region ends so many standard deviations above and below a measured height."""

_NO_OUTLIER = 1e-30
"""The share of outliers with bias=none, which keeps the likelihood above zero far from a range."""


@dataclass(frozen=True)
class DirectRanges(RowBlock):
    """Rows (B, K) of ranges as the mixture needs them: Gaussian about the distance from the sensor."""

    circles: RangeRows

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point."""
        return len(self.circles.sensor)

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: one."""
        return np.ones(self.circles.range_m.shape, dtype=np.int64)

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P); half a million where it can't be direct."""
        half_chi_square = self.circles.length_m(k, *point)
        half_chi_square -= self.circles.range_m[:, k, None]
        half_chi_square *= sqrt(0.5) / self.circles.std_m[:, k, None]
        half_chi_square *= half_chi_square
        return half_chi_square

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) on the circle of the points of `sample_ridge`."""
        return ring_density(self.circles)

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density over that (B, P), ``ratio`` itself."""
        return ratio

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) about the circle of row ``k`` of a snapshot, as the range's error is distributed."""
        return sample_ring(self.circles, ball, snapshot, k, normal, uniform)

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,), and its derivatives."""
        path = self.circles.path(k, *point)
        precision = 1.0 / self.circles.std_m[:, k]
        scaled = (path.length_m - self.circles.range_m[:, k]) * precision
        gain, bend = precision * precision, scaled * precision / path.radius_m
        gauss = SymmetricMatrix.outer(*path.along, weight=gain)
        hessian = SymmetricMatrix(
            *(
                mine + bend * (1.0 - u * v) if i == j else mine - bend * u * v
                for mine, (i, u, j, v) in zip(gauss.parts, _pairs(path.along), strict=True)
            )
        )
        gradient = tuple(scaled * precision * part for part in path.along)
        return RowDerivatives(0.5 * scaled * scaled, gradient, gauss, hessian)


def _pairs(vector: Point) -> Iterator[tuple[int, FloatArray, int, FloatArray]]:
    """Yield the coordinates of the entries of a symmetric matrix in the order of its parts."""
    for i, right in enumerate(vector):
        for j, left in enumerate(vector[: i + 1]):
            yield i, left, j, right


@dataclass(frozen=True)
class RangeOutlierModel:
    """A block of ranges with all that the mixture needs; shapes (B,) and (B, K).

    ``share`` is each row's probability to be the direct one of its group, given that one is; ``volume`` (B,) the area
    in which a source is expected; ``log_density`` (B,) the logarithm of the density of an outlier of any range.
    """

    circles: RangeRows
    mixture: Mixture
    leader: IntArray
    share: FloatArray
    region: Region
    volume: FloatArray
    log_density: FloatArray

    def log_evidence(self, cost: FloatArray, probability: FloatArray, hessian: SymmetricMatrix) -> FloatArray:
        """Return the logarithm of the evidence of modes (B,) over that of "no source", in nats.

        Without a source a range is anything up to the longest of the snapshot. That is denser than over the diagonal of
        the search region, and holds for the outliers of a source too, apart from late ones. It is the evidence that no
        row is an outlier, with the `bonus_of_agreement`, where that is more.
        """
        gain = self._gain()
        if self.mixture.outliers is None:
            evidence = log_evidence(self.mixture, cost, probability, hessian, self.volume, gain)
            gain = gain[:, None]
            probability = gain * probability / (1.0 + (gain - 1.0) * probability)
        else:
            no_source = self.mixture.count * (self.log_density - np.log(gain))
            evidence = log_evidence(self.mixture, cost, probability, hessian, self.volume)
            evidence += self.mixture.log_nlos - no_source
        if self.mixture.last is not None:  # of several paths of a sensor all but one are outliers
            return evidence
        log_width = sum_measurements(np.log(_WITHIN_STDS * self.circles.std_m)) / self.mixture.count
        log_chance = log_width - np.log(self.volume) / self.mixture.dimension
        bonus = bonus_of_agreement(self.mixture, probability, log_chance, self.always_agree)
        return np.maximum(evidence, evidence + bonus)

    @property
    def always_agree(self) -> int:
        """So many rows always agree, as many as unknowns: whether there is a source can't be known from them."""
        return self.mixture.dimension - (self.circles.level is not None)

    def rivalled(self, fixes: RankedFixes, within: float) -> BoolArray:
        """Return which best fixes (B,) leave out a row although other modes have exp(-``within``) of their mass.

        A late range widens its own posterior (`LateRanges`): there are no other modes to weigh.
        """
        if self.mixture.outliers is not None:
            return np.zeros(self.volume.shape, dtype=bool)
        sensors = self.mixture.count if self.mixture.last is None else np.count_nonzero(self.mixture.last, axis=1)
        rivals = rival_mass(fixes, self.volume, self._gain()) >= exp(-within)
        return np.asarray(rivals & (fixes.n_used[:, 0] < sensors))

    def _gain(self) -> FloatArray:
        """Return by how much outliers (B,) are rarer if they are anything up to the longest range: at most 1."""
        longest = np.maximum(max_measurements(self.circles.range_m), np.finfo(np.float64).tiny)
        return np.asarray(np.minimum(np.exp(self.log_density) * longest, 1.0))


def grouped_ranges(batch: RangeBatch) -> tuple[RangeBatch, PathGroups]:
    """Return the batch with the numbered paths of each sensor next to each other, and its groups in the file's order.

    Rows without a path number are repeated measurements, each in a separate group.
    """
    alone = np.where(batch.path < 0, np.arange(batch.measurements), -1)
    keys = [batch.sensor, batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_height_m, alone]
    keys += [] if batch.reflector is None else [batch.reflector]
    groups = group_paths(keys, batch.path)
    keys += [] if batch.sensor_z_m is None else [batch.sensor_z_m]
    names = ("sensor", "sensor_xy_m", "range_m", "range_std_m", "path", "reflector", "sensor_height_m", "sensor_z_m")
    arrays: dict[str, Any] = {name: getattr(batch, name) for name in names}
    sorted_arrays: dict[str, Any] = {
        name: sort_rows(array, groups) for name, array in arrays.items() if array is not None
    }
    return dataclasses.replace(batch, **sorted_arrays), groups


@dataclass(frozen=True)
class BiasLaw:
    """The law of an outlier's range.

    ``both``: uniform with the density ``density_per_m``; None: one over the diagonal of the search region.
    ``positive``: the distance plus a bias of mean ``mean_m``, None if unknown; some outliers are as by ``both``.
    ``none``: no row is an outlier.
    """

    bias: str
    mean_m: float | None
    density_per_m: float | None


def range_outlier_model(
    batch: RangeBatch, groups: PathGroups, *, alpha: float, law: BiasLaw, path_prior: str
) -> RangeOutlierModel:
    """Return the model of a grouped batch: a share ``alpha`` of outliers, whose range has a law."""
    circles = range_rows(batch)
    region = _region(batch, circles)
    alpha = _NO_OUTLIER if law.bias == "none" else alpha
    obstructed = np.full(batch.size, alpha)
    share = sort_rows(path_shares(groups, path_prior), groups)
    with ignoring_division():
        log_share = np.log(share * (1.0 - alpha))
    log_width = np.log(circles.std_m * sqrt(2.0 * pi))
    extent = box_diagonal(*region.bounds_m)
    log_density = np.full(extent.shape, log(law.density_per_m)) if law.density_per_m else -np.log(extent)
    if law.bias == "positive":
        rows = LateRanges.of(circles, law.mean_m, log_density)
        log_stray = np.log(rows.stray)
        log_nlos = sum_measurements(log_stray - log_width)
        mixture = Mixture.of(rows, log_share - log_stray, obstructed, groups.last, log_nlos, rows, circles.level)
    else:
        log_direct = log_share - log_width - log_density[:, None]
        log_nlos = batch.measurements * log_density
        mixture = Mixture.of(DirectRanges(circles), log_direct, obstructed, groups.last, log_nlos, height=circles.level)
    volume = region.volume * (_PLAUSIBLE_SHARE if isinstance(batch.field, SensorsField) else 1.0)
    if circles.level is not None:  # a measured height counts as its Gaussian
        volume = volume * np.where(circles.level.known, sqrt(2.0 * pi) / (2.0 * _HEIGHT_STDS), 1.0)
    leader = sort_rows(groups.leader, groups)
    return RangeOutlierModel(circles, mixture, leader, share, region, volume, log_density)


def _region(batch: RangeBatch, rows: RangeRows) -> Region:
    """Return the search regions; a default field of the sensors is enlarged by the longest range.

    In space about as high as a measured height may be.
    """
    sensors: Point = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1])
    if batch.sensor_z_m is not None and isinstance(rows, RangeSpheres):
        sensors = (*sensors, batch.sensor_z_m)
    region = search_region(batch.field, sensors, rows.center)
    if isinstance(batch.field, SensorsField):
        region = reach_region(region, rows.sensor, max_measurements(batch.range_m))
    if rows.level is None:
        return region
    with ignoring_division():
        return limit_height(region, rows.level.z_m, _HEIGHT_STDS / rows.level.inverse_std)
