"""Earth-centred coordinates of WGS 84, the local axes east, north and up, and geodesics; angles in radians."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.earth import geodesic_solver, geodetic_transformer

__all__ = ["geodesic_between", "geodesic_end", "local_axes", "to_earth_centred", "to_geodetic"]


def to_earth_centred(latitude: FloatArray, longitude: FloatArray, height_m: FloatArray) -> tuple[FloatArray, ...]:
    """Return x, y, z (...) in metres of places above the ellipsoid; NaN stays NaN."""
    return _shaped(geodetic_transformer().transform(longitude, latitude, height_m, radians=True), np.shape(latitude))


def to_geodetic(x_m: FloatArray, y_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, ...]:
    """Return latitude, longitude and height (...) above the ellipsoid; NaN stays NaN."""
    back = geodetic_transformer().transform(x_m, y_m, z_m, radians=True, direction="INVERSE")
    longitude, latitude, height = _shaped(back, np.shape(x_m))
    return latitude, longitude, height


def local_axes(latitude: FloatArray, longitude: FloatArray) -> FloatArray:
    """Return the directions east, north and up as rows (..., 3, 3) in earth-centred coordinates."""
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    east = np.stack([-sin_lon, cos_lon, np.zeros(np.shape(latitude))], axis=-1)
    north = np.stack([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat], axis=-1)
    up = np.stack([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat], axis=-1)
    return np.stack([east, north, up], axis=-2)


def geodesic_between(
    latitude: FloatArray, longitude: FloatArray, to_latitude: FloatArray, to_longitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the azimuth at the first point, clockwise from north, and the length of geodesics (...)."""
    azimuth, _, length = _shaped(
        geodesic_solver().inv(longitude, latitude, to_longitude, to_latitude, radians=True), np.shape(latitude)
    )
    return azimuth, length


def geodesic_end(
    latitude: FloatArray, longitude: FloatArray, azimuth: FloatArray, length_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return latitude and longitude of the ends of geodesics (...)."""
    to_longitude, to_latitude, _ = _shaped(
        geodesic_solver().fwd(longitude, latitude, azimuth, length_m, radians=True), np.shape(latitude)
    )
    return to_latitude, to_longitude


def _shaped(parts: tuple[object, ...], shape: tuple[int, ...]) -> tuple[FloatArray, ...]:
    """Return the results of pyproj in their shape, with NaN for its infinities."""
    arrays = [np.asarray(part, dtype=np.float64).reshape(shape) for part in parts]
    return tuple(np.where(np.isfinite(array), array, np.nan) for array in arrays)
