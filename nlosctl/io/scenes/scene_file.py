"""Scene files: TOML to a scene and back, and which scene belongs to an input."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from nlosctl.contract.scene import EarthFrame, Scene, Sensor
from nlosctl.contract.toml_text import parse_toml, read_limited
from nlosctl.errors import DataError, did_you_mean
from nlosctl.io.paths.locations import Location, location, near_name
from nlosctl.io.scenes.reflector_kinds import REFLECTOR_KINDS, kind_of_reflector
from nlosctl.io.scenes.toml_decoder import Decoder, Finite, Point

__all__ = ["SCENE_KEY", "find_scene", "scene_from_toml", "scene_to_toml"]

SCENE_KEY = b"nlosctl.scene"
"""The key of the scene's TOML text in a table's metadata."""

_IN_METADATA = "the scene in the table's metadata"


_KEYS = ("sensor", "reflector", "frame")


class _SensorEntry(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    position: Point
    heading_deg: Finite | None = None


class _FrameEntry(msgspec.Struct, forbid_unknown_fields=True):
    crs: str | None = None
    origin_lat_deg: Finite | None = None
    origin_lon_deg: Finite | None = None
    rotation_deg: Finite = 0.0


def scene_from_toml(text: str, name: str) -> Scene:
    """Return the scene that ``text`` describes; ``name`` is the file's, for messages.

    Raises DataError that says which key is wrong, what came and what was expected.
    """
    tree = parse_toml(text, name)
    for key in tree:
        if key not in _KEYS:
            near = did_you_mean(key, _KEYS)
            raise DataError(f"{name}: unknown key {key!r}{near}; a scene has [[sensor]], [[reflector]] and [frame]")
    decoder = Decoder(file=name)
    sensors = []
    for where, entry in _entries(tree, "sensor", name):
        read = decoder.decode(entry, _SensorEntry, where)
        sensors.append(Sensor(name=read.name, position=read.position, heading_deg=read.heading_deg))
    reflectors = []
    for where, entry in _entries(tree, "reflector", name):
        kind = entry.get("kind")
        if not isinstance(kind, str) or kind not in REFLECTOR_KINDS:
            known = ", ".join(repr(word) for word in REFLECTOR_KINDS)
            near = did_you_mean(kind, REFLECTOR_KINDS) if isinstance(kind, str) else ""
            came = "nothing" if "kind" not in entry else repr(kind)
            raise DataError(f"{name}: {where}.kind: got {came}, expected one of {known}{near}")
        reflectors.append(REFLECTOR_KINDS[kind].read(decoder, entry, where))
    _check_names(name, "sensor", [sensor.name for sensor in sensors])
    _check_names(name, "reflector", [reflector.name for reflector in reflectors])
    return Scene(sensors=tuple(sensors), reflectors=tuple(reflectors), frame=_frame(tree, decoder))


def scene_to_toml(scene: Scene) -> str:
    """Return the scene as TOML text that reads back to an equal scene."""
    blocks = []
    if scene.frame is not None:
        held = {
            name: value for name, value in vars(scene.frame).items() if value not in (None, 0.0) or "origin" in name
        }
        kept = {name: value for name, value in held.items() if value is not None}
        blocks.append(_block("[frame]", kept))
    for sensor in scene.sensors:
        entry: dict[str, Any] = {"name": sensor.name, "position": sensor.position}
        if sensor.heading_deg is not None:
            entry["heading_deg"] = sensor.heading_deg
        blocks.append(_block("[[sensor]]", entry))
    for reflector in scene.reflectors:
        kind = kind_of_reflector(reflector)
        blocks.append(_block("[[reflector]]", {"kind": kind, **REFLECTOR_KINDS[kind].write(reflector)}))
    return "\n".join(blocks)


def find_scene(option: str | None, metadata: Mapping[bytes, bytes], input_path: Location | None) -> Scene:
    """Return the scene of an input: ``option`` (a file), else the table's metadata, else a file beside the input.

    Beside ``dir/STEM.parquet`` that is ``dir/STEM.scene.toml``, then ``dir/scene.toml``. Without any the scene is
    empty. Raises DataError where the file named is not there or malformed.
    """
    if option is not None:
        return _scene_of_file(location(option))
    if SCENE_KEY in metadata:
        try:
            text = metadata[SCENE_KEY].decode("utf-8")
        except UnicodeDecodeError as error:
            raise DataError(f"{_IN_METADATA}: not UTF-8 text") from error
        return scene_from_toml(text, _IN_METADATA)
    for candidate in _beside(input_path):
        if candidate.is_file():
            return _scene_of_file(candidate)
    return Scene()


def _beside(input_path: Location | None) -> list[Location]:
    if input_path is None:
        return []
    is_folder = input_path.is_dir()
    stems = [input_path.name]
    if not is_folder:
        stems = [input_path.stem.removesuffix(".csv").removesuffix(".jsonl"), input_path.name.split(".")[0]]
    named = [input_path.with_name(f"{word}.scene.toml") for word in dict.fromkeys(stems)]
    folder = input_path if is_folder else input_path.parent
    return [*named, folder / "scene.toml"]


def _scene_of_file(path: Location) -> Scene:
    try:
        text = read_limited(path, str(path))
    except OSError as error:
        raise DataError(f"{path}: the scene can't be read: {error.strerror}{near_name(path)}") from error
    return scene_from_toml(text, str(path))


def _entries(tree: Mapping[str, Any], key: str, file: str) -> list[tuple[str, dict[str, Any]]]:
    entries = tree.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DataError(f"{file}: {key}: got {entries!r}, expected tables headed [[{key}]]")
    return [(f"{key}[{place}]", entry) for place, entry in enumerate(entries)]


def _frame(tree: Mapping[str, Any], decoder: Decoder) -> EarthFrame | None:
    entry = tree.get("frame")
    if entry is None:
        return None
    if not isinstance(entry, dict):
        decoder.refuse("frame", f"got {entry!r}, expected a table headed [frame]")
    read = decoder.decode(entry, _FrameEntry, "frame")
    origin = (read.origin_lat_deg, read.origin_lon_deg)
    if (read.crs is None) == (origin == (None, None)) or (read.crs is None and None in origin):
        decoder.refuse("frame", "expected either crs, or origin_lat_deg and origin_lon_deg")
    if read.crs is not None and not re.fullmatch(r"[A-Za-z]\w*:\w+", read.crs):
        decoder.refuse("frame.crs", f"got {read.crs!r}, expected the code of an authority, as EPSG:32632")
    for key, value, limit in (("origin_lat_deg", origin[0], 90.0), ("origin_lon_deg", origin[1], 180.0)):
        if value is not None and abs(value) > limit:
            decoder.refuse(f"frame.{key}", f"got {value!r}, expected {-limit:g} to {limit:g}")
    return EarthFrame(crs=read.crs, origin_lat_deg=origin[0], origin_lon_deg=origin[1], rotation_deg=read.rotation_deg)


def _check_names(file: str, key: str, names: list[str]) -> None:
    for place, name in enumerate(names):
        if name in names[:place]:
            first = names.index(name)
            raise DataError(f"{file}: {key}[{place}].name: {name!r} is taken by {key}[{first}], expected another name")
        if not name:
            raise DataError(f"{file}: {key}[{place}].name: got '', expected a name")


def _block(head: str, entry: Mapping[str, Any]) -> str:
    lines = [f"{name} = {_toml_value(value)}" for name, value in entry.items()]
    return "\n".join([head, *lines, ""])


def _toml_value(value: Any) -> str:
    if isinstance(value, str):
        return msgspec.json.encode(value).decode("utf-8").replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    if not math.isfinite(value):
        raise ValueError(f"a scene holds finite numbers. Got {value!r} instead.")
    return repr(float(value))
