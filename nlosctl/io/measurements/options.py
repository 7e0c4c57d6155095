"""How measurements are to be read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from nlosctl.contract.limits import size
from nlosctl.contract.scene import EarthFrame, Scene

__all__ = ["ReadOptions"]


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How to read. ``kind`` None: told by the columns. ``renames``: contract's name -> file's name.

    ``scene`` is given as it is, or found as `nlosctl.io.scenes.scene_file.find_scene` says, ``scene_file`` first;
    ``frame`` stands for the scene's. Without either, places on earth get the plane that touches the first of them.
    ``constants`` (contract's name -> value in its unit) stand in for missing columns. ``extra_columns``: those
    to keep in ``Chunk.table`` beside the measurement's own, by name or by its beginning (``sweep_*``); None: all.
    Columns that are not kept are not read, so that nothing in them can be at fault.
    """

    kind: str | None = None
    renames: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    scene: Scene | None = None
    scene_file: str | None = None
    frame: EarthFrame | None = None
    all_rows: bool = False
    chunk_rows: int = field(default_factory=partial(size, "chunk_rows"))
    max_snapshot_rows: int = 1_000_000
    use_threads: bool = True
    extra_columns: Sequence[str] | None = None
