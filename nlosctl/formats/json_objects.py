"""Logs of JSON objects: one a line (JSON Lines), one after the other over several lines, or an array."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, Row, UnfitError
from nlosctl.errors import DataError
from nlosctl.formats.fields import decoded

__all__ = ["cells_of", "json_objects", "read_objects"]

_BETWEEN = " \t\r\n,[]"
_SHOWN = 200
_DECODER = json.JSONDecoder(parse_int=str, parse_float=str, parse_constant=str)
"""Numbers stay text, so that they are checked and reported as those of other logs are."""


def json_objects(file: ForeignFile) -> Iterator[tuple[int, Any]]:
    """Yield the line where each object begins, and the object, or a `BadLine` for what is not an object.

    After a fault the next line is read. Numbers are text. Raises DataError for a file that is not UTF-8 text, or with
    objects nested too deep.
    """
    text = decoded(file)
    at, line, counted = 0, 1, 0
    while True:
        at = _skip(text, at)
        if at >= len(text):
            return
        line, counted = line + text.count("\n", counted, at), at
        try:
            value, after = _DECODER.raw_decode(text, at)
            fault = "" if isinstance(value, dict) else "expected an object {...}"
        except json.JSONDecodeError as error:
            value, after, fault = None, at, f"not JSON: {error.msg} at character {error.pos - at + 1}"
        except RecursionError as error:
            raise DataError(f"{file.name}, line {line}: objects nested too deep") from error
        if fault:
            end = text.find("\n", max(after, at))
            after = len(text) if end < 0 else end
            yield line, BadLine(line=line, fault=fault, text=text[at : min(after, at + _SHOWN)])
        else:
            yield line, value
        at = after


def _skip(text: str, at: int) -> int:
    while at < len(text) and text[at] in _BETWEEN:
        at += 1
    return at


def cells_of(record: Mapping[str, Any]) -> dict[str, str]:
    """Return the plain values of an object as text, ``null`` as empty, without arrays and objects."""
    cells = {}
    for name, value in record.items():
        if value is None or isinstance(value, str):
            cells[name] = (value or "").strip()
        elif isinstance(value, bool):
            cells[name] = str(value).lower()
    return cells


def read_objects(file: ForeignFile, parse: Callable[[int, Mapping[str, Any]], Row | None]) -> Iterator[Row | BadLine]:
    """Yield ``parse(line, object)`` of each object unless None, or a `BadLine` where it raises UnfitError."""
    for line, value in json_objects(file):
        if isinstance(value, BadLine):
            yield value
            continue
        try:
            row = parse(line, value)
        except UnfitError as unfit:
            yield BadLine(line=line, fault=unfit.fault, column=unfit.column, text=json.dumps(value)[:_SHOWN])
        else:
            if row is not None:
                yield row
