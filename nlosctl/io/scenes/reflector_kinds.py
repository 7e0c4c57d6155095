"""The kinds of reflector in a scene file: one entry each, how it is read and how it is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from nlosctl.contract.scene import CircleReflector, LineReflector, Reflector, SegmentReflector
from nlosctl.io.scenes.toml_decoder import Decoder, Finite, Point

__all__ = ["REFLECTOR_KINDS", "ReflectorKind", "kind_of_reflector"]


@dataclass(frozen=True, kw_only=True)
class ReflectorKind:
    """How one kind of reflector is read from a TOML table (by its place, for messages) and written to one."""

    reflector: type[Any]
    read: Callable[[Decoder, Mapping[str, Any], str], Reflector]
    write: Callable[[Any], dict[str, Any]]


class _LineEntry(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    kind: str
    point: Point | None = None
    direction: Point | None = None
    slope: Finite | None = None
    intercept: Finite | None = None


def _read_line(decoder: Decoder, entry: Mapping[str, Any], where: str) -> LineReflector:
    read = decoder.decode(entry, _LineEntry, where)
    by_point = read.point is not None or read.direction is not None
    by_slope = read.slope is not None or read.intercept is not None
    if by_point and by_slope:
        decoder.refuse(where, "has both point/direction and slope/intercept, expected one of the two pairs")
    pair = ("slope", "intercept") if by_slope else ("point", "direction")
    for key in pair:
        if getattr(read, key) is None:
            decoder.refuse(f"{where}.{key}", "missing; a line has point and direction, or slope and intercept")
    if read.slope is not None and read.intercept is not None:
        return LineReflector(name=read.name, point=(0.0, read.intercept), direction=(1.0, read.slope))
    direction, point = read.direction or (0.0, 0.0), read.point or (0.0, 0.0)
    if direction == (0.0, 0.0):
        decoder.refuse(f"{where}.direction", "got [0, 0], expected a direction of any length but zero")
    return LineReflector(name=read.name, point=point, direction=direction)


def _write_line(reflector: LineReflector) -> dict[str, Any]:
    return {"name": reflector.name, "point": reflector.point, "direction": reflector.direction}


class _SegmentEntry(msgspec.Struct, forbid_unknown_fields=True, rename={"start": "from", "end": "to"}):
    name: str
    kind: str
    start: Point
    end: Point


def _read_segment(decoder: Decoder, entry: Mapping[str, Any], where: str) -> SegmentReflector:
    read = decoder.decode(entry, _SegmentEntry, where)
    if read.start == read.end:
        decoder.refuse(f"{where}.to", "got the same point as 'from', expected another: a wall has a length")
    return SegmentReflector(name=read.name, start=read.start, end=read.end)


def _write_segment(reflector: SegmentReflector) -> dict[str, Any]:
    return {"name": reflector.name, "from": reflector.start, "to": reflector.end}


class _CircleEntry(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    kind: str
    center: Point
    radius: Finite
    blocker_radius: Finite | None = None
    min_elevation_deg: Finite | None = None


def _read_circle(decoder: Decoder, entry: Mapping[str, Any], where: str) -> CircleReflector:
    read = decoder.decode(entry, _CircleEntry, where)
    blocker, least = read.blocker_radius, read.min_elevation_deg
    if not read.radius > 0.0:
        decoder.refuse(f"{where}.radius", f"got {read.radius:g}, expected a radius above 0")
    if blocker is not None and not 0.0 < blocker < read.radius:
        decoder.refuse(
            f"{where}.blocker_radius", f"got {blocker:g}, expected one inside the reflector: in (0, {read.radius:g})"
        )
    if least is not None and blocker is None:
        decoder.refuse(f"{where}.min_elevation_deg", "needs a blocker_radius: without a blocker there is no horizon")
    if least is not None and not 0.0 <= least < 90.0:
        decoder.refuse(f"{where}.min_elevation_deg", f"got {least:g}, expected an angle in [0, 90)")
    return CircleReflector(
        name=read.name, center=read.center, radius=read.radius, blocker_radius=blocker, min_elevation_deg=least
    )


def _write_circle(reflector: CircleReflector) -> dict[str, Any]:
    entry = {"name": reflector.name, "center": reflector.center, "radius": reflector.radius}
    if reflector.blocker_radius is not None:
        entry["blocker_radius"] = reflector.blocker_radius
    if reflector.min_elevation_deg is not None:
        entry["min_elevation_deg"] = reflector.min_elevation_deg
    return entry


REFLECTOR_KINDS: dict[str, ReflectorKind] = {
    "line": ReflectorKind(reflector=LineReflector, read=_read_line, write=_write_line),
    "segment": ReflectorKind(reflector=SegmentReflector, read=_read_segment, write=_write_segment),
    "circle": ReflectorKind(reflector=CircleReflector, read=_read_circle, write=_write_circle),
}
"""By the word in ``kind``."""


def kind_of_reflector(reflector: Reflector) -> str:
    """Return the ``kind`` word of a reflector; raise KeyError for a class that no kind has."""
    for word, kind in REFLECTOR_KINDS.items():
        if type(reflector) is kind.reflector:
            return word
    raise KeyError(type(reflector).__name__)
