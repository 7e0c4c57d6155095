"""Scene files: a scene from TOML and to TOML, and the scene that belongs to an input."""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from itertools import pairwise
from typing import Any

import msgspec

from nlosctl.contract.limits import LARGEST_NUMBER, parse_toml, read_limited
from nlosctl.contract.scene import EarthFrame, Scene, Sensor
from nlosctl.errors import DataError, did_you_mean, hide_secrets
from nlosctl.geometry.earth import EarthPlane
from nlosctl.io.paths.locations import Location, is_local, location, near_name
from nlosctl.io.scenes.scene_entries import (
    REFLECTOR_KINDS,
    TOML_NAMES,
    EntryError,
    FrameEntry,
    SceneEntries,
    SensorEntry,
    shown_time,
)

__all__ = ["SCENE_KEY", "find_scene", "plane_of", "scene_from_toml", "scene_to_toml", "toml_value"]

SCENE_KEY = b"nlosctl.scene"
"""The metadata key of a table whose value is the scene as TOML text."""

_LONGEST_NAME = 255
"""File systems allow names of so many bytes."""

_NOT_WRITTEN = ("z_m", "on_ellipsoid")
"""Fields of a scene that are no keys: a height is part of the position, and inputs decide what is on the ellipsoid."""

_IN_METADATA = "the scene in the table's metadata"


def scene_from_toml(text: str, name: str) -> Scene:
    """Return the scene in TOML ``text``; ``name`` is the file's name, for messages.

    Raises DataError that names the key, with the value and what was expected.
    """
    tree = parse_toml(text, name)
    for key in tree:
        if key not in SceneEntries.__struct_fields__:
            near = did_you_mean(key, SceneEntries.__struct_fields__)
            raise DataError(f"{name}: unknown key {key!r}{near}; a scene has [[sensor]], [[reflector]] and [frame]")
    try:
        entries = msgspec.convert(tree, SceneEntries)
    except msgspec.ValidationError as error:
        raise DataError(f"{name}: {_fault(tree, error)}") from error
    for key in ("sensor", "reflector"):
        _check_names(name, key, getattr(entries, key))
    _check_times(name, entries.sensor)
    _check_heights(name, entries.sensor)
    return Scene(
        sensors=tuple(_sensor(entry) for entry in entries.sensor),
        reflectors=tuple(entry.to_scene() for entry in entries.reflector),
        frame=None if entries.frame is None else entries.frame.to_scene(),
    )


def _fault(tree: Mapping[str, Any], error: msgspec.ValidationError) -> str:
    """Return the key of a fault, its value and what was expected; msgspec's message ends with the key's path."""
    reason, _, path = str(error).rpartition(" - at `$.")
    table, index, key = re.findall(r"^(\w+)(?:\[(\d+)\])?(?:\.(\w+))?", path)[0]
    where, entry = (f"{table}[{index}]", tree[table][int(index)]) if index else (table, tree[table])
    if not isinstance(entry, dict) or not (index or table == "frame"):
        expected = "a table headed [frame]" if table == "frame" else f"tables headed [[{table}]]"
        return f"{table}: got {tree[table]!r}, expected {expected}"
    if isinstance(error.__cause__, EntryError):
        key, fault = error.__cause__.args
        return f"{where}.{key}: {fault}" if key else f"{where}: {fault}"
    if table == "reflector" and entry.get("kind") not in list(REFLECTOR_KINDS):
        kind = entry.get("kind")
        near = did_you_mean(kind, REFLECTOR_KINDS) if isinstance(kind, str) else ""
        got = repr(kind) if "kind" in entry else "nothing"
        return f"{where}.kind: got {got}, expected one of {', '.join(map(repr, REFLECTOR_KINDS))}{near}"
    struct = REFLECTOR_KINDS[entry["kind"]] if table == "reflector" else SensorEntry if index else FrameEntry
    fields = {field.encode_name: field for field in msgspec.structs.fields(struct)}
    keys = ["kind", *fields] if table == "reflector" else [*fields]
    for unknown in entry:
        if unknown not in keys:
            return f"{where}.{unknown}: unknown key{did_you_mean(unknown, keys)}; there are: {', '.join(keys)}"
    if not key:
        key = next(name for name, field in fields.items() if field.required and name not in entry)
        return f"{where}.{key}: missing, expected {_expected(fields[key].type)}"
    if "_std_" in key and not isinstance(entry[key], str | list):
        most = 180 if key.endswith("_deg") else LARGEST_NUMBER
        return f"{where}.{key}: got {entry[key]!r}, expected a standard deviation from 0 to {most:g}"
    beyond = re.match("Expected `float` [<>]=", reason)
    expected = f"finite numbers within {LARGEST_NUMBER:g}" if beyond else _expected(fields[key].type)
    return f"{where}.{key}: got {entry[key]!r}, expected {expected}"


def _expected(kind: Any) -> str:
    if "datetime" in str(kind):
        return "a date-time with an offset, or a number of seconds"
    if "str" in str(kind):
        return "text"
    if "list" in str(kind):
        return "two numbers, [x, y], or three with the height, [x, y, z]"
    if str(kind).count("float") == 3:
        return "three numbers, [x, y, z]"
    return "two numbers, [x, y]" if "tuple" in str(kind) else "a number"


def _sensor(entry: SensorEntry) -> Sensor:
    x, y, *z = entry.position
    return Sensor(**{**msgspec.structs.asdict(entry), "position": (x, y)}, z_m=z[0] if z else None)


def _has_times(entry: Any) -> bool:
    return isinstance(entry, SensorEntry) and (entry.start is not None or entry.end is not None)


def _check_times(file: str, sensors: Sequence[SensorEntry]) -> None:
    """Raise DataError if the times of sensors are of two kinds, or two entries of one name hold at one time."""
    timed = [(index, sensor) for index, sensor in enumerate(sensors) if _has_times(sensor)]
    for index, sensor in timed:
        try:
            sensor.check_times()
        except EntryError as error:
            key, fault = error.args
            raise DataError(f"{file}: sensor[{index}].{key}: {fault}") from error
        if isinstance(sensor.limits[0], datetime) != isinstance(timed[0][1].limits[0], datetime):
            raise DataError(
                f"{file}: sensor[{index}]: sensor {sensor.name!r} has other times than sensor[{timed[0][0]}], "
                f"{timed[0][1].name!r}; give all 'from' and 'to' of a scene as date-times, or all as numbers"
            )
    by_name: dict[str, list[tuple[int, SensorEntry]]] = {sensor.name: [] for _, sensor in timed}
    for index, sensor in enumerate(sensors):
        by_name.get(sensor.name, []).append((index, sensor))
    for entries in by_name.values():
        bounded = [(index, sensor) for index, sensor in entries if sensor.start is not None]
        bounded.sort(key=lambda entry: entry[1].start)  # type: ignore[arg-type, return-value]
        ordered = [*(entry for entry in entries if entry[1].start is None), *bounded]
        for (first, earlier), (index, later) in pairwise(ordered):
            if earlier.end is None or later.start is None or earlier.end > later.start:  # type: ignore[operator]
                end = "without 'to'" if earlier.end is None else f"up to {shown_time(earlier.end)}"
                start = "without 'from'" if later.start is None else f"from {shown_time(later.start)}"
                raise DataError(
                    f"{file}: sensor[{index}]: sensor {later.name!r} {start} overlaps sensor[{first}] {end}; "
                    "end one entry of a name where the next begins"
                )


def _check_heights(file: str, sensors: Sequence[SensorEntry]) -> None:
    for index, sensor in enumerate(sensors):
        if len(sensor.position) != len(sensors[0].position):
            raise DataError(
                f"{file}: sensor[{index}].position: got {sensor.position!r}, expected {len(sensors[0].position)} "
                f"numbers as for sensor[0]: either all sensors of a scene have a height, or none has"
            )


def _check_names(file: str, key: str, entries: Sequence[Any]) -> None:
    """Raise DataError for a name that is empty, or taken by another entry; see `_check_times` for those with times."""
    indices: dict[str, int] = {}
    for index, entry in enumerate(entries):
        name = entry.name
        first = indices.setdefault(name, index)
        if first < index and not (_has_times(entry) or _has_times(entries[first])):
            raise DataError(f"{file}: {key}[{index}].name: {name!r} is taken by {key}[{first}], expected another name")
        if not name:
            raise DataError(f"{file}: {key}[{index}].name: got '', expected a name")


def scene_to_toml(scene: Scene) -> str:
    """Return the scene as TOML text that reads back to an equal scene, except for `EarthFrame.on_ellipsoid`."""
    kinds = {entry.scene_type: kind for kind, entry in REFLECTOR_KINDS.items()}
    blocks = [] if scene.frame is None else [_block("[frame]", scene.frame)]
    blocks += [_block("[[sensor]]", sensor) for sensor in scene.sensors]
    blocks += [_block("[[reflector]]", reflector, kind=kinds[type(reflector)]) for reflector in scene.reflectors]
    return "\n".join(blocks)


def _block(head: str, item: Any, **keys: Any) -> str:
    """Return an object of a scene as a TOML table: ``keys``, then the fields that differ from their defaults."""
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if isinstance(item, Sensor) and field.name == "position" and item.z_m is not None:
            value = (*value, item.z_m)
        if value != field.default and field.name not in _NOT_WRITTEN:
            keys[TOML_NAMES.get(field.name, field.name)] = value
    return "\n".join([head, *(f"{name} = {toml_value(value)}" for name, value in keys.items()), ""])


def toml_value(value: Any) -> str:
    """Return text, a finite number, a date-time, or a list of them as TOML."""
    if isinstance(value, str):
        return msgspec.json.encode(value).decode("utf-8").replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    if isinstance(value, datetime):
        return value.isoformat()
    if not math.isfinite(value):
        raise ValueError(f"a scene has finite numbers. Got {value!r} instead.")
    return repr(float(value))


def find_scene(option: str | None, metadata: Mapping[bytes, bytes], input_path: Location | None) -> Scene:
    """Return the scene of an input: ``option`` (a file), else the table's metadata, else a file beside the input.

    Beside ``dir/STEM.parquet`` that is ``dir/STEM.scene.toml``, then ``dir/scene.toml``. Without any of them the scene
    is empty. Raises DataError if the file does not exist or is malformed.
    """
    if option is not None:
        return _scene_of_file(location(option))
    if SCENE_KEY in metadata:
        try:
            text = metadata[SCENE_KEY].decode("utf-8")
        except UnicodeDecodeError as error:
            raise DataError(f"{_IN_METADATA}: not UTF-8 text") from error
        return scene_from_toml(text, _IN_METADATA)
    for candidate in _candidates(input_path):
        if candidate.is_file():
            return _scene_of_file(candidate)
    return Scene()


def _candidates(input_path: Location | None) -> list[Location]:
    """Return the possible paths of a scene file beside an input, in order of preference."""
    if input_path is None or (not is_local(input_path) and input_path.owns_query):
        return []
    is_folder = input_path.is_dir()
    stems = [input_path.name]
    if not is_folder:
        stems = [input_path.stem.removesuffix(".csv").removesuffix(".jsonl"), input_path.name.split(".")[0]]
    names = [f"{stem}.scene.toml" for stem in dict.fromkeys(stems) if stem]  # "." has no name
    named = [input_path.parent / name for name in names if len(os.fsencode(name)) <= _LONGEST_NAME]
    folder = input_path if is_folder else input_path.parent
    return [*named, folder / "scene.toml"]


def _scene_of_file(path: Location) -> Scene:
    try:
        text = read_limited(path, hide_secrets(str(path)))
    except OSError as error:
        raise DataError(f"{path}: the scene can't be read: {error.strerror}{near_name(path)}") from error
    return scene_from_toml(text, hide_secrets(str(path)))


@lru_cache(maxsize=64)
def plane_of(frame: EarthFrame) -> EarthPlane:
    """Return the plane of a frame. Raises UsageError without pyproj, or if the CRS cannot be used."""
    place = {name: value for name, value in vars(frame).items() if name != "on_ellipsoid"}
    return EarthPlane(**place)
