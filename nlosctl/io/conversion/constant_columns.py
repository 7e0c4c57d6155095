"""Constant standard deviations as columns of a converted table that lacks them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pyarrow as pa

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.column_mapping import check_constants, kind_of_columns, kind_table
from nlosctl.io.measurements.missing_columns import measured_names, usable_defaults

__all__ = ["new_constants", "with_constants"]


def new_constants(options: InputOptions, schema: Any, file: str) -> dict[str, float]:
    """Return the constants that become columns of a table with this schema: defaults only if it lacks them.

    Raises UsageError for a given constant that the measurements do not take, or that the table has as a column;
    DataError if the table has no measurements to which it could belong.
    """
    names = schema.names
    table = kind_table(kind_of_columns(names, {*options.constants, *options.default_constants}))
    measured = [column for column in table.required if not column.constant_allowed and not column.scene_axis]
    is_measured = any(set(column.accepted_names) & set(names) for column in measured if column.unit in ("rad", "m"))
    if options.constants and not is_measured:
        raise DataError(f"{file}: a constant standard deviation needs measurements, and the table has none")
    mapped = {
        column.name: column
        for column in table.columns
        if column.constant_allowed and set(column.accepted_names) & set(names)
    }
    check_constants(table, options.constants, mapped, file)
    for name in options.constants:
        if set(names_measured := measured_names(name, table)).isdisjoint(names):
            raise UsageError(
                f"`constants[{name!r}]` is given, but {file} has no column {names_measured[0]!r}; leave it out"
            )
    return {**(usable_defaults(options.default_constants, names, table) if is_measured else {}), **options.constants}


def with_constants(tables: Iterator[Any], constants: dict[str, float]) -> Iterator[Any]:
    """Yield the tables with a column for each constant."""
    for table in tables:
        for name, value in constants.items():
            table = table.append_column(name, pa.repeat(pa.scalar(value), table.num_rows))
        yield table
