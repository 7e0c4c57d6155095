"""Jobs over measurements: solve them (or bound them) and write all tables or none."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any

from nlosctl.contract.methods import Job
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import format_named
from nlosctl.io.results.layouts import carried_names
from nlosctl.io.writers.output_set import OutputSet, is_folder_target
from nlosctl.jobs.files import (
    Destination,
    Opened,
    naming_importer,
    open_inputs,
    open_measurements,
    open_output,
    write_report,
)
from nlosctl.pipeline.engine.workers import usable_jobs
from nlosctl.pipeline.engine.writing import ChunkTables, Run, write_tables
from nlosctl.pipeline.solve.method_runs import MethodRun, leaves_options_open, method_runs, require_estimates
from nlosctl.pipeline.solve.run import MeasurementRun

__all__ = ["Execution", "check_conditions", "input_passes", "met_conditions", "readable_again", "solve"]

_POOLED = ("file", "sensor")
"""What may have a factor of its standard deviations that takes passes over the input."""


def solve(
    job: Job,
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
) -> MeasurementRun:
    """Solve measurements by the methods of ``options`` and write the tables; return the run with its report.

    The tables are estimates, flags and trace. Raises DataError for faults of the data, UsageError for options that do
    not suit the data or contradict each other.
    """
    wanted = tuple(destination.wanted)
    options = dataclasses.replace(options, jobs=options.jobs or usable_jobs(0))
    read = dataclasses.replace(
        read,
        use_threads=options.jobs != 1,
        missing_std=_missing_std(job, options),
        unlabelled="always" if job == "identify-los" else "",
        keep_times="motion" if _needs_times(options) else "",
        extra_columns=read.extra_columns if "flags" in wanted else carried_names((*write.carry, *read.by)),
    )
    with naming_importer(inputs):
        given = open_inputs(inputs, read.input_format)
    with (
        readable_again(given, read, options) if _may_need_passes(options) else nullcontext(given) as sources,
        open_measurements(sources, read, write, destination) as opened,
    ):
        runs = method_runs(options.method, opened.reader.kind, job, options.parameters, options.sweep)
        if "estimates" in wanted:
            require_estimates(runs)
        if options.estimate_std is not None:
            if read.calibration is not None:
                raise UsageError("`estimate_std` and `calibration` both scale standard deviations; leave out one")
            from nlosctl.pipeline.solve.stds.unknown_std import with_unknown_std

            runs = with_unknown_std(runs, opened.reader.kind, options.estimate_std)
        shown = not destination.console.quiet
        start = partial(MeasurementRun, runs=runs, options=options, write=write, wanted=wanted, summarized=shown)
        run = start(opened.reader)
        if _needs_passes(runs, options):
            start = partial(start, runs=_learn(runs, opened, options, write, destination))
            run = start(opened.reader)
        for line in run.plan():
            destination.console.detail(line)
        Execution(job, run, start, opened, options, write, destination).complete()
    return run


def _missing_std(job: Job, options: SolveOptions) -> str:
    """Return what becomes of missing standard deviations, see `InputOptions`."""
    if options.estimate_std is not None:
        return "unit"
    return "estimable" if job == "localize" else "error"


def _needs_times(options: SolveOptions) -> bool:
    """Return whether a method estimates velocities: whether it has the parameter ``motion``, other than none."""
    given = {**options.parameters, **options.sweep}
    return any(name.rpartition(":")[2] == "motion" and value != "none" for name, value in given.items())


def _may_need_passes(options: SolveOptions) -> bool:
    """Return whether the settings ask for anything that is estimated from the whole input."""
    return leaves_options_open(options.parameters) or options.estimate_std in _POOLED


def _needs_passes(runs: Sequence[MethodRun], options: SolveOptions) -> bool:
    """Return whether anything is estimated from the whole input before the run."""
    return options.estimate_std in _POOLED or any(method.open_options for method in runs)


def readable_again(
    inputs: Sequence[Input], read: InputOptions, options: SolveOptions
) -> AbstractContextManager[Sequence[Input]]:
    """Return the inputs, with streams that can be read several times."""
    from nlosctl.io.paths.spooled import spooled
    from nlosctl.pipeline.engine.slices import refuse_streams

    if options.engine != "local":
        refuse_streams(inputs)
    return spooled(inputs, read.max_spool_bytes)


def input_passes(opened: Opened, options: SolveOptions, write: OutputOptions) -> Any:
    """Return the passes over opened inputs, by the processes or the cluster of ``options``."""
    from nlosctl.pipeline.engine.passes import InputPasses

    return InputPasses(
        inputs=tuple(opened.inputs),
        options=opened.reader.options,
        survey=opened.reader.survey(),
        jobs=options.jobs,
        engine=None if options.scheduler is None else _cluster(options),  # processes serve as well as a local cluster
        ignores_bad_rows=write.bad_rows is not None,
    )


def _learn(
    runs: Sequence[MethodRun], opened: Opened, options: SolveOptions, write: OutputOptions, destination: Destination
) -> list[MethodRun]:
    """Return the runs with open options, or the factors of standard deviations, estimated from the whole input."""
    reader, passes, show = opened.reader, input_passes(opened, options, write), destination.console.detail
    if options.estimate_std is not None:
        from nlosctl.pipeline.solve.stds.std_passes import estimate_stds

        return estimate_stds(runs, options.estimate_std, reader.kind, reader.scene, options, passes, show)
    from nlosctl.pipeline.solve.learned_options import learn_options

    return learn_options(runs, reader.kind, reader.scene, options, passes, show)


def _cluster(options: SolveOptions) -> Any:
    from nlosctl.pipeline.engine.dask_engine import dask_engine

    return dask_engine(options.scheduler, options.jobs or usable_jobs(0), options.worker_timeout)


def check_conditions(fail_if: Sequence[str], job: Job, methods: Sequence[str]) -> None:
    """Raise UsageError for a condition of ``fail_if`` on a metric or method that the run does not have."""
    if fail_if:
        from nlosctl.pipeline.evaluate.fail_conditions import parse_condition
        from nlosctl.pipeline.solve.run_metrics import METRICS

        for text in fail_if:
            parse_condition(text).check([{"method": method} for method in methods], METRICS[job])


def met_conditions(fail_if: Sequence[str], job: Job, run: MeasurementRun) -> list[str]:
    """Return a line for each method that meets a condition of ``fail_if`` after the run."""
    if not fail_if:
        return []
    from nlosctl.pipeline.evaluate.fail_conditions import parse_condition

    groups = run.metrics(job)
    return [reason for text in fail_if for reason in parse_condition(text).reasons(groups)]


@dataclass(frozen=True)
class Execution:
    """A run from its first chunk to its files; ``start`` returns an equal run over another reader."""

    job: str
    run: Run
    start: Callable[[MeasurementReader], Run]
    opened: Opened
    options: SolveOptions
    write: OutputOptions
    destination: Destination

    def complete(self) -> None:
        """Write all tables and the report file; a run that fails leaves no file."""
        if any(map(is_folder_target, self.destination.wanted.values())):
            self._write_folders()
        elif self.write.resume:
            raise UsageError("`resume` continues a run into a folder: set `output` to FOLDER/, or leave `resume` out")
        else:
            self._write_files()

    def _write_files(self) -> None:
        def metadata() -> dict[str, str]:
            return self.run.metadata(self.job, self.opened.inputs, with_hash=self.write.hash)

        with OutputSet() as outputs:
            first = metadata()

            def sink(name: str, target: str) -> Any:
                schema = self.run.schemas[name]
                if name in self.destination.sinks:
                    return self.destination.sinks[name](schema)
                return outputs.take(open_output(target, schema, self.write, self.opened.protected, first))

            sinks = {name: sink(name, target) for name, target in self.destination.wanted.items()}
            self.opened.set_bad_rows_aside(self.write, outputs)
            with self.destination.console.progress(self.job) as progress:
                write_tables(self._tables(), sinks, metadata, lambda rows: progress(rows, None))
                write_report(self.write, self.run.report.as_dict(), outputs, self.destination.console)

    def _tables(self) -> Iterator[ChunkTables]:
        """Return the tables of the run, made by the chosen engine."""
        if self.options.engine == "local" and self.options.jobs == 1:
            return self.run.tables()
        from nlosctl.pipeline.engine.slices import cluster_tables, local_tables

        if self.options.engine == "local":
            return local_tables(self.run, self.start, self.opened.inputs, self.options.jobs)
        return cluster_tables(self.run, self.start, self.opened.inputs, _cluster(self.options))

    def _write_folders(self) -> None:
        from nlosctl.pipeline.engine.folder_run import FolderRun
        from nlosctl.pipeline.engine.parts import BAD_ROWS

        roots = self.destination.wanted
        if self.write.bad_rows is not None:
            roots[BAD_ROWS] = self.write.bad_rows
        files = [target for target in roots.values() if not is_folder_target(target)]
        if files:
            raise UsageError(f"{files[0]}: the other tables are written to folders; give this one a folder too (NAME/)")
        writer = FolderRun(
            self.run,
            self.start,
            self.job,
            self.opened.inputs,
            roots,
            format=None if self.write.format is None else format_named(self.write.format),
            with_hash=self.write.hash,
        )
        with self.destination.console.progress(self.job) as progress:
            writer.write(
                None if self.options.engine == "local" else _cluster(self.options),
                self.options.jobs,
                resume=self.write.resume,
                overwrite=self.write.overwrite,
                progress=lambda rows: progress(rows, None),
            )
        with OutputSet() as outputs:
            write_report(self.write, self.run.report.as_dict(), outputs, self.destination.console)
