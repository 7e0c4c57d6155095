"""Lines on the rows that options of reading leave out."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["no_rows_left", "unused_rows_remark"]

_REASONS = {"missing": "by `missing`", "where": "by `where`", "wide": "for empty cells of `wide`"}


def unused_rows_remark(unused_rows: Mapping[str, int]) -> str:
    """Return how many rows are left out by which option, for the summary."""
    total = sum(unused_rows.values())
    rows = "1 row is" if total == 1 else f"{total} rows are"
    return f"{rows} left out: {_by_option(unused_rows)}"


def no_rows_left(name: str, unused_rows: Mapping[str, int]) -> str:
    """Return the message on inputs whose rows are all left out; ``name`` is that of the first."""
    return f"{name}: no rows left: {_by_option(unused_rows)}; compare these options with the values in the file"


def _by_option(unused_rows: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {_REASONS[name]}" for name, count in sorted(unused_rows.items()))
