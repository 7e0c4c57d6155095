"""A run of methods over measurements: chunks in, tables of estimates and flags out, in order, counted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from nlosctl.arrays import SeedArray
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.tables import KINDS
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.layouts import EstimatesLayout, FlagsLayout, TraceLayout, carried_columns
from nlosctl.io.sweep_columns import SweepColumns
from nlosctl.pipeline.engine.provenance import describe_inputs, file_metadata
from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.pipeline.engine.writing import ChunkTables
from nlosctl.pipeline.solve.flat_plane import FlatPlaneTally
from nlosctl.pipeline.solve.gdop import gdop, refuse_gdop
from nlosctl.pipeline.solve.precision_columns import on_earth, precision_columns, precision_of
from nlosctl.pipeline.solve.remarks import method_remarks
from nlosctl.pipeline.solve.report import MethodTally, RunReport
from nlosctl.pipeline.solve.sensor_heights import heights_remark, with_sensor_heights
from nlosctl.pipeline.solve.settings import RunSettings
from nlosctl.pipeline.solve.solve_chunk import FlatEstimates, FlatFlags, MethodRun, Problem, solve_flat
from nlosctl.pipeline.solve.sweeps import refuse_swept_columns

__all__ = ["MeasurementRun"]


class MeasurementRun:
    """Solves everything that a reader gives, with one or several methods.

    The schemas of the results are known before the first chunk; ``report`` is complete when ``tables`` has ended.
    """

    def __init__(self, reader: MeasurementReader, runs: Sequence[MethodRun], settings: RunSettings) -> None:
        self._reader, self._runs, self._settings = reader, tuple(runs), settings
        methods = tuple(run.spec.name for run in self._runs)
        if "gdop" in settings.add:
            refuse_gdop(reader.kind, self._runs)
        refuse_swept_columns([run.sweep for run in self._runs], reader.column_names)
        sweeps = SweepColumns([run.sweep for run in self._runs])
        self._estimates_layout = EstimatesLayout(
            methods=methods,
            input_schema=reader.schema,
            carried=carried_columns(reader.column_names, settings.carry),
            measurement_name=self._measurement_name(),
            with_covariance_kind=any(run.spec.covariance_kinds for run in self._runs),
            with_source=reader.has_several_sources,
            frame=None if reader.scene.frame is None else reader.scene.frame.words,
            wanted=precision_columns(settings.ellipse, settings.add),
            sweeps=sweeps,
        )
        self._flags_layout = FlagsLayout(
            methods=methods,
            input_schema=reader.schema,
            said=self._said(),
            constants=reader.constants,
            with_source=reader.has_several_sources,
            sweeps=sweeps,
        )
        self._trace_layout = TraceLayout(
            methods=methods, input_schema=reader.schema, with_source=reader.has_several_sources, sweeps=sweeps
        )
        if settings.want_trace and not any(run.spec.traces for run in self._runs):
            raise UsageError(f"--trace-out: {', '.join(dict.fromkeys(methods))} has no steps to trace; sequential has")
        self.report = self._new_report()

    @property
    def reader(self) -> MeasurementReader:
        """What the run reads."""
        return self._reader

    @property
    def schemas(self) -> dict[str, Any]:
        """The Arrow schema of every table that can be asked for, by its name."""
        schemas = {"estimates": self.estimates_schema, "flags": self.flags_schema}
        return {**schemas, "trace": self.trace_schema} if self._settings.want_trace else schemas

    def again(self) -> Callable[[MeasurementReader], MeasurementRun]:
        """Return what starts an equal run, of one job, over another reader; it can be sent to another process."""
        return partial(MeasurementRun, runs=self._runs, settings=dataclasses.replace(self._settings, jobs=1))

    @property
    def estimates_schema(self) -> Any:
        """The Arrow schema of the estimates."""
        return self._estimates_layout.schema

    @property
    def flags_schema(self) -> Any:
        """The Arrow schema of the flags."""
        return self._flags_layout.schema

    @property
    def trace_schema(self) -> Any:
        """The Arrow schema of the trace."""
        return self._trace_layout.schema

    def plan(self) -> list[str]:
        """Return what the run is about to do, a line for the data and one for each method."""
        scene, settings = self._reader.scene, self._settings
        lines = [
            f"scene: {len(scene.sensors)} sensors, {len(scene.reflectors)} reflectors; seed {settings.seed}, "
            f"jobs {settings.jobs}, blocks of {settings.block_size} snapshots"
        ]
        for run in self._runs:
            options = ", ".join(f"{name}={value}" for name, value in dataclasses.asdict(run.options).items())
            lines.append(f"{run.spec.full_name}: {options or 'no parameters'}")
        return lines

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files; after ``tables`` has ended they tell the rows of each input."""
        described = describe_inputs(inputs, self._reader.report.rows_by_file, with_hash=with_hash)
        return file_metadata(command, {**self.provenance(), "inputs": described}, self._reader.scene)

    def provenance(self) -> dict[str, Any]:
        """Return the methods, their parameters, and what else of the settings makes the results, as plain values."""
        settings = self._settings
        methods = [{"name": run.spec.full_name, "parameters": dataclasses.asdict(run.options)} for run in self._runs]
        content = {"methods": methods, "seed": settings.seed, "field": str(settings.field)}
        if settings.target_z_m is not None:
            content["target_z_m"] = settings.target_z_m
        return content

    def choices(self) -> dict[str, Any]:
        """Return what else must be the same for two runs to write the same tables, as plain values."""
        settings = self._settings
        return {
            "alternatives": settings.alternatives,
            "carry": list(settings.carry),
            "details": settings.want_details,
            "ellipse": settings.ellipse,
            "add": list(settings.add),
        }

    def tables(self, jobs: int | None = None) -> Iterator[ChunkTables]:
        """Yield the results chunk by chunk, in input order; raises what reading and solving raise.

        ``jobs`` are those of the settings unless given.
        """
        chunks = map(self._slimmed, self._reader.chunks())
        for tables, counts in map_in_processes(self._solve, chunks, jobs or self._settings.jobs):
            self.report.take(counts)
            yield tables
        self._finish()

    def _slimmed(self, chunk: Chunk) -> Chunk:
        """Return the chunk with those columns of its table alone that results carry: it may be sent far."""
        if self._settings.want_flags or self._settings.want_trace:
            return chunk
        names = {*self._estimates_layout.carried, self._estimates_layout.measurement_name} - {""}
        return dataclasses.replace(chunk, table=chunk.table.select(sorted(names)))

    def _solve(self, chunk: Chunk) -> tuple[ChunkTables, dict[str, Any]]:
        """Return the tables of a chunk, and its counts."""
        settings = self._settings
        problem = Problem(
            kind=self._reader.kind,
            scene=self._reader.scene,
            field=settings.field,
            columns=with_sensor_heights(chunk.columns, settings.target_z_m),
            offsets=chunk.offsets,
            kept=~chunk.left_out,
            seed=self._seeds(chunk),
        )
        estimates, flags, trace = solve_flat(
            problem,
            self._runs,
            block_size=settings.block_size,
            alternatives=settings.alternatives,
            want_flags=settings.want_flags or "gdop" in settings.add,
            want_details=settings.want_details,
            want_trace=settings.want_trace,
        )
        named: dict[str, Any] = {}
        if settings.want_estimates and estimates is not None:
            arrays = {field.name: getattr(estimates, field.name) for field in dataclasses.fields(estimates)}
            arrays |= on_earth(self._reader.scene.frame, estimates.position_m)
            arrays |= precision_of(estimates, settings.ellipse, settings.add)
            if "gdop" in settings.add:
                arrays["gdop"] = gdop(problem, estimates, [flag.used for flag in flags])
            named["estimates"] = self._estimates_layout.table(
                arrays, ids=chunk.snapshot, first_row=chunk.offsets[:-1], rows=chunk.table, source=chunk.source
            )
        if settings.want_flags:
            counts = np.diff(chunk.offsets)
            named["flags"] = self._flags_layout.table(
                [(flag.used, flag.columns) for flag in flags],
                rows=chunk.table,
                snapshot_of_row=np.repeat(np.arange(counts.shape[0]), counts),
                source=chunk.source,
            )
        if trace is not None:
            steps = {field.name: getattr(trace, field.name) for field in dataclasses.fields(trace)}
            named["trace"] = self._trace_layout.table(steps, ids=chunk.snapshot, rows=chunk.table, source=chunk.source)
        rows = int(chunk.offsets[-1])
        return ChunkTables(named=named, rows=rows), self._counted(problem, estimates, flags, rows)

    def _new_report(self) -> RunReport:
        return RunReport(kind=self._reader.kind, inputs=[], methods={run.label: MethodTally() for run in self._runs})

    def _seeds(self, chunk: Chunk) -> SeedArray:
        if not any(run.spec.randomized for run in self._runs):
            return np.zeros(len(chunk.snapshot), dtype=np.uint64)
        return snapshot_seeds(self._settings.seed, chunk.snapshot_ids())

    def _said(self) -> tuple[str, ...]:
        details = self._settings.want_details
        columns = (
            run.spec.flag_columns(run.options, self._reader.scene, self._reader.schema.names, details=details)
            for run in self._runs
        )
        return tuple(dict.fromkeys(name for names in columns for name in names))

    def _measurement_name(self) -> str:
        name = KINDS[self._reader.kind].measurement_name
        return name if name in self._reader.schema.names else ""

    def _counted(
        self, problem: Problem, estimates: FlatEstimates | None, flags: Sequence[FlatFlags], rows: int
    ) -> dict[str, Any]:
        """Return the counts of a chunk, for the report to take."""
        report = self._new_report()
        report.rows = rows
        if estimates is not None:
            best = estimates.alternative == 0
            for number, run in enumerate(self._runs):
                mine = best & (estimates.method == number)
                cost = estimates.cost if run.spec.cost_tells_fit else np.full(estimates.cost.shape, np.nan)
                tally = report.methods[run.label]
                tally.add(estimates.status[mine], cost[mine], estimates.n_used[mine])
                tally.on_edge += int(np.count_nonzero(estimates.on_edge[mine]))
        for run, said in zip(self._runs, flags, strict=False):
            if run.spec.job != "localize":
                report.methods[run.label].add_verdicts(said.columns)
        FlatPlaneTally(self._reader.scene.frame, report.flat_plane).add(problem, estimates)
        return report.counts()

    def _finish(self) -> None:
        read = self._reader.report
        self.report.snapshots = read.snapshots
        self.report.rows_left_out = read.left_out_rows
        self.report.bad_rows = read.bad_rows
        self.report.snapshots_lost = read.snapshots_lost
        self.report.inputs = [{"name": name, "rows": rows} for name, rows in read.rows_by_file.items()]
        if not self._reader.reads_one_part:
            self.add_notes(read.remarks)

    def add_notes(self, remarks: Sequence[str]) -> None:
        """Add to the report what its counts say; ``remarks`` are the reader's."""
        self.report.notes += [
            *remarks,
            *heights_remark(self._reader.column_names, self._settings.target_z_m),
            *FlatPlaneTally(self._reader.scene.frame, self.report.flat_plane).remarks(),
            *method_remarks(self._runs, self.report, self._reader.schema.names, self._settings.field),
        ]
