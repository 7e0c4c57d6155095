"""Likely causes of measurements that do not fit: one change of all rows after which most snapshots do."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.results import is_fix
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import KINDS, Spelling
from nlosctl.contract.tables.shared import DEGREE
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.models.triplets import paths_of
from nlosctl.pipeline.solve.advice import Measured
from nlosctl.pipeline.solve.method_runs import method_runs
from nlosctl.pipeline.solve.solve_chunk import ChunkSolver, dense_batch
from nlosctl.solvers.triplets.target_fits import fit_paths
from nlosctl.solvers.triplets.target_status import p_values

__all__ = ["cause_remarks", "change_text", "changes", "fit_after_changes", "some_snapshots"]

Columns = Mapping[str, npt.NDArray[Any]]

_BAD_P_VALUE = 1e-3
_BAD_P_VALUE_OF_FEW = 0.05
_FEW = 5
_MOST = 0.5
_NEARLY_ALL = 0.9
_MOSTLY_INDIRECT = 0.8
_LARGEST_CHUNK = 2000
_MOST_SNAPSHOTS = 200
_FEWEST_PAIRS = 5
_TRIED, _AS_GIVEN, _PAIRS, _SHORT = "tried", "as given", "pairs", "short"
_EXCHANGED = "exchanged"
_ALONE = " alone"
"""After the name of a unit: the ranges alone are in it, their standard deviations as given."""

_LARGEST_STD = 0.2
"""Standard deviations that would be a larger share of the ranges are not in the unit of these: everything would fit."""

_EXCHANGE = {"dod_rad": "doa_rad", "doa_rad": "dod_rad", "dod_std_rad": "doa_std_rad", "doa_std_rad": "dod_std_rad"}
_VARIED = {"bearings": "bearing_rad", "ranges": "range_m", "triplets": "doa_rad"}


def _spelling(measured: Measured) -> Spelling:
    """Return the spelling under which the file has the column that is varied; radians count as their degrees."""
    column = KINDS[measured.kind].column(_VARIED[measured.kind])
    given = next((spelling for spelling in column.spellings if spelling.name in measured.names), None)
    return given or Spelling(name=column.name, scale=1.0 if column.unit == "m" else DEGREE, meaning="metres")


def _others(measured: Measured) -> list[Spelling]:
    """Return the other spellings of that column: first those turned by 180 degrees, then the usual ones."""
    given, column = _spelling(measured), KINDS[measured.kind].column(_VARIED[measured.kind])
    known = [*column.spellings, *([Spelling(name=column.name, scale=1.0, meaning="metres")] * (column.unit == "m"))]
    alike = [other for other in known if other.is_relative == given.is_relative]
    if column.unit == "rad":  # in the same unit: thousandths of a degree are no mistake
        alike = [other for other in alike if abs(other.scale) == abs(given.scale)]
    others = [other for other in alike if other.meaning and not _same(given, other)]
    return sorted(others, key=lambda other: (not _is_turned(given, other), not other.usual))


def _same(given: Spelling, other: Spelling) -> bool:
    return given.scale == other.scale and given.offset == other.offset


def _is_turned(given: Spelling, other: Spelling) -> bool:
    return given.scale == other.scale and abs(given.offset - other.offset) == np.pi


def fit_after_changes(chunk: Chunk, reader: MeasurementReader) -> dict[str, int]:
    """Return how many snapshots (of triplets: paths) were tried, and how many fit as given and after each change.

    At most the first 200 of a chunk (2000 paths) are tried: those of three or more rows, else (``pairs``) of two.
    """
    measured = Measured.of(reader)
    if measured.kind not in _VARIED:
        return {}
    if measured.kind == "triplets":
        return _fits_of_paths(chunk, measured)
    rows = np.add.reduceat(~chunk.left_out, chunk.offsets[:-1]) if chunk.left_out.size else np.zeros(0, dtype=np.int64)
    wanted = np.flatnonzero(rows > 2)[:_MOST_SNAPSHOTS]
    pairs = not wanted.size
    if pairs:
        wanted = np.flatnonzero(rows == 2)[:_MOST_SNAPSHOTS]
    if not wanted.size:
        return {}
    part = some_snapshots(chunk, wanted)
    counts = {_TRIED: wanted.size, _PAIRS: wanted.size * pairs, _AS_GIVEN: _fitting(part, measured)}
    for name, columns in changes(part.columns, measured):
        counts[name] = _fitting(replace(part, columns=columns), measured)
    return counts


def some_snapshots(chunk: Chunk, wanted: npt.NDArray[Any]) -> Chunk:
    """Return a chunk of some snapshots of another, without its table."""
    starts, ends = chunk.offsets[wanted], chunk.offsets[wanted + 1]
    rows = np.concatenate([np.arange(start, end) for start, end in zip(starts, ends, strict=True)])
    return replace(
        chunk,
        table=None,
        snapshot=chunk.snapshot.take(wanted),
        offsets=np.concatenate([[0], np.cumsum(ends - starts)]),
        columns={name: values[rows] for name, values in chunk.columns.items()},
        left_out=chunk.left_out[rows],
    )


def changes(columns: Columns, measured: Measured) -> Iterator[tuple[str, Columns]]:
    """Yield the columns with the measured values read under each other name of them, with that name."""
    given, name = _spelling(measured), _VARIED[measured.kind]
    heading_rad: Any = 0.0
    if given.is_relative:
        heading_rad = columns[KINDS[measured.kind].column(name).heading_names[0].replace("_deg", "_rad")]
    stated = (columns[name] + heading_rad - given.offset) / given.scale
    for other in _others(measured):
        changed = {**columns, name: stated * other.scale + other.offset - heading_rad}
        if name == "range_m" and "range_std_m" not in measured.constants:
            yield other.name + _ALONE, changed
            changed = {**changed, "range_std_m": columns["range_std_m"] * (other.scale / given.scale)}
            if np.median(changed["range_std_m"]) > _LARGEST_STD * np.median(changed["range_m"]):
                continue
        yield other.name, changed


def _fitting(chunk: Chunk, measured: Measured) -> int:
    """Return the number of snapshots with a fix by maximum likelihood whose residuals fit their standard deviations.

    Few snapshots fit after one of seven changes by chance more easily; they need a larger p-value.
    """
    runs = tuple(method_runs(["ml"], measured.kind, "localize", {}))
    solver = ChunkSolver(kind=measured.kind, scene=measured.scene, runs=runs)
    estimates = solver.solve(chunk, np.zeros(len(chunk.snapshot), dtype=np.uint64)).estimates
    assert estimates is not None  # noqa: S101 - ml estimates
    least = _BAD_P_VALUE if len(chunk.snapshot) >= _FEW else _BAD_P_VALUE_OF_FEW
    fits = is_fix(estimates.status) & ~(estimates.fit_p_value < least)
    return int(np.count_nonzero(fits & (estimates.alternative == 0)))


def _fits_of_paths(chunk: Chunk, measured: Measured) -> dict[str, int]:
    """Return the counts of paths, each fitted by itself, and of those that are shorter than their baseline."""
    rows = np.flatnonzero(~chunk.left_out)[:_LARGEST_CHUNK, None]
    exchanged = {**chunk.columns, **{name: chunk.columns[other] for name, other in _EXCHANGE.items()}}
    ways = {_AS_GIVEN: chunk.columns, **dict(changes(chunk.columns, measured)), _EXCHANGED: exchanged}
    counts = {_TRIED: rows.size}
    for name, columns in ways.items():
        batch: Any = dense_batch("triplets", columns, rows, scene=Scene())
        paths = paths_of(batch)
        p_value = p_values(paths, fit_paths(paths))
        counts[name] = int(np.count_nonzero(p_value >= _BAD_P_VALUE))
    one = {name: values[rows[:, 0]] for name, values in chunk.columns.items()}
    baseline = np.hypot(one["tx_x_m"] - one["rx_x_m"], one["tx_y_m"] - one["rx_y_m"])
    counts[_SHORT] = int(np.count_nonzero(one["path_length_m"] < baseline - 3.0 * one["path_length_std_m"]))
    return counts


def cause_remarks(counts: Mapping[str, int], measured: Measured) -> list[str]:
    """Return a line for the change after which most fit that do not fit as given; ``counts`` of all chunks."""
    tried = counts.get(_TRIED, 0)
    if not tried or counts[_AS_GIVEN] > _MOST * tried:
        return []
    if counts.get(_SHORT, 0) > _MOST * tried:
        return [
            f"{counts[_SHORT]} of {tried} paths are shorter than the way from transmitter to receiver: are the delays "
            "relative to the first path? Add its delay to all, or give path_length_m"
        ]
    pairs = counts.get(_PAIRS, 0) > _MOST * tried
    names = [other.name for other in _others(measured)] + [_EXCHANGED] * (measured.kind == "triplets")
    names += [name + _ALONE for name in names]
    best = max(names, key=lambda name: counts.get(name, 0))
    if counts.get(best, 0) > (_NEARLY_ALL if pairs else _MOST) * tried and not (pairs and tried < _FEWEST_PAIRS):
        what = "paths" if measured.kind == "triplets" else "snapshots"
        return [f"{counts[best]} of {tried} {what} fit ({counts[_AS_GIVEN]} as given) {change_text(best, measured)}"]
    return []


def change_text(name: str, measured: Measured) -> str:
    """Return what the change ``name`` of `changes` is and the setting for it, after 'fit'."""
    given, stated = _spelling(measured).name, name
    name = name.removesuffix(_ALONE)
    if name == _EXCHANGED:
        dod = given.replace("doa", "dod")
        return (
            f"if departure and arrival are exchanged: {measured.option(dod, given)} and {measured.option(given, dod)}"
        )
    meaning = next(other.meaning for other in _others(measured) if other.name == name)
    header = measured.headers.get(given, given)
    if given.endswith("_rad"):
        return f"if {header!r} is read as {meaning}: convert it to degrees and name it {name}"
    option = measured.option(given, name)
    if measured.kind == "ranges" and "range_std_m" not in measured.constants and stated == name:
        option += f" and {measured.option(_std(given), _std(name))}"
    return f"if {header!r} is read {'in' if measured.kind == 'ranges' else 'as'} {meaning}: {option}"


def _std(name: str) -> str:
    return re.sub("^range_", "range_std_", name)
