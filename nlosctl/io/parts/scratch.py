"""Temporary part files whose tables go into a single output: read back and removed."""

from __future__ import annotations

import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pyarrow as pa

from nlosctl.io.paths.locations import is_local, location
from nlosctl.io.writers.byte_output import writing

__all__ = ["read_part", "scratch_folder"]


def read_part(path: str) -> Any:
    """Return an Arrow file as a table without metadata, and remove the file."""
    source = location(path)
    with pa.OSFile(path) if is_local(source) else source.open_native() as file, pa.ipc.open_file(file) as reader:
        table = reader.read_all().replace_schema_metadata(None)
    source.unlink()
    return table


@contextmanager
def scratch_folder(target: str) -> Iterator[str]:
    """Make a new hidden folder beside ``target`` (``-``: in the current folder), removed at the end of the block.

    Raises DataError if it can't be made.
    """
    beside = location(target)
    if not is_local(beside):
        folder = beside.with_name(f".nlosctl.{secrets.token_hex(8)}.parts")
        try:
            yield str(folder)
        finally:
            with suppress(OSError):
                folder.remove_all()
        return
    with writing(target):
        scratch = tempfile.mkdtemp(
            prefix=".nlosctl.", suffix=".parts", dir=Path.cwd() if target == "-" else beside.resolve().parent
        )
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
