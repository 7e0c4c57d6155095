"""Limits that keep a hostile or broken file from taking time or memory, and TOML files read within them.

Each limit has a default far above what honest files need. The environment variable ``NLOSCTL_MAX_`` with its name in
capitals changes it. The rows of a snapshot have a setting of their own, ``max_snapshot_rows``.
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
    "Limit",
    "limit",
    "limit_variable",
    "parse_toml",
    "read_limited",
    "refusal_hint",
]

LARGEST_NUMBER = 1e15
"""No number of a measurement, a scene or a search field is larger: squares and their products stay finite."""

LEAST_POSITIVE = 1e-15
"""No standard deviation, range or length is less: its inverse square stays finite."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A limit: its default, and what it limits."""

    default: int
    meaning: str


LIMITS = {
    "toml_bytes": Limit(default=16 << 20, meaning="bytes of a scene, a config file or a polygon"),
    "toml_key_parts": Limit(default=32, meaning="parts of a dotted key in TOML"),
    "line_bytes": Limit(default=4 << 20, meaning="bytes of a line of CSV or JSON Lines"),
    "columns": Limit(default=10_000, meaning="columns of a table"),
    "expansion": Limit(default=250, meaning="times that a compressed file of more than 256 MiB may grow when read"),
    "memory_mb": Limit(default=0, meaning="MiB that the program may allocate; 0: as many as the system allows"),
}
"""All limits by name."""


def limit(name: str) -> int:
    """Return the value of a limit: its environment variable, else its default. Raises UsageError if not an integer."""
    text = os.environ.get(limit_variable(name), "").strip()
    if not text:
        return LIMITS[name].default
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise UsageError(f"{limit_variable(name)} must be an integer of 0 or more. Got {text!r} instead.")
    return int(text)


def refusal_hint(name: str) -> str:
    """Return the end of a message about input beyond a limit."""
    return f"if that is intended, set {limit_variable(name)} higher"


def limit_variable(name: str) -> str:
    """Return the environment variable that sets a limit."""
    return f"NLOSCTL_MAX_{name.upper()}"


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
