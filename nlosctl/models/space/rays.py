"""The rows of a batch of bearings as rays in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import SphereReflector
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.directions import dot
from nlosctl.models.measured_height import GroundHeight, MeasuredHeight
from nlosctl.models.obstacles import locate_walls
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.measured_angles import MeasuredAngles, Vector
from nlosctl.models.space.plane_mirrors import PlaneMirrors, gather_plane_mirrors
from nlosctl.models.space.sensor_axes import SensorAxes
from nlosctl.models.space.sphere_lines import SphereLines
from nlosctl.models.space.sphere_rows import SphereRows, locate_opaque_spheres, locate_sphere_rows

__all__ = ["space_lines"]

_LEAST_STD_M = 1.0
"""A height above a sphere that is stated as exact is known to this: x, y and z stay the unknowns."""


def space_lines(batch: BearingBatch) -> SpaceLines:
    """Return the unfolded rays of a batch in space, and the height of its source if it is measured."""
    assert batch.sensor_z_m is not None  # noqa: S101 - batches in space have heights
    sensor: Vector = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_z_m)
    shape = batch.bearing_rad.shape
    elevation = np.full(shape, np.nan) if batch.elevation_rad is None else batch.elevation_rad
    angles = MeasuredAngles.of(batch.bearing_rad, elevation, in_tangent_plane=batch.direction_std_rad is not None)
    mirrors = gather_plane_mirrors(batch.scene, batch.reflector, sensor)
    spheres = _spheres(batch, sensor, angles)
    if spheres is not None:
        mirrors = _with_tangents(mirrors, spheres)
    origin = sensor if mirrors is None else mirrors.images(sensor)
    count = batch.measurements
    x, y, z = (sum_measurements(part) / count for part in origin)
    lines = SpaceLines(
        center=(x, y, z),
        origin=(origin[0] - x[:, None], origin[1] - y[:, None], origin[2] - z[:, None]),
        angles=angles,
        std=_stds(batch, np.isfinite(elevation)),
        axes=_axes(batch, mirrors),
        mirrors=None if mirrors is None else mirrors.about(x, y, z),
        walls=locate_walls(batch.scene, batch.reflector, x, y),
        **_height(batch, (x, y, z)),
    )
    if spheres is None:
        return lines
    opaque = locate_opaque_spheres(batch.scene, batch.reflector, sensor)
    return SphereLines(
        **vars(lines), spheres=spheres.about(x, y, z), opaque=tuple(rows.about(x, y, z) for rows in opaque)
    )


def _height(batch: BearingBatch, center: Vector) -> dict[str, Any]:
    """Return the field of `SpaceLines` of a measured height, above the x-y plane or the blocker of a sphere."""
    if batch.target_z_m is None or batch.target_z_std_m is None:
        return {}
    if not _is_above_sphere(batch):
        if batch.height_held:
            return {"held_m": batch.target_z_m - center[2]}
        return {"height": MeasuredHeight.of(batch.target_z_m, batch.target_z_std_m, center[2])}
    inverse_std = 1.0 / np.maximum(batch.target_z_std_m, _LEAST_STD_M)
    for reflector in batch.scene.reflectors:
        if isinstance(reflector, SphereReflector) and reflector.blocker_radius is not None:
            x, y, z = (at - part for at, part in zip(reflector.center, center, strict=True))
            return {"height": GroundHeight((x, y, z), reflector.blocker_radius + batch.target_z_m, inverse_std)}
    raise UsageError(
        "target_height_m is above the blocker of a sphere, or the ellipsoid, but there is neither; name it target_z_m"
    )


def _is_above_sphere(batch: BearingBatch) -> bool:
    """Return whether a measured height is above a sphere's blocker; that above the ellipsoid is z in local axes."""
    return batch.target_above_ground is not None and batch.sensor_frame is None


def _spheres(batch: BearingBatch, sensor: Vector, angles: MeasuredAngles) -> SphereRows | None:
    """Return the rows by spheres, their measured directions in the frame; None where the scene has no sphere."""
    if not any(isinstance(reflector, SphereReflector) for reflector in batch.scene.reflectors):
        return None
    axes = _axes(batch, None)
    level = angles.cos_azimuth, angles.sin_azimuth, np.zeros(angles.cos_azimuth.shape)
    ray, aside = angles.directions(), angles.tangents()[0]
    if axes is not None:
        ray, level, aside = (axes.unfolded(vector, slice(None)) for vector in (ray, level, aside))
    unknown = np.where(angles.has_elevation > 0.0, 0.0, np.nan)
    share = np.ones(unknown.shape) if angles.in_tangent_plane else angles.cos_elevation
    known = tuple(part + unknown for part in ray)
    return locate_sphere_rows(batch.scene, batch.reflector, sensor, known, level, aside, share)


def _with_tangents(mirrors: PlaneMirrors | None, spheres: SphereRows) -> PlaneMirrors:
    """Return the mirrors with the tangent planes of the rows by spheres (centres in the frame), as rows (B, K)."""
    if mirrors is None:
        x, y, z, offset = (np.zeros(spheres.shape, order="F") for _ in range(4))
        mirrors = PlaneMirrors((x, y, z), offset, np.full(spheres.shape, np.nan, order="F"))
    tangents = spheres.tangents
    for block, part in zip(mirrors.normal, tangents.normal, strict=True):
        spheres.place_in(block, part)
    offset = dot(tangents.normal, spheres.center) + np.where(tangents.has_plane, spheres.radius, 0.0)
    spheres.place_in(mirrors.offset_m, offset)
    return mirrors


def _stds(batch: BearingBatch, has_elevation: BoolArray) -> FloatArray:
    """Return the standard deviations (B, M) of azimuths, elevations (1 without one) and of a height with one."""
    azimuth, elevation = batch.bearing_std_rad, batch.elevation_std_rad
    if batch.direction_std_rad is not None:
        azimuth, elevation = batch.direction_std_rad, batch.direction_std_rad
    if elevation is None:
        elevation = np.ones(azimuth.shape)
    parts = [azimuth, np.where(has_elevation, elevation, 1.0)]
    if batch.target_z_std_m is not None and (_is_above_sphere(batch) or not batch.height_held):
        parts.append(np.maximum(batch.target_z_std_m, _LEAST_STD_M if _is_above_sphere(batch) else 0.0)[:, None])
    return np.asfortranarray(np.concatenate(parts, axis=1))


def _axes(batch: BearingBatch, mirrors: PlaneMirrors | None) -> SensorAxes | None:
    """Return the axes in which the sensors of rows (B, K) see, reflected where a mirror unfolds the row."""
    if batch.sensor_frame is None and mirrors is None:
        return None
    rows = []
    for i in range(3):
        if batch.sensor_frame is None:
            row = [np.full(batch.bearing_rad.shape, float(i == j)) for j in range(3)]
        else:
            row = [batch.sensor_frame[..., i, j] for j in range(3)]
        x, y, z = row if mirrors is None else mirrors.reflected(tuple(row))
        rows.append((x, y, z))
    return SensorAxes((rows[0], rows[1], rows[2]))
