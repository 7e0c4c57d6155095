"""Times of log rows: numbers in a unit, or ISO 8601 with or without an offset, but one of them throughout a log."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

from nlosctl.contract.formats import UnfitError
from nlosctl.formats.fields import number

__all__ = ["TIME_TYPES", "Clock"]

TIME_TYPES: dict[str, Any] = {"time_s": "number", "time": "text"}
"""The columns that `Clock` gives: seconds, or the text of the log."""

_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d")
_NUMBER, _ZONED, _LOCAL = "a number", "ISO 8601 with an offset or Z", "ISO 8601 without an offset"


class Clock:
    """Reads the times of one log; ``unit_s`` is the unit of numbers in seconds."""

    def __init__(self, unit_s: float = 1.0) -> None:
        self._unit_s = unit_s
        self._first: tuple[str, int] | None = None

    def read(self, line: int, text: str, name: str) -> tuple[float, dict[str, Any]]:
        """Return a time in seconds, for windows, and its column: ``time_s``, or ``time`` with the text of the log.

        Seconds of ISO times are since 1970, in UTC if they have no offset. Raises UnfitError for another form than
        that of the first row.
        """
        if not _ISO.match(text):
            seconds = number(text, name) * self._unit_s
            self._check(_NUMBER, line, text, name)
            return seconds, {"time_s": seconds}
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise UnfitError(f"got {text[:40]!r}, expected a time such as 2024-06-10T06:13:19.985Z", name) from None
        local = moment.tzinfo is None
        self._check(_LOCAL if local else _ZONED, line, text, name)
        return (moment.replace(tzinfo=UTC) if local else moment).timestamp(), {"time": text}

    def _check(self, form: str, line: int, text: str, name: str) -> None:
        if self._first is None:
            self._first = (form, line)
        elif self._first[0] != form:
            raise UnfitError(f"got {text[:40]!r}, expected {self._first[0]} as in line {self._first[1]}", name)
