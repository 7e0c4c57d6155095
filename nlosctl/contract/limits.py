"""What a file may ask of the program: the limits that keep a hostile or broken one from taking time or memory.

Each has a default that honest files stay far below, and is raised by an environment variable, ``NLOSCTL_MAX_`` and its
name in capitals. The rows of a snapshot have an option of their own, ``--max-snapshot-rows``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from nlosctl.errors import UsageError

__all__ = ["LARGEST_NUMBER", "LEAST_POSITIVE", "LIMITS", "Limit", "limit", "limit_variable", "refusal_hint"]


LARGEST_NUMBER = 1e15
"""No number of a measurement, a scene or a search field is larger: squares and their products stay finite."""

LEAST_POSITIVE = 1e-15
"""No standard deviation, range or length is less: its inverse square stays finite."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A limit: its default, and what it keeps in bounds."""

    default: int
    meaning: str


LIMITS = {
    "toml_bytes": Limit(default=16 << 20, meaning="bytes of a scene, a config file or a polygon"),
    "toml_key_parts": Limit(default=32, meaning="parts of a dotted key in TOML"),
    "line_bytes": Limit(default=4 << 20, meaning="bytes of a line of CSV or JSON Lines"),
    "columns": Limit(default=10_000, meaning="columns of a table"),
    "expansion": Limit(default=250, meaning="times that a compressed file of more than 256 MiB may grow when read"),
    "memory_mb": Limit(default=0, meaning="MiB that the program may allocate; 0: as many as the system gives"),
}
"""All limits by name."""


def limit(name: str) -> int:
    """Return a limit's value: that of its environment variable, else its default; UsageError for no integer."""
    text = os.environ.get(limit_variable(name), "").strip()
    if not text:
        return LIMITS[name].default
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise UsageError(f"{limit_variable(name)} must be an integer of 0 or more. Got {text!r} instead.")
    return int(text)


def refusal_hint(name: str) -> str:
    """Return how a message ends that refuses what is beyond a limit."""
    return f"if that is meant, set {limit_variable(name)} higher"


def limit_variable(name: str) -> str:
    """Return the environment variable that sets a limit."""
    return f"NLOSCTL_MAX_{name.upper()}"
