"""Columns of any type as text: for formats and files that have no other place for them."""

from __future__ import annotations

import json
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

__all__ = ["as_text", "json_default", "plain", "plain_type", "text_at", "without_views"]


def as_text(cells: Any) -> Any:
    """Return a column as text: bytes as UTF-8 with escapes, lists and structs as JSON, anything else as Arrow does."""
    if not _is_bytes(cells.type):
        try:
            return cells.cast(pa.string())
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            pass
    return pa.array([_text(value) for value in cells.to_pylist()], pa.string())


def json_default(value: Any) -> Any:
    """Return a value that JSON lacks as text: for ``json.dumps(default=...)``."""
    return value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else str(value)


def without_views(arrow_type: Any) -> Any:
    """Return the type, with plain text or bytes for views, on which Arrow can compute little."""
    if pa.types.is_string_view(arrow_type):
        return pa.string()
    return pa.binary() if pa.types.is_binary_view(arrow_type) else arrow_type


def _is_bytes(kind: Any) -> bool:
    return bool(pa.types.is_binary(kind) or pa.types.is_large_binary(kind) or pa.types.is_fixed_size_binary(kind))


def _text(value: Any) -> str | None:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, list | dict | tuple):
        return json.dumps(value, ensure_ascii=False, default=json_default)
    return str(json_default(value))


def text_at(column: Any, place: int) -> str | None:
    """Return one value as text, or None."""
    value = column[place].as_py()
    return None if value is None else str(value)


def plain(column: Any) -> Any:
    """Return a column with a dictionary decoded; others as they are."""
    return pc.cast(column, column.type.value_type) if pa.types.is_dictionary(column.type) else column


def plain_type(arrow_type: Any) -> Any:
    """Return the type without a dictionary."""
    return arrow_type.value_type if pa.types.is_dictionary(arrow_type) else arrow_type
