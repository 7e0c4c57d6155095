"""Grouping of log rows into snapshots: by time windows and group, or by rounds of the sensors."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from nlosctl.contract.epochs import epoch_numbers
from nlosctl.contract.formats import BadLine, Row
from nlosctl.errors import DataError, UsageError

__all__ = ["AUTO", "WINDOW_MEANING", "in_epochs", "in_rounds", "parse_window"]

WINDOW_MEANING = (
    "duration of a snapshot, such as 0.1s, 500ms, 2min; auto: the epochs of a periodic log; all: the whole file"
)
AUTO = 0.0
"""The width of a window that ends when a sensor reports again, or at a gap between epochs."""

_UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}


def parse_window(text: str, owner: str) -> float:
    """Return a duration in seconds, infinity for ``all``, `AUTO` for ``auto``; raise UsageError for anything else."""
    parts = re.fullmatch(r"([0-9.eE+-]+)\s*([a-z]+)", text.strip())
    if text in ("all", "auto"):
        return math.inf if text == "all" else AUTO
    try:
        window = float(parts[1]) * _UNITS[parts[2]] if parts else math.nan
    except (ValueError, KeyError):
        window = math.nan
    if not 0.0 < window < math.inf:
        raise UsageError(
            f"The 'window' parameter of {owner} must be a duration such as 0.1s or 2min, or 'all' or 'auto'. "
            f"Got {text!r} instead."
        )
    return window


def in_epochs(rows: Iterable[Row | BadLine], window_s: float) -> Iterator[Row | BadLine]:
    """Yield the rows with a ``snapshot``, sorted by window of ``epoch_s``, group and line.

    Windows start at the earliest time of the file; empty ones are not counted. With `AUTO` each group has epochs of
    its own (`nlosctl.contract.epochs`), and the snapshots are in order of their first rows. A snapshot is named by
    its window's number, preceded by the group if the file has several. Times may be in any order: all rows are held
    in memory. Raises DataError for times so far apart that their windows can't be counted.
    """
    good: list[Row] = []
    for row in rows:
        if isinstance(row, BadLine):
            yield row
        else:
            good.append(row)
    if not good:
        return
    times = [0.0 if row.epoch_s is None else row.epoch_s for row in good]
    if window_s == AUTO:
        yield from _with_snapshots(_in_auto_epochs(good, times))
        return
    first, last = min(times), max(times)
    if not math.isfinite((last - first) / window_s):
        raise DataError(
            f"times from {first:g} s to {last:g} s span too many windows of {window_s:g} s; look for wrong times"
        )
    window = [0 if math.isinf(window_s) else math.floor((time - first) / window_s + 1e-9) for time in times]
    groups = {group: index for index, group in enumerate(dict.fromkeys(row.group for row in good))}
    numbers = {start: number for number, start in enumerate(sorted(set(window)))}
    order = sorted(range(len(good)), key=lambda index: (window[index], groups[good[index].group], index))
    several = len(groups) > 1
    yield from _with_snapshots(
        (good[index], f"{good[index].group}_{numbers[window[index]]}" if several else numbers[window[index]])
        for index in order
    )


def _in_auto_epochs(rows: Sequence[Row], times: Sequence[float]) -> Iterator[tuple[Row, object]]:
    """Yield the rows by the epochs of their groups, with the names of their snapshots."""
    groups: dict[str, list[int]] = {}
    for index in sorted(range(len(rows)), key=lambda index: (times[index], index)):
        groups.setdefault(rows[index].group, []).append(index)
    epochs: list[tuple[float, int, list[int]]] = []
    for position, members in enumerate(groups.values()):
        numbers = epoch_numbers([times[i] for i in members], [rows[i].values["sensor"] for i in members])
        parts: list[list[int]] = [[] for _ in range(numbers[-1] + 1)]
        for number, index in zip(numbers, members, strict=True):
            parts[number].append(index)
        epochs += [(times[part[0]], position, part) for part in parts]
    counts: Counter[str] = Counter()
    for number, (_, _, part) in enumerate(sorted(epochs)):
        group = rows[part[0]].group
        name: object = number if len(groups) == 1 else f"{group}_{counts[group]}"
        counts[group] += 1
        yield from ((rows[index], name) for index in part)


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
        if "range_m" not in values:
            sensor = tuple(values.get(key) for key in ("sensor", "sensor_x_m", "sensor_lat_deg", "sensor_lon_deg"))
            counts[sensor] += 1
            if counts[sensor] > 1:
                values["sensor"] = f"{values['sensor']}#{counts[sensor]}"
        yield replace(row, values=values)
