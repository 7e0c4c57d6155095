"""Places on earth in metres of local east, north and up: errors of positions, and points about a place."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import EarthFrame
from nlosctl.geometry.earth_centred import local_axes, to_earth_centred, to_geodetic
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["errors_in", "from_tangent_plane", "places"]


def places(xy_m: FloatArray, frame: EarthFrame) -> tuple[FloatArray, FloatArray]:
    """Return latitude and longitude (...) in radians of points (..., 2) of the plane."""
    shape = xy_m.shape[:-1]
    latitude, longitude = plane_of(frame).to_earth(xy_m[..., 0].ravel(), xy_m[..., 1].ravel())
    return np.radians(latitude).reshape(shape), np.radians(longitude).reshape(shape)


def errors_in(frame: EarthFrame, position_m: FloatArray, truth_m: FloatArray) -> FloatArray:
    """Return the errors (E, D) of positions: of places on an ellipsoid in local east, north and up at the estimates."""
    if not frame.on_ellipsoid:
        return position_m - truth_m
    latitude, longitude = places(position_m[:, :2], frame)
    place = np.stack(to_earth_centred(latitude, longitude, position_m[:, 2]), axis=1)
    truth = np.stack(to_earth_centred(*places(truth_m[:, :2], frame), truth_m[:, 2]), axis=1)
    return np.asarray(np.einsum("eij,ej->ei", local_axes(latitude, longitude), place - truth))


def from_tangent_plane(frame: EarthFrame, place_m: FloatArray, east_north_m: FloatArray) -> FloatArray:
    """Return the points (..., 2) of the map ``east_north_m`` (..., 2) from a place (3,), horizontally there."""
    latitude, longitude = places(place_m[:2], frame)
    origin = np.array(to_earth_centred(latitude, longitude, place_m[2]))
    east, north, _ = local_axes(latitude, longitude)
    points = origin + east_north_m[..., :1] * east + east_north_m[..., 1:] * north
    latitude, longitude, _ = to_geodetic(*points.reshape(-1, 3).T)
    on_plane = plane_of(frame).to_plane(np.degrees(latitude), np.degrees(longitude))
    return np.stack(on_plane, axis=-1).reshape(east_north_m.shape)
