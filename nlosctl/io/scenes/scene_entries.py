"""The tables of a scene file: what msgspec decodes, and checks that no type expresses."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.scene import (
    EARTH_RADIUS_M,
    CircleReflector,
    EarthFrame,
    LineReflector,
    PlaneReflector,
    SegmentReflector,
    Sensor,
    SphereReflector,
)

__all__ = [
    "REFLECTOR_KINDS",
    "TOML_NAMES",
    "Entry",
    "EntryError",
    "FrameEntry",
    "SceneEntries",
    "SensorEntry",
    "shown_time",
]

Number = Annotated[float, msgspec.Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Std = Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST_NUMBER)]
Point = tuple[Number, Number]
PointInSpace = tuple[Number, Number, Number]
Place = Annotated[list[Number], msgspec.Meta(min_length=2, max_length=3)]
"""Two coordinates, or three with the height."""

TOML_NAMES = {"start": "from", "end": "to"}
"""Keys of a scene file that differ from the names of the scene's fields."""


class EntryError(ValueError):
    """A fault of an entry: its key ("" for the entry itself), and the rest of the message."""


class Entry(msgspec.Struct, forbid_unknown_fields=True):
    """A table of a scene file. Its fields are the file's keys; ``scene_type`` is the class that it becomes."""

    scene_type: ClassVar[type[Any]]

    def to_scene(self) -> Any:
        """Return the entry as the scene's object."""
        return self.scene_type(**msgspec.structs.asdict(self))


class SensorEntry(Entry, rename=TOML_NAMES):
    """A table [[sensor]]."""

    scene_type = Sensor

    name: str
    position: Place
    heading_deg: Number | None = None
    heading_std_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] | None = None
    position_std_m: Std | None = None
    range_offset_std_m: Std | None = None
    arrival_offset_std_m: Std | None = None
    start: datetime | Number | None = None
    end: datetime | Number | None = None

    @property
    def limits(self) -> list[datetime | float]:
        """Those of ``from`` and ``to`` that are given."""
        return [limit for limit in (self.start, self.end) if limit is not None]

    def check_times(self) -> None:
        """Raise EntryError for a time without offset, for two kinds of times, and unless ``from`` is before ``to``."""
        for key, limit in (("from", self.start), ("to", self.end)):
            if isinstance(limit, datetime) and limit.tzinfo is None:
                raise EntryError(
                    key, f"sensor {self.name!r}: got {limit.isoformat()}, expected an offset; add it, or Z for UTC"
                )
        if self.start is None or self.end is None:
            return
        start, end = self.start, self.end
        if isinstance(start, datetime) and isinstance(end, datetime):
            in_order = end > start
        elif isinstance(start, datetime) or isinstance(end, datetime):
            raise EntryError("to", f"sensor {self.name!r}: expected a date-time or a number as in 'from'")
        else:
            in_order = end > start
        if not in_order:
            raise EntryError(
                "to", f"sensor {self.name!r}: got {shown_time(end)}, expected a time after {shown_time(start)}"
            )


def shown_time(limit: datetime | float) -> str:
    """Return a limit of validity as text for messages."""
    return limit.isoformat() if isinstance(limit, datetime) else repr(limit)


class LineEntry(Entry, tag_field="kind", tag="line"):
    scene_type = LineReflector

    name: str
    point: Point | None = None
    direction: Point | None = None
    slope: Number | None = None
    intercept: Number | None = None
    offset_std_m: Std | None = None
    direction_std_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] | None = None

    def __post_init__(self) -> None:
        by_slope = self.slope is not None or self.intercept is not None
        if by_slope and (self.point is not None or self.direction is not None):
            raise EntryError("", "has both point/direction and slope/intercept, expected one of the two pairs")
        for key in ("slope", "intercept") if by_slope else ("point", "direction"):
            if getattr(self, key) is None:
                raise EntryError(key, "missing; a line has point and direction, or slope and intercept")
        if self.direction == (0.0, 0.0):
            raise EntryError("direction", "got [0, 0], expected a direction of any length except zero")

    def to_scene(self) -> LineReflector:
        stds = {"offset_std_m": self.offset_std_m, "direction_std_deg": self.direction_std_deg}
        point, direction = self.point, self.direction
        if point is None or direction is None:
            point, direction = (0.0, self.intercept or 0.0), (1.0, self.slope or 0.0)
        return LineReflector(name=self.name, point=point, direction=direction, **stds)


class SegmentEntry(Entry, tag_field="kind", tag="segment", rename=TOML_NAMES):
    scene_type = SegmentReflector

    name: str
    start: Point
    end: Point
    offset_std_m: Std | None = None
    direction_std_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] | None = None

    def __post_init__(self) -> None:
        if self.start == self.end:
            raise EntryError("to", "got the same point as 'from', expected a different one: a wall has a length")


class CircleEntry(Entry, tag_field="kind", tag="circle"):
    scene_type = CircleReflector

    name: str
    center: Point
    radius: Number
    blocker_radius: Number | None = None
    min_elevation_deg: Number | None = None
    radius_std_m: Std | None = None

    def __post_init__(self) -> None:
        _check_round(self.radius, self.blocker_radius, self.min_elevation_deg)


class PlaneEntry(Entry, tag_field="kind", tag="plane"):
    scene_type = PlaneReflector

    name: str
    point: PointInSpace
    normal: PointInSpace
    offset_std_m: Std | None = None
    direction_std_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] | None = None

    def __post_init__(self) -> None:
        if self.normal == (0.0, 0.0, 0.0):
            raise EntryError("normal", "got [0, 0, 0], expected a direction of any length except zero")


class SphereEntry(Entry, tag_field="kind", tag="sphere"):
    scene_type = SphereReflector

    name: str
    center: PointInSpace | Literal["earth"]
    radius: Number | None = None
    blocker_radius: Number | None = None
    min_elevation_deg: Number | None = None
    height_m: Number | None = None
    radius_std_m: Std | None = None

    def __post_init__(self) -> None:
        around = self.center == "earth"
        for key, wanted in (("radius", not around), ("blocker_radius", not around), ("height_m", around)):
            if getattr(self, key) is not None and not wanted:
                raise EntryError(key, f"is not a key of a sphere {'about the earth' if around else 'with a center'}")
        if around and not (self.height_m or 0.0) > 0.0:
            raise EntryError("height_m", "missing or not above 0; a layer about the earth has a height in metres")
        if not around:
            if self.radius is None:
                raise EntryError("radius", "missing; a sphere has a radius in metres")
            _check_round(self.radius, self.blocker_radius, self.min_elevation_deg)

    def to_scene(self) -> SphereReflector:
        shared: dict[str, Any] = {"name": self.name, "min_elevation_deg": self.min_elevation_deg}
        shared["radius_std_m"] = self.radius_std_m
        if self.center == "earth":
            radius = EARTH_RADIUS_M + (self.height_m or 0.0)
            center = (0.0, 0.0, -EARTH_RADIUS_M)
            return SphereReflector(center=center, radius=radius, blocker_radius=EARTH_RADIUS_M, **shared)
        return SphereReflector(
            center=self.center, radius=self.radius or 0.0, blocker_radius=self.blocker_radius, **shared
        )


def _check_round(radius: float, blocker: float | None, elevation: float | None) -> None:
    """Raise EntryError for a circle or sphere without an inside, or with a blocker or elevation that it can't have."""
    if not radius > 0.0:
        raise EntryError("radius", f"got {radius:g}, expected a radius above 0")
    if blocker is not None and not 0.0 < blocker < radius:
        raise EntryError("blocker_radius", f"got {blocker:g}, expected one inside the reflector: in (0, {radius:g})")
    if elevation is not None and blocker is None:
        raise EntryError("min_elevation_deg", "needs a blocker_radius: without a blocker there is no horizon")
    if elevation is not None and not 0.0 <= elevation < 90.0:
        raise EntryError("min_elevation_deg", f"got {elevation:g}, expected an angle in [0, 90)")


class FrameEntry(Entry):
    """The table [frame]."""

    scene_type = EarthFrame

    crs: str | None = None
    origin_lat_deg: Number | None = None
    origin_lon_deg: Number | None = None
    rotation_deg: Number = 0.0

    def __post_init__(self) -> None:
        origin = {"origin_lat_deg": self.origin_lat_deg, "origin_lon_deg": self.origin_lon_deg}
        if list(origin.values()).count(None) != (0 if self.crs is None else 2):
            raise EntryError("", "expected either crs, or origin_lat_deg and origin_lon_deg")
        if self.crs is not None and not re.fullmatch(r"[A-Za-z]\w*:\w+", self.crs):
            raise EntryError("crs", f"got {self.crs!r}, expected the code of an authority, such as EPSG:32632")
        for (key, value), most in zip(origin.items(), (90.0, 180.0), strict=True):
            if value is not None and abs(value) > most:
                raise EntryError(key, f"got {value!r}, expected {-most:g} to {most:g}")


class SceneEntries(msgspec.Struct, forbid_unknown_fields=True):
    """All tables of a scene file."""

    sensor: list[SensorEntry] = []
    reflector: list[LineEntry | SegmentEntry | CircleEntry | PlaneEntry | SphereEntry] = []
    frame: FrameEntry | None = None


REFLECTOR_KINDS: dict[str, type[Entry]] = {
    "line": LineEntry,
    "segment": SegmentEntry,
    "circle": CircleEntry,
    "plane": PlaneEntry,
    "sphere": SphereEntry,
}
"""Entries of reflectors by their ``kind``."""
