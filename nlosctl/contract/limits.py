"""Limits on what an input may ask for, sizes in which data are read and written, and TOML files within the limits.

Each limit has a default far above what honest files need. The environment variable ``NLOSCTL_MAX_`` with its name in
capitals changes it. The rows of a snapshot have a setting of their own, ``max_snapshot_rows``. A size trades memory for
speed; ``NLOSCTL_`` with its name in capitals changes it. Results do not depend on it, except for the row groups of the
files written. The block size is a setting of its own, ``block_size``.
"""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass
from typing import IO, Any, Literal, Protocol

from nlosctl.errors import DataError, UsageError

__all__ = [
    "LARGEST_NUMBER",
    "LEAST_POSITIVE",
    "LIMITS",
    "SIZES",
    "Limit",
    "Size",
    "limit",
    "limit_variable",
    "parse_toml",
    "read_limited",
    "refusal_hint",
    "size",
    "size_variable",
]

LARGEST_NUMBER = 1e15
"""No number of a measurement, a scene or a search region is larger: squares and their products stay finite."""

LEAST_POSITIVE = 1e-15
"""No standard deviation, range or length is less: its inverse square stays finite."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A limit: its default, and what it limits."""

    default: int
    meaning: str


@dataclass(frozen=True, kw_only=True)
class Size:
    """A size: its default, and what it counts."""

    default: int
    meaning: str


LIMITS = {
    "toml_bytes": Limit(default=16 << 20, meaning="bytes of a scene, a config file or a polygon"),
    "toml_key_parts": Limit(default=32, meaning="parts of a dotted key in TOML"),
    "line_bytes": Limit(default=4 << 20, meaning="bytes of a line of CSV or JSON Lines"),
    "columns": Limit(default=10_000, meaning="columns of a table"),
    "expansion": Limit(default=250, meaning="ratio of the decompressed to the compressed size of a file"),
    "unchecked_expansion_mb": Limit(default=256, meaning="MiB that a file may decompress to at any ratio"),
    "grid_vertices": Limit(default=10_000_000, meaning="vertices of the grid of the method ml-grid"),
    "candidates": Limit(default=20_000, meaning="candidate targets of a snapshot of echoes; the best are kept"),
    "memory_mb": Limit(default=0, meaning="MiB that the program may allocate; 0: as many as the system allows"),
}
"""All limits by name."""

SIZES = {
    "chunk_rows": Size(default=131_072, meaning="rows read at a time; a chunk of whole snapshots may have more"),
    "json_block_lines": Size(default=32_768, meaning="lines of JSON Lines whose names and types are inferred together"),
    "slice_rows": Size(default=131_072, meaning="rows of Parquet that a worker process reads and solves at a time"),
    "task_rows": Size(default=1_048_576, meaning="rows of Parquet in a task of a Dask cluster"),
    "group_rows": Size(default=65_536, meaning="rows of a row group of results"),
    "measurement_group_rows": Size(default=131_072, meaning="rows of a row group of measurements"),
}
"""All sizes by name."""


def limit(name: str) -> int:
    """Return the value of a limit: its environment variable, else its default. Raises UsageError if not an integer."""
    return _integer(limit_variable(name), LIMITS[name].default, least=0)


def size(name: str) -> int:
    """Return the value of a size, as `limit` does; it is at least 1."""
    return _integer(size_variable(name), SIZES[name].default, least=1)


def _integer(variable: str, default: int, *, least: int) -> int:
    text = os.environ.get(variable, "").strip()
    if not text:
        return default
    if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) >= least):
        raise UsageError(f"{variable} must be an integer of {least} or more. Got {text!r} instead.")
    return int(text)


def refusal_hint(name: str) -> str:
    """Return the end of a message about input beyond a limit."""
    return f"if that is intended, set {limit_variable(name)} higher"


def limit_variable(name: str) -> str:
    """Return the environment variable that sets a limit."""
    return f"NLOSCTL_MAX_{name.upper()}"


def size_variable(name: str) -> str:
    """Return the environment variable that sets a size."""
    return f"NLOSCTL_{name.upper()}"


class _Readable(Protocol):
    """A local or remote path."""

    def open(self, mode: Literal["rb"]) -> IO[bytes]:
        """Open the file for reading bytes."""


def read_limited(path: _Readable, name: str) -> str:
    """Return the text of a small UTF-8 file; ``name`` is the file's name in messages.

    Raises DataError if it is larger than the limit ``toml_bytes`` or not UTF-8, OSError if it cannot be read.
    """
    largest = limit("toml_bytes")
    with path.open("rb") as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise DataError(f"{name}: larger than {largest} bytes; {refusal_hint('toml_bytes')}")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: byte 0x{content[error.start]:02x} is not UTF-8; save it as UTF-8") from error


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Return the tables of TOML text; raises DataError for invalid TOML or excessive nesting."""
    if len(text) > limit("toml_bytes"):
        raise DataError(f"{name}: larger than {limit('toml_bytes')} bytes; {refusal_hint('toml_bytes')}")
    most = limit("toml_key_parts")
    dotted = re.search(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{most}}}", text)
    if dotted is not None:
        line = text.count("\n", 0, dotted.start()) + 1
        raise DataError(f"{name}: line {line}: a key of more than {most} parts; {refusal_hint('toml_key_parts')}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{name}: not valid TOML: {error}") from error
    except RecursionError:
        raise DataError(f"{name}: the TOML cannot be read: brackets are nested too deeply") from None
    except ValueError as error:  # an integer of thousands of digits, a date that does not exist
        raise DataError(f"{name}: the TOML cannot be read: {str(error).partition(';')[0]}") from error
