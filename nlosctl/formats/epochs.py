"""Rows of a log put together as snapshots: by windows of time, by what they are of, or by who speaks again."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace

from nlosctl.contract.formats import BadLine, Row
from nlosctl.errors import DataError, UsageError

__all__ = ["WINDOW_MEANING", "in_epochs", "in_rounds", "parse_window"]

WINDOW_MEANING = "time that a snapshot lasts, as 0.1s, 500ms, 2min; all: the whole file"

_UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}


def parse_window(words: str, owner: str) -> float:
    """Return a duration in seconds, infinity for ``all``; raises UsageError."""
    found = re.fullmatch(r"([0-9.eE+-]+)\s*([a-z]+)", words.strip())
    if words == "all":
        return math.inf
    try:
        window = float(found[1]) * _UNITS[found[2]] if found else math.nan
    except (ValueError, KeyError):
        window = math.nan
    if not 0.0 < window < math.inf:
        raise UsageError(
            f"The 'window' parameter of {owner} must be a time, as 0.1s or 2min, or 'all'. Got {words!r} instead."
        )
    return window


def in_epochs(rows: Iterable[Row | BadLine], window_s: float) -> Iterator[Row | BadLine]:
    """Yield the rows with ``snapshot``, by window of ``epoch_s`` and by group, each in the order of the file.

    Windows begin at the first time of the file and follow each other; those without rows are not counted. A snapshot is
    named by its number, with the group where the file has several. All rows are held in memory, in any order of time.
    Raises DataError for times so far apart that their windows can't be counted.
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
    first, last = min(times), max(times)
    if not math.isfinite((last - first) / window_s):
        raise DataError(
            f"times from {first:g} s to {last:g} s can't be cut into windows of {window_s:g} s; look for odd ones"
        )
    number = [0 if math.isinf(window_s) else math.floor((time - first) / window_s + 1e-9) for time in times]
    keys = [(window, row.group) for window, row in zip(number, good, strict=True)]
    groups = {group: place for place, group in enumerate(dict.fromkeys(row.group for row in good))}
    windows = {window: place for place, window in enumerate(sorted(set(number)))}
    order = sorted(range(len(good)), key=lambda place: (keys[place][0], groups[keys[place][1]], place))
    several = len(groups) > 1
    named = (
        (good[place], f"{keys[place][1]}_{windows[keys[place][0]]}" if several else windows[keys[place][0]])
        for place in order
    )
    yield from _numbered(named)


def in_rounds(rows: Iterable[Row | BadLine]) -> Iterator[Row | BadLine]:
    """Yield the rows with ``snapshot``: those of a group until one of its sensors speaks again.

    For logs without a common clock. All rows are held in memory.
    """
    rounds: dict[str, list[tuple[Row, int]]] = {}
    heard: dict[str, set[str]] = {}
    for row in rows:
        if isinstance(row, BadLine):
            yield row
            continue
        held, spoken = rounds.setdefault(row.group, []), heard.setdefault(row.group, set())
        sensor = str(row.values["sensor"])
        if sensor in spoken:
            spoken.clear()
        spoken.add(sensor)
        held.append((row, 0 if not held else held[-1][1] + (len(spoken) == 1)))
    several = len(rounds) > 1
    for group, held in rounds.items():
        yield from _numbered((row, f"{group}_{number}" if several else number) for row, number in held)


def _numbered(named: Iterable[tuple[Row, object]]) -> Iterator[Row]:
    """Yield rows with their snapshot; directions measured again by one sensor in one place are told apart: #2, #3."""
    snapshot: object = None
    said: Counter[object] = Counter()
    for row, name in named:
        if name != snapshot:
            snapshot = name
            said.clear()
        values = {"snapshot": name, **row.values}
        if "range_m" not in values:
            place = tuple(values.get(key) for key in ("sensor", "sensor_x_m", "sensor_lat_deg", "sensor_lon_deg"))
            said[place] += 1
            if said[place] > 1:
                values["sensor"] = f"{values['sensor']}#{said[place]}"
        yield replace(row, values=values)
