"""What the windows of a run contain: sensors that are missing, that repeat, and epochs that a grid cuts in two."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.io.measurements.row_batch import RowBatch

__all__ = ["tally_windows", "window_remarks"]

_SENSORS = "sensors_"
_REPEATED, _CUT = "repeated", "cut"


class SortedRows(Protocol):
    """Rows sorted by window, with the start and the part of each row's window and the first row of each."""

    rows: RowBatch
    start: IntArray
    group: IntArray
    heads: IntArray


def tally_windows(windows: Counter[str], made: SortedRows, mine: BoolArray, width: Any) -> None:
    """Count the windows ``mine`` (S,): by their number of sensors, those in which a sensor repeats, and cuts."""
    if "sensor" not in made.rows.columns:
        windows[f"{_SENSORS}0"] += int(mine.sum())
        return
    size = made.heads.shape[0]
    window = np.repeat(np.arange(size), np.diff(made.heads, append=len(made.rows)))
    sensor, reference = made.rows.columns["sensor"], made.rows.columns.get("reference")
    if reference is not None:  # pairs repeat, not sensors
        sensor = sensor * (int(reference.max()) + 2) + reference + 1
    sensors = int(sensor.max()) + 1
    pairs, counts = np.unique(window * sensors + sensor, return_counts=True)
    distinct = np.bincount(pairs // sensors, minlength=size)
    for number, count in zip(*np.unique(distinct[mine], return_counts=True), strict=True):
        windows[f"{_SENSORS}{number}"] += int(count)
    repeated = pairs[counts > 1]
    again = np.zeros(size, dtype=np.bool_)
    again[repeated // sensors] = True
    windows[_REPEATED] += int((again & mine).sum())
    if isinstance(width, int) and repeated.size:
        windows[_CUT] += int((_cuts(made, pairs, repeated, sensors, width) & mine).sum())


def _cuts(made: SortedRows, pairs: IntArray, repeated: IntArray, sensors: int, width: int) -> BoolArray:
    """Return the windows (S,) with a sensor that repeats, and is missing in the window before or after."""
    start, group = made.start[made.heads], made.group[made.heads]
    by_part = np.lexsort((start, group))
    neighbours = (np.diff(group[by_part]) == 0) & (np.diff(start[by_part]) == width)
    cut = np.zeros(start.shape[0], dtype=np.bool_)
    window, sensor = repeated // sensors, repeated % sensors
    for here, other in ((by_part[:-1], by_part[1:]), (by_part[1:], by_part[:-1])):
        neighbour = np.full(start.shape[0], -1, dtype=np.int64)
        neighbour[here[neighbours]] = other[neighbours]
        adjacent = neighbour[window]
        missing = (adjacent >= 0) & ~np.isin(adjacent * sensors + sensor, pairs)
        cut[window[missing]] = True
    return cut


def window_remarks(windows: Mapping[str, int], width: str | None) -> list[str]:
    """Return what the counts mean, a line each; nothing without windows."""
    by_sensors = {int(key.removeprefix(_SENSORS)): n for key, n in windows.items() if key.startswith(_SENSORS)}
    total = sum(by_sensors.values())
    if not total:
        return []
    incomplete = total - by_sensors[max(by_sensors)]
    repeated, cut = windows.get(_REPEATED, 0), windows.get(_CUT, 0)
    lines = [
        f"`window` {width}: {total} snapshot{'s' if total > 1 else ''}, {incomplete} incomplete (without a sensor that "
        f"others have), {repeated} with a sensor more than once"
    ]
    if cut:
        lines.append(
            f"in {cut} of {total} snapshots a sensor repeats that is missing in the window before or after: the "
            "windows cut epochs in two; `window` auto ends a snapshot when a sensor reports again"
        )
    return lines
