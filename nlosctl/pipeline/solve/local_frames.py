"""Local axes east, north and up on the earth, and batches whose sensors are seen in them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import ArrivalBatch, BearingBatch
from nlosctl.contract.scene import EARTH_RADIUS_M, EarthFrame
from nlosctl.geometry.blocks import max_measurements, rows_of, sum_measurements
from nlosctl.geometry.earth_centred import local_axes, to_earth_centred, to_geodetic
from nlosctl.io.scenes.places import places
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["LocalFrames", "RowsOnEarth"]


@dataclass(frozen=True)
class LocalFrames:
    """Axes at N points of the ellipsoid: ``origin_m`` (N, 3) is earth-centred, ``axes`` (N, 3, 3) has them as rows.

    A point straight above the origin has its height above the ellipsoid as z.
    """

    origin_m: FloatArray
    axes: FloatArray

    @classmethod
    def below(cls, place_m: FloatArray) -> Self:
        """Return the frames on the ellipsoid below earth-centred places (N, 3); NaN for NaN."""
        latitude, longitude, _ = to_geodetic(*place_m.T)
        ground = to_earth_centred(latitude, longitude, np.zeros(latitude.shape))
        return cls(np.stack(ground, axis=-1), local_axes(latitude, longitude))

    def take(self, index: IntArray) -> Self:
        """Return the frames with these indices."""
        return type(self)(self.origin_m[index], self.axes[index])

    def local(self, place_m: FloatArray) -> FloatArray:
        """Return earth-centred places (N, ..., 3) in the frame of their index."""
        between = (slice(None), *[None] * (place_m.ndim - 2))
        return np.asarray(np.einsum("nij,n...j->n...i", self.axes, place_m - self.origin_m[between]))

    def earth_centred(self, local_m: FloatArray) -> FloatArray:
        """Return points (N, 3), given in the frame of their index, as earth-centred places."""
        return np.asarray(np.einsum("nij,ni->nj", self.axes, local_m) + self.origin_m)

    def away_m(self, place_m: FloatArray) -> FloatArray:
        """Return the horizontal distances (N,) of earth-centred places (N, 3) from the origins."""
        east, north, _ = self.local(place_m).T
        return np.asarray(np.hypot(east, north))


@dataclass(frozen=True)
class RowsOnEarth:
    """A batch of places: its sensors earth-centred, ``place_m`` (B, K, 3), and if it has directions their axes.

    ``axes`` (B, K, 3, 3) are east, north and up; azimuths of ``batch`` are counter-clockwise from true east.
    ``reference_m`` (B, K, 3) are the references of independent differences of arrivals.
    """

    batch: Any
    place_m: FloatArray
    axes: FloatArray | None = None
    reference_m: FloatArray | None = None

    @classmethod
    def of(cls, batch: Any, frame: EarthFrame) -> Self:
        """Return the rows of a batch in x, y of the frame's plane and heights above the ellipsoid."""
        latitude, longitude = places(batch.sensor_xy_m, frame)
        place = np.stack(to_earth_centred(latitude, longitude, batch.sensor_z_m), axis=-1)
        if isinstance(batch, ArrivalBatch) and batch.reference_xy_m is not None and batch.reference_z_m is not None:
            reference = to_earth_centred(*places(batch.reference_xy_m, frame), batch.reference_z_m)
            return cls(batch, place, reference_m=np.stack(reference, axis=-1))
        if not isinstance(batch, BearingBatch):
            return cls(batch, place)
        x, y = (part.ravel() for part in np.moveaxis(batch.sensor_xy_m, -1, 0))
        north_rad = plane_of(frame).north_rad(x, y).reshape(latitude.shape)
        turned = np.asfortranarray(batch.bearing_rad - (north_rad - 0.5 * np.pi))
        return cls(dataclasses.replace(batch, bearing_rad=turned), place, local_axes(latitude, longitude))

    def middle_m(self) -> FloatArray:
        """Return the mean (B, 3) of the sensors of each snapshot, earth-centred."""
        x, y, z = (sum_measurements(part) / part.shape[1] for part in np.moveaxis(self.place_m, -1, 0))
        return np.stack([x, y, z], axis=-1)

    def with_loose_height(self) -> RowsOnEarth:
        """Return the rows with measured heights that are as uncertain as the ground bends over twice their extent."""
        away = self.place_m - self.middle_m()[:, None]
        extent = 2.0 * max_measurements(np.linalg.norm(away, axis=-1))
        std = np.hypot(self.batch.target_z_std_m, extent * extent / (2.0 * EARTH_RADIUS_M))
        return dataclasses.replace(self, batch=dataclasses.replace(self.batch, target_z_std_m=std))

    def earth_centred(self) -> Any:
        """Return the batch in earth-centred coordinates."""
        return _placed(self.batch, self.place_m, self.axes, self.reference_m)

    def seen_in(self, frames: LocalFrames, index: IntArray) -> Any:
        """Return a batch of the snapshots with these indices (N,), each in the frame (N) of the same place in order."""
        arrays = {
            name: rows_of(value, index) for name, value in vars(self.batch).items() if isinstance(value, np.ndarray)
        }
        axes = None
        if self.axes is not None:
            axes = np.einsum("nkij,nlj->nkil", self.axes[index], frames.axes)
        reference = None if self.reference_m is None else frames.local(self.reference_m[index])
        return _placed(dataclasses.replace(self.batch, **arrays), frames.local(self.place_m[index]), axes, reference)


def _placed(batch: Any, place_m: FloatArray, axes: FloatArray | None, reference_m: FloatArray | None) -> Any:
    changed = {"sensor_xy_m": np.asfortranarray(place_m[..., :2]), "sensor_z_m": np.asfortranarray(place_m[..., 2])}
    if reference_m is not None:
        changed["reference_xy_m"] = np.asfortranarray(reference_m[..., :2])
        changed["reference_z_m"] = np.asfortranarray(reference_m[..., 2])
    if axes is not None:
        changed["sensor_frame"] = np.asfortranarray(axes)
    return dataclasses.replace(batch, **changed)
