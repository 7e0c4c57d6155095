"""The input of a method: dense blocks of snapshots that have the same number of measurements.

Arrays have shape (B, K) or (B, K, 2): B snapshots, K measurements each, the last axis x and y; heights and elevations,
which only batches in three dimensions have, are arrays of their own. They are stored
in Fortran order, so that ``array[:, k]`` and ``array[..., 0]`` are contiguous, and they are read-only. Sum over
measurements with `nlosctl.geometry.blocks.sum_measurements`: then a row's bits do not depend on its neighbours.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, SeedArray
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.scene import Scene

__all__ = ["ArrivalBatch", "Batch", "BearingBatch", "RangeBatch", "TripletBatch", "batch_class"]


@dataclass(frozen=True, kw_only=True)
class Batch:
    """The fields that batches of every kind of measurement share.

    ``seed`` (B,) is each snapshot's own seed, the only source of random numbers for a randomized method. If
    ``want_flags`` is false the flags are not used, and a method may omit them. ``field`` is the search region of
    methods that search (`nlosctl.models.search_regions` evaluates it). If ``want_details`` is true the flags include
    the quantities behind the decision; if ``want_trace`` is true a sequential method returns its steps.
    ``std`` is what is known of standard deviations: ``stated``, ``estimated`` (from residuals of the whole input), or
    ``unknown``: relative weights, whose factor a method with `MethodSpec.scales_std` estimates from the residuals of
    each snapshot.

    ``dimension`` is 2 or 3: that of the positions to estimate. In space, ``target_z_m`` (B,) is a measured height of
    the target with the standard deviation ``target_z_std_m`` (B,); both are None if no snapshot has one. Within a
    batch either all heights are held exactly (all standard deviations 0, see `height_held`), or none.

    ``elapsed_s`` (B, K) are the times of rows after the mean time of those of their snapshot, None unless a method
    estimates velocities: one whose `MethodSpec.all_estimate_columns` include ``time_s`` gets them.

    ``STDS`` names the arrays of standard deviations, ``SOURCES`` the input columns of each array, ``SPACE_SOURCES``
    those that only batches in space have, ``ABSENT`` the value that fills an array if the input lacks its columns; an
    array that is not in ``ABSENT`` is None then. ``OPTIONAL_SOURCES`` are further ones, which few files have.
    ``EXACT`` names, for an array, the column with the rest of its values beyond floating-point numbers and the array of
    the origins (B,) that are subtracted.
    """

    SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    OPTIONAL_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {"elapsed_s": ("elapsed_s",)}
    SPACE_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    ABSENT: ClassVar[Mapping[str, float]] = {}
    STDS: ClassVar[tuple[str, ...]] = ()
    EXACT: ClassVar[Mapping[str, tuple[str, str]]] = {}

    scene: Scene = dataclasses.field(default_factory=Scene)
    field: Field = dataclasses.field(default_factory=SensorsField)
    seed: SeedArray
    want_flags: bool = True
    want_trace: bool = False
    want_details: bool = False
    std: Literal["stated", "estimated", "unknown"] = "stated"
    dimension: int = 2
    target_z_m: FloatArray | None = None
    target_z_std_m: FloatArray | None = None
    elapsed_s: FloatArray | None = None

    @property
    def size(self) -> int:
        """The number of snapshots, B."""
        return int(self.seed.shape[0])

    @property
    def height_held(self) -> bool:
        """Whether the height of the target is known exactly: then x and y are the only unknowns."""
        return self.target_z_std_m is not None and not np.any(self.target_z_std_m)


@dataclass(frozen=True, kw_only=True)
class BearingBatch(Batch):
    """B snapshots of K bearings each.

    ``sensor`` numbers the sensors (equal numbers: the same sensor), ``path`` numbers the measurements of one
    sensor, ``reflector`` is an index into ``scene.reflectors``, or -1 for the direct path. ``sensor_xy_m`` is in
    metres, ``bearing_rad`` and ``bearing_std_rad`` in radians; all are finite and the std is positive.
    ``range_m`` and ``range_std_m`` are NaN in rows without a range, and None if no row has one. ``prior_xy_m`` is
    the prior position, with either its standard deviation ``prior_std_m`` in x and y or its covariance ``prior_cov_m2``
    (B, K, 3: xx, xy, yy), equal in all rows of a snapshot; None or NaN if there is no prior.

    In space ``sensor_z_m`` is in metres, and ``elevation_rad`` is the angle above the x-y plane with the standard
    deviation ``elevation_std_rad``, both NaN in rows that give their azimuth alone, None if no row has an elevation.
    ``direction_std_rad`` replaces both standard deviations: that across the ray, equal in every direction, for
    residuals in the tangent plane of the measured direction; ``bearing_std_rad`` is then ``direction_std_rad /
    cos(elevation)``. ``sensor_frame`` (B, K, 3, 3) has each sensor's own axes (east, north, up) as rows, in the
    coordinates of the batch, to which azimuths and elevations refer; None: the axes of the frame. With
    ``target_above_ground`` the measured height is that above the blocker of a sphere, or the ellipsoid.
    """

    SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "sensor": ("sensor",),
        "sensor_xy_m": ("sensor_x_m", "sensor_y_m"),
        "bearing_rad": ("bearing_rad",),
        "bearing_std_rad": ("bearing_std_rad",),
        "path": ("path",),
        "reflector": ("reflector",),
        "range_m": ("range_m",),
        "range_std_m": ("range_std_m",),
        "prior_xy_m": ("prior_x_m", "prior_y_m"),
        "prior_std_m": ("prior_std_m",),
        "prior_cov_m2": ("prior_cov_xx_m2", "prior_cov_xy_m2", "prior_cov_yy_m2"),
    }
    SPACE_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "sensor_z_m": ("sensor_z_m",),
        "elevation_rad": ("elevation_rad",),
        "elevation_std_rad": ("elevation_std_rad",),
        "direction_std_rad": ("direction_std_rad",),
        "target_above_ground": ("target_above_ground",),
    }
    STDS: ClassVar[tuple[str, ...]] = ("bearing_std_rad", "range_std_m", "elevation_std_rad", "direction_std_rad")

    sensor: IntArray
    sensor_xy_m: FloatArray
    bearing_rad: FloatArray
    bearing_std_rad: FloatArray
    path: IntArray
    reflector: IntArray
    range_m: FloatArray | None = None
    range_std_m: FloatArray | None = None
    prior_xy_m: FloatArray | None = None
    prior_std_m: FloatArray | None = None
    prior_cov_m2: FloatArray | None = None
    sensor_z_m: FloatArray | None = None
    elevation_rad: FloatArray | None = None
    elevation_std_rad: FloatArray | None = None
    direction_std_rad: FloatArray | None = None
    target_above_ground: FloatArray | None = None
    sensor_frame: FloatArray | None = None

    @property
    def measurements(self) -> int:
        """The number of measurements of each snapshot, K."""
        return int(self.bearing_rad.shape[1])


@dataclass(frozen=True, kw_only=True)
class RangeBatch(Batch):
    """B snapshots of K ranges each; a sensor may have any number of them (unlabelled echoes).

    ``sensor`` numbers the sensors, ``path`` the measurements of one sensor (-1: not numbered). ``sensor_xy_m``,
    ``range_m`` and ``range_std_m`` are in metres; all are finite, ranges and stds positive. ``sensor_height_m`` is
    the sensor's height above the plane of the targets: 0 for ranges in the plane, else the ranges are slant ranges.
    ``reflector`` is an index into ``scene.reflectors``, or -1 for the direct path; None if no row has one. Only methods
    that read ``reflector`` (see `MethodSpec.reads`) get rows that have one. ``sensor_z_m`` is the height of the sensors
    in space, None in the plane.
    """

    SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "sensor": ("sensor",),
        "sensor_xy_m": ("sensor_x_m", "sensor_y_m"),
        "range_m": ("range_m",),
        "range_std_m": ("range_std_m",),
        "path": ("path",),
        "reflector": ("reflector",),
        "sensor_height_m": ("sensor_height_m",),
    }
    ABSENT: ClassVar[Mapping[str, float]] = {"sensor_height_m": 0.0}
    SPACE_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {"sensor_z_m": ("sensor_z_m",)}
    STDS: ClassVar[tuple[str, ...]] = ("range_std_m",)

    sensor: IntArray
    sensor_xy_m: FloatArray
    range_m: FloatArray
    range_std_m: FloatArray
    path: IntArray
    sensor_height_m: FloatArray
    reflector: IntArray | None = None
    sensor_z_m: FloatArray | None = None

    @property
    def measurements(self) -> int:
        """The number of measurements of each snapshot, K."""
        return int(self.range_m.shape[1])


@dataclass(frozen=True, kw_only=True)
class ArrivalBatch(Batch):
    """B snapshots of K arrivals each, times in metres: an arrival is the range plus an unknown offset of the snapshot.

    ``arrival_m`` are the arrivals less ``origin_m`` (B,), which was subtracted while they were exact, and which the
    offsets of the estimates include again. ``arrival_std_m`` is of a single arrival; all are finite, stds positive.
    ``sensor`` numbers the sensors; ``sensor_z_m`` is their height in space, None in the plane.

    If the rows of each snapshot are independent differences, ``reference_xy_m`` (B, K, 2) are the positions of the
    sensors whose arrivals are subtracted, and ``reference_z_m`` (B, K) their heights in space; there is no offset then,
    ``arrival_std_m`` is of the difference, and ``origin_m`` is 0. None where all rows have one offset. Only methods
    that read ``reference`` (see `MethodSpec.reads`) get such snapshots. ``speed_std`` (B,) is the standard deviation of
    the speed of the wave, as a share of it, None if that is exactly known; only methods that read it get it.
    """

    SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "sensor": ("sensor",),
        "sensor_xy_m": ("sensor_x_m", "sensor_y_m"),
        "arrival_m": ("arrival_m",),
        "arrival_std_m": ("arrival_std_m",),
    }
    SPACE_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {"sensor_z_m": ("sensor_z_m",)}
    STDS: ClassVar[tuple[str, ...]] = ("arrival_std_m",)
    EXACT: ClassVar[Mapping[str, tuple[str, str]]] = {"arrival_m": ("arrival_rest_m", "origin_m")}

    sensor: IntArray
    sensor_xy_m: FloatArray
    arrival_m: FloatArray
    arrival_std_m: FloatArray
    origin_m: FloatArray
    sensor_z_m: FloatArray | None = None
    reference_xy_m: FloatArray | None = None
    reference_z_m: FloatArray | None = None
    speed_std: FloatArray | None = None

    @property
    def measurements(self) -> int:
        """The number of measurements of each snapshot, K."""
        return int(self.arrival_m.shape[1])


@dataclass(frozen=True, kw_only=True)
class TripletBatch(Batch):
    """B snapshots of K paths each, every path from a transmitter over a target to a receiver.

    ``tx_xy_m`` and ``rx_xy_m`` (B, K, 2) and ``path_length_m`` are in metres; ``dod_rad`` is the direction in which
    the path leaves the transmitter, ``doa_rad`` that from the receiver to where the wave comes from, radians; all
    are finite and the standard deviations positive. ``target_radius_m`` is NaN in rows without it, and None if no row
    has one. In space ``tx_z_m`` and ``rx_z_m`` are the heights, and the elevations of both directions are above the x-y
    plane, radians, with their standard deviations; they are NaN in rows without them, and None if no row has one.
    """

    SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "tx_xy_m": ("tx_x_m", "tx_y_m"),
        "rx_xy_m": ("rx_x_m", "rx_y_m"),
        "dod_rad": ("dod_rad",),
        "doa_rad": ("doa_rad",),
        "path_length_m": ("path_length_m",),
        "dod_std_rad": ("dod_std_rad",),
        "doa_std_rad": ("doa_std_rad",),
        "path_length_std_m": ("path_length_std_m",),
    }
    OPTIONAL_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {"target_radius_m": ("target_radius_m",)}
    SPACE_SOURCES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "tx_z_m": ("tx_z_m",),
        "rx_z_m": ("rx_z_m",),
        "dod_elevation_rad": ("dod_elevation_rad",),
        "doa_elevation_rad": ("doa_elevation_rad",),
        "dod_elevation_std_rad": ("dod_elevation_std_rad",),
        "doa_elevation_std_rad": ("doa_elevation_std_rad",),
    }

    tx_xy_m: FloatArray
    rx_xy_m: FloatArray
    dod_rad: FloatArray
    doa_rad: FloatArray
    path_length_m: FloatArray
    dod_std_rad: FloatArray
    doa_std_rad: FloatArray
    path_length_std_m: FloatArray
    target_radius_m: FloatArray | None = None
    tx_z_m: FloatArray | None = None
    rx_z_m: FloatArray | None = None
    dod_elevation_rad: FloatArray | None = None
    doa_elevation_rad: FloatArray | None = None
    dod_elevation_std_rad: FloatArray | None = None
    doa_elevation_std_rad: FloatArray | None = None

    @property
    def measurements(self) -> int:
        """The number of measurements of each snapshot, K."""
        return int(self.dod_rad.shape[1])


_CLASSES: dict[str, type[Any]] = {
    "bearings": BearingBatch,
    "ranges": RangeBatch,
    "triplets": TripletBatch,
    "arrivals": ArrivalBatch,
}


def batch_class(kind: str) -> type[Any]:
    """Return the batch class of a kind of measurement."""
    return _CLASSES[kind]
