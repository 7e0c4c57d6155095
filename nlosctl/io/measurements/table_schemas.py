"""The table of unlabelled rows; what several files share: one Arrow schema for their columns, and one scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pyarrow as pa

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import KINDS, Table, contract_names
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import kind_of_columns, kind_table
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import as_text, plain, plain_type

__all__ = ["check_same_scene", "conformed", "unified_schema", "unlabelled_table"]

_UNLABELLED = {"ranges": "range_m", "bearings": "bearing_rad"}
"""The measured column of each kind whose rows may be unlabelled; of a file that has both, the first is meant."""

_MARKS = ({"truth_target"}, {"target", "los"})
"""Columns that mark rows as those of several targets: of simulations, and flags of `identify-los`."""


def unlabelled_table(options: InputOptions, names: Iterable[str]) -> Table | None:
    """Return the table of a file of unlabelled rows with the columns ``names``; None if its rows are not.

    It has no key that no rows may share. Where rows are always unlabelled it is that of ranges if the file has them,
    else of bearings, unless the kind is given.
    """
    given, kind = set(names), options.kind
    if options.unlabelled == "marked":
        if not any(given >= mark for mark in _MARKS):
            return None
        kind = kind or kind_of_columns(given)
    measured = [own for own, name in _UNLABELLED.items() if given.intersection(KINDS[own].column(name).accepted_names)]
    return replace(kind_table(kind or next(iter(measured), "ranges")), row_key=())


def unified_schema(schemas: Sequence[Any]) -> Any:
    """Return the schema for the columns of all files, in order of first appearance, nullable.

    Integers and floats become float64, integers of different sizes int64 (uint64 in a column that the contract does
    not have: text), and any other mixture of types text.
    """
    types: dict[str, Any] = {}
    for schema in schemas:
        for column in schema:
            earlier, new = types.get(column.name), plain_type(column.type)
            in_contract = column.name in contract_names()
            types[column.name] = new if earlier is None else _common_type(earlier, new, in_contract)
    return pa.schema(list(types.items()))


def _common_type(one: Any, other: Any, in_contract: bool) -> Any:
    if one == other or pa.types.is_null(other):
        return one
    if pa.types.is_null(one):
        return other
    numeric = [pa.types.is_integer(kind) or pa.types.is_floating(kind) for kind in (one, other)]
    if all(numeric) and (in_contract or not any(pa.types.is_uint64(kind) for kind in (one, other))):
        both_integers = pa.types.is_integer(one) and pa.types.is_integer(other)
        return pa.int64() if both_integers else pa.float64()
    return pa.string()


def conformed(batch: Any, schema: Any, file: str, file_names: Mapping[str, str]) -> Any:
    """Return an Arrow batch as a table with the columns of ``schema``, null where it has none.

    Raises DataError for a value of another type; ``file_names`` are the file's own names of columns, for the message.
    """
    columns = [
        _cast(plain(batch.column(column.name)), column, file, file_names)
        if column.name in batch.schema.names
        else pa.nulls(batch.num_rows, column.type)
        for column in schema
    ]
    return pa.table(columns, schema=schema)


def _cast(cells: Any, column: Any, file: str, file_names: Mapping[str, str]) -> Any:
    try:
        return as_text(cells) if pa.types.is_string(column.type) else cells.cast(column.type)
    except pa.ArrowInvalid as error:
        raise DataError(
            f"{file}, column {file_names[column.name]!r}: contains {cells.type}, and a value of it "
            f"can't be {column.type} as in the other files; give the column one type in all of them"
        ) from error


def check_same_scene(first: Scene, other: Scene, first_part: Part, part: Part) -> None:
    """Raise DataError if the scene of another file is not that of the first."""
    if other.frame is None:
        other = replace(other, frame=first.frame)
    if other != first:
        raise DataError(
            f"{part.name}: its scene is not that of {first_part.name}; give one for all with `scene` FILE, "
            f"or run once for each file"
        )
