"""Columns of text turned into typed ones; every value that doesn't fit is told by its row."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.tables import ColumnType
from nlosctl.io.raw import CellFault

__all__ = ["EXPECTED", "arrow_type_of", "convert_text", "decode_utf8", "infer_type", "shown"]

EXPECTED = {
    "number": "a number",
    "integer": "an integer",
    "boolean": "true/false or 1/0",
    "text": "text",
}

_ARROW_TYPES = {
    "number": pa.float64(),
    "integer": pa.int64(),
    "boolean": pa.bool_(),
    "text": pa.string(),
    "identifier": pa.string(),
}


def arrow_type_of(wanted: ColumnType) -> Any:
    """Return the Arrow type that a text column of this contract type becomes."""
    return _ARROW_TYPES[wanted]


def shown(value: object) -> str:
    """Return a value as messages show it: quoted if text, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def infer_type(cells: Any, plain_integers: bool = False) -> ColumnType:
    """Return the narrowest type that all ``cells`` (text, null where empty) fit; text if all are null.

    With ``plain_integers`` only integers or text come out, and integers with leading zeros or a plus sign are text.
    """
    filled = cells.drop_null()
    if len(filled) == 0:
        return "text"
    if plain_integers:
        plain = pc.all(pc.match_substring_regex(filled, r"^(0|-?[1-9][0-9]*)$")).as_py()
        return "integer" if plain and _cast(filled, pa.int64()) is not None else "text"
    if _cast(filled, pa.int64()) is not None:
        return "integer"
    if _cast(filled, pa.float64()) is not None:
        return "number"
    words = pc.is_in(pc.utf8_lower(filled), value_set=pa.array(["true", "false"]))
    return "boolean" if pc.all(words).as_py() else "text"


def convert_text(cells: Any, wanted: ColumnType, column: str, hint: str = "") -> tuple[Any, list[CellFault]]:
    """Return the cells as the wanted type, null where they don't fit, and a fault for each of these."""
    target = _ARROW_TYPES[wanted]
    if wanted in ("text", "identifier"):
        return cells, []
    if wanted == "boolean":
        converted = _booleans(cells)
    else:
        whole = _cast(cells, target)
        if whole is not None:
            return whole, []
        cells = pc.utf8_trim_whitespace(cells)
        whole = _cast(cells, target)
        if whole is not None:
            return whole, []
        converted = pa.array([_one(value, target) for value in cells.to_pylist()], type=target)
    unfit = pc.and_(pc.is_valid(cells), pc.is_null(converted))
    places = np.flatnonzero(unfit.to_numpy(zero_copy_only=False))
    faults = [
        CellFault(
            position=int(place),
            column=column,
            fault=f"got {shown(cells[int(place)].as_py())}, expected {EXPECTED[wanted]}{hint}",
        )
        for place in places
    ]
    return converted, faults


def decode_utf8(cells: Any, column: str) -> tuple[Any, list[CellFault]]:
    """Return binary cells as text, null where they are not UTF-8, and a fault for each of these."""
    try:
        return cells.cast(pa.string()), []
    except pa.ArrowInvalid:
        pass
    decoded: list[str | None] = []
    faults = []
    for place, value in enumerate(cells.to_pylist()):
        try:
            decoded.append(None if value is None else value.decode("utf-8"))
        except UnicodeDecodeError as error:
            decoded.append(None)
            fault = f"got {shown(value)}, byte 0x{value[error.start]:02x} is not UTF-8; save the file as UTF-8"
            faults.append(CellFault(position=place, column=column, fault=fault))
    return pa.array(decoded, type=pa.string()), faults


def _cast(cells: Any, target: Any) -> Any:
    try:
        return cells.cast(target)
    except pa.ArrowInvalid:
        return None


def _one(value: str | None, target: Any) -> Any:
    if value is None:
        return None
    converted = _cast(pa.array([value]), target)
    return None if converted is None else converted[0].as_py()


def _booleans(cells: Any) -> Any:
    lower = pc.utf8_lower(pc.utf8_trim_whitespace(cells))
    yes = pc.is_in(lower, value_set=pa.array(["true", "1"]))
    known = pc.or_(yes, pc.is_in(lower, value_set=pa.array(["false", "0"])))
    return pc.if_else(known, yes, pa.scalar(None, pa.bool_()))
