"""Arrow types on which Arrow itself can compute little, read as plain ones: views, run ends, half floats, ..."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.tables import ColumnType
from nlosctl.io.readers.base import CellFault, RecordBatch, as_text

__all__ = [
    "contract_batch",
    "contract_column",
    "contract_schema",
    "read_batch",
    "read_column",
    "read_schema",
    "read_type",
]

_PLAIN = {pa.string_view(): pa.string(), pa.binary_view(): pa.binary(), pa.float16(): pa.float32()}


def read_type(arrow_type: Any) -> Any:
    """Return the type as which a column of ``arrow_type`` is read: the same values, without loss.

    Views become plain text and bytes, half floats single ones, small decimals 128 bits wide, run-end encoded
    and dictionary-encoded columns plain; only dictionary-encoded text stays encoded.
    """
    if pa.types.is_dictionary(arrow_type):
        values = _decoded(arrow_type)
        is_text = pa.types.is_string(values) or pa.types.is_large_string(values)
        return pa.dictionary(arrow_type.index_type, values) if is_text else values
    return _decoded(arrow_type)


def _decoded(arrow_type: Any) -> Any:
    """Return the type as which the values inside of a list, a struct or a dictionary are read."""
    types = pa.types
    if types.is_dictionary(arrow_type) or types.is_run_end_encoded(arrow_type):
        return _decoded(arrow_type.value_type)
    if types.is_decimal(arrow_type) and arrow_type.bit_width < 128:
        return pa.decimal128(arrow_type.precision, arrow_type.scale)
    if types.is_fixed_size_list(arrow_type):
        return pa.list_(_inner(arrow_type.value_field), arrow_type.list_size)
    if types.is_large_list(arrow_type):
        return pa.large_list(_inner(arrow_type.value_field))
    if types.is_list(arrow_type):
        return pa.list_(_inner(arrow_type.value_field))
    if types.is_struct(arrow_type):
        return pa.struct([_inner(arrow_type.field(index)) for index in range(arrow_type.num_fields)])
    if types.is_map(arrow_type):
        return pa.map_(_inner(arrow_type.key_field), _inner(arrow_type.item_field))
    return _PLAIN.get(arrow_type, arrow_type)


def _inner(field: Any) -> Any:
    return field.with_type(_decoded(field.type))


def read_schema(schema: Any) -> Any:
    """Return the schema of a file as it is read, see `read_type`."""
    return pa.schema([field.with_type(read_type(field.type)) for field in schema], metadata=schema.metadata)


def read_batch(batch: Any) -> Any:
    """Return a record batch with the types of `read_schema`; raise ArrowInvalid with the column of a corrupted value.

    Offsets out of range would be read unchecked.
    """
    try:
        batch.validate(full=True)
    except pa.ArrowInvalid:
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            try:
                column.validate(full=True)
            except pa.ArrowInvalid as error:
                raise pa.ArrowInvalid(f"column {name!r}: {error}") from error
        raise
    schema = read_schema(batch.schema)
    if batch.schema.equals(schema):
        return batch
    return pa.RecordBatch.from_arrays([read_column(column) for column in batch.columns], schema=schema)


def read_column(column: Any) -> Any:
    """Return a column (N,) with the type of `read_type`."""
    wanted = read_type(column.type)
    if column.type == wanted:
        return column
    if pa.types.is_run_end_encoded(column.type):
        rows = np.arange(column.offset, column.offset + len(column))
        runs = np.searchsorted(column.run_ends.to_numpy(), rows, side="right")
        return _cast(read_column(column.values).take(pa.array(runs)), wanted)
    if pa.types.is_dictionary(column.type):
        values = read_column(column.dictionary)
        if pa.types.is_dictionary(wanted):
            return pa.DictionaryArray.from_arrays(column.indices, _cast(values, wanted.value_type))
        return _cast(values.take(column.indices), wanted)
    return _cast(column, wanted)


def _cast(column: Any, wanted: Any) -> Any:
    if column.type == wanted:
        return column
    try:
        return column.cast(wanted)
    except (pa.ArrowNotImplementedError, pa.ArrowTypeError):  # such as lists of dictionary-encoded text
        return pa.array(column.to_pylist(), wanted)


def _contract_type(arrow_type: Any, wanted: ColumnType) -> Any:
    types = pa.types
    if wanted == "identifier" and (types.is_timestamp(arrow_type) or types.is_date(arrow_type)):
        return pa.string()
    if wanted in ("identifier", "integer", "boolean") and (
        types.is_floating(arrow_type) or types.is_decimal(arrow_type)
    ):
        return pa.int64()
    return arrow_type


def contract_column(column: Any, wanted: ColumnType, name: str) -> tuple[Any, list[CellFault]]:
    """Return a column (N,) of the contract with the type of `contract_schema`, and the faults of other values.

    NaN is null.
    """
    target = _contract_type(column.type, wanted)
    if column.type == target:
        return column, []
    if pa.types.is_string(target):
        return column.cast(target), []
    if pa.types.is_floating(column.type):
        column = pc.if_else(pc.is_nan(column), pa.scalar(None, column.type), column)
    try:
        return column.cast(target), []
    except pa.ArrowInvalid:
        values = [
            None if value is None or value % 1 or abs(value) >= 2**63 else int(value) for value in column.to_pylist()
        ]
    whole = pa.array(values, target)
    unfit = np.flatnonzero(pc.and_(pc.is_valid(column), pc.is_null(whole)).to_numpy(zero_copy_only=False))
    expected = "text or a whole number" if wanted == "identifier" else "a whole number"
    return whole, [
        CellFault(index=index, column=name, fault=f"got {column[index].as_py()}, expected {expected}")
        for index in unfit.tolist()
    ]


def contract_schema(schema: Any, types: Mapping[str, ColumnType]) -> Any:
    """Return the schema of a file (see `read_schema`) with its columns of the contract, of these ``types``, as read.

    Times as ids become text, whole floats and decimals as ids, integers or booleans 64-bit integers.
    """
    return pa.schema(
        [
            field.with_type(_contract_type(field.type, types[field.name])) if field.name in types else field
            for field in schema
        ]
    )


def contract_batch(batch: Any, types: Mapping[str, ColumnType], first_row: int) -> RecordBatch:
    """Return the rows of an Arrow record batch with the types of `contract_schema`."""
    schema = contract_schema(batch.schema, types)
    if batch.schema.equals(schema):
        return RecordBatch(table=batch, first_row=first_row)
    columns, faults = [], list[CellFault]()
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        converted, unfit = contract_column(column, types[name], name) if name in types else (column, [])
        columns.append(converted)
        faults += unfit
    text = pa.RecordBatch.from_arrays(list(map(as_text, batch.columns)), names=schema.names) if faults else None
    table = pa.RecordBatch.from_arrays(columns, schema=schema)
    return RecordBatch(
        table=table, first_row=first_row, text=text, cell_faults=sorted(faults, key=lambda fault: fault.index)
    )
