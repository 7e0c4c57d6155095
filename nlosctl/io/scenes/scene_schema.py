"""The schema of scene files, from the entries that read them."""

from __future__ import annotations

from typing import Any

import msgspec

from nlosctl.io.scenes.scene_entries import REFLECTOR_KINDS, Entry, FrameEntry, SceneEntries, SensorEntry

__all__ = ["scene_keys", "scene_schema"]

_MEANINGS = {
    "name": "name, by which rows refer to it; unique",
    "position": "x, y in metres, or x, y, z with the height (in all sensors of a scene, or none)",
    "heading_deg": "boresight, clockwise from +y",
    "heading_std_deg": "standard deviation of the heading, an error that all bearings of the sensor share",
    "position_std_m": "standard deviation of each coordinate of the position",
    "range_offset_std_m": "standard deviation of what all ranges of the sensor are too long by",
    "arrival_offset_std_m": "standard deviation of what all arrivals of the sensor are too late by, in metres",
    "offset_std_m": "standard deviation of its place along its normal",
    "direction_std_deg": "standard deviation of its direction, about point (a wall: about from)",
    "radius_std_m": "standard deviation of the radius",
    "kind": "line: an endless mirror; segment: a wall that reflects and blocks; circle: a mirror seen from inside; "
    "plane, sphere: the same in space",
    "point": "x, y in metres of a point of the line (with direction), or x, y, z of the plane",
    "normal": "direction across the plane, of any length",
    "direction": "direction of the line, of any length (with point)",
    "slope": "slope of the line (with intercept, in place of point and direction)",
    "intercept": "y in metres at x = 0 (with slope)",
    "from": "x, y in metres of the wall's first end",
    "to": "x, y in metres of the wall's other end",
    "center": "x, y in metres of the circle's centre, or x, y, z of the sphere's; 'earth': below z = 0, with height_m",
    "radius": "radius in metres",
    "height_m": "height in metres of a layer about the earth, which is the blocker (in place of radius)",
    "blocker_radius": "radius in metres of an opaque concentric circle or sphere",
    "min_elevation_deg": "least elevation above the sensor's horizontal that is received (with blocker_radius)",
    "crs": "projected CRS of x and y, such as EPSG:32632 (in place of the origin)",
    "origin_lat_deg": "latitude of x = y = 0 (WGS 84)",
    "origin_lon_deg": "longitude of x = y = 0 (WGS 84)",
    "rotation_deg": "direction of the x axis, counter-clockwise from east",
}


_VALIDITY = {
    "name": "name, by which rows refer to it; unique at any time",
    "from": "first time at which the entry is valid: a date-time with offset (files with time) or seconds (time_s)",
    "to": "time from which on the entry is no longer valid, written as from",
}
"""Keys of a sensor that have other meanings elsewhere."""


def scene_keys() -> list[dict[str, str]]:
    """Return a row for each key of a scene file: table, key, type, whether it is required, and its meaning."""
    tables: dict[str, type[Entry]] = {"[[sensor]]": SensorEntry, "[frame]": FrameEntry}
    tables |= {f"[[reflector]] {kind}": entry for kind, entry in REFLECTOR_KINDS.items()}
    rows = []
    for table, entry in tables.items():
        if table.startswith("[[reflector]]"):
            kind = table.rpartition(" ")[2]
            rows.append(_row(table, "kind", repr(kind), is_required=True))
        for field in msgspec.structs.fields(entry):
            rows.append(_row(table, field.encode_name, _type_name(field.type), is_required=field.required))
    return rows


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scene file, which is TOML."""
    schema = msgspec.json.schema(SceneEntries)
    for struct, definition in schema["$defs"].items():
        meanings = _MEANINGS | _VALIDITY if struct == SensorEntry.__name__ else _MEANINGS
        for key, content in definition.get("properties", {}).items():
            if key in meanings:
                content["description"] = meanings[key]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scene", **schema}


def _row(table: str, key: str, kind: str, *, is_required: bool) -> dict[str, str]:
    required = "required" if is_required else ""
    meaning = (_MEANINGS | _VALIDITY if table == "[[sensor]]" else _MEANINGS)[key]
    return {"table": table, "key": key, "type": kind, "required": required, "meaning": meaning}


def _type_name(kind: Any) -> str:
    if str(kind).count("float") == 3:
        return "3 numbers"
    names = {"datetime": "date-time or number", "list": "2 or 3 numbers", "tuple": "2 numbers", "str": "text"}
    return next((name for word, name in names.items() if word in str(kind)), "number")
