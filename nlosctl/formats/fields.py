"""Parsing of text lines: fields as numbers within limits, with faults that name their field."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress

from nlosctl.contract.formats import BadLine, ForeignFile, Row, UnfitError
from nlosctl.errors import DataError

__all__ = ["KEEP_MEANING", "decoded", "integer", "kept_cells", "lines", "listed", "number", "take_apart"]

_LONGEST_LINE = 1 << 20
_SHOWN = 60


def lines(file: ForeignFile) -> Iterator[tuple[int, str]]:
    """Yield number and text of each non-blank line; raise DataError if the file is not UTF-8 text."""
    text = io.TextIOWrapper(file.stream, encoding="utf-8-sig", newline=None)
    number = 0
    try:
        while line := text.readline(_LONGEST_LINE):
            number += 1
            if len(line) >= _LONGEST_LINE:
                raise DataError(f"{file.name}, line {number}: longer than {_LONGEST_LINE} characters; not such a log")
            if "\0" in line:
                raise DataError(f"{file.name}, line {number}: contains zero bytes; not a text file")
            if line.strip():
                yield number, line.rstrip("\r\n")
    except UnicodeDecodeError as error:
        raise DataError(f"{file.name}, after line {number}: not UTF-8 text; save it as UTF-8") from error
    finally:
        with suppress(ValueError):  # already closed if the reader was abandoned before its end
            text.detach()


def decoded(file: ForeignFile) -> str:
    """Return the text of a format without lines, with ``\\n`` line ends; raise DataError if it is not UTF-8 text."""
    content = file.stream.read()
    if b"\0" in content:
        line = content.count(b"\n", 0, content.index(b"\0")) + 1
        raise DataError(f"{file.name}, line {line}: contains zero bytes; not a text file")
    try:
        text: str = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start)
        raise DataError(f"{file.name}, after line {line}: not UTF-8 text; save it as UTF-8") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def take_apart(numbered: Iterator[tuple[int, str]], parse: Callable[[int, str], Row | None]) -> Iterator[Row | BadLine]:
    """Yield ``parse(line, text)`` of each line unless None, or a `BadLine` where it raises UnfitError."""
    for line, text in numbered:
        try:
            row = parse(line, text)
        except UnfitError as unfit:
            yield BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text)
        else:
            if row is not None:
                yield row


KEEP_MEANING = "further columns to copy as text, separated by commas"


def listed(names: str | None) -> list[str]:
    """Return the names of a list with commas; nothing for None."""
    return [name.strip() for name in (names or "").split(",") if name.strip()]


def kept_cells(cells: Mapping[str, str], names: Sequence[str]) -> dict[str, str | None]:
    """Return the cells of these columns as text, None for an empty one."""
    return {name: cells[name] or None for name in names}


def number(text: str, name: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a field as a finite number from ``low`` to ``high``; raise UnfitError with the text otherwise."""
    try:
        value = float(text) if _plain(text) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or not low <= value <= high:
        raise UnfitError(f"got {text.strip()[:_SHOWN]!r}, expected {_within('a number', low, high)}", name)
    return value


def integer(text: str, name: str, low: float = -math.inf, high: float = math.inf) -> int:
    """Return a field as an integer from ``low`` to ``high``; raise UnfitError with the text otherwise."""
    try:
        value = int(text) if _plain(text) else None
    except ValueError:
        value = None
    if value is None or not low <= value <= high:
        raise UnfitError(f"got {text.strip()[:_SHOWN]!r}, expected {_within('an integer', low, high)}", name)
    return value


def _plain(text: str) -> bool:
    """Return whether a text has no underscores and no other digits than 0 to 9; Python accepts both in numbers."""
    return text.isascii() and "_" not in text


def _within(what: str, low: float, high: float) -> str:
    if math.isfinite(low) and math.isfinite(high):
        return f"{what} from {low:g} to {high:g}"
    if math.isfinite(low):
        return f"{what} of at least {low:g}"
    return what
