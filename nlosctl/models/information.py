"""Fisher information of a position, by kind of measurement: the inverse of the Cramér-Rao bound.

A kind has one entry in `INFORMATION`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division
from nlosctl.contract.batches import ArrivalBatch, Batch, BearingBatch, RangeBatch
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import arrival_rows
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import SightLines, sight_lines
from nlosctl.models.ranges.predictions import predict_ranges, predict_space_ranges
from nlosctl.models.ranges.spheres import RangeSpheres, range_rows
from nlosctl.models.space.paths import predict_directions
from nlosctl.models.space.rays import space_lines

__all__ = ["INFORMATION", "UNIT_INFORMATION", "Information", "InformationModel"]


@dataclass(frozen=True)
class Information:
    """Fisher information (B,) of positions, and the number of measurements (B,) it is based on.

    ``of_height`` is the part of a measured height in ``matrix``, None without one.
    """

    matrix: SymmetricMatrix
    n_used: IntArray
    of_height: SymmetricMatrix | None = None

    def with_rows_scaled(self, factor: float) -> SymmetricMatrix:
        """Return the information with that of the rows times ``factor``; that of a measured height stays."""
        scaled = self.matrix.map(lambda part: factor * part)
        if self.of_height is None or factor == 1.0:
            return scaled
        return scaled - self.of_height.map(lambda part: (factor - 1.0) * part)


@dataclass(frozen=True, kw_only=True)
class InformationModel:
    """The information that one kind of measurement has on positions.

    ``at(batch, *point)`` is the information of each snapshot about its point, D arrays (B,), for Gaussian errors, from
    those rows that can see it as the scene is, and in space from a measured height; about x and y alone where the
    height is exactly known. ``seen_from(batch, *point)`` is a batch with a snapshot for each point (V,): the sensors,
    paths and stds of the one snapshot of ``batch``, the measurements without error.
    """

    at: Callable[..., Information]
    seen_from: Callable[..., Any]


def _bearing_information(batch: BearingBatch, *point: FloatArray) -> Information:
    if batch.dimension == 3:
        return _direction_information(batch, point)
    x, y = point
    lines = sight_lines(batch)
    local_x, local_y = x - lines.center_x, y - lines.center_y
    seen = ~lines.unseen(local_x, local_y)
    informative = replace(lines, std_rad=np.where(seen, lines.std_rad, np.inf))
    matrix = informative.information(local_x, local_y)
    if batch.range_m is not None and batch.range_std_m is not None:
        matrix = _with_ranges(matrix, informative, np.where(seen, batch.range_std_m, np.nan), local_x, local_y)
    return Information(matrix, np.count_nonzero(seen, axis=1))


def _direction_information(batch: BearingBatch, point: tuple[FloatArray, ...]) -> Information:
    lines = space_lines(batch)
    if batch.range_m is not None and batch.range_std_m is not None:
        lines = lines.with_ranges(batch.range_m, batch.range_std_m, lognormal=False)
    local = tuple(part - middle for part, middle in zip(point, lines.center, strict=True))[: lines.unknowns]
    seen = ~lines.unseen(*local)
    scalars = np.concatenate([seen] * (lines.of_rows // lines.rows), axis=1)
    hidden = np.where(scalars, lines.std[:, : lines.of_rows], np.inf)
    of_height = None
    if lines.std.shape[1] > lines.of_rows:
        of_height = lines.with_std(np.full(hidden.shape, np.inf)).information(*local)
    return Information(lines.with_std(hidden).information(*local), np.count_nonzero(seen, axis=1), of_height)


def _with_ranges(
    matrix: SymmetricMatrix, lines: SightLines, std_m: FloatArray, x: FloatArray, y: FloatArray
) -> SymmetricMatrix:
    """Return the joint information of bearings and ranges; rows whose std (B, K) is NaN have no range to add."""
    dx, dy = x[:, None] - lines.origin_x, y[:, None] - lines.origin_y
    with ignoring_division():
        weight = np.where(np.isnan(std_m), 0.0, 1.0 / (std_m * std_m * (dx * dx + dy * dy)))
        return matrix + SymmetricMatrix.gram(dx, dy, weight=weight)


def _repeated(batch: Batch, count: int) -> dict[str, Any]:
    """Return the arrays of a batch of one snapshot, repeated ``count`` times."""
    arrays = {name: value for name, value in vars(batch).items() if isinstance(value, np.ndarray)}
    return {
        name: np.asfortranarray(np.broadcast_to(value, (count, *value.shape[1:]))) for name, value in arrays.items()
    }


def _directions_seen_from(batch: BearingBatch, point: tuple[FloatArray, ...]) -> BearingBatch:
    assert batch.sensor_z_m is not None  # noqa: S101 - batches in space have heights
    every = _repeated(batch, point[0].shape[0])
    sensor = (every["sensor_xy_m"][..., 0], every["sensor_xy_m"][..., 1], every["sensor_z_m"])
    source = tuple(np.broadcast_to(part[:, None], sensor[0].shape) for part in point)
    azimuth, elevation = predict_directions(sensor, source, every["reflector"], batch.scene)
    every["bearing_rad"] = np.asfortranarray(np.nan_to_num(azimuth))
    if batch.elevation_rad is not None:
        every["elevation_rad"] = np.where(np.isnan(every["elevation_rad"]), np.nan, np.nan_to_num(elevation))
    return replace(batch, **every)


def _bearings_seen_from(batch: BearingBatch, *point: FloatArray) -> BearingBatch:
    if batch.dimension == 3:
        return _directions_seen_from(batch, point)
    x, y = point
    shape = (x.shape[0], batch.measurements)
    sensor_xy = np.broadcast_to(batch.sensor_xy_m, (*shape, 2))
    reflector = np.broadcast_to(batch.reflector, shape)
    source_xy = np.broadcast_to(np.stack([x, y], axis=1)[:, None, :], (*shape, 2))
    bearing = predict_bearings(sensor_xy, reflector, batch.scene, source_xy)
    return replace(
        batch,
        seed=np.zeros(x.shape, dtype=np.uint64),
        sensor=np.broadcast_to(batch.sensor, shape),
        sensor_xy_m=np.asfortranarray(sensor_xy),
        bearing_rad=np.asfortranarray(np.nan_to_num(bearing)),
        bearing_std_rad=np.asfortranarray(np.broadcast_to(batch.bearing_std_rad, shape)),
        path=np.broadcast_to(batch.path, shape),
        reflector=np.asfortranarray(reflector),
        range_m=None if batch.range_m is None else np.asfortranarray(np.broadcast_to(batch.range_m, shape)),
        range_std_m=None if batch.range_std_m is None else np.asfortranarray(np.broadcast_to(batch.range_std_m, shape)),
        prior_xy_m=None,
        prior_std_m=None,
        prior_cov_m2=None,
    )


def _range_information(batch: RangeBatch, *point: FloatArray) -> Information:
    rows = range_rows(batch)
    local = tuple(part - middle for part, middle in zip(point, rows.center, strict=False))
    seen = ~rows.unseen(*local)
    informative = replace(rows, std_m=np.where(seen, rows.std_m, np.inf))
    of_height = None
    if isinstance(rows, RangeSpheres) and rows.level is not None:
        of_height = replace(rows, std_m=np.full(rows.std_m.shape, np.inf)).information(*local)
    return Information(informative.information(*local), np.count_nonzero(seen, axis=1), of_height)


def _ranges_in_space_seen_from(batch: RangeBatch, point: tuple[FloatArray, ...]) -> RangeBatch:
    every = _repeated(batch, point[0].shape[0])
    sensor = (every["sensor_xy_m"][..., 0], every["sensor_xy_m"][..., 1], every["sensor_z_m"])
    source = tuple(np.broadcast_to(part[:, None], sensor[0].shape) for part in point)
    every["range_m"] = np.asfortranarray(predict_space_ranges(sensor, source, every.get("reflector"), batch.scene))
    return replace(batch, **every)


def _ranges_seen_from(batch: RangeBatch, *point: FloatArray) -> RangeBatch:
    if batch.dimension == 3:
        return _ranges_in_space_seen_from(batch, point)
    x, y = point
    shape = (x.shape[0], batch.measurements)
    names = ("sensor", "sensor_xy_m", "range_std_m", "path", "reflector", "sensor_height_m")
    seen: dict[str, Any] = {
        name: np.asfortranarray(np.broadcast_to(array, (*shape, *array.shape[2:])))
        for name, array in ((name, getattr(batch, name)) for name in names)
        if array is not None
    }
    source_xy = np.broadcast_to(np.stack([x, y], axis=1)[:, None, :], (*shape, 2))
    path = (seen.get("reflector"), batch.scene)
    range_m = np.asfortranarray(predict_ranges(seen["sensor_xy_m"], seen["sensor_height_m"], source_xy, *path))
    return RangeBatch(scene=batch.scene, seed=np.zeros(x.shape, dtype=np.uint64), range_m=range_m, **seen)


def _arrival_information(batch: ArrivalBatch, *point: FloatArray) -> Information:
    if batch.speed_std is not None:  # its effect is that of arrivals without error
        batch = _arrivals_seen_from(batch, *point)
    rows = arrival_rows(batch)
    local = tuple(part - middle for part, middle in zip(point, rows.center, strict=False))
    return Information(rows.information(*local), np.full(point[0].shape, batch.measurements, dtype=np.int64))


def _arrivals_seen_from(batch: ArrivalBatch, *point: FloatArray) -> ArrivalBatch:
    every = _repeated(batch, point[0].shape[0])

    def distance(owner: str) -> FloatArray:
        places = [every[f"{owner}_xy_m"][..., 0], every[f"{owner}_xy_m"][..., 1]]
        places += [every[f"{owner}_z_m"]] if batch.dimension == 3 else []
        squares = [(part[:, None] - own) ** 2 for part, own in zip(point, places, strict=True)]
        return np.asarray(np.sqrt(np.sum(squares, axis=0)))

    arrival = distance("sensor") if batch.reference_xy_m is None else distance("sensor") - distance("reference")
    every["arrival_m"] = np.asfortranarray(arrival)
    return replace(batch, **every)


INFORMATION: dict[str, InformationModel] = {
    "bearings": InformationModel(at=_bearing_information, seen_from=_bearings_seen_from),
    "ranges": InformationModel(at=_range_information, seen_from=_ranges_seen_from),
    "arrivals": InformationModel(at=_arrival_information, seen_from=_arrivals_seen_from),
}
"""By kind of measurement."""


def _unit_bearing_information(batch: BearingBatch, *point: FloatArray) -> SymmetricMatrix:
    if batch.dimension == 3:
        rays = space_lines(batch)
        local = tuple(part - middle for part, middle in zip(point, rays.center, strict=True))[: rays.unknowns]
        with ignoring_division():
            unit = np.where(np.isinf(rays.std), np.inf, 1.0 / np.abs(rays.tube_width_m(*local)))
        return rays.with_std(unit).information(*local)
    x, y = point
    lines = sight_lines(batch)
    local_x, local_y = x - lines.center_x, y - lines.center_y
    with ignoring_division():
        return replace(lines, std_rad=1.0 / np.abs(lines.tube_width_m(local_x, local_y))).information(local_x, local_y)


def _unit_range_information(batch: RangeBatch, *point: FloatArray) -> SymmetricMatrix:
    rows = range_rows(replace(batch, range_std_m=np.ones_like(batch.range_std_m)))
    return rows.information(*(part - middle for part, middle in zip(point, rows.center, strict=False)))


UNIT_INFORMATION: dict[str, Callable[..., SymmetricMatrix]] = {
    "bearings": _unit_bearing_information,
    "ranges": _unit_range_information,
}
"""Information of points, D arrays (B,), if every line or circle of position had a std of 1 m: the geometry alone."""
