"""The columns of every table that nlosctl reads or writes, each declared once. Imports no numpy."""

from __future__ import annotations

from collections.abc import Collection
from functools import cache

from nlosctl.contract.tables.added import ADDED_COLUMNS, ELLIPSE
from nlosctl.contract.tables.arrivals import ARRIVALS
from nlosctl.contract.tables.bearings_ranges import BEARINGS, RANGES
from nlosctl.contract.tables.bound import BOUND
from nlosctl.contract.tables.calibration import CALIBRATION, DEVIATIONS
from nlosctl.contract.tables.columns import SWEEP_PREFIX, Column, ColumnType, Spelling, Table, is_swept
from nlosctl.contract.tables.motion import FIXES, OF_MOVING, PART, TRACK, VELOCITY, has_states
from nlosctl.contract.tables.posterior import POSTERIOR
from nlosctl.contract.tables.results import ESTIMATES, FLAGS, TRUTH
from nlosctl.contract.tables.scores import SCORES
from nlosctl.contract.tables.shared import DEGREE, EARTH_PLACES
from nlosctl.contract.tables.space import TRUTH_HEIGHT
from nlosctl.contract.tables.trace import TRACE
from nlosctl.contract.tables.triplets import TRIPLETS

__all__ = [
    "ADDED_COLUMNS",
    "ARRIVALS",
    "BEARINGS",
    "BOUND",
    "CALIBRATION",
    "DEVIATIONS",
    "EARTH_PLACES",
    "ELLIPSE",
    "ESTIMATES",
    "FIXES",
    "FLAGS",
    "KINDS",
    "OF_MOVING",
    "PART",
    "POSTERIOR",
    "RANGES",
    "SCORES",
    "SWEEP_PREFIX",
    "TABLES",
    "TRACE",
    "TRACK",
    "TRIPLETS",
    "TRUTH",
    "TRUTH_HEIGHT",
    "VELOCITY",
    "Column",
    "ColumnType",
    "Spelling",
    "Table",
    "azimuth_units",
    "contract_names",
    "declared_type",
    "has_states",
    "is_swept",
    "measured_names",
    "result_table",
]

KINDS: dict[str, Table] = {table.name: table for table in (BEARINGS, RANGES, TRIPLETS, ARRIVALS)}
"""The tables of measurements by their kind."""

_TABLES_OF_ROWS = {
    **KINDS,
    **{table.name: table for table in (ESTIMATES, FLAGS, TRACE, BOUND, POSTERIOR, SCORES, TRUTH)},
}

TABLES: dict[str, Table] = {**_TABLES_OF_ROWS, CALIBRATION.name: CALIBRATION, DEVIATIONS.name: DEVIATIONS}
"""Every table by its name; ``schemas/`` has one file for each."""


@cache
def contract_names() -> frozenset[str]:
    """Return the names of all columns of measurements and results, including other spellings."""
    return frozenset(
        name
        for table in _TABLES_OF_ROWS.values()
        for column in (*table.columns, *table.space)
        for name in column.accepted_names
    )


@cache
def measured_names() -> frozenset[str]:
    """Return the names of the columns of measured values in all kinds, including other spellings."""
    columns = [column for table in KINDS.values() for column in (*table.columns, *table.space) if column.measured]
    return frozenset(name for column in columns for name in column.accepted_names)


@cache
def azimuth_units() -> dict[str, float]:
    """Return the names of columns of azimuths as a compass shows them, each with its unit in degrees."""
    columns = [column for table in KINDS.values() for column in table.columns if column.measured]
    return {
        spelling.name: abs(spelling.scale) / DEGREE
        for column in columns
        for spelling in column.spellings
        if spelling.is_compass
    }


@cache
def _declared_types() -> dict[str, ColumnType]:
    types: dict[str, ColumnType] = {}
    for table in _TABLES_OF_ROWS.values():
        for column in (*table.used_columns(()), *table.space):
            types |= dict.fromkeys(column.accepted_names, column.type)
    return types


def declared_type(name: str) -> ColumnType | None:
    """Return the type of a column in the tables that have it, None for a column that none has."""
    return _declared_types().get(name)


def result_table(names: Collection[str]) -> Table | None:
    """Return the table of results that has the columns ``names``, None if it is not one: measurements, perhaps."""
    if "of" in names and not {"rows", "snapshots"}.isdisjoint(names):
        return SCORES
    candidates = (BOUND, POSTERIOR, ESTIMATES, TRACE, FLAGS)
    return next((table for table in candidates if all(column.name in names for column in table.required)), None)
