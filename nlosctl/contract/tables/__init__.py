"""The columns of every table that nlosctl reads or writes: the one place that defines them. Imports no numpy."""

from __future__ import annotations

from nlosctl.contract.tables.columns import Column, ColumnType, Spelling, Table
from nlosctl.contract.tables.measurements import BEARINGS, EARTH_PLACES, RANGES, TRIPLETS
from nlosctl.contract.tables.results import BOUND, ELLIPSE, ESTIMATES, FLAGS, PRECISION, TRACE, TRUTH
from nlosctl.contract.tables.scores import SCORES

__all__ = [
    "BEARINGS",
    "BOUND",
    "EARTH_PLACES",
    "ELLIPSE",
    "ESTIMATES",
    "FLAGS",
    "KINDS",
    "PRECISION",
    "RANGES",
    "SCORES",
    "TABLES",
    "TRACE",
    "TRIPLETS",
    "TRUTH",
    "Column",
    "ColumnType",
    "Spelling",
    "Table",
]

KINDS: dict[str, Table] = {table.name: table for table in (BEARINGS, RANGES, TRIPLETS)}
"""The kinds of measurement, by name."""

TABLES: dict[str, Table] = {**KINDS, **{table.name: table for table in (ESTIMATES, FLAGS, TRACE, BOUND, SCORES, TRUTH)}}
"""Every table, by name: ``schemas/`` holds one file for each."""
