"""A plane on the earth: latitude and longitude (WGS 84) to x and y in metres and back, and where north is."""

from __future__ import annotations

from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import UsageError

__all__ = ["EarthPlane", "flat_errors"]


_WGS84 = "EPSG:4326"


class EarthPlane:
    """The plane of a projected coordinate reference system, or a tangent plane about an origin.

    ``crs`` is a name that pyproj accepts (``EPSG:32632``) and must be projected, in metres. Else the plane is
    azimuthal equidistant about the origin on WGS 84: distances and directions from the origin are exact, and a
    distance d elsewhere is stretched by less than d^2 / 6 R^2. ``rotation_deg`` is the direction of the x axis,
    counter-clockwise from east. Raises UsageError where pyproj is not installed or the CRS can't be used.
    """

    def __init__(
        self,
        *,
        crs: str | None = None,
        origin_lat_deg: float | None = None,
        origin_lon_deg: float | None = None,
        rotation_deg: float = 0.0,
    ) -> None:
        pyproj = _pyproj()
        projected = f"+proj=aeqd +lat_0={origin_lat_deg!r} +lon_0={origin_lon_deg!r} +datum=WGS84 +units=m +no_defs"
        if crs is not None:
            projected = _checked_crs(pyproj, crs)
        self._forward = pyproj.Transformer.from_crs(_WGS84, projected, always_xy=True)
        self._back = pyproj.Transformer.from_crs(projected, _WGS84, always_xy=True)
        self._factors = pyproj.Proj(projected)
        self._turn_rad = float(np.radians(rotation_deg))

    def to_plane(self, lat_deg: FloatArray, lon_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y (N,) in metres; NaN where a coordinate is NaN or outside the plane."""
        east, north = _finite(self._forward.transform(_single(lon_deg), _single(lat_deg)), lon_deg.shape)
        cos, sin = np.cos(self._turn_rad), np.sin(self._turn_rad)
        return cos * east + sin * north, cos * north - sin * east

    def to_earth(self, x_m: FloatArray, y_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return latitude and longitude (N,) in degrees; NaN where a position is NaN or off the earth."""
        cos, sin = np.cos(self._turn_rad), np.sin(self._turn_rad)
        east, north = cos * x_m - sin * y_m, sin * x_m + cos * y_m
        lon, lat = _finite(self._back.transform(_single(east), _single(north)), x_m.shape)
        return lat, lon

    def north_rad(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return the direction of true north (N,) in the plane, counter-clockwise from +x; NaN as in `to_earth`."""
        lat, lon = self.to_earth(x_m, y_m)
        if lat.size == 0:
            return lat  # get_factors rejects it
        convergence = np.radians(self._factors.get_factors(lon, lat).meridian_convergence)
        return np.where(np.isfinite(convergence), 0.5 * np.pi + convergence - self._turn_rad, np.nan)


def flat_errors(
    plane: EarthPlane, x_m: FloatArray, y_m: FloatArray, to_x_m: FloatArray, to_y_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return by how much straight lines of the plane (N,) miss the geodesics of WGS 84 between the same points.

    Direction at the first point, in radians in (-pi, pi], and length, in metres: plane minus earth. NaN where a
    point is NaN or off the earth.
    """
    lat, lon = plane.to_earth(x_m, y_m)
    to_lat, to_lon = plane.to_earth(to_x_m, to_y_m)
    azimuth_deg, _, length = _pyproj().Geod(ellps="WGS84").inv(*map(_single, (lon, lat, to_lon, to_lat)))
    dx, dy = to_x_m - x_m, to_y_m - y_m
    along = plane.north_rad(x_m, y_m) - np.radians(azimuth_deg)
    turned = np.pi - (np.pi - (np.arctan2(dy, dx) - along)) % (2.0 * np.pi)
    return turned, np.hypot(dx, dy) - length


def _single(values: FloatArray) -> Any:
    """Return a number for one value, else the array: pyproj converts arrays of one, and NumPy warns about that."""
    return values.item() if values.size == 1 else values


def _finite(pair: tuple[Any, Any], shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the result of pyproj in the requested shape, with NaN for its infinities."""
    one, other = (np.asarray(part).reshape(shape) for part in pair)
    return np.where(np.isfinite(one), one, np.nan), np.where(np.isfinite(other), other, np.nan)


def _pyproj() -> Any:
    try:
        import pyproj
    except ImportError:
        raise UsageError(
            "coordinates on earth need pyproj, which is not installed: pip install 'nlosctl[geo]'"
        ) from None
    return pyproj


def _checked_crs(pyproj: Any, name: str) -> Any:
    try:
        crs = pyproj.CRS.from_user_input(name)
    except pyproj.exceptions.CRSError:
        raise UsageError(f"no coordinate reference system {name!r}; give one such as EPSG:32632") from None
    axes = crs.axis_info
    if not crs.is_projected or any(axis.unit_conversion_factor != 1.0 for axis in axes[:2]):
        units = " and ".join(dict.fromkeys(axis.unit_name for axis in axes))
        raise UsageError(f"{name!r} is {crs.type_name} in {units}, expected a projected one in metres, as EPSG:32632")
    return crs
