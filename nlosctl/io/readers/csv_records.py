"""CSV text in blocks of whole records with their line numbers; quoted cells may contain line ends."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.limits import limit, refusal_hint
from nlosctl.errors import DataError

__all__ = ["CsvBlock", "RecordBlocks", "separator_of"]

_HEAD_BYTES = 4096

_QUOTE, _LINE_FEED, _RETURN = ord('"'), ord("\n"), ord("\r")
_SEPARATORS = b",\t;"


def separator_of(text: bytes, tabs: bool = False) -> bytes:
    """Return the separator of the first line: the most frequent of comma, tab and semicolon, the first of equals.

    With ``tabs`` it is a tab wherever there is one. Quoted cells and comments (``#``) do not count.
    """
    line = re.split(rb"[\r\n]", text.removeprefix(b"\xef\xbb\xbf").lstrip(b"\r\n"), maxsplit=1)[0]
    if line.startswith(b"#"):
        return b","
    if tabs and b"\t" in line:
        return b"\t"
    line = re.sub(rb'"[^"]*"', b"", line)
    return max((bytes([separator]) for separator in _SEPARATORS), key=line.count)


@dataclass(frozen=True, kw_only=True)
class CsvBlock:
    """Whole records, and the lines (R,) where those that are not blank begin."""

    content: bytes
    lines: IntArray


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """The indices of bytes where lines end (the last of a line end) and records stop, and of a quote that is open."""

    line_ends: IntArray
    stops: IntArray
    open_quote: int | None


class RecordBlocks:
    """Splits a CSV stream into a header and blocks of 4 MiB (the limit ``line_bytes``); lines end with LF, CR LF or CR.

    ``separator`` stands between cells; it is that of the first line, see `separator_of`.

    A quote opens a quoted cell only at its beginning, as in pyarrow. Raises DataError with the line of a quote that is
    not closed before the end of the file or within 4 MiB, or that is closed on a later line in the middle of a cell.
    """

    def __init__(self, stream: IO[bytes], name: str, tabs: bool = False) -> None:
        self._stream, self._name, self._tabs = stream, name, tabs
        self._block_bytes = max(limit("line_bytes"), 1)
        self._buffer = b""
        self._line = 1
        self._ended = False
        self._set_separator(b",")

    def _set_separator(self, separator: bytes) -> None:
        self.separator = separator
        self._at_edge = np.isin(np.arange(256), list(separator + b'\r\n"'))
        self._quoted = re.compile(rb'(?:(?<=[%b\r\n])|\A)"[^"]*(?:""[^"]*)*("?)' % separator)

    @property
    def at_end(self) -> bool:
        """Whether all records have been returned."""
        return self._ended and not self._buffer

    def header(self) -> bytes:
        """Return the first record without its line end; empty if there is no record."""
        if not self._fill():
            return b""
        if b"\0" in self._buffer[:_HEAD_BYTES] and not self._buffer.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise DataError(f"{self._name}: contains zero bytes: not a CSV file")
        self._set_separator(separator_of(self._buffer, self._tabs))
        layout = self._layout()
        return self._take(layout, int(layout.stops[0])).rstrip(b"\r\n")

    def blocks(self) -> Iterator[CsvBlock]:
        """Yield the records after the header."""
        while self._fill():
            layout = self._layout()
            first_line = self._line
            content = self._take(layout, int(layout.stops[-1]))
            yield CsvBlock(content=content, lines=_record_lines(content, layout, first_line))

    def _fill(self) -> bool:
        parts = [self._buffer]
        size = len(self._buffer)
        while size < self._block_bytes and not self._ended:
            part = self._stream.read(self._block_bytes - size)
            self._ended = not part
            parts.append(part)
            size += len(part)
        self._buffer = b"".join(parts)
        return bool(self._buffer)

    def _layout(self) -> _Layout:
        layout = self._scan()
        if layout.open_quote is not None and (self._ended or not layout.stops.shape[0]):
            raise self._unclosed(layout.line_ends, layout.open_quote)
        if not layout.stops.shape[0]:
            raise DataError(
                f"{self._name}, line {self._line}: the line is longer than {self._block_bytes} bytes: not a "
                f"CSV file; {refusal_hint('line_bytes')}"
            )
        return layout

    def _scan(self) -> _Layout:
        data, array = self._buffer, np.frombuffer(self._buffer, np.uint8)
        line_ends = _line_ends(data, array, self._ended)
        quotes = np.flatnonzero(array == _QUOTE)
        if not _plain_quotes(array, quotes, self._at_edge):
            quotes = self._exact_quotes(line_ends)
        stops = line_ends + 1
        if quotes.shape[0]:
            stops = stops[np.searchsorted(quotes, line_ends) % 2 == 0]
        if self._ended and (not stops.shape[0] or stops[-1] < len(data)):
            stops = np.append(stops, len(data))
        return _Layout(
            line_ends=line_ends, stops=stops, open_quote=int(quotes[-1]) if quotes.shape[0] % 2 == 1 else None
        )

    def _exact_quotes(self, line_ends: IntArray) -> IntArray:
        """Return the indices of quotes that open and close quoted cells, in turn; other quotes are text."""
        data = self._buffer
        indices = []
        for match in self._quoted.finditer(data):
            indices.append(match.start())
            if match[1]:
                indices.append(match.end() - 1)
                after = data[match.end() : match.end() + 1]
                if (
                    after not in (b"", self.separator, b"\r", b"\n")
                    and np.diff(np.searchsorted(line_ends, indices[-2:]))[0]
                ):
                    raise self._unclosed(line_ends, match.start())
        return np.array(indices, dtype=np.int64)

    def _unclosed(self, line_ends: IntArray, index: int) -> DataError:
        line = self._line + int(np.searchsorted(line_ends, index))
        return DataError(
            f"{self._name}, line {line}: a quote opens here and is not closed; "
            f'close it, or double a quote within a quoted cell ("")'
        )

    def _take(self, layout: _Layout, stop: int) -> bytes:
        taken, self._buffer = self._buffer[:stop], self._buffer[stop:]
        self._line += int(np.searchsorted(layout.line_ends, stop))
        return taken


def _line_ends(data: bytes, array: npt.NDArray[np.uint8], ended: bool) -> IntArray:
    """Return the index of the last byte of every line end; a CR at the very end may be half of one."""
    if b"\r" not in data:
        return np.flatnonzero(array == _LINE_FEED)
    following = np.append(array[1:], _LINE_FEED if not ended else 0)
    return np.flatnonzero((array == _LINE_FEED) | ((array == _RETURN) & (following != _LINE_FEED)))


def _plain_quotes(array: npt.NDArray[np.uint8], quotes: IntArray, at_edge: BoolArray) -> bool:
    """Return whether the first, third, ... quote begins a cell, and each other one ends its cell."""
    if quotes.shape[0] == 0:
        return True
    opening, closing = quotes[::2], quotes[1::2]
    before = at_edge[array[opening - 1]] | (opening == 0)
    after = at_edge[array[np.minimum(closing + 1, array.shape[0] - 1)]] | (closing + 1 == array.shape[0])
    return bool(before.all() and after.all())


def _record_lines(content: bytes, layout: _Layout, first_line: int) -> IntArray:
    """Return the line of each record that is not blank."""
    array = np.frombuffer(content, np.uint8)
    starts = np.concatenate([np.zeros(1, dtype=np.int64), layout.stops[:-1]])
    last = array[layout.stops - 1]
    sizes = layout.stops - starts - np.isin(last, (_LINE_FEED, _RETURN))
    sizes -= (last == _LINE_FEED) & (sizes > 0) & (array[np.maximum(layout.stops - 2, 0)] == _RETURN)
    lines = first_line + np.searchsorted(layout.line_ends, starts)
    of_records: IntArray = lines[sizes > 0].astype(np.int64)
    return of_records
