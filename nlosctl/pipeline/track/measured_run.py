"""Tracks through measurements of every kind that a method follows along a path."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, SeedArray
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.results import Flags
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.io.measurements.completion.calibrated_rows import STD_FACTOR
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.layouts import EstimatesLayout, carried_columns
from nlosctl.io.results.measurement_layouts import FlagsLayout
from nlosctl.io.results.snapshot_rows import one_row_each
from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.pipeline.engine.writing import ChunkTables, describe_inputs, file_metadata, read_settings
from nlosctl.pipeline.solve.merged_flags import flags_of_windows
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.pipeline.solve.reference_rows import alike_differences
from nlosctl.pipeline.solve.report import RunReport
from nlosctl.pipeline.solve.solve_chunk import ChunkSolver, dense_batch, dense_blocks
from nlosctl.pipeline.solve.stds.row_squares import uses_ranges
from nlosctl.pipeline.solve.target_heights import heights_remark, refuse_dimension, with_target_heights
from nlosctl.pipeline.track.measured_snapshots import Collected, MeasuredSnapshots
from nlosctl.pipeline.track.merged_fixes import with_merged_fixes
from nlosctl.pipeline.track.offset_rows import OffsetRows
from nlosctl.pipeline.track.state_flags import RowResults, row_results
from nlosctl.pipeline.track.track_fit import run_remarks, with_p_values
from nlosctl.pipeline.track.track_options import TrackOptions
from nlosctl.pipeline.track.track_table import SnapshotStates, density_note, optional_columns, track_estimates
from nlosctl.solvers.tracking.tracks_of_rows import SnapshotRows, TrackedRows, TracksOfRows, track_rows

__all__ = ["MeasuredRun"]


class MeasuredRun:
    """Tracks through everything that a reader yields, by one method; ``wanted`` are the tables to make.

    ``report`` is complete when ``tables`` has ended.
    """

    def __init__(
        self,
        reader: MeasurementReader,
        run: MethodRun,
        options: SolveOptions,
        write: OutputOptions,
        own: TrackOptions,
        by: Sequence[str],
        wanted: Collection[str],
    ) -> None:
        self.reader, self._run, self._options, self._own, self._by = reader, run, options, own, tuple(by)
        self._refuse(write)
        self._collected = Collected(self._by, "time_s" if "time_s" in reader.column_names else "time", self._most_rows)
        self._carried = carried_columns(reader.column_names, write.carry, self._by)
        self._layouts = self._wanted_layouts(wanted)
        self._solver = ChunkSolver(
            kind=reader.kind,
            scene=reader.scene,
            runs=(run,),
            dimension=reader.dimension,
            field=options.field,
            block_size=options.block_size,
            calibration=reader.options.calibration,
        )
        self._chunks: list[tuple[Chunk, Chunk | None]] = []
        self._first: Chunk | None = None
        self.report = RunReport(kind=reader.kind, inputs=[], methods={run.label: MethodTally()})
        self.report.settings = self.provenance()

    @property
    def schemas(self) -> Mapping[str, Any]:
        """The Arrow schema of each wanted table by its name."""
        return {name: layout.schema for name, layout in self._layouts.items()}

    @property
    def _most_rows(self) -> int:
        return self.reader.options.max_sort_rows

    def provenance(self) -> dict[str, Any]:
        """Return everything that determines the results, as plain values."""
        method = {"name": self._run.spec.full_name, "parameters": dataclasses.asdict(self._run.options)}
        content: dict[str, Any] = {"methods": [method], "track": {**self._own.as_dict(), "by": list(self._by)}}
        return {**content, "seed": self._options.seed, "field": str(self._options.field), **read_settings(self.reader)}

    def metadata(self, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files."""
        described = describe_inputs(inputs, self.reader.report.rows_by_file, with_hash=with_hash)
        return file_metadata("track", {**self.provenance(), "inputs": described}, self.reader.scene)

    def tables(self) -> Iterator[ChunkTables]:
        """Yield the states and flags of each chunk, after all have been read and solved."""
        for position, covariance in map_in_processes(self._fixes, self._read(), self._options.jobs):
            self._collected.add_fixes(position, covariance)
        snapshots = self._collected.together()
        if self.reader.kind != "arrivals":  # whose snapshots have offsets of their own
            snapshots = with_merged_fixes(snapshots, self._fixes_of)
        paths = track_rows(self._tracked(snapshots), self._own.density)
        results = row_results(paths, *self._rows_of, snapshots.left_out.shape[0])
        start = first = 0
        for one_each, chunk in self._chunks:
            stop, last = start + len(one_each.snapshot), first + int(self._row_counts.pop(0))
            yield self._tables(one_each, chunk, paths, results, snapshots, slice(start, stop), slice(first, last))
            start, first = stop, last
        self._finish(paths)

    def _read(self) -> Iterator[Chunk]:
        """Yield the chunks as a method needs them, and keep what the tables need."""
        self._row_counts: list[int] = []
        for chunk in self.reader.chunks():
            chunk = with_target_heights(chunk, self.reader.dimension, self._options)
            self._collected.add(dataclasses.replace(chunk, table=chunk.table.select(list(self._by))))
            self._chunks.append((one_row_each(chunk, self._carried), chunk if "flags" in self._layouts else None))
            self._row_counts.append(int(chunk.offsets[-1]))
            self._first = self._first or dataclasses.replace(chunk, table=None)
            yield dataclasses.replace(chunk, table=chunk.table.select([]))

    def _fixes(self, chunk: Chunk) -> tuple[FloatArray, FloatArray]:
        """Return the fixes (S, D) of a chunk's snapshots by the method, with covariances (S, D, D), else NaN."""
        randomized = self._run.spec.randomized
        return self._fixes_of(chunk, snapshot_seeds(self._options.seed, chunk.snapshot_ids()) if randomized else None)

    def _fixes_of(self, chunk: Chunk, seeds: SeedArray | None = None) -> tuple[FloatArray, FloatArray]:
        dimension, size = self.reader.dimension, len(chunk.snapshot)
        estimates = self._solver.solve(chunk, np.zeros(size, dtype=np.uint64) if seeds is None else seeds).estimates
        assert estimates is not None  # noqa: S101 - the method estimates
        best = (estimates.alternative == 0) & np.isfinite(estimates.covariance_m2[:, 0])
        position, covariance = np.full((size, dimension), np.nan), np.full((size, dimension, dimension), np.nan)
        at = estimates.snapshot[best]
        position[at] = estimates.position_m[best]
        for one in range(dimension):
            for other in range(one + 1):
                entry = estimates.covariance_m2[best, one * (one + 1) // 2 + other]
                covariance[at, one, other] = covariance[at, other, one] = entry
        return position, covariance

    def _tracked(self, snapshots: MeasuredSnapshots) -> TrackedRows:
        """Return the snapshots with their rows in dense blocks, as the method follows them along a path."""
        follow = self._run.spec.path_rows
        assert follow is not None  # noqa: S101 - checked before
        self._rows_of: tuple[list[IntArray], list[IntArray]] = ([], [])
        blocks, batches = [], []
        made: dict[str, Any] = {"scene": self.reader.scene, "dimension": self.reader.dimension}
        whole = dense_blocks(snapshots.offsets, ~snapshots.left_out, self._options.block_size)
        for snapshot, row in (part for block in whole for part in alike_differences(snapshots.columns, *block)):
            if not row.shape[1]:
                continue
            batch = dense_batch(self.reader.kind, snapshots.columns, row, field=self._options.field, **made)
            rows = follow(batch, self._run.options)
            elapsed_s = snapshots.elapsed_s[row]
            if rows.count > row.shape[1]:  # a reference without a row of its own
                elapsed_s = np.append(elapsed_s, snapshots.mean_elapsed_s[snapshot, None], axis=1)
            blocks.append(SnapshotRows(rows, snapshot, rows.in_order(elapsed_s)))
            self._rows_of[0].append(row)
            self._rows_of[1].append(snapshot)
            batches.append(batch)
        return TrackedRows(
            snapshots.key,
            snapshots.mean_elapsed_s,
            blocks,
            snapshots.fix_m,
            snapshots.fix_m2,
            self._own.gap_s,
            self._run.spec.direct_rows is not None,
            self._own.causal,
            self._uncertain(snapshots, batches),
        )

    def _uncertain(self, snapshots: MeasuredSnapshots, batches: Sequence[Any]) -> OffsetRows | None:
        """Return the rows of batches with the offsets of their sensors, None if those are exactly known.

        Raises UsageError for filtered states, which have no model of them.
        """
        kind, columns, spec, options = self.reader.kind, snapshots.columns, self._run.spec, self._run.options
        follow = spec.path_rows
        assert follow is not None  # noqa: S101 - checked before
        rows = OffsetRows(
            kind,
            columns,
            batches,
            self._rows_of[0],
            self.reader.options.calibration,
            lambda batch: follow(batch, options),
            uses_ranges(spec, options) and any(batch.range_m is not None for batch in batches),
        )
        if not batches or not rows.any_error:
            return None
        if self._own.causal:
            raise UsageError(
                "`causal` takes the offsets of sensors as exactly known; leave it out, or the standard deviations of "
                "the offsets in the calibration and the scene"
            )
        return rows

    def _tables(
        self,
        one_each: Chunk,
        chunk: Chunk | None,
        paths: TracksOfRows,
        results: RowResults,
        snapshots: MeasuredSnapshots,
        mine: slice,
        rows: slice,
    ) -> ChunkTables:
        found = SnapshotStates.of(
            paths.states[mine],
            paths.covariance[mine],
            paths.origin_m[mine],
            paths.known[mine],
            paths.moving[mine],
            paths.settled[mine],
            paths.of.part[mine],
        )
        counts = np.diff(snapshots.offsets)[mine]
        frame = self.reader.scene.frame
        estimates = track_estimates(
            found, snapshots.time_s[mine], counts, results.n_used[mine], results.cost[mine], self._own, frame
        )
        judged = with_p_values(estimates, self._run, results.cost[mine], results.n_residuals[mine])
        self.report.methods[self._run.label].add_estimates(judged, 0)
        named: dict[str, Any] = {}
        if "estimates" in self._layouts:
            named["estimates"] = self._layouts["estimates"].table(estimates, one_each)
        if chunk is not None:
            answered = np.repeat(estimates.status == Status.OK, counts)
            flags: Flags = results.flags(rows, answered)
            flags = flags if chunk.windows is None else flags_of_windows(flags, chunk.windows.leader)
            named["flags"] = self._layouts["flags"].table([flags], chunk)
        windows = None if chunk is None else chunk.windows
        return ChunkTables(named=named, rows=rows.stop - rows.start, windows=windows)

    def _wanted_layouts(self, wanted: Collection[str]) -> dict[str, Any]:
        reader = self.reader
        shared: dict[str, Any] = {
            "methods": (self._run.spec.name,),
            "input_schema": reader.table_schema,
            "with_source": reader.has_several_sources,
        }
        layouts: dict[str, Any] = {}
        if "estimates" in wanted:
            layouts["estimates"] = EstimatesLayout(
                **shared,
                carried=self._carried,
                optional=optional_columns(reader.dimension, self._own, reader.scene.frame),
                frame="" if reader.scene.frame is None else reader.scene.frame.words,
            )
        if "flags" in wanted:
            given = reader.measured_columns | set(reader.schema.names)
            asked: dict[str, Any] = {"details": False, "dimension": reader.dimension}
            names = self._run.spec.flag_columns(self._run.options, reader.scene, given, **asked)
            names = tuple(name for name in names if name in RowResults.NAMES)
            names += () if reader.options.calibration is None else (STD_FACTOR,)
            layouts["flags"] = FlagsLayout(**shared, names=names, constants=reader.constants)
        return layouts

    def _refuse(self, write: OutputOptions) -> None:
        """Raise UsageError for what a track through measurements does not have."""
        spec, reader = self._run.spec, self.reader
        if spec.path_rows is None:
            raise UsageError(
                f"{spec.name} can't track {reader.kind}; ml and mixture-ml of bearings, ranges and arrivals can"
            )
        refuse_dimension([self._run], reader.dimension, self._options.field)
        if reader.scene.frame is not None and reader.scene.frame.on_ellipsoid:
            raise UsageError("tracks on the earth are of two dimensions; set `dimensions` to 2")
        if self._run.open_options:
            raise UsageError(f"`parameters` {self._run.open_options[0]}=estimate: set a number to track with")
        if reader.dimension == 3 and (self._options.target_z_m is not None or "target_z_m" in reader.column_names):
            raise UsageError("a track in three dimensions estimates the height: leave out target_z_m")

    def _finish(self, paths: TracksOfRows) -> None:
        read, report = self.reader.report, self.report
        report.rows, report.snapshots, report.rows_left_out = read.rows, read.snapshots, read.left_out_rows
        report.bad_rows, report.snapshots_lost, report.windows = read.bad_rows, read.snapshots_lost, read.windows
        report.inputs = [{"name": name, "rows": rows} for name, rows in read.rows_by_file.items()]
        report.settings = {**report.settings, "acceleration_psd": paths.density.density, "tracks": paths.tracks}
        report.notes += [
            *read.remarks,
            *heights_remark(self.reader, self._options),
            *run_remarks(self.reader, self._run, report, self._first, self._options.field),
            density_note(paths.density, self._own.density is None, self._collected.tracks, paths.tracks),
        ]
