"""Places on the earth in three dimensions: batches in earth-centred coordinates, and their solutions as places again.

Positions in tables are x, y of the local plane and the height above the ellipsoid; covariances are in local east, north
and up at the estimate.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Estimates, Solution
from nlosctl.contract.scene import EarthFrame
from nlosctl.errors import UsageError
from nlosctl.geometry.earth_centred import local_axes, to_earth_centred, to_geodetic
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.io.scenes.places import places
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.pipeline.solve.method_runs import BlockSolver

__all__ = ["solver_on_earth"]


def solver_on_earth(solve: BlockSolver, frame: EarthFrame) -> BlockSolver:
    """Return a method that solves places on the ellipsoid in earth-centred coordinates.

    It raises UsageError for what has no model there: reflectors, and a measured height beside elevations or ranges.
    """

    def solve_places(batch: Any, row: IntArray) -> Solution:
        _check(batch)
        solution = solve(_earth_centred(batch, frame), row)
        return dataclasses.replace(solution, estimates=_as_places(solution.estimates, batch, frame))

    return solve_places


def _check(batch: Any) -> None:
    if batch.reflector is not None and (batch.reflector >= 0).any():
        raise UsageError(
            "reflectors have no model among places on earth in three dimensions; give x, y, z in metres, or set "
            "`dimensions` to 2"
        )
    if batch.target_z_m is not None and not _is_geodesic(batch):
        raise UsageError(
            "a measured height of the target on earth is for azimuths alone; leave it out, or give x, y, z in metres"
        )


def _is_geodesic(batch: Any) -> bool:
    """Whether all that a batch has is azimuths: of geodesics on the ground."""
    return isinstance(batch, BearingBatch) and batch.elevation_rad is None


def _earth_centred(batch: Any, frame: EarthFrame) -> Any:
    """Return a batch with its sensors in earth-centred coordinates, and their axes where it has directions."""
    latitude, longitude = places(batch.sensor_xy_m, frame)
    x, y, z = (np.asfortranarray(part) for part in to_earth_centred(latitude, longitude, batch.sensor_z_m))
    changed: dict[str, Any] = {"sensor_xy_m": np.asfortranarray(np.stack([x, y], axis=-1)), "sensor_z_m": z}
    if isinstance(batch, BearingBatch):
        changed["sensor_frame"] = np.asfortranarray(local_axes(latitude, longitude))
        changed["bearing_rad"] = np.asfortranarray(
            batch.bearing_rad - (_north_rad(batch.sensor_xy_m, frame) - 0.5 * np.pi)
        )
    return dataclasses.replace(batch, **changed)


def _as_places(estimates: Estimates, batch: Any, frame: EarthFrame) -> Estimates:
    """Return estimates in earth-centred coordinates with x, y of the plane, heights, and covariances of the ground."""
    latitude, longitude, height = to_geodetic(*estimates.position_m.T)
    x, y = plane_of(frame).to_plane(np.degrees(latitude), np.degrees(longitude))
    axes = local_axes(latitude, longitude)
    dense = SymmetricMatrix(*estimates.covariance_m2.T).dense()
    local = np.einsum("eij,ejk,elk->eil", axes, dense, axes)
    covariance = np.stack([local[:, i, j] for i in range(3) for j in range(i + 1)], axis=1)
    if _is_geodesic(batch):
        held, std = (0.0 if part is None else part[estimates.row] for part in (batch.target_z_m, batch.target_z_std_m))
        height = np.where(np.isnan(height), np.nan, held)
        covariance[:, 3:] = np.where(np.isnan(covariance[:, 3:]), np.nan, 0.0)
        covariance[:, 5] += std * std
    return dataclasses.replace(estimates, position_m=np.stack([x, y, height], axis=1), covariance_m2=covariance)


def _north_rad(xy_m: FloatArray, frame: EarthFrame) -> FloatArray:
    shape = xy_m.shape[:-1]
    return plane_of(frame).north_rad(xy_m[..., 0].ravel(), xy_m[..., 1].ravel()).reshape(shape)
