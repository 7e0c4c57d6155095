"""Measurements or flags of many snapshots as plain arrays, evenly sampled if there are too many rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.plot_inputs import PlotInput, PlotSnapshot, as_array, is_sampled, with_missing_constants

__all__ = ["SampledSnapshots", "read_sampled_snapshots"]

Columns = dict[str, npt.NDArray[Any]]

_KEPT = ("los", "used", "ip")


@dataclass(frozen=True, kw_only=True)
class SampledSnapshots:
    """Some snapshots (S,) of a file: their ``ids`` and the ``offsets`` (S+1,) of their rows (N,).

    ``columns`` are the contract's, ``sensor_names`` those that the codes in ``sensor`` and ``reference`` index,
    ``flags`` the columns ``los``, ``used`` and ``ip`` that the file has, as 1, 0 and -1 (null). ``left_out`` marks
    rows that an earlier step flagged. ``rows`` and ``snapshots`` count the whole file; the sample has one in ``step``
    snapshots.
    """

    kind: str
    scene: Scene
    dimension: int
    ids: Sequence[str]
    offsets: IntArray
    columns: Columns
    sensor_names: Sequence[str]
    flags: Columns
    left_out: BoolArray
    rows: int
    snapshots: int
    step: int

    def plot_snapshots(self) -> Iterator[PlotSnapshot]:
        """Yield the snapshots one by one."""
        for number, name in enumerate(self.ids):
            rows = slice(int(self.offsets[number]), int(self.offsets[number + 1]))
            columns = {key: values[rows] for key, values in self.columns.items()}
            yield PlotSnapshot(
                id=name,
                kind=self.kind,
                scene=self.scene,
                columns=columns,
                sensor=[self.sensor_names[code] for code in columns.get("sensor", ())],
                left_out=self.left_out[rows],
                reference=[self.sensor_names[code] for code in columns.get("reference", ())],
                dimension=self.dimension,
                file_columns={key: values[rows] for key, values in self.flags.items()},
            )


def read_sampled_snapshots(file: PlotInput, options: InputOptions, limit: int) -> SampledSnapshots:
    """Return the measurements or flags of a file, of at most about ``limit`` rows: whole snapshots, evenly sampled.

    Raises DataError for faults of the file, and for one without rows.
    """
    kept: list[_Part] = []
    rows = snapshots = 0
    step = 1
    with closing(MeasurementReader([file.input()], with_missing_constants(options))) as reader:
        for chunk in reader.chunks():
            number = np.arange(snapshots, snapshots + len(chunk.snapshot))
            rows, snapshots = rows + int(chunk.offsets[-1]), snapshots + number.size
            kept.append(_Part.of(chunk, number).only(is_sampled(number, step)))
            while sum(part.rows for part in kept) > limit and snapshots > step:
                step *= 2
                kept = [part.only(is_sampled(part.number, step)) for part in kept]
        if not rows:
            raise DataError(f"{file.name}: no rows")
        sizes = np.concatenate([part.sizes for part in kept])
        return SampledSnapshots(
            kind=reader.kind,
            scene=reader.scene,
            dimension=reader.dimension,
            ids=[name for part in kept for name in part.ids],
            offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            columns=_joined([part.columns for part in kept]),
            sensor_names=list(reader.sensor_names),
            flags=_joined([part.flags for part in kept]),
            left_out=np.concatenate([part.left_out for part in kept]),
            rows=rows,
            snapshots=snapshots,
            step=step,
        )


@dataclass(frozen=True, kw_only=True)
class _Part:
    """Whole snapshots (S,) of a chunk with their numbers in the file, and their rows (N,)."""

    number: IntArray
    ids: list[str]
    sizes: IntArray
    columns: Columns
    flags: Columns
    left_out: BoolArray

    @classmethod
    def of(cls, chunk: Chunk, number: IntArray) -> _Part:
        names = [name for name in _KEPT if name in chunk.table.column_names]
        return cls(
            number=number,
            ids=[str(name) for name in chunk.snapshot.to_pylist()],
            sizes=np.diff(chunk.offsets),
            columns={name: np.asarray(values) for name, values in chunk.columns.items()},
            flags={name: _codes(as_array(chunk.table.column(name))) for name in names},
            left_out=chunk.left_out,
        )

    @property
    def rows(self) -> int:
        return int(self.left_out.size)

    def only(self, chosen: BoolArray) -> _Part:
        """Return some of the snapshots (S,), copied, so that the chunk can be freed."""
        rows = np.repeat(chosen, self.sizes)
        return _Part(
            number=self.number[chosen],
            ids=[name for name, is_chosen in zip(self.ids, chosen.tolist(), strict=True) if is_chosen],
            sizes=self.sizes[chosen],
            columns={name: values[rows] for name, values in self.columns.items()},
            flags={name: values[rows] for name, values in self.flags.items()},
            left_out=self.left_out[rows],
        )


def _codes(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return flags (N,) as 1, 0 and -1 (null), also those of a file that has them as text."""
    if values.dtype.kind != "O":
        return np.nan_to_num(np.asarray(values, dtype=np.float64), nan=-1.0).astype(np.int8)
    words = {"true": 1, "1": 1, "false": 0, "0": 0}
    return np.array([words.get(str(word).lower(), -1) for word in values], dtype=np.int8)


def _joined(parts: Sequence[Columns]) -> Columns:
    """Return the columns of all parts that every part has."""
    names = [name for name in parts[0] if all(name in part for part in parts)]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
