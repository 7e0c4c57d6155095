"""Whether a snapshot comes back in another part: told by the ends of the parts, and by reading all ids if need be."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import Any

from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input

__all__ = ["IdOrder"]


class IdOrder:
    """Takes the span of the ids of each part; parts whose spans don't overlap share no snapshot.

    Where that does not tell, all ids are read once, which raises DataError as reading them in one go does.
    """

    def __init__(self, inputs: Sequence[Input], reader: MeasurementReader) -> None:
        self._inputs, self._reader = tuple(inputs), reader
        self._ends: list[list[tuple[Any, Any]]] = [[] for _ in inputs]
        self._sure = False

    def add(self, group: int, span: Mapping[str, Any]) -> None:
        """Take a part of the input at index ``group``; ``span`` has the fields of `IdSpan`."""
        if self._sure or span["first"] is None or len(self._inputs[group].parts) == 1:
            return
        low, high = sorted((span["first"], span["last"]))
        ends = self._ends[group]
        place = bisect_left(ends, (low, high))
        apart = (place == 0 or ends[place - 1][1] < low) and (place == len(ends) or high < ends[place][0])
        if not (apart and span["ordered"]):
            self._read_all()
        ends.insert(place, (low, high))

    def _read_all(self) -> None:
        reader = MeasurementReader(self._inputs, self._reader.options, lambda rows: None, found=self._reader.found())
        for _ in reader.chunks():
            pass
        self._sure = True
