"""True positions from separate files, joined to estimates by snapshot, and by source where both have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.scene import parse_frame
from nlosctl.contract.tables import TRUTH, TRUTH_HEIGHT
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.reader import PlainReader
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["TruthTable"]

_PLANE = ("truth_x_m", "truth_y_m")
_EARTH = ("truth_lat_deg", "truth_lon_deg")
_LARGEST_DEGREES = (90.0, 360.0)
_OWN_NUMBERS = "; if the files number their own snapshots, add a column 'source'"
_BETWEEN = "\0"
"""Separates source and snapshot in a key; no file name contains it."""


@dataclass(frozen=True, kw_only=True)
class _TrueRows:
    """The T rows with a truth of one file: ids and sources (None without the column), positions (T, 2), row numbers.

    The positions are x and y in metres, or latitude and longitude in degrees if ``on_earth`` (T,).
    """

    ids: Any
    sources: Any | None
    position: FloatArray
    on_earth: BoolArray
    rows: IntArray


class TruthTable:
    """True positions by snapshot id of one or more files, in any number of equal rows; those without one are left out.

    A column ``source`` in all files and in the estimates is part of the key. ``snapshots`` and ``matched`` count the
    snapshots looked up, and those of them with a truth. Raises DataError for a file that is not a table of truth.
    """

    def __init__(self, inputs: Sequence[Input]) -> None:
        parts = [Input(name=part.name, parts=(part,)) for given in inputs for part in given.parts]
        read = [_read(part) for part in parts]
        self.name = parts[0].name if len(parts) == 1 else f"the {len(parts)} files of truth"
        self._ids = pa.concat_arrays([rows.ids for rows in read])
        sources = [rows.sources for rows in read]
        self._sources = None if any(names is None for names in sources) else pa.concat_arrays(sources)
        least = min(rows.position.shape[1] for rows in read)
        self._position = np.concatenate([rows.position[:, :least] for rows in read])
        self._on_earth = np.concatenate([rows.on_earth for rows in read])
        self._files = [part.name for part in parts]
        self._file = np.repeat(np.arange(len(parts)), [len(rows.rows) for rows in read])
        self._row = np.concatenate([rows.rows for rows in read])
        self._keys: dict[bool, Any] = {}
        self._source_of: npt.NDArray[Any] = np.full(len(self._ids), None, dtype=object)
        self.snapshots = self.matched = 0

    def look_up(self, estimates: Any, name: str, dimension: int = 2) -> FloatArray:
        """Return the truth (N, D) of a table of whole snapshots; NaN without a truth.

        Raises DataError for contradicting truths, an id of several sources, or latitudes without the column ``frame``.
        """
        self._position = self._of_dimension(dimension)
        by_source = self._sources is not None and "source" in estimates.column_names
        own = _key(estimates.column("snapshot"), estimates.column("source") if by_source else None)
        keys = self._checked_keys(by_source)
        known = pc.is_in(pc.unique(own), value_set=keys)
        self.snapshots += len(known)
        self.matched += int(pc.sum(known).as_py() or 0)
        index = pc.index_in(own, value_set=keys)
        rows = np.flatnonzero(index.is_valid())
        found = np.asarray(index.drop_null())
        if "source" in estimates.column_names and not by_source:
            self._refuse_several_sources(found, estimates.column("source").take(pa.array(rows)), name)
        truth_m = np.full((len(index), dimension), np.nan)
        truth_m[rows] = self._position[found]
        on_earth = rows[self._on_earth[found]]
        if on_earth.size:
            truth_m[on_earth, :2] = self._in_plane(truth_m[on_earth, :2], estimates.take(pa.array(on_earth)), name)
        return truth_m

    def of_snapshots(self, ids: Any, source: str, frame: str, dimension: int) -> FloatArray:
        """Return the truth (S, D) of snapshots with these ids of the input ``source``; arguments as in `look_up`.

        ``frame`` is the local plane on earth as text, empty without one.
        """
        columns = {"snapshot": ids, "source": pa.array([source] * len(ids), pa.string())}
        if frame:
            columns["frame"] = pa.array([frame] * len(ids), pa.string())
        return self.look_up(pa.table(columns), source, dimension)

    def _of_dimension(self, dimension: int) -> FloatArray:
        """Return the positions (T, D); raise DataError without heights."""
        if dimension > self._position.shape[1]:
            raise DataError(f"{self.name}: no column {TRUTH_HEIGHT.name!r}, and the estimates have heights; add it")
        return self._position[:, :dimension]

    def remark(self) -> list[str]:
        """Return a line on the snapshots without a truth; raise DataError if none of those looked up has one."""
        if self.snapshots and not self.matched:
            some = f" (the first is {self._ids[0].as_py()!r})" if len(self._ids) else ""
            joined = "columns 'source' and 'snapshot'" if True in self._keys else "column 'snapshot'"
            raise DataError(
                f"{self.name}: none of its snapshots{some} is one of the {self.snapshots} snapshots of the estimates; "
                f"the truth is joined by the {joined}"
            )
        if self.matched == self.snapshots:
            return []
        has = "have" if self.name.startswith("the ") else "has"
        return [
            f"{self.name} {has} the truth of {self.matched} of {self.snapshots} snapshots; the others are not scored"
        ]

    def _checked_keys(self, by_source: bool) -> Any:
        """Return the keys of all true rows; raise DataError if two rows of one key differ."""
        if by_source not in self._keys:
            keys = _key(self._ids, self._sources if by_source else None)
            first = np.asarray(pc.index_in(keys, value_set=keys))
            same = (self._position == self._position[first]) | (
                np.isnan(self._position) & np.isnan(self._position[first])
            )
            differs = ~same.all(axis=1) | (self._on_earth != self._on_earth[first])
            other = np.flatnonzero(differs)
            if other.size:
                raise DataError(self._contradiction(int(first[other[0]]), int(other[0])))
            self._keys[by_source] = keys
        return self._keys[by_source]

    def _contradiction(self, first: int, second: int) -> str:
        same = self._file[first] == self._file[second]
        names = ", ".join(_EARTH if self._on_earth[second] else _PLANE)
        (x, y, *_), (other_x, other_y, *_) = self._position[[first, second]].tolist()
        return (
            f"{self._files[self._file[second]]}, row {self._row[second]}: got {names} {other_x:.12g}, {other_y:.12g} "
            f"for snapshot {self._ids[first].as_py()!r}, which has {x:.12g}, {y:.12g} in "
            f"{'' if same else f'{self._files[self._file[first]]}, '}row {self._row[first]}; expected one true "
            f"position per snapshot{'' if same else _OWN_NUMBERS}"
        )

    def _refuse_several_sources(self, found: IntArray, sources: Any, name: str) -> None:
        """Raise DataError if a truth without source belongs to snapshots of several sources."""
        values = np.asarray(sources.to_pylist(), dtype=object)
        fresh = np.array([source is None for source in self._source_of[found]], dtype=np.bool_)
        self._source_of[found[fresh][::-1]] = values[fresh][::-1]  # the first of each wins
        wrong = np.flatnonzero(self._source_of[found] != values)
        if wrong.size:
            row = int(found[wrong[0]])
            raise DataError(
                f"{name}: snapshot {self._ids[row].as_py()!r} is in several inputs ({self._source_of[row]}, "
                f"{values[wrong[0]]}), but {self.name} has no column 'source'; add it, or evaluate input by input"
            )

    def _in_plane(self, degrees: FloatArray, estimates: Any, name: str) -> FloatArray:
        """Return latitudes and longitudes (N, 2) as x and y in the plane of each estimate."""
        frames = estimates.column("frame").to_pylist() if "frame" in estimates.column_names else [None]
        if None in frames:
            raise DataError(
                f"{name}: no plane on earth (column 'frame') for the true latitudes of {self.name}; "
                "localize with `crs` or `origin`, or give truth_x_m and truth_y_m"
            )
        position = np.empty(degrees.shape)
        for frame in dict.fromkeys(frames):
            rows = [row for row, value in enumerate(frames) if value == frame]
            lat, lon = degrees[rows].T
            plane = plane_of(parse_frame(str(frame), "column 'frame'"))
            position[rows] = np.stack(plane.to_plane(lat, (lon + 180.0) % 360.0 - 180.0), axis=1)
        return position


def _read(part: Input) -> _TrueRows:
    reader = PlainReader(part, TRUTH)
    names = next((pair for pair in (_PLANE, _EARTH) if set(pair) <= set(reader.schema.names)), None)
    if names is None:
        reader.close()
        raise DataError(
            f"{part.name}: truth needs the columns {' and '.join(_PLANE)}, or {' and '.join(_EARTH)}. "
            f"The file has: {', '.join(reader.schema.names)}"
        )
    table = reader.read_all()
    read = [*names, *([TRUTH_HEIGHT.name] if TRUTH_HEIGHT.name in table.column_names else [])]
    position = np.stack([np.asarray(table.column(name).cast(pa.float64(), safe=False)) for name in read], axis=1)
    largest = (*(_LARGEST_DEGREES if names == _EARTH else (LARGEST_NUMBER, LARGEST_NUMBER)), LARGEST_NUMBER)
    for name, values, most in zip(read, position.T, largest, strict=False):
        if (np.abs(values) > most).any():
            raise DataError(
                f"{part.name}, column {name!r}: got {values[np.abs(values) > most][0]:g}, "
                f"expected numbers within {most:g}"
            )
    given = np.flatnonzero(~np.isnan(position[:, :2]).any(axis=1))
    table = table.take(pa.array(given))
    return _TrueRows(
        ids=_as_text(table.column("snapshot")),
        sources=_as_text(table.column("source")) if "source" in table.column_names else None,
        position=position[given],
        on_earth=np.full(given.shape, names == _EARTH),
        rows=given + 1,
    )


def _key(ids: Any, sources: Any | None) -> Any:
    if sources is None:
        return _as_text(ids)
    return pc.binary_join_element_wise(pc.fill_null(_as_text(sources), ""), _as_text(ids), _BETWEEN)


def _as_text(values: Any) -> Any:
    values = values.cast(pa.string())
    return values.combine_chunks() if isinstance(values, pa.ChunkedArray) else values
