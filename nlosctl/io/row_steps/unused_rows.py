"""Lines on the rows that options of reading leave out, and on those that a calibration does not change."""

from __future__ import annotations

from collections.abc import Collection, Mapping

__all__ = ["no_rows_left", "option_remarks", "unused_rows_remark"]

_MOST_NAMES = 10

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


def option_remarks(unused_rows: Mapping[str, int], uncalibrated: Collection[str]) -> list[str]:
    """Return lines on the rows left out, and on the sensors that a calibration lacks, for the summary."""
    lines = [unused_rows_remark(unused_rows)] if unused_rows else []
    return [*lines, *([_uncalibrated_remark(uncalibrated)] if uncalibrated else [])]


def _uncalibrated_remark(names: Collection[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"sensors without an entry in the calibration, offset 0: {', '.join(sorted(names)[:_MOST_NAMES])}{more}"
