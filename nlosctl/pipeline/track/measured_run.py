"""Tracks through measurements of every kind that a method follows along a path."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, SeedArray
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.layouts import carried_columns
from nlosctl.io.results.snapshot_rows import SnapshotNumbers
from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.pipeline.engine.writing import ChunkTables, describe_inputs, file_metadata, read_settings
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.pipeline.solve.reference_rows import alike_differences
from nlosctl.pipeline.solve.report import RunReport
from nlosctl.pipeline.solve.solve_chunk import ChunkSolver, dense_batch, dense_blocks
from nlosctl.pipeline.solve.stds.row_squares import uses_ranges
from nlosctl.pipeline.solve.target_heights import heights_remark, refuse_dimension, with_target_heights
from nlosctl.pipeline.track.measured_snapshots import Collected, MeasuredSnapshots
from nlosctl.pipeline.track.merged_fixes import with_merged_fixes
from nlosctl.pipeline.track.offset_rows import OffsetRows
from nlosctl.pipeline.track.state_flags import row_results
from nlosctl.pipeline.track.state_tables import FoundTracks, StateTables
from nlosctl.pipeline.track.track_fit import run_remarks
from nlosctl.pipeline.track.track_options import TrackOptions
from nlosctl.pipeline.track.track_table import density_note
from nlosctl.solvers.tracking.tracks_of_rows import SnapshotRows, TrackedRows, track_rows

__all__ = ["MeasuredRun", "PartOfTracks"]


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
        self._collected = Collected(
            self._by, "time_s" if "time_s" in reader.column_names else "time", reader.options.max_sort_rows
        )
        self.state_tables = StateTables(
            reader, run, own, carried_columns(reader.column_names, write.carry, self._by), wanted
        )
        self._solver = ChunkSolver(
            kind=reader.kind,
            scene=reader.scene,
            runs=(run,),
            dimension=reader.dimension,
            field=options.field,
            block_size=options.block_size,
            calibration=reader.options.calibration,
        )
        self._kept: list[tuple[Chunk, Chunk | None]] = []
        self._first: Chunk | None = None
        self.report = RunReport(kind=reader.kind, inputs=[], methods={run.label: MethodTally()})
        self.report.settings = self.provenance()

    @property
    def schemas(self) -> Mapping[str, Any]:
        """The Arrow schema of each wanted table by its name."""
        return self.state_tables.schemas

    def provenance(self) -> dict[str, Any]:
        """Return everything that determines the results, as plain values."""
        method = {"name": self._run.spec.full_name, "parameters": dataclasses.asdict(self._run.options)}
        content: dict[str, Any] = {"methods": [method], "track": {**self._own.as_dict(), "by": list(self._by)}}
        return {**content, "seed": self._options.seed, "field": str(self._options.field), **read_settings(self.reader)}

    def choices(self) -> dict[str, Any]:
        """Return the other options that two runs must share to write equal tables, as plain values."""
        return {"carry": list(self.state_tables.carried)}

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files."""
        described = describe_inputs(inputs, self.reader.report.rows_by_file, with_hash=with_hash)
        return file_metadata(command, {**self.provenance(), "inputs": described}, self.reader.scene)

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the states and flags of each chunk, after all have been read and solved by ``jobs`` processes."""
        found = self.solve(jobs, keeps=True)
        start = 0
        for one_each, chunk in self._kept:
            mine = np.arange(start, start + len(one_each.snapshot))
            yield self.state_tables.tables(one_each, chunk, found, mine, self.report)
            start += mine.shape[0]
        count_rows(self.report, self.reader)
        self.note(self.report, found, self.reader.report.remarks)

    def solve(self, jobs: int, *, keeps: bool) -> FoundTracks:
        """Return the tracks through everything that the reader yields; ``keeps``: and what the tables need of it."""
        numbers = SnapshotNumbers()
        for position, covariance in map_in_processes(self._fixes, self._read(numbers, keeps=keeps), jobs):
            self._collected.add_fixes(position, covariance)
        snapshots = self._collected.together()
        if self.reader.kind != "arrivals":  # whose snapshots have offsets of their own
            snapshots = with_merged_fixes(snapshots, self._fixes_of)
        paths = track_rows(self._tracked(snapshots), self._own.density)
        results = row_results(paths, *self._rows_of, snapshots.left_out.shape[0])
        return FoundTracks(paths, results, snapshots, numbers, self._collected.tracks)

    def note(self, report: RunReport, found: FoundTracks, remarks: Sequence[str]) -> None:
        """Add the notes on what was found to a report, after the ``remarks`` of the reader."""
        paths = found.paths
        report.settings = {**report.settings, "acceleration_psd": paths.density.density, "tracks": paths.tracks}
        report.notes += [
            *remarks,
            *heights_remark(self.reader, self._options),
            *run_remarks(self.reader, self._run, report, self._first, self._options.field),
            density_note(paths.density, self._own.density is None, found.tracks, paths.tracks),
        ]

    def _read(self, numbers: SnapshotNumbers, *, keeps: bool) -> Iterator[Chunk]:
        """Yield the chunks as a method needs them, their snapshots numbered, and keep what the tables need."""
        for chunk in self.reader.chunks():
            chunk = with_target_heights(chunk, self.reader.dimension, self._options)
            self._collected.add(dataclasses.replace(chunk, table=chunk.table.select(list(self._by))))
            numbers.add(chunk)
            self._first = self._first or dataclasses.replace(chunk, table=None)
            if keeps:
                self._kept.append(self.state_tables.kept(chunk))
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


class PartOfTracks:
    """The tables of the snapshots that another ``reader`` yields, such as those of a part, of tracks that were found.

    ``report`` is complete when ``tables`` has ended.
    """

    def __init__(self, reader: MeasurementReader, whole: MeasuredRun, found: FoundTracks) -> None:
        self.reader, self._whole, self._found = reader, whole, found
        self.report = RunReport(
            kind=reader.kind, inputs=[], methods={name: MethodTally() for name in whole.report.methods}
        )
        self.report.settings = whole.provenance()

    @property
    def schemas(self) -> Mapping[str, Any]:
        """The Arrow schema of each wanted table by its name."""
        return self._whole.schemas

    def provenance(self) -> dict[str, Any]:
        """Return everything that determines the results, as plain values."""
        return self._whole.provenance()

    def choices(self) -> dict[str, Any]:
        """Return the other options that two runs must share to write equal tables, as plain values."""
        return {"carry": list(self._whole.state_tables.carried)}

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files."""
        described = describe_inputs(inputs, self.reader.report.rows_by_file, with_hash=with_hash)
        return file_metadata(command, {**self.provenance(), "inputs": described}, self.reader.scene)

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the states and flags of each chunk."""
        made = self._whole.state_tables
        for chunk in self.reader.chunks():
            yield made.tables(*made.kept(chunk), self._found, self._found.numbers.find(chunk), self.report)
        count_rows(self.report, self.reader)

    def add_notes(self, remarks: Sequence[str]) -> None:
        """Add the notes on the motion to the report, after the ``remarks`` of the reader."""
        self._whole.note(self.report, self._found, remarks)


def count_rows(report: RunReport, reader: MeasurementReader) -> None:
    """Count in a report what a reader has read."""
    read = reader.report
    report.rows, report.snapshots, report.rows_left_out = read.rows, read.snapshots, read.left_out_rows
    report.bad_rows, report.snapshots_lost, report.windows = read.bad_rows, read.snapshots_lost, read.windows
    report.inputs = [{"name": name, "rows": rows} for name, rows in read.rows_by_file.items()]
