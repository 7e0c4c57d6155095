"""A plane on the earth: latitude and longitude (WGS 84) to x and y in metres and back, and where north is."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import UsageError

__all__ = ["EarthPlane", "flat_errors", "geodesic_solver", "geodesics", "geodetic_transformer"]


_WGS84 = "EPSG:4326"

_ALIGNED = 0.99
"""Axes are those of east and north if the cosine of their angle is larger; planes may distort angles a little."""

_TURN_OF_DATUM_RAD = 5e-5
"""Turns of north by a datum operation are corrected if larger: PROJ's derivatives are off by 4e-5 at some points."""


class EarthPlane:
    """The plane of a projected coordinate reference system, or a tangent plane about an origin.

    ``crs`` is a name that pyproj accepts (``EPSG:32632``) and must be projected, in metres, with y along grid north and
    x to the right of it. One datum operation, the best available, serves all points. Without ``crs`` the plane is
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
        projected: Any = (
            f"+proj=aeqd +lat_0={origin_lat_deg!r} +lon_0={origin_lon_deg!r} +datum=WGS84 +units=m +no_defs"
        )
        if crs is not None:
            projected = _checked_crs(pyproj, crs)
        self._turn_rad, self._projected = float(np.radians(rotation_deg)), pyproj.CRS.from_user_input(projected)
        self._meridian_deg = 0.0
        self._datum_turn_rad = 0.0
        if crs is None:
            self._transformer = pyproj.Transformer.from_crs(_WGS84, projected, always_xy=True)
            self._factors = pyproj.Proj(projected)
            return
        self._transformer = _best_operation(pyproj, projected, crs)
        self._factors = pyproj.Proj(projected)
        if projected.prime_meridian is not None:
            meridian = projected.prime_meridian  # its longitude may be in grads
            self._meridian_deg = float(np.degrees(meridian.longitude * meridian.unit_conversion_factor))
        turned = self._checked_north(projected, crs)
        if abs(turned) > _TURN_OF_DATUM_RAD:
            self._datum_turn_rad = turned

    def wkt(self) -> str | None:
        """Return the coordinate reference system as text of ESRI's kind; None for a turned plane, which has none."""
        return None if self._turn_rad else str(self._projected.to_wkt("WKT1_ESRI"))

    def to_plane(self, lat_deg: FloatArray, lon_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y (N,) in metres; NaN where a coordinate is NaN or outside the plane."""
        east, north = _finite(self._transformer.transform(_single(lon_deg), _single(lat_deg)), lon_deg.shape)
        cos, sin = np.cos(self._turn_rad), np.sin(self._turn_rad)
        return cos * east + sin * north, cos * north - sin * east

    def to_earth(self, x_m: FloatArray, y_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return latitude and longitude (N,) in degrees; NaN where a position is NaN or off the earth."""
        cos, sin = np.cos(self._turn_rad), np.sin(self._turn_rad)
        east, north = cos * x_m - sin * y_m, sin * x_m + cos * y_m
        back = self._transformer.transform(_single(east), _single(north), direction="INVERSE")
        lon, lat = _finite(back, x_m.shape)
        return lat, lon

    def north_rad(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return the direction of true north (N,) in the plane, counter-clockwise from +x; NaN as in `to_earth`."""
        lat, lon = self.to_earth(x_m, y_m)
        if lat.size == 0:
            return lat  # get_factors rejects it
        factors = self._factors.get_factors(lon - self._meridian_deg, lat)  # longitudes from the CRS's own meridian
        convergence = np.radians(factors.meridian_convergence)
        north = 0.5 * np.pi + convergence - self._turn_rad + self._datum_turn_rad
        return np.where(np.isfinite(convergence), north, np.nan)

    def _checked_north(self, crs: Any, name: str) -> float:
        """Return by how much a step north on WGS 84 turns from `north_rad`, mid-area; UsageError if axes differ.

        A datum operation with rotations about the earth's axes turns all directions of its area alike. A step north
        must move about along `north_rad`, and a step east to its right.

        Planes of southings and westings are turned or mirrored: directions from their axes would mean something else.
        """
        area = crs.area_of_use
        if area is None:
            lat, lon = (part[0] for part in self.to_earth(np.zeros(1), np.zeros(1)))
        else:
            east = area.east + (360.0 if area.east < area.west else 0.0)
            lat, lon = 0.5 * (area.south + area.north), (0.5 * (area.west + east) + 180.0) % 360.0 - 180.0
        step = 1e-4
        lats, lons = lat + step * np.array([0.0, -0.5, 0.5, 0.0]), lon + step * np.array([0.0, 0.0, 0.0, 1.0])
        x, y = self.to_plane(lats, lons)
        north, to_east = np.arctan2([y[2] - y[1], y[3] - y[0]], [x[2] - x[1], x[3] - x[0]])
        turned = np.array([north - self.north_rad(x[:1], y[:1])[0], north - to_east - 0.5 * np.pi])
        if (np.cos(turned) < _ALIGNED).any():
            axes = " and ".join(f"{axis.abbrev} ({axis.direction})" for axis in crs.axis_info[:2])
            raise UsageError(f"{name!r} has the axes {axes}, expected east and north, as EPSG:32632")
        return float(np.remainder(turned[0] + np.pi, 2.0 * np.pi) - np.pi)


def flat_errors(
    plane: EarthPlane, x_m: FloatArray, y_m: FloatArray, to_x_m: FloatArray, to_y_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return by how much straight lines of the plane (N,) miss the geodesics of WGS 84 between the same points.

    Direction at the first point, in radians in (-pi, pi], and length, in metres: plane minus earth. NaN where a
    point is NaN or off the earth.
    """
    lat, lon = plane.to_earth(x_m, y_m)
    to_lat, to_lon = plane.to_earth(to_x_m, to_y_m)
    azimuth_deg, _, length = geodesic_solver().inv(*map(_single, (lon, lat, to_lon, to_lat)))
    dx, dy = to_x_m - x_m, to_y_m - y_m
    along = plane.north_rad(x_m, y_m) - np.radians(azimuth_deg)
    turned = np.pi - (np.pi - (np.arctan2(dy, dx) - along)) % (2.0 * np.pi)
    return turned, np.hypot(dx, dy) - length


def geodesics(
    lat_deg: FloatArray, lon_deg: FloatArray, azimuth_rad: FloatArray, length_m: FloatArray, points: int
) -> FloatArray:
    """Return longitudes and latitudes (N, ``points``, 2) of evenly spaced points on geodesics of WGS 84 from N points.

    NaN where any value is NaN.
    """
    along = np.linspace(0.0, 1.0, points) * length_m[:, None]
    start = [np.repeat(part[:, None], points, axis=1).ravel() for part in (lon_deg, lat_deg, np.degrees(azimuth_rad))]
    known = np.isfinite(np.stack([*start, along.ravel()])).all(axis=0)
    path = np.full((known.size, 2), np.nan)
    if known.any():
        lon, lat, _ = geodesic_solver().fwd(*(part[known] for part in (*start, along.ravel())))
        path[known] = np.stack([lon, lat], axis=1)
    return path.reshape(*along.shape, 2)


@cache
def geodesic_solver() -> Any:
    """Return pyproj's geodesics of WGS 84; raises UsageError where pyproj is not installed."""
    return _pyproj().Geod(ellps="WGS84")


@cache
def geodetic_transformer() -> Any:
    """Return pyproj's transformer from longitude, latitude and height (WGS 84) to earth-centred coordinates."""
    return _pyproj().Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


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


def _best_operation(pyproj: Any, projected: Any, name: str) -> Any:
    """Return the best available operation from WGS 84 to a CRS: one for all points, whatever their location.

    A transformer of pyproj chooses the operation for each point by its area, so that neighbours could differ by metres.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a better one may need a grid that is not installed
        try:
            operations = pyproj.transformer.TransformerGroup(_WGS84, projected, always_xy=True).transformers
        except (pyproj.exceptions.ProjError, IndexError):  # IndexError: pyproj itself, for lists without an operation
            operations = []
    if not operations:
        raise UsageError(f"{name!r} has no known transformation from WGS 84; give a CRS of the earth, as EPSG:32632")
    return operations[0]


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
