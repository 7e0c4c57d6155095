"""Times of rows as whole ticks: the columns ``time_s`` (microseconds) and ``time`` (nanoseconds since 1970 UTC)."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.window_starts import microseconds
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.measurements.row_checks import Fault, as_float64, got, is_null, null_mask
from nlosctl.io.readers.base import plain, text_at

__all__ = ["TimeColumn", "zone_named"]

_LARGEST = 2**62
"""Differences of times within this do not overflow."""

_UTC_TEXT = r"^\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?(Z|[+-]\d\d:\d\d)$"
"""Texts that Arrow reads as they are meant."""

_ISO = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)[T ](\d\d):(\d\d)(?::(\d\d)(?:[.,](\d+))?)?\s?(?:([Zz])|([+-])(\d\d):?(\d\d)?)?", re.ASCII
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_SECOND = timedelta(seconds=1)


@lru_cache(maxsize=8)
def zone_named(name: str) -> ZoneInfo:
    """Return a time zone; raise UsageError for an unknown name."""
    import zoneinfo

    try:
        return ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError) as error:
        near = did_you_mean(name, zoneinfo.available_timezones())
        raise UsageError(
            f"`timezone` must be a name of the IANA database, such as Europe/Berlin or UTC. Got {name!r} instead{near}."
        ) from error


class TimeColumn:
    """The times of one file: ``column`` is ``time_s`` or ``time``, ``own_name`` the file's name for it.

    ``timezone`` is the zone of times without an offset. Raises DataError for a file that needs one, or mixes times with
    and without.
    """

    def __init__(self, column: str, own_name: str, file: str, timezone: str | None) -> None:
        self._column, self._own_name, self._file = column, own_name, file
        self._zone = None if timezone is None else zone_named(timezone)
        self._zoned: tuple[bool, int, str] | None = None

    def ticks(self, cells: Any, rows: IntArray, faults: list[Fault]) -> IntArray:
        """Return the times (N,) of the cells in ticks, 0 at a fault; ``rows`` (N,) are row numbers for messages."""
        cells = plain(cells)
        if self._column == "time_s":
            return self._seconds(cells, faults)
        if pa.types.is_string(cells.type) or pa.types.is_large_string(cells.type):
            return self._iso(cells, rows, faults)
        texts = pc.cast(cells, pa.string())
        wrong = ~null_mask(cells)
        describe = _described(texts, "ISO 8601, such as 2024-06-10T06:13:19Z; seconds belong in a column 'time_s'")
        self._add(null_mask(cells), is_null("a time"), faults)
        self._add(wrong, describe, faults)
        return np.zeros(len(cells), dtype=np.int64)

    def _add(self, mask: BoolArray, describe: Any, faults: list[Fault]) -> None:
        if mask.any():
            faults.append(Fault(mask=mask, column=self._column, describe=describe))

    def _seconds(self, cells: Any, faults: list[Fault]) -> IntArray:
        absent = null_mask(cells)
        self._add(absent, is_null("a time in seconds"), faults)
        if pa.types.is_integer(cells.type):
            whole = cells.cast(pa.int64(), safe=False).fill_null(0).to_numpy(zero_copy_only=False)
            beyond = np.abs(whole) > _LARGEST // 10**6
            self._add(beyond, got(as_float64(cells), "seconds within 4.6e12"), faults)
            return np.asarray(np.where(beyond, 0, whole) * 10**6, dtype=np.int64)
        values = as_float64(cells)
        beyond = ~(np.abs(values) <= _LARGEST / 1e6) & ~absent
        self._add(beyond, got(values, "seconds within 4.6e12"), faults)
        return microseconds(np.where(beyond | absent, 0.0, values))

    def _iso(self, cells: Any, rows: IntArray, faults: list[Fault]) -> IntArray:
        if not cells.null_count and pc.all(pc.match_substring_regex(cells, _UTC_TEXT)).as_py() is not False:
            try:
                ticks = cells.cast(pa.timestamp("ns", "UTC")).cast(pa.int64()).to_numpy(zero_copy_only=False)
            except pa.ArrowInvalid:
                pass
            else:
                if len(cells):
                    self._note_zone(True, int(rows[0]), cells[0].as_py())
                if not len(ticks) or np.abs(ticks).max() <= _LARGEST:
                    return np.asarray(ticks, dtype=np.int64)
        ticks = np.zeros(len(cells), dtype=np.int64)
        messages: dict[int, str] = {}
        for index, text in enumerate(cells.to_pylist()):
            value = self._parsed(text, int(rows[index]))
            if isinstance(value, str):
                messages[index] = value
            else:
                ticks[index] = value
        wrong = np.zeros(len(cells), dtype=np.bool_)
        wrong[list(messages)] = True
        self._add(wrong, messages.__getitem__, faults)
        return ticks

    def _parsed(self, text: str | None, row: int) -> int | str:
        """Return a time in nanoseconds, or the message on its fault."""
        if text is None or not text.strip():
            return is_null("a time")(0)
        match = _ISO.fullmatch(text.strip())
        if match is None:
            return f"got {text!r}, expected ISO 8601, such as 2024-06-10T06:13:19.985Z"
        year, month, day, hour, minute = (int(match[index]) for index in range(1, 6))
        try:
            moment = datetime(year, month, day, hour, minute, int(match[6] or 0), tzinfo=UTC)
        except ValueError as error:
            return f"got {text!r}, expected a date and time that exist: {error}"
        nanoseconds = int(f"{match[7] or '':0<9}"[:9])
        zoned = match[8] is not None or match[9] is not None
        self._note_zone(zoned, row, text)
        if match[9] is not None:
            if int(match[10]) > 23 or int(match[11] or 0) > 59:
                return f"got {text!r}, expected an offset within 23:59"
            offset = timedelta(hours=int(match[10]), minutes=int(match[11] or 0))
            moment -= offset if match[9] == "+" else -offset
        elif not zoned:
            assert self._zone is not None  # noqa: S101 - see _note_zone
            local = moment.replace(tzinfo=self._zone)
            first, second = local.utcoffset(), local.replace(fold=1).utcoffset()
            if first != second:
                what = "does not exist" if first is not None and second is not None and first < second else "is twice"
                return f"got {text!r}, expected an offset: this local time {what} in {self._zone.key}"
            moment = local.astimezone(UTC)
        ticks = (moment - _EPOCH) // _SECOND * 10**9 + nanoseconds
        return ticks if abs(ticks) <= _LARGEST else f"got {text!r}, expected a year from 1824 to 2116"

    def _note_zone(self, zoned: bool, row: int, text: str) -> None:
        """Raise DataError for a time without an offset that has no zone; see the class."""
        if self._zone is not None:
            return
        if self._zoned is None:
            self._zoned = zoned, row, text
        where = f"{self._file}, row {row}, column {self._own_name!r}: got {text!r}"
        first, first_row, first_text = self._zoned
        if first != zoned:
            these = "with an offset, but" if zoned else "without an offset, but"
            those = "has none" if zoned else "has one"
            raise DataError(
                f"{where} {these} row {first_row} ({first_text!r}) {those}; give all times an offset or Z, or state "
                "the zone of the others by `timezone`"
            )
        if not zoned:
            raise DataError(f"{where}, expected an offset or Z; add it, or state the zone by `timezone`")


def _described(texts: Any, expected: str) -> Any:
    return lambda index: f"got {text_at(texts, index)}, expected {expected}"
