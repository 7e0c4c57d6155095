"""Where a result comes from: put into the metadata of the files that have room for it. No time, no path but the names
given, nothing that differs between equal runs."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from nlosctl.contract.scene import Scene
from nlosctl.io.paths.inputs import Input
from nlosctl.io.scenes.scene_file import SCENE_KEY, scene_to_toml
from nlosctl.io.writers.table_writer import provenance_text
from nlosctl.version import __version__

__all__ = ["PROVENANCE_KEY", "describe_inputs", "file_metadata"]

PROVENANCE_KEY = "nlosctl"


def file_metadata(command: str, content: Mapping[str, Any], scene: Scene) -> dict[str, str]:
    """Return the metadata of a result file: the provenance as JSON, and the scene as TOML where there is one."""
    provenance = {"version": __version__, "command": command, **content}
    metadata = {PROVENANCE_KEY: provenance_text(provenance)}
    if scene != Scene():
        metadata[SCENE_KEY.decode()] = scene_to_toml(scene)
    return metadata


def describe_inputs(inputs: Sequence[Input], rows: Mapping[str, int], *, with_hash: bool) -> list[dict[str, Any]]:
    """Return name, size, number of rows (where it is known) and, if wanted, SHA-256 of every input file."""
    described = []
    for part in (part for given in inputs for part in given.parts):
        entry: dict[str, Any] = {"name": part.name}
        if part.path is not None:
            entry["bytes"] = part.path.stat().st_size
            if with_hash:
                with part.path.open("rb") as file:
                    entry["sha256"] = hashlib.file_digest(file, "sha256").hexdigest()
        if part.name in rows:
            entry["rows"] = rows[part.name]
        described.append(entry)
    return described
