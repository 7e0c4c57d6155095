"""Known positions of the snapshots, from the truth columns of the input or from a table of truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.tables import TRUTH_HEIGHT
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.layouts import TRUTH_NAMES, truth_positions
from nlosctl.io.results.truth_table import TruthTable

__all__ = ["OWN_COLUMNS", "KnownPositions"]

OWN_COLUMNS = "columns"
"""The name in place of a file that stands for the input's own truth columns."""


@dataclass(frozen=True, kw_only=True)
class KnownPositions:
    """The true positions of snapshots: those of ``table``, None: of the input's own columns.

    ``frame`` is the local plane on earth as text, empty without one.
    """

    table: TruthTable | None = None
    frame: str = ""

    @classmethod
    def of(cls, reader: MeasurementReader, table: TruthTable | None) -> KnownPositions:
        """Return the positions for an input; raises DataError without ``table`` and without truth columns.

        UsageError for places on earth in three dimensions.
        """
        needed = [*TRUTH_NAMES, TRUTH_HEIGHT.name][: reader.dimension]
        lacking = [name for name in needed if name not in reader.column_names]
        if table is None and lacking:
            raise DataError(f"`truth` columns: the input has no column {lacking[0]!r}; give a table of true positions")
        frame = reader.scene.frame
        if frame is not None and frame.on_ellipsoid:
            raise UsageError(
                "`truth` is not for places on earth in three dimensions; give metres, or set `dimensions` to 2"
            )
        return cls(table=table, frame="" if frame is None else frame.words)

    def positions(self, chunk: Chunk, dimension: int) -> FloatArray:
        """Return the positions (S, D) of a chunk's snapshots, NaN where they are not known."""
        if self.table is None:
            return truth_positions(chunk.table, np.asarray(chunk.offsets[:-1]), dimension)
        return self.table.of_snapshots(chunk.snapshot, chunk.source, self.frame, dimension)
