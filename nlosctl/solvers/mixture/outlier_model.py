"""The outlier model of a block of bearings: shares, densities, groups of paths, minimum ranges, the search region."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import reduce
from math import log, pi, radians, sqrt
from typing import Any

import numpy as np
from scipy.special import erf

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_division
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.regions import Region, box_diagonal
from nlosctl.models.measured_height import MeasuredHeight
from nlosctl.models.search_regions import limit_height, reach_region, search_region
from nlosctl.models.sight import bearing_lines, has_geodesics
from nlosctl.models.space.geodesic_lines import GeodesicLines, geodesics_about_sensors
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.fix_status import nearly_singular
from nlosctl.solvers.bearings.geodesic_row_terms import DirectGeodesics
from nlosctl.solvers.bearings.joint_range_bearing import range_columns
from nlosctl.solvers.bearings.line_fits import fit_least_squares
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.bearings.space_row_terms import DirectDirections
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.outlier_options import BearingOutlierOptions
from nlosctl.solvers.mixture.path_groups import PathGroups, group_paths, path_shares, sort_rows

__all__ = ["OutlierModel", "bearing_region", "grouped_batch", "has_several_paths", "outlier_model", "source_volume"]


_SPACE = 3

_HEIGHT_STANDARD_DEVIATIONS = 5.0
"""The search region reaches so many standard deviations beyond a measured height."""

_RANGE_STANDARD_DEVIATIONS = 4.0
"""The default search region reaches beyond the longest range by this many of its standard deviations."""

_MINIMUM_RANGE_SHARE = 0.005
"""Default minimum range in units of the larger side of the box of the sensors."""


@dataclass(frozen=True)
class OutlierModel(RowBlock):
    """A block of bearings with all that equation (23) needs; shapes (B,) and (B, K).

    ``lines`` are `SightLines` in the plane, `SpaceLines` in space, `GeodesicLines` about the middle of the sensors on
    the earth, ``direct`` the rows of either; ``volume`` is that
    (in the plane the area) in which a source may be; ``has_height`` marks that its height is measured, or known.
    ``share`` is each row's probability to be the direct one of its group, given that one is; ``extent_m`` the diagonal
    of the search region, over which an outlier's range is uniform; ``measured_m`` and ``range_std_m`` are NaN in rows
    without a range, None where no row has one.
    """

    lines: Any
    direct: Any
    mixture: Mixture
    leader: IntArray
    share: FloatArray
    region: Region
    volume: FloatArray
    minimum_range_m: FloatArray
    extent_m: FloatArray
    sensor_extent_m: FloatArray
    measured_m: FloatArray | None
    range_std_m: FloatArray | None
    has_height: bool = False

    def take_rows(self, rows: IntArray) -> OutlierModel:
        """Return the model of some snapshots, in rising order, each named once: all of them are this itself."""
        return self if rows.shape[0] == self.extent_m.shape[0] else self.take(rows)

    @property
    def crossing_lines(self) -> Any:
        """The lines for linear fits: those of geodesics are straight about their crossing alone."""
        return self.lines.about_crossing() if isinstance(self.lines, GeodesicLines) else self.lines

    def too_few(self) -> BoolArray:
        """Return which snapshots (B,) measure fewer scalars than a position has."""
        scalars = self.direct.scalars().sum(axis=1)
        if self.mixture.height is not None:
            scalars = scalars + self.mixture.height.known
        few: BoolArray = scalars < self.direct.dimension
        return few

    def uninformative(self) -> BoolArray:
        """Return which snapshots (B,) can't determine a position for any values of their rows.

        Those have parallel lines, or all sensors at a single point and no measured height, and no range.
        """
        uninformative = nearly_singular(fit_least_squares(self.crossing_lines).normal)
        if not self.has_height:
            uninformative |= _larger_side(*_origins(self.lines)) <= 0.0
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
    names: tuple[str, ...] = ("sensor", "sensor_xy_m", "sensor_z_m", "bearing_rad", "bearing_std_rad", "elevation_rad")
    names += ("elevation_std_rad", "direction_std_rad", "sensor_frame", "path", "reflector", "range_m", "range_std_m")
    arrays: dict[str, Any] = {name: getattr(batch, name) for name in names}
    sorted_arrays: dict[str, Any] = {
        name: sort_rows(array, groups) for name, array in arrays.items() if array is not None
    }
    return dataclasses.replace(batch, **sorted_arrays), groups


def outlier_model(batch: BearingBatch, groups: PathGroups, options: BearingOutlierOptions) -> OutlierModel:
    """Return the model of a grouped batch: outlier share alpha and density 1 / field of view, equation (23).

    The default search region, that of the sensors, is enlarged by the longest range.
    The direct density is (1), Gaussian and truncated to a right angle on either side. A row with a range has the
    product of both densities, as an outlier too: its range is then uniform over the search region's diagonal. The
    elevation of a row in space is Gaussian, that of an outlier uniform: one over the field of view and pi.
    """
    lines: Any = geodesics_about_sensors(batch) if has_geodesics(batch) else bearing_lines(batch)
    ranges = range_columns(batch, options.use_ranges)
    if ranges is not None and isinstance(lines, GeodesicLines):
        raise UsageError("ranges beside azimuths of geodesics have no model: set `parameters` use_ranges=false")
    region = bearing_region(batch, lines, ranges)
    extent = box_diagonal(*region.bounds_m)
    sensor_extent = _larger_side(*_sensors(batch, lines))
    least = options.min_range_m
    minimum = _MINIMUM_RANGE_SHARE * sensor_extent if least is None else np.full(extent.shape, least)
    minimum = np.maximum(minimum, 1e-9 * extent + np.finfo(np.float64).tiny)
    share = sort_rows(path_shares(groups, options.path_prior), groups)
    fov = radians(options.field_of_view_deg)
    std_rad = lines.std[:, : batch.measurements]
    with ignoring_division():
        log_direct = np.log(share * (1.0 - options.alpha)) - np.log(
            std_rad * (sqrt(2.0 * pi) / fov) * erf(pi / (2.0 * sqrt(2.0) * std_rad))
        )
    log_nlos = np.full(extent.shape, -batch.measurements * log(fov))
    if isinstance(lines, SpaceLines):
        elevated = lines.angles.has_elevation
        log_direct += elevated * (
            log(sqrt(pi / 2.0)) - np.log(lines.std[:, batch.measurements : 2 * batch.measurements])
        )
        log_nlos -= log(pi) * sum_measurements(elevated)
    if ranges is not None:
        known = np.isfinite(ranges[0])
        with ignoring_division():
            log_direct += np.where(known, np.log(extent[:, None] / (ranges[1] * sqrt(2.0 * pi))), 0.0)
            log_nlos -= np.log(extent) * sum_measurements(known.astype(np.float64))
    lognormal, height = options.range_noise == "lognormal", None
    rows: DirectBearings | DirectDirections | DirectGeodesics
    if isinstance(lines, GeodesicLines):
        rows = DirectGeodesics(lines, minimum)
    elif isinstance(lines, SpaceLines):
        height = lines.height
        lines = lines if ranges is None else lines.with_ranges(*ranges, lognormal=lognormal)
        rows = DirectDirections.of(lines, minimum * minimum)
    else:
        rows = DirectBearings.of(lines, minimum, *(ranges or (None, None)), lognormal=lognormal)
    obstructed = np.full(extent.shape, options.alpha)
    mixture = Mixture.of(rows, log_direct, obstructed, groups.last, log_nlos, height=height)
    leader = sort_rows(groups.leader, groups)
    has_height = height is not None or (isinstance(lines, SpaceLines) and lines.is_held)
    return OutlierModel(
        lines, rows, mixture, leader, share, region, source_volume(lines, region), minimum, extent, sensor_extent,
        ranges and ranges[0], ranges and ranges[1], has_height,
    )  # fmt: skip


def _sensors(batch: BearingBatch, lines: Any) -> Point:
    """Return the sensors' positions (B, K), those of the unknown coordinates; on the earth about the local origins."""
    if isinstance(lines, GeodesicLines):
        return lines.sensors_m
    sensors: Point = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1])
    return sensors if batch.sensor_z_m is None or lines.is_held else (*sensors, batch.sensor_z_m)


def _origins(lines: Any) -> Point:
    """Return the origins (B, K) of rays."""
    if isinstance(lines, GeodesicLines):
        return lines.sensors_m
    return lines.origin if isinstance(lines, SpaceLines) else (lines.origin_x, lines.origin_y)


def bearing_region(batch: BearingBatch, lines: Any, ranges: tuple[FloatArray, FloatArray] | None) -> Region:
    """Return the search regions; in space about as high as a height of the plane z = 0 may be."""
    sensors = _sensors(batch, lines)
    center = tuple(np.zeros(batch.size) for _ in sensors)
    if not isinstance(lines, GeodesicLines):
        center = lines.center[: len(sensors)]
    region = search_region(batch.field, sensors, center)
    if ranges is not None and isinstance(batch.field, SensorsField):
        reach = np.where(np.isnan(ranges[0]), -np.inf, ranges[0] + _RANGE_STANDARD_DEVIATIONS * ranges[1])
        about = tuple(part - middle[:, None] for part, middle in zip(sensors, center, strict=True))
        region = reach_region(region, about, max_measurements(reach))
    height = lines.height if isinstance(lines, SpaceLines) else None
    if not isinstance(height, MeasuredHeight):
        return region
    with ignoring_division():
        return limit_height(region, height.z_m, _HEIGHT_STANDARD_DEVIATIONS / height.inverse_std)


def source_volume(lines: Any, region: Region) -> FloatArray:
    """Return the volumes (B,) in which sources may be: a measured height counts as its Gaussian across the region."""
    height = lines.height if isinstance(lines, SpaceLines) else None
    if height is None:
        return region.volume
    lower, upper = region.bounds_m
    up, _ = height.plane(*(0.5 * (least + most) for least, most in zip(lower, upper, strict=True)))
    width = reduce(np.add, [np.abs(part) * (most - least) for part, least, most in zip(up, lower, upper, strict=True)])
    with ignoring_division():
        return region.volume * np.minimum(sqrt(2.0 * pi) / (height.inverse_std * width), 1.0)


def _groups(batch: BearingBatch) -> PathGroups:
    """Return the groups of paths; rows without a path number are measurements of other times, each by itself."""
    alone = np.where(batch.path < 0, np.arange(batch.measurements), -1)
    keys = [batch.sensor, batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.reflector, alone]
    keys += [] if batch.sensor_z_m is None else [batch.sensor_z_m]
    return group_paths(keys, batch.path)


def _larger_side(*points: FloatArray) -> FloatArray:
    """Return the largest side (B,) of the box of points, D arrays (B, K)."""
    return reduce(np.maximum, [max_measurements(part) + max_measurements(-part) for part in points])
