"""Part files that are on their way into a single one: read back as they were written, and taken away."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa

from nlosctl.io.locations import location

__all__ = ["read_part", "scratch_folder"]


def read_part(path: str) -> Any:
    """Return an Arrow file as a table without metadata, and remove the file."""
    with pa.OSFile(path) as file, pa.ipc.open_file(file) as reader:
        table = reader.read_all().replace_schema_metadata(None)
    Path(path).unlink()
    return table


@contextmanager
def scratch_folder(target: str) -> Iterator[str]:
    """Give a new hidden folder beside ``target`` (``-`` or a URL: in the current folder); it goes at its end."""
    place = location(target)
    folder = place.resolve().parent if isinstance(place, Path) and target != "-" else Path.cwd()
    scratch = tempfile.mkdtemp(prefix=".nlosctl.", suffix=".parts", dir=folder)
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
