"""Widths of time windows, and the names of the snapshots that they make. Imports no numpy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from typing import Literal

from nlosctl.errors import UsageError

__all__ = [
    "ALL",
    "AUTO",
    "KEEPS",
    "TICKS_PER_SECOND",
    "WINDOW_MEANING",
    "Width",
    "parse_window",
    "value_text",
    "window_id",
]

ALL: Literal["all"] = "all"
AUTO: Literal["auto"] = "auto"

Width = int | Literal["all", "auto"]
"""A width in microseconds, `ALL` (one window) or `AUTO` (the epochs of a periodic log)."""

KEEPS = ("all", "nearest", "mean")
"""What becomes of several rows of a sensor in a window."""

TICKS_PER_SECOND = {"time_s": 10**6, "time": 10**9}
"""Times are whole numbers of ticks: microseconds in the column ``time_s``, nanoseconds in ``time``."""

WINDOW_MEANING = "width of a snapshot, such as 0.1s, 500ms, 2min; auto: the epochs of a periodic log; all: one snapshot"

_UNITS_US = {"us": 1, "ms": 10**3, "s": 10**6, "min": 60 * 10**6, "h": 3600 * 10**6, "d": 86400 * 10**6}
_WIDTH = re.compile(rf"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE]([+-]?[0-9]{{1,2}}))?\s*({'|'.join(_UNITS_US)})")
_WIDEST_US = 2**61 // 1000
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def parse_window(text: str, name: str = "`window`") -> Width:
    """Return the width that ``text`` states; raise UsageError, which calls the setting ``name``, for anything else."""
    if text == ALL:
        return ALL
    if text == AUTO:
        return AUTO
    match = _WIDTH.fullmatch(text.strip())
    width = Fraction(0)
    if match:
        width = Fraction(match[1]) * Fraction(10) ** int(match[2] or 0) * _UNITS_US[match[3]]
    if width <= 0 or width.denominator != 1:
        raise UsageError(
            f"{name} must be a width larger than 0 with its unit, such as 2s or 500ms (us, ms, s, min, h, d; a whole "
            f"number of microseconds), or auto, or all. Got {text!r} instead."
        )
    return min(int(width), _WIDEST_US)


def window_id(by: Sequence[tuple[str, str]], start: int, column: str) -> str:
    """Return the name of a window: the columns that part the rows with their values, then its start in ticks."""
    text = _iso(start) if column == "time" else _seconds(start)
    return "".join([*(f"{name}-{value}/" for name, value in by), text])


def value_text(value: object) -> str:
    """Return a value of a column that parts the rows as text: whole numbers without decimals, null as empty text."""
    if value is None:
        return ""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)


def _seconds(start: int) -> str:
    """Return microseconds as seconds without trailing zeros."""
    whole, rest = divmod(abs(start), 10**6)
    decimals = f".{rest:06d}".rstrip("0") if rest else ""
    return f"{'-' if start < 0 else ''}{whole}{decimals}"


def _iso(start: int) -> str:
    """Return nanoseconds since 1970 as ISO 8601 in UTC with at most six decimals."""
    whole, rest = divmod(start // 1000, 10**6)
    decimals = f".{rest:06d}".rstrip("0") if rest else ""
    return f"{(_EPOCH + timedelta(seconds=whole)).strftime('%Y-%m-%dT%H:%M:%S')}{decimals}Z"
