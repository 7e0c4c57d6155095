"""A run of methods over measurements: chunks in, tables of estimates, flags and traces out, in input order."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import SeedArray
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.contract.tables import KINDS
from nlosctl.errors import UsageError
from nlosctl.io.arrow_columns import SweepColumns
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.measurements.returned_ids import rejoined_remark
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.layouts import OF_SPACE, EstimatesLayout, carried_columns
from nlosctl.io.results.measurement_layouts import FlagsLayout, TraceLayout
from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.pipeline.engine.writing import ChunkTables, describe_inputs, file_metadata, read_settings
from nlosctl.pipeline.solve.added_columns import ADDED, check_added, further_columns, optional_columns
from nlosctl.pipeline.solve.flat_plane import flat_plane_errors, flat_plane_remarks
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.pipeline.solve.report import RunReport, method_remarks
from nlosctl.pipeline.solve.sensor_residuals import add_residuals
from nlosctl.pipeline.solve.solve_chunk import ChunkSolution, ChunkSolver
from nlosctl.pipeline.solve.sweeps import refuse_swept_columns
from nlosctl.pipeline.solve.target_heights import check_geometry, geometry_remarks, height_settings, with_target_heights

__all__ = ["MeasurementRun"]

_ON_EARTH = ("lat_deg", "lon_deg", "frame")


class MeasurementRun:
    """Solves everything that a reader yields by one or several methods; ``wanted`` are the names of the tables to make.

    ``schemas`` are known before the first chunk; ``report`` is complete when ``tables`` has ended.
    """

    def __init__(
        self,
        reader: MeasurementReader,
        runs: Sequence[MethodRun],
        options: SolveOptions,
        write: OutputOptions,
        wanted: Collection[str],
        summarized: bool = False,
    ) -> None:
        self.reader, self._runs, self._options, self._write = reader, tuple(runs), options, write
        self._wanted = tuple(wanted)
        check_geometry(reader, runs, options)
        self._optional = self._optional_columns()
        self._layouts = self._wanted_layouts()
        want_flags = "flags" in wanted or any(ADDED[word].needs_flags for word in write.add)
        of_sensors = reader.kind != "triplets" and all(run.spec.job == "localize" for run in self._runs)
        self._counts_residuals = of_sensors and (want_flags or write.report is not None or summarized)
        read: dict[str, Any] = {"kind": reader.kind, "scene": reader.scene, "dimension": reader.dimension}
        self._solver = ChunkSolver(
            **read,
            runs=self._runs,
            calibration=reader.options.calibration,
            field=options.field,
            block_size=options.block_size,
            alternatives=options.alternatives,
            want_flags=want_flags or self._counts_residuals,
            want_details=write.details,
            want_trace="trace" in wanted,
        )
        self.report = self._new_report()
        self.report.settings = self.provenance()

    @property
    def schemas(self) -> dict[str, Any]:
        """The Arrow schema of each wanted table by its name."""
        return {name: layout.schema for name, layout in self._layouts.items()}

    def plan(self) -> list[str]:
        """Return what the run will do: a line for the data and one for each method."""
        scene, options = self.reader.scene, self._options
        lines = [
            f"scene: {len(scene.sensors)} sensors, {len(scene.reflectors)} reflectors; seed {options.seed}, "
            f"jobs {options.jobs}, blocks of {options.block_size} snapshots"
        ]
        for run in self._runs:
            parameters = ", ".join(f"{name}={value}" for name, value in dataclasses.asdict(run.options).items())
            lines.append(f"{run.spec.full_name}: {parameters or 'no parameters'}")
        return lines

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files; the rows of each input are known after ``tables`` has ended."""
        described = describe_inputs(inputs, self.reader.report.rows_by_file, with_hash=with_hash)
        return file_metadata(command, {**self.provenance(), "inputs": described}, self.reader.scene)

    def provenance(self) -> dict[str, Any]:
        """Return the methods, their parameters and the other options that determine the results, as plain values."""
        options = self._options
        methods = [
            {"name": run.spec.full_name, "parameters": dataclasses.asdict(run.options)}
            | ({"estimated": list(run.learned.values)} if run.learned else {})
            | ({} if run.std is None else {"estimated_std": run.std.as_dict()})
            for run in self._runs
        ]
        content = {"methods": methods, "seed": options.seed, "field": str(options.field)}
        return content | read_settings(self.reader) | height_settings(options)

    def choices(self) -> dict[str, Any]:
        """Return the other options that two runs must share to write equal tables, as plain values."""
        write = self._write
        return {
            "alternatives": self._options.alternatives,
            "carry": list(write.carry),
            "details": write.details,
            "ellipse": write.ellipse,
            "add": list(write.add),
        }

    def metrics(self, job: str) -> list[dict[str, Any]]:
        """Return the metrics of each method after the run, those of `METRICS`, for conditions on them."""
        from nlosctl.pipeline.solve.run_metrics import run_metrics

        return run_metrics(job, self._runs, self.report)

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the results of each chunk in input order, by ``jobs`` processes."""
        chunks = map(self._without_unused_columns, self.reader.chunks())
        solved = map(self._solve, chunks) if jobs == 1 else map_in_processes(self._solve, chunks, jobs)
        for tables, counts in solved:
            self.report.take(counts)
            yield tables
        self._finish()

    def add_notes(self, remarks: Sequence[str]) -> None:
        """Add the notes on the counts to the report, after the ``remarks`` of the reader."""
        advice, known = self._advice(), [*self.reader.schema.names, *self.reader.constants]
        self.report.notes += [
            *remarks,
            *(rejoined_remark(self.report.rejoined) if self.report.rejoined else ()),
            *geometry_remarks(self.reader, self._runs, self._options),
            *(flat_plane_remarks(self.report.flat_plane) if self.report.flat_plane else ()),
            *method_remarks(self._runs, self.report, known, self._options, advised=bool(advice)),
            *advice,
        ]

    def _advice(self) -> list[str]:
        if not self.report.refits and any(tally.answered for tally in self.report.methods.values()):
            return []
        from nlosctl.pipeline.solve.advice import advice

        return advice(self._runs, self.report, self.reader)

    def _optional_columns(self) -> frozenset[str]:
        """Return the optional columns of the estimates; raises UsageError for columns that can't be there."""
        write = self._write
        names: set[str] = set() if self.reader.options.window is None else {"time_s"}
        names |= set(OF_SPACE) if self.reader.dimension == 3 else set()
        if write.ellipse is not None or write.add:
            names |= optional_columns(write.ellipse, write.add, self.reader.dimension)
            check_added(write.add, self.reader, self._runs)
        if self.reader.scene.frame is not None:
            names |= {*_ON_EARTH, *(("height_m",) if self.reader.scene.frame.on_ellipsoid else ())}
        if any(run.spec.covariance_kinds for run in self._runs):
            names.add("covariance_kind")
        for run in self._runs:
            names.update(run.spec.all_estimate_columns(run.options, self.reader.dimension))
        return frozenset(names.union(() if self._options.estimate_std is None else ("std_factor", "std_dof")))

    def _wanted_layouts(self) -> dict[str, Any]:
        reader, sweeps, methods = self.reader, None, tuple(run.spec.name for run in self._runs)
        if any(run.sweep for run in self._runs):
            sweeps = SweepColumns([run.sweep for run in self._runs])
            refuse_swept_columns(sweeps.points, reader.column_names)
        shared: dict[str, Any] = {
            "methods": methods,
            "input_schema": reader.table_schema,
            "with_source": reader.has_several_sources,
            "sweeps": sweeps,
        }
        layouts: dict[str, Any] = {}
        carried = carried_columns(reader.column_names, self._write.carry, reader.options.by)
        if "estimates" in self._wanted:
            single = KINDS[reader.kind].measurement_name
            layouts["estimates"] = EstimatesLayout(
                **shared,
                carried=carried,
                optional=self._optional,
                measurement_name=single if single in reader.schema.names else "",
                frame="" if reader.scene.frame is None else reader.scene.frame.words,
            )
        if "flags" in self._wanted:
            layouts["flags"] = FlagsLayout(**shared, names=self._flag_names(), constants=reader.constants)
        if "trace" in self._wanted:
            layouts["trace"] = TraceLayout(**shared)
            if not any(run.spec.traces for run in self._runs):
                names = ", ".join(dict.fromkeys(methods))
                raise UsageError(f"`trace_out`: {names} has no steps to trace; sequential has")
        return layouts

    def _flag_names(self) -> tuple[str, ...]:
        given, reader = self.reader.measured_columns | set(self.reader.schema.names), self.reader
        asked: dict[str, Any] = {"details": self._write.details, "dimension": reader.dimension}
        columns = (run.spec.flag_columns(run.options, reader.scene, given, **asked) for run in self._runs)
        factors = self._options.estimate_std == "sensor" or reader.options.calibration is not None
        return tuple(dict.fromkeys(name for names in (*columns, ("std_factor",) * factors) for name in names))

    def _without_unused_columns(self, chunk: Chunk) -> Chunk:
        """Return the chunk with only those columns of its table that results carry: it may be sent to a process."""
        if "flags" in self._wanted or "trace" in self._wanted:
            return chunk
        layout = self._layouts["estimates"]
        by_sensor = self._counts_residuals or self._options.estimate_std == "sensor"
        sensors = {"sensor", "reference"} & set(chunk.table.column_names) if by_sensor else set()
        names = {*layout.carried, layout.measurement_name, *sensors} - {""}
        return dataclasses.replace(chunk, table=chunk.table.select(sorted(names)))

    def _solve(self, chunk: Chunk) -> tuple[ChunkTables, dict[str, Any]]:
        """Return the tables of a chunk, and its counts."""
        write, chunk = self._write, with_target_heights(chunk, self.reader.dimension, self._options)
        at_mean = chunk
        if self.reader.options.keep_times:
            from nlosctl.pipeline.solve.motion.moving_sources import at_mean_time, with_row_times

            chunk = with_row_times(chunk, self.reader)
            at_mean = at_mean_time(chunk)
        if self.reader.scene.reflectors:
            from nlosctl.pipeline.solve.reflected_ranges import refuse_reflected_ranges

            refuse_reflected_ranges(chunk, self.reader.kind, self.reader.scene, self._runs)
        solution = self._solver.solve(chunk, self._seeds(chunk))
        named: dict[str, Any] = {}
        if "estimates" in self._layouts and solution.estimates is not None:
            estimates = solution.estimates
            if self._optional - {"covariance_kind", "std_factor", "std_dof"}:
                columns = further_columns(self._solver, at_mean, solution, write.ellipse, write.add)
                estimates = dataclasses.replace(estimates, columns={**estimates.columns, **columns})
            named["estimates"] = self._layouts["estimates"].table(estimates, at_mean)
        if "flags" in self._layouts:
            named["flags"] = self._layouts["flags"].table(solution.flags, chunk)
        if solution.trace is not None:
            named["trace"] = self._layouts["trace"].table(solution.trace, chunk)
        tables = ChunkTables(named=named, rows=int(chunk.offsets[-1]), windows=chunk.windows)
        return tables, self._counts(chunk, solution)

    def _seeds(self, chunk: Chunk) -> SeedArray:
        if not any(run.spec.randomized for run in self._runs):
            return np.zeros(len(chunk.snapshot), dtype=np.uint64)
        return snapshot_seeds(self._options.seed, chunk.snapshot_ids())

    def _new_report(self) -> RunReport:
        return RunReport(
            kind=self.reader.kind,
            inputs=[],
            methods={run.label: MethodTally(residuals={} if self._counts_residuals else None) for run in self._runs},
            learned={run.label: run.learned for run in self._runs if run.learned is not None},
        )

    def _counts(self, chunk: Chunk, solution: ChunkSolution) -> dict[str, Any]:
        """Return the counts of a chunk, for the report to take."""
        report, frame = self._new_report(), self.reader.scene.frame
        report.rows = int(chunk.offsets[-1])
        taking_part = np.add.reduceat(~chunk.left_out, chunk.offsets[:-1], dtype=np.int64)
        report.largest_snapshot = int(taking_part.max())
        if "path" in self.reader.schema.names and self.reader.kind != "triplets":
            from nlosctl.pipeline.solve.outlier_shares import competing_rows

            report.competing_rows = competing_rows(chunk)
        for number, run in enumerate(self._runs):
            tally = report.methods[run.label]
            if solution.estimates is not None:
                tally.add_estimates(solution.estimates, number)
            if solution.flags and run.spec.job != "localize":
                tally.add_verdicts(solution.flags[number].columns)
            if tally.residuals is not None:
                add_residuals(tally.residuals, chunk, solution, number, self.reader.kind)
        robust = [(n, report.methods[run.label]) for n, run in enumerate(self._runs) if hasattr(run.options, "alpha")]
        if robust and solution.estimates is not None:
            from nlosctl.pipeline.solve.outlier_shares import count_lone_rows

            count_lone_rows(robust, chunk, solution.estimates)
        named = [run for run in self._runs if run.spec.job != "identify-los" or run.spec.kind == "bearings"]
        suspect = any(report.methods[run.label].mostly_bad for run in named)
        if suspect and self.reader.dimension == 2 and not self.reader.options.keep_times:
            from nlosctl.pipeline.solve.likely_causes import fit_after_changes

            report.refits.update(fit_after_changes(chunk, self.reader))
        if self.reader.dimension == 2 and frame is not None and solution.estimates is not None:
            report.flat_plane = flat_plane_errors(frame, self.reader.kind, chunk, solution.estimates)
        return report.counts()

    def _finish(self) -> None:
        read = self.reader.report
        self.report.snapshots, self.report.rows_left_out = read.snapshots, read.left_out_rows
        self.report.bad_rows, self.report.snapshots_lost = read.bad_rows, read.snapshots_lost
        self.report.rejoined, self.report.windows = read.rejoined, read.windows
        self.report.inputs = [{"name": name, "rows": rows} for name, rows in read.rows_by_file.items()]
        if not self.reader.reads_one_part:
            self.add_notes(read.remarks)
