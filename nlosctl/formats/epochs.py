"""Grouping of log rows into snapshots: by windows of time and group, or by rounds of the sensors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.formats import BadLine, ForeignFile, Row
from nlosctl.contract.window_starts import first_times, microseconds, window_starts
from nlosctl.contract.windows import TICKS_PER_SECOND, WINDOW_MEANING, Width, value_text, window_id
from nlosctl.contract.windows import parse_window as _parse_window
from nlosctl.errors import DataError, did_you_mean

__all__ = ["WINDOW_MEANING", "in_epochs", "in_rounds", "parse_window"]

_LONGEST_S = 4.6e12

_SEVERAL = {"range_m", "tdoa_m"}
"""A snapshot may have several of these measurements of one sensor, under its name."""


def parse_window(text: str, owner: str) -> Width:
    """Return the width of windows in microseconds, `ALL` or `AUTO`; raise UsageError for anything else."""
    return _parse_window(text, f"The 'window' parameter of {owner}")


def in_epochs(rows: Iterable[Row | BadLine], width: Width, file: ForeignFile, by: str) -> Iterator[Row | BadLine]:
    """Yield the rows with a ``snapshot``: the name of their window of ``epoch_s``, as of tables (`Width`).

    Groups, or the values of the columns that the file is parted ``by``, have windows of their own; ``by`` names
    the column of a group (or several, with commas). Rows are sorted by window, time, sensor and line; all rows are
    held in memory. Raises DataError for a column that is absent, or times out of range.
    """
    good: list[Row] = []
    for row in rows:
        if isinstance(row, BadLine):
            yield row
        else:
            good.append(row)
    if not good:
        return
    names = file.by or (tuple(by.split(",")) if any(row.group for row in good) else ())
    values = [tuple(_value(row, name, file) for name in file.by) or _group(row, len(names)) for row in good]
    times = np.array([0.0 if row.epoch_s is None else row.epoch_s for row in good])
    if np.abs(times).max() > _LONGEST_S:
        raise DataError(f"{file.name}: times from {times.min():g} to {times.max():g} s, expected seconds within 4.6e12")
    ticks = microseconds(times)
    known, parts = _numbered(values)
    _, sensors = _numbered([str(row.values["sensor"]) for row in good])
    start = window_starts(ticks, parts, first_times(ticks, parts), sensors, width)
    column = "time" if "time" in good[0].values else "time_s"
    scale = TICKS_PER_SECOND[column] // 10**6
    order = np.lexsort((np.arange(len(good)), sensors, ticks, parts, start))
    yield from _with_snapshots(
        (good[index], window_id(list(zip(names, known[parts[index]], strict=True)), int(start[index]) * scale, column))
        for index in order.tolist()
    )


def _group(row: Row, count: int) -> tuple[str, ...]:
    """Return the group of a row as ``count`` values."""
    values = tuple(row.group.split("/"))
    return values if len(values) == count else (row.group, *[""] * (count - 1))[:count]


def _value(row: Row, name: str, file: ForeignFile) -> str:
    """Return the value of a column as text; raise DataError with those that there are."""
    cells: Mapping[str, Any] = {**row.values, **row.kept}
    if name not in cells:
        near = did_you_mean(name, cells)
        raise DataError(f"{file.name}: `by` {name}: no column {name!r}{near}; there are: {', '.join(cells)}")
    return value_text(cells[name])


def _numbered(values: Sequence[Any]) -> tuple[list[Any], IntArray]:
    """Return the different values in order, and the index (N,) of each."""
    known = sorted(set(values))
    index = {value: number for number, value in enumerate(known)}
    return known, np.array([index[value] for value in values], dtype=np.int64)


def in_rounds(rows: Iterable[Row | BadLine]) -> Iterator[Row | BadLine]:
    """Yield the rows with a ``snapshot``; a group starts a new one when a sensor reports for the second time.

    For logs without a common clock. All rows are held in memory.
    """
    rounds: dict[str, list[tuple[Row, int]]] = {}
    sensors: dict[str, set[str]] = {}
    for row in rows:
        if isinstance(row, BadLine):
            yield row
            continue
        numbered, seen = rounds.setdefault(row.group, []), sensors.setdefault(row.group, set())
        sensor = str(row.values["sensor"])
        if sensor in seen:
            seen.clear()
        seen.add(sensor)
        numbered.append((row, 0 if not numbered else numbered[-1][1] + (len(seen) == 1)))
    several = len(rounds) > 1
    for group, numbered in rounds.items():
        yield from _with_snapshots((row, f"{group}_{number}" if several else number) for row, number in numbered)


def _with_snapshots(named: Iterable[tuple[Row, object]]) -> Iterator[Row]:
    """Yield rows with their snapshot; repeated bearings of a sensor at one position get the sensor names #2, #3."""
    snapshot: object = None
    counts: Counter[object] = Counter()
    for row, name in named:
        if name != snapshot:
            snapshot = name
            counts.clear()
        values = {"snapshot": name, **row.values}
        if not _SEVERAL & set(values):
            sensor = tuple(values.get(key) for key in ("sensor", "sensor_x_m", "sensor_lat_deg", "sensor_lon_deg"))
            counts[sensor] += 1
            if counts[sensor] > 1:
                values["sensor"] = f"{values['sensor']}#{counts[sensor]}"
        yield replace(row, values=values)
