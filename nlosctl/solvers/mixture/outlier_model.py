"""The outlier model of a block of bearings: shares, densities, groups of paths, minimum ranges, the search region."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import log, pi, radians, sqrt
from typing import Any

import numpy as np
from scipy.special import erf

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.regions import Region, box_diagonal
from nlosctl.models.bearings import SightLines, sight_lines
from nlosctl.models.search_regions import reach_region, search_region
from nlosctl.solvers.bearings.fix_status import nearly_singular
from nlosctl.solvers.bearings.joint_range_bearing import range_columns
from nlosctl.solvers.bearings.line_fits import fit_least_squares
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.outlier_options import BearingOutlierOptions
from nlosctl.solvers.mixture.path_groups import PathGroups, group_paths, path_shares, sort_rows

__all__ = ["OutlierModel", "grouped_batch", "has_several_paths", "outlier_model"]


_RANGE_STANDARD_DEVIATIONS = 4.0
"""The default search region reaches beyond the longest range by this many of its standard deviations."""

_MINIMUM_RANGE_SHARE = 0.005
"""Default minimum range in units of the larger side of the box of the sensors."""


@dataclass(frozen=True)
class OutlierModel(RowBlock):
    """A block of bearings with all that equation (23) needs; shapes (B,) and (B, K).

    ``share`` is each row's probability to be the direct one of its group, given that one is; ``extent_m`` the
    diagonal of the search region, over which an outlier's range is uniform; ``measured_m`` and ``range_std_m`` are NaN
    in rows without a range, None where no row has one.
    """

    lines: SightLines
    direct: DirectBearings
    mixture: Mixture
    leader: IntArray
    share: FloatArray
    region: Region
    minimum_range_m: FloatArray
    extent_m: FloatArray
    sensor_extent_m: FloatArray
    measured_m: FloatArray | None
    range_std_m: FloatArray | None

    def take_rows(self, rows: IntArray) -> OutlierModel:
        """Return the model of some snapshots, in rising order, each named once: all of them are this itself."""
        return self if rows.shape[0] == self.extent_m.shape[0] else self.take(rows)

    def too_few(self) -> BoolArray:
        """Return which snapshots (B,) measure fewer scalars than a position has."""
        scalars = self.direct.scalars().sum(axis=1)
        few: BoolArray = scalars < self.direct.dimension
        return few

    def uninformative(self) -> BoolArray:
        """Return which snapshots (B,) can't determine a position for any values of their rows.

        Those have parallel lines, or all sensors at a single point, and no range.
        """
        uninformative = nearly_singular(fit_least_squares(self.lines).normal)
        uninformative |= _larger_side(self.lines.origin_x, self.lines.origin_y) <= 0.0
        if self.measured_m is not None:
            uninformative &= np.isnan(self.measured_m).all(axis=1)
        return uninformative


def has_several_paths(batch: BearingBatch) -> BoolArray:
    """Return in which snapshots (B,) some sensor has several paths, at most one of them direct."""
    several: BoolArray = np.asarray((_groups(batch).size > 1).any(axis=1))
    return several


def grouped_batch(batch: BearingBatch) -> tuple[BearingBatch, PathGroups]:
    """Return the batch with the paths of each sensor next to each other, and its groups in the file's order."""
    groups = _groups(batch)
    names = ("sensor", "sensor_xy_m", "bearing_rad", "bearing_std_rad", "path", "reflector", "range_m", "range_std_m")
    arrays: dict[str, Any] = {name: getattr(batch, name) for name in names}
    sorted_arrays: dict[str, Any] = {
        name: sort_rows(array, groups) for name, array in arrays.items() if array is not None
    }
    return dataclasses.replace(batch, **sorted_arrays), groups


def outlier_model(batch: BearingBatch, groups: PathGroups, options: BearingOutlierOptions) -> OutlierModel:
    """Return the model of a grouped batch: outlier share alpha and density 1 / field of view, equation (23).

    The default search region, that of the sensors, is enlarged by the longest range.
    The direct density is (1), Gaussian and truncated to a right angle on either side. A row with a range has the
    product of both densities, as an outlier too: its range is then uniform over the search region's diagonal.
    """
    lines = sight_lines(batch)
    sensor_x, sensor_y = batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]
    ranges = range_columns(batch, options.use_ranges)
    region = search_region(batch.field, (sensor_x, sensor_y), (lines.center_x, lines.center_y))
    if ranges is not None and isinstance(batch.field, SensorsField):
        reach = np.where(np.isnan(ranges[0]), -np.inf, ranges[0] + _RANGE_STANDARD_DEVIATIONS * ranges[1])
        x, y = sensor_x - lines.center_x[:, None], sensor_y - lines.center_y[:, None]
        region = reach_region(region, (x, y), max_measurements(reach))
    extent = box_diagonal(*region.bounds_m)
    sensor_extent = _larger_side(sensor_x, sensor_y)
    least = options.min_range_m
    minimum = _MINIMUM_RANGE_SHARE * sensor_extent if least is None else np.full(extent.shape, least)
    minimum = np.maximum(minimum, 1e-9 * extent + np.finfo(np.float64).tiny)
    share = sort_rows(path_shares(groups, options.path_prior), groups)
    fov = radians(options.field_of_view_deg)
    with ignoring_division():
        log_direct = np.log(share * (1.0 - options.alpha)) - np.log(
            lines.std_rad * (sqrt(2.0 * pi) / fov) * erf(pi / (2.0 * sqrt(2.0) * lines.std_rad))
        )
    log_nlos = np.full(extent.shape, -batch.measurements * log(fov))
    if ranges is not None:
        known = np.isfinite(ranges[0])
        with ignoring_division():
            log_direct += np.where(known, np.log(extent[:, None] / (ranges[1] * sqrt(2.0 * pi))), 0.0)
            log_nlos -= np.log(extent) * sum_measurements(known.astype(np.float64))
    rows = DirectBearings.of(lines, minimum, *(ranges or (None, None)), lognormal=options.range_noise == "lognormal")
    mixture = Mixture.of(rows, log_direct, np.full(extent.shape, options.alpha), groups.last, log_nlos)
    leader = sort_rows(groups.leader, groups)
    return OutlierModel(
        lines, rows, mixture, leader, share, region, minimum, extent, sensor_extent, *(ranges or (None, None))
    )


def _groups(batch: BearingBatch) -> PathGroups:
    """Return the groups of paths; rows without a path number are measurements of other times, each by itself."""
    alone = np.where(batch.path < 0, np.arange(batch.measurements), -1)
    keys = [batch.sensor, batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.reflector, alone]
    return group_paths(keys, batch.path)


def _larger_side(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the larger side (B,) of the box of points (B, K)."""
    return np.maximum(max_measurements(x) + max_measurements(-x), max_measurements(y) + max_measurements(-y))
