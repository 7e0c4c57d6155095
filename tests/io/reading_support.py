"""Helpers of the tests of readers: make files, and read them completely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.measurements.row_checks import BadRow, BadRowSink
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.scenes.scene_file import find_scene

FIXTURES = Path(__file__).parents[2] / "fixtures"


@dataclass(frozen=True, kw_only=True)
class Whole:
    """All chunks of a file, joined."""

    ids: list[Any]
    counts: list[int]
    columns: Mapping[str, np.ndarray]
    table: Any


def read(paths: Sequence[Path | str], bad_rows: BadRowSink | None = None, **options: Any) -> list[Chunk]:
    """Return all chunks of files, on one thread."""
    inputs = expand_inputs([str(path) for path in paths])
    reader = MeasurementReader(inputs, InputOptions(use_threads=False, **options), bad_rows)
    return list(reader.chunks())


def scene_of(path: Path) -> Scene:
    """Return the scene file in the same folder."""
    return find_scene(None, {}, path)


def whole(chunks: Sequence[Chunk]) -> Whole:
    """Join chunks."""
    return Whole(
        ids=[value for chunk in chunks for value in chunk.snapshot.to_pylist()],
        counts=[int(count) for chunk in chunks for count in np.diff(chunk.offsets)],
        columns={name: np.concatenate([chunk.columns[name] for chunk in chunks]) for name in chunks[0].columns},
        table=pa.concat_tables([chunk.table for chunk in chunks]),
    )


def bearings(snapshots: Sequence[Any], **columns: Sequence[Any]) -> Any:
    """Return a table of plain bearings, one row per snapshot id; columns can be replaced."""
    count = len(snapshots)
    standard: dict[str, Any] = {
        "snapshot": snapshots,
        "sensor": [f"s{place}" for place in range(count)],
        "sensor_x_m": [float(place) for place in range(count)],
        "sensor_y_m": [0.5] * count,
        "bearing_rad": [0.1] * count,
        "bearing_std_rad": [0.01] * count,
    }
    return pa.table({**standard, **columns})


def save(table: Any, path: Path, row_group_size: int = 1000) -> Path:
    """Write a Parquet file and return its path."""
    pa.parquet.write_table(table, path, row_group_size=row_group_size)
    return path


class Gathered(list[BadRow]):
    """A sink that keeps the bad rows."""

    def __call__(self, rows: Sequence[BadRow]) -> None:
        """Keep rows."""
        self.extend(rows)
