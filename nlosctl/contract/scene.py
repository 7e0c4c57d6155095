"""The scene: stationary sensors and reflectors."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from datetime import datetime

from nlosctl.errors import UsageError

__all__ = [
    "EARTH_RADIUS_M",
    "CircleReflector",
    "EarthFrame",
    "LineReflector",
    "PlaneReflector",
    "Reflector",
    "Scene",
    "SegmentReflector",
    "Sensor",
    "SphereReflector",
    "parse_frame",
]

EARTH_RADIUS_M = 6_371_000.0
"""The mean radius of the earth as a sphere."""

_ORIGIN = "`origin`"
_ON_ELLIPSOID = "ellipsoid"


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A sensor at ``position`` (x, y in metres); ``heading_deg`` is its boresight, clockwise from +y.

    What is not exactly known has a standard deviation, of an error that all its measurements share: each coordinate of
    the position, the heading, and by how much ranges and arrivals are too long; None is exactly known.

    ``z_m`` is its height, which all sensors of a scene have, or none. The entry is valid from ``start`` up to, not
    including, ``end``: moments with an offset, or seconds of ``time_s``; None is without limit.
    """

    name: str
    position: tuple[float, float]
    heading_deg: float | None = None
    heading_std_deg: float | None = None
    position_std_m: float | None = None
    range_offset_std_m: float | None = None
    arrival_offset_std_m: float | None = None
    z_m: float | None = None
    start: datetime | float | None = None
    end: datetime | float | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether anything of it is not exactly known."""
        stds = (self.heading_std_deg, self.position_std_m, self.range_offset_std_m, self.arrival_offset_std_m)
        return any(stds)

    @property
    def limits(self) -> list[datetime | float]:
        """Those of ``start`` and ``end`` that are given."""
        return [limit for limit in (self.start, self.end) if limit is not None]


@dataclass(frozen=True, kw_only=True)
class LineReflector:
    """An infinite mirror through ``point`` (metres) along ``direction`` (any length, not zero); vertical in space.

    ``offset_std_m`` is the standard deviation of its place along its normal, ``direction_std_deg`` that of its
    direction about ``point``; None is exactly known.
    """

    name: str
    point: tuple[float, float]
    direction: tuple[float, float]
    offset_std_m: float | None = None
    direction_std_deg: float | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether anything of it is not exactly known."""
        return bool(self.offset_std_m or self.direction_std_deg)


@dataclass(frozen=True, kw_only=True)
class SegmentReflector:
    """A finite wall from ``start`` to ``end`` (metres, not equal): it reflects, and blocks paths across it.

    In space it is vertical and of any height. Standard deviations are those of `LineReflector`, about ``start``.
    """

    name: str
    start: tuple[float, float]
    end: tuple[float, float]
    offset_std_m: float | None = None
    direction_std_deg: float | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether anything of it is not exactly known."""
        return bool(self.offset_std_m or self.direction_std_deg)

    @property
    def point(self) -> tuple[float, float]:
        """A point of its line."""
        return self.start

    @property
    def direction(self) -> tuple[float, float]:
        """The direction of its line."""
        return self.end[0] - self.start[0], self.end[1] - self.start[1]


@dataclass(frozen=True, kw_only=True)
class CircleReflector:
    """The inner side of a circle in the plane, about ``center`` (metres) mirrors; sensors and sources are inside it.

    ``blocker_radius`` is an opaque concentric circle (as the earth in the ionosphere), which no wave crosses.
    ``min_elevation_deg`` is the least elevation above the sensor's horizontal at which a path is received (to avoid
    ground clutter); without it the blocker's horizon is the limit. ``radius_std_m`` is the standard deviation of the
    radius, None: it is exactly known.
    """

    name: str
    center: tuple[float, float]
    radius: float
    blocker_radius: float | None = None
    min_elevation_deg: float | None = None
    radius_std_m: float | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether anything of it is not exactly known."""
        return bool(self.radius_std_m)


@dataclass(frozen=True, kw_only=True)
class PlaneReflector:
    """A mirror in space through ``point`` (metres) across ``normal`` (any length, not zero).

    ``offset_std_m`` is the standard deviation of its place along its normal, ``direction_std_deg`` that of its turn
    about ``point``, about either of two axes in it; None is exactly known.
    """

    name: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    offset_std_m: float | None = None
    direction_std_deg: float | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether anything of it is not exactly known."""
        return bool(self.offset_std_m or self.direction_std_deg)


@dataclass(frozen=True, kw_only=True)
class SphereReflector:
    """The inner side of a sphere about ``center`` (metres) mirrors: a `CircleReflector` in space.

    ``min_elevation_deg`` is above the tangent plane, at the sensor, of the sphere through it.
    """

    name: str
    center: tuple[float, float, float]
    radius: float
    blocker_radius: float | None = None
    min_elevation_deg: float | None = None
    radius_std_m: float | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether anything of it is not exactly known."""
        return bool(self.radius_std_m)


Reflector = LineReflector | SegmentReflector | CircleReflector | PlaneReflector | SphereReflector
"""Any kind of reflector: circles are of the plane alone, planes and spheres of space alone."""


@dataclass(frozen=True, kw_only=True)
class EarthFrame:
    """The position of the plane on the earth: a projected CRS, or the plane that touches WGS 84 in an origin.

    ``rotation_deg`` is the direction of the x axis, counter-clockwise from east (of grid east with a ``crs``).
    Where positions are ``on_ellipsoid`` their z is the height above it, and they are solved in earth-centred
    coordinates, with covariances in local east, north and up.
    """

    crs: str | None = None
    origin_lat_deg: float | None = None
    origin_lon_deg: float | None = None
    rotation_deg: float = 0.0
    on_ellipsoid: bool = False

    @property
    def words(self) -> str:
        """The frame as text that `parse_frame` accepts: a CRS, or latitude, longitude and any rotation."""
        origin = self.crs if self.crs is not None else f"{self.origin_lat_deg!r} {self.origin_lon_deg!r}"
        turned = f"{origin} {self.rotation_deg!r}" if self.rotation_deg else origin
        return f"{turned} {_ON_ELLIPSOID}" if self.on_ellipsoid else turned


def parse_frame(text: str, option: str) -> EarthFrame:
    """Return the frame of ``LAT,LON[,ROTATION]`` or ``CRS [ROTATION]`` (commas or spaces); raises UsageError.

    A number alone is an EPSG code, except as an origin. The word ``ellipsoid`` may follow.
    """
    parts = text.replace(",", " ").split()
    if len(parts) > 1 and parts[-1] == _ON_ELLIPSOID:
        return replace(parse_frame(" ".join(parts[:-1]), option), on_ellipsoid=True)
    if len(parts) == 1 and option != _ORIGIN and re.fullmatch(r"[0-9]{4,6}", parts[0]):
        parts = [f"EPSG:{parts[0]}"]
    numbers = [number for part in parts if (number := _number(part)) is not None]
    if len(numbers) == len(parts) and len(parts) in (2, 3) and abs(numbers[0]) <= 90.0 and abs(numbers[1]) <= 180.0:
        turn = numbers[2] if len(parts) == 3 else 0.0
        return EarthFrame(origin_lat_deg=numbers[0], origin_lon_deg=numbers[1], rotation_deg=turn)
    if len(parts) in (1, 2) and len(numbers) == len(parts) - 1 and _number(parts[0]) is None:
        return EarthFrame(crs=parts[0], rotation_deg=numbers[0] if numbers else 0.0)
    if option == _ORIGIN:
        raise UsageError(f"{option} takes LAT,LON in degrees (LAT from -90 to 90). Got {text!r} instead.")
    raise UsageError(f"{option} takes a CRS, such as EPSG:32632 (LAT,LON belongs to `origin`). Got {text!r} instead.")


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Sensors and reflectors with unique names, and the frame of the plane on earth; all may be absent.

    Several sensors of one name are entries that are valid at different times.
    """

    sensors: tuple[Sensor, ...] = ()
    reflectors: tuple[Reflector, ...] = field(default=())
    frame: EarthFrame | None = None

    @property
    def is_uncertain(self) -> bool:
        """Whether a sensor or a reflector is not exactly known."""
        return any(part.is_uncertain for part in (*self.sensors, *self.reflectors))

    @property
    def has_heights(self) -> bool:
        """Whether the sensors have heights."""
        return any(sensor.z_m is not None for sensor in self.sensors)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The distinct names of the sensors."""
        return tuple(dict.fromkeys(sensor.name for sensor in self.sensors))

    @property
    def time_column(self) -> str:
        """The column of times that the validity of sensors refers to, empty if all are valid at any time."""
        limit = next((limit for sensor in self.sensors for limit in sensor.limits), None)
        return "" if limit is None else "time" if isinstance(limit, datetime) else "time_s"

    def stationary_sensors(self, purpose: str) -> dict[str, Sensor]:
        """Return the sensors by name; raise UsageError, which names ``purpose``, if one is valid for a time only."""
        for sensor in self.sensors:
            if sensor.limits:
                raise UsageError(
                    f"{purpose} takes scene sensors without 'from' and 'to'. Got sensor {sensor.name!r} with one."
                )
        return {sensor.name: sensor for sensor in self.sensors}

    @property
    def has_circles(self) -> bool:
        """Whether any reflector is a circle."""
        return any(isinstance(reflector, CircleReflector) for reflector in self.reflectors)

    @property
    def has_spheres(self) -> bool:
        """Whether any reflector is a sphere."""
        return any(isinstance(reflector, SphereReflector) for reflector in self.reflectors)

    def has_horizons(self, dimension: int) -> bool:
        """Whether rows can be under a horizon: those by circles in the plane, by spheres with a blocker in space."""
        if dimension == 2:
            return self.has_circles
        spheres = (reflector for reflector in self.reflectors if isinstance(reflector, SphereReflector))
        return any(sphere.blocker_radius is not None for sphere in spheres)

    @property
    def reflector_names(self) -> tuple[str, ...]:
        """The names of the reflectors; a batch refers to them by index."""
        return tuple(reflector.name for reflector in self.reflectors)
