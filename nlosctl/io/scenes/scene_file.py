"""Scene files: a scene from TOML and to TOML, and the scene that belongs to an input."""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Annotated, Any, ClassVar

import msgspec

from nlosctl.contract.limits import LARGEST_NUMBER, parse_toml, read_limited
from nlosctl.contract.scene import CircleReflector, EarthFrame, LineReflector, Scene, SegmentReflector, Sensor
from nlosctl.errors import DataError, did_you_mean, hide_secrets
from nlosctl.geometry.earth import EarthPlane
from nlosctl.io.paths.locations import Location, is_local, location, near_name

__all__ = ["SCENE_KEY", "find_scene", "plane_of", "scene_from_toml", "scene_to_toml"]

SCENE_KEY = b"nlosctl.scene"
"""The metadata key of a table whose value is the scene as TOML text."""

_LONGEST_NAME = 255
"""File systems allow names of so many bytes."""

_IN_METADATA = "the scene in the table's metadata"

Number = Annotated[float, msgspec.Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Point = tuple[Number, Number]

_TOML_NAMES = {"start": "from", "end": "to"}
"""Keys of a scene file that differ from the names of the scene's fields."""


class _EntryError(ValueError):
    """A fault of an entry: its key ("" for the entry itself), and the rest of the message."""


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    """A table of a scene file. Its fields are the file's keys; ``scene_type`` is the class that it becomes."""

    scene_type: ClassVar[type[Any]]

    def to_scene(self) -> Any:
        """Return the entry as the scene's object."""
        return self.scene_type(**msgspec.structs.asdict(self))


class _SensorEntry(_Entry):
    scene_type = Sensor

    name: str
    position: Point
    heading_deg: Number | None = None


class _LineEntry(_Entry, tag_field="kind", tag="line"):
    scene_type = LineReflector

    name: str
    point: Point | None = None
    direction: Point | None = None
    slope: Number | None = None
    intercept: Number | None = None

    def __post_init__(self) -> None:
        by_slope = self.slope is not None or self.intercept is not None
        if by_slope and (self.point is not None or self.direction is not None):
            raise _EntryError("", "has both point/direction and slope/intercept, expected one of the two pairs")
        for key in ("slope", "intercept") if by_slope else ("point", "direction"):
            if getattr(self, key) is None:
                raise _EntryError(key, "missing; a line has point and direction, or slope and intercept")
        if self.direction == (0.0, 0.0):
            raise _EntryError("direction", "got [0, 0], expected a direction of any length except zero")

    def to_scene(self) -> LineReflector:
        if self.point is not None and self.direction is not None:
            return LineReflector(name=self.name, point=self.point, direction=self.direction)
        return LineReflector(name=self.name, point=(0.0, self.intercept or 0.0), direction=(1.0, self.slope or 0.0))


class _SegmentEntry(_Entry, tag_field="kind", tag="segment", rename=_TOML_NAMES):
    scene_type = SegmentReflector

    name: str
    start: Point
    end: Point

    def __post_init__(self) -> None:
        if self.start == self.end:
            raise _EntryError("to", "got the same point as 'from', expected a different one: a wall has a length")


class _CircleEntry(_Entry, tag_field="kind", tag="circle"):
    scene_type = CircleReflector

    name: str
    center: Point
    radius: Number
    blocker_radius: Number | None = None
    min_elevation_deg: Number | None = None

    def __post_init__(self) -> None:
        radius, blocker, elevation = self.radius, self.blocker_radius, self.min_elevation_deg
        if not radius > 0.0:
            raise _EntryError("radius", f"got {radius:g}, expected a radius above 0")
        if blocker is not None and not 0.0 < blocker < radius:
            raise _EntryError(
                "blocker_radius", f"got {blocker:g}, expected one inside the reflector: in (0, {radius:g})"
            )
        if elevation is not None and blocker is None:
            raise _EntryError("min_elevation_deg", "needs a blocker_radius: without a blocker there is no horizon")
        if elevation is not None and not 0.0 <= elevation < 90.0:
            raise _EntryError("min_elevation_deg", f"got {elevation:g}, expected an angle in [0, 90)")


class _FrameEntry(_Entry):
    scene_type = EarthFrame

    crs: str | None = None
    origin_lat_deg: Number | None = None
    origin_lon_deg: Number | None = None
    rotation_deg: Number = 0.0

    def __post_init__(self) -> None:
        origin = {"origin_lat_deg": self.origin_lat_deg, "origin_lon_deg": self.origin_lon_deg}
        if list(origin.values()).count(None) != (0 if self.crs is None else 2):
            raise _EntryError("", "expected either crs, or origin_lat_deg and origin_lon_deg")
        if self.crs is not None and not re.fullmatch(r"[A-Za-z]\w*:\w+", self.crs):
            raise _EntryError("crs", f"got {self.crs!r}, expected the code of an authority, such as EPSG:32632")
        for (key, value), most in zip(origin.items(), (90.0, 180.0), strict=True):
            if value is not None and abs(value) > most:
                raise _EntryError(key, f"got {value!r}, expected {-most:g} to {most:g}")


class _SceneEntries(msgspec.Struct, forbid_unknown_fields=True):
    sensor: list[_SensorEntry] = []
    reflector: list[_LineEntry | _SegmentEntry | _CircleEntry] = []
    frame: _FrameEntry | None = None


_KINDS: dict[str, type[_Entry]] = {"line": _LineEntry, "segment": _SegmentEntry, "circle": _CircleEntry}
"""Entries of reflectors by their ``kind``."""


def scene_from_toml(text: str, name: str) -> Scene:
    """Return the scene in TOML ``text``; ``name`` is the file's name, for messages.

    Raises DataError that names the key, with the value and what was expected.
    """
    tree = parse_toml(text, name)
    for key in tree:
        if key not in _SceneEntries.__struct_fields__:
            near = did_you_mean(key, _SceneEntries.__struct_fields__)
            raise DataError(f"{name}: unknown key {key!r}{near}; a scene has [[sensor]], [[reflector]] and [frame]")
    try:
        entries = msgspec.convert(tree, _SceneEntries)
    except msgspec.ValidationError as error:
        raise DataError(f"{name}: {_fault(tree, error)}") from error
    for key in ("sensor", "reflector"):
        _check_names(name, key, [entry.name for entry in getattr(entries, key)])
    return Scene(
        sensors=tuple(entry.to_scene() for entry in entries.sensor),
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
    if isinstance(error.__cause__, _EntryError):
        key, fault = error.__cause__.args
        return f"{where}.{key}: {fault}" if key else f"{where}: {fault}"
    if table == "reflector" and entry.get("kind") not in list(_KINDS):
        kind = entry.get("kind")
        near = did_you_mean(kind, _KINDS) if isinstance(kind, str) else ""
        got = repr(kind) if "kind" in entry else "nothing"
        return f"{where}.kind: got {got}, expected one of {', '.join(map(repr, _KINDS))}{near}"
    struct = _KINDS[entry["kind"]] if table == "reflector" else _SensorEntry if index else _FrameEntry
    fields = {field.encode_name: field for field in msgspec.structs.fields(struct)}
    keys = ["kind", *fields] if table == "reflector" else [*fields]
    for unknown in entry:
        if unknown not in keys:
            return f"{where}.{unknown}: unknown key{did_you_mean(unknown, keys)}; there are: {', '.join(keys)}"
    if not key:
        key = next(name for name, field in fields.items() if field.required and name not in entry)
        return f"{where}.{key}: missing, expected {_expected(fields[key].type)}"
    beyond = re.match("Expected `float` [<>]=", reason)
    expected = f"finite numbers within {LARGEST_NUMBER:g}" if beyond else _expected(fields[key].type)
    return f"{where}.{key}: got {entry[key]!r}, expected {expected}"


def _expected(kind: Any) -> str:
    if "str" in str(kind):
        return "text"
    return "two numbers, [x, y]" if "tuple" in str(kind) else "a number"


def _check_names(file: str, key: str, names: Sequence[str]) -> None:
    indices: dict[str, int] = {}
    for index, name in enumerate(names):
        first = indices.setdefault(name, index)
        if first < index:
            raise DataError(f"{file}: {key}[{index}].name: {name!r} is taken by {key}[{first}], expected another name")
        if not name:
            raise DataError(f"{file}: {key}[{index}].name: got '', expected a name")


def scene_to_toml(scene: Scene) -> str:
    """Return the scene as TOML text that reads back to an equal scene."""
    kinds = {entry.scene_type: kind for kind, entry in _KINDS.items()}
    blocks = [] if scene.frame is None else [_block("[frame]", scene.frame)]
    blocks += [_block("[[sensor]]", sensor) for sensor in scene.sensors]
    blocks += [_block("[[reflector]]", reflector, kind=kinds[type(reflector)]) for reflector in scene.reflectors]
    return "\n".join(blocks)


def _block(head: str, item: Any, **keys: Any) -> str:
    """Return an object of a scene as a TOML table: ``keys``, then the fields that differ from their defaults."""
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if value != field.default:
            keys[_TOML_NAMES.get(field.name, field.name)] = value
    return "\n".join([head, *(f"{name} = {_toml_value(value)}" for name, value in keys.items()), ""])


def _toml_value(value: Any) -> str:
    if isinstance(value, str):
        return msgspec.json.encode(value).decode("utf-8").replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
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
    return EarthPlane(**vars(frame))
