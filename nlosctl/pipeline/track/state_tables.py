"""The tables of tracks through measurements: states and flags of a chunk's snapshots, from those of all inputs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.statuses import Status
from nlosctl.io.measurements.completion.calibrated_rows import STD_FACTOR
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.layouts import EstimatesLayout
from nlosctl.io.results.measurement_layouts import FlagsLayout
from nlosctl.io.results.snapshot_rows import SnapshotNumbers, one_row_each
from nlosctl.pipeline.engine.writing import ChunkTables
from nlosctl.pipeline.solve.merged_flags import flags_of_windows
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.report import RunReport
from nlosctl.pipeline.track.measured_snapshots import MeasuredSnapshots
from nlosctl.pipeline.track.state_flags import RowResults
from nlosctl.pipeline.track.track_fit import with_p_values
from nlosctl.pipeline.track.track_options import TrackOptions
from nlosctl.pipeline.track.track_table import SnapshotStates, optional_columns, track_estimates
from nlosctl.solvers.tracking.tracks_of_rows import TracksOfRows

__all__ = ["FoundTracks", "StateTables"]


@dataclass(frozen=True)
class FoundTracks:
    """The paths through all snapshots (S,), what they say of the rows (N,), and the number of tracks before gaps.

    ``numbers`` finds snapshots by their ids.
    """

    paths: TracksOfRows
    results: RowResults
    snapshots: MeasuredSnapshots
    numbers: SnapshotNumbers
    tracks: int

    def states(self, mine: IntArray) -> SnapshotStates:
        """Return the states of some snapshots (C,)."""
        paths = self.paths
        return SnapshotStates.of(
            paths.states[mine],
            paths.covariance[mine],
            paths.origin_m[mine],
            paths.known[mine],
            paths.moving[mine],
            paths.settled[mine],
            paths.of.part[mine],
        )

    def rows(self, mine: IntArray) -> IntArray:
        """Return the rows of some snapshots (C,), one after the other."""
        start, counts = self.snapshots.offsets[:-1][mine], np.diff(self.snapshots.offsets)[mine]
        return np.repeat(start - np.cumsum(counts) + counts, counts) + np.arange(int(counts.sum()))


class StateTables:
    """Makes the ``wanted`` tables of chunks; ``layouts`` are theirs by name."""

    def __init__(
        self,
        reader: MeasurementReader,
        run: MethodRun,
        own: TrackOptions,
        carried: Sequence[str],
        wanted: Collection[str],
    ) -> None:
        self._run, self._own, self._frame, self.carried = run, own, reader.scene.frame, tuple(carried)
        shared: dict[str, Any] = {
            "methods": (run.spec.name,),
            "input_schema": reader.table_schema,
            "with_source": reader.has_several_sources,
        }
        self.layouts: dict[str, Any] = {}
        if "estimates" in wanted:
            self.layouts["estimates"] = EstimatesLayout(
                **shared,
                carried=self.carried,
                optional=optional_columns(reader.dimension, own, self._frame),
                frame="" if self._frame is None else self._frame.words,
            )
        if "flags" in wanted:
            given = reader.measured_columns | set(reader.schema.names)
            asked: dict[str, Any] = {"details": False, "dimension": reader.dimension}
            names = run.spec.flag_columns(run.options, reader.scene, given, **asked)
            names = tuple(name for name in names if name in RowResults.NAMES)
            names += () if reader.options.calibration is None else (STD_FACTOR,)
            self.layouts["flags"] = FlagsLayout(**shared, names=names, constants=reader.constants)

    @property
    def schemas(self) -> Mapping[str, Any]:
        """The Arrow schema of each table by its name."""
        return {name: layout.schema for name, layout in self.layouts.items()}

    def kept(self, chunk: Chunk) -> tuple[Chunk, Chunk | None]:
        """Return what the tables need of a chunk: a row of each snapshot, and all rows for flags."""
        return one_row_each(chunk, self.carried), chunk if "flags" in self.layouts else None

    def tables(
        self, one_each: Chunk, chunk: Chunk | None, found: FoundTracks, mine: IntArray, report: RunReport
    ) -> ChunkTables:
        """Return the tables of a chunk, whose snapshots are ``mine`` (C,) of those found; the report counts them."""
        counts, rows = np.diff(found.snapshots.offsets)[mine], found.rows(mine)
        estimates = track_estimates(
            found.states(mine),
            found.snapshots.time_s[mine],
            counts,
            found.results.n_used[mine],
            found.results.cost[mine],
            self._own,
            self._frame,
        )
        judged = with_p_values(estimates, self._run, found.results.cost[mine], found.results.n_residuals[mine])
        report.methods[self._run.label].add_estimates(judged, 0)
        named: dict[str, Any] = {}
        if "estimates" in self.layouts:
            named["estimates"] = self.layouts["estimates"].table(estimates, one_each)
        if chunk is None:
            return ChunkTables(named=named, rows=rows.shape[0])
        flags = found.results.flags(rows, np.repeat(estimates.status == Status.OK, counts))
        flags = flags if chunk.windows is None else flags_of_windows(flags, chunk.windows.leader)
        named["flags"] = self.layouts["flags"].table([flags], chunk)
        return ChunkTables(named=named, rows=rows.shape[0], windows=chunk.windows)
