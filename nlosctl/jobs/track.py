"""Job: the paths of moving sources, from estimates or measurements at times."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.contract.tables import measured_names
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.fixes import are_fixes, column_names
from nlosctl.io.results.layouts import carried_names
from nlosctl.io.writers.output_set import OutputSet, check_targets, is_folder_target
from nlosctl.jobs.files import (
    Destination,
    Opened,
    naming_importer,
    open_inputs,
    open_measurements,
    open_output,
    require_columns,
    write_report,
)
from nlosctl.jobs.solve import Execution, readable_again
from nlosctl.pipeline.engine.workers import usable_jobs
from nlosctl.pipeline.engine.writing import write_tables
from nlosctl.pipeline.solve.method_runs import method_runs
from nlosctl.pipeline.track.fix_run import FixRun
from nlosctl.pipeline.track.measured_run import MeasuredRun, PartOfTracks
from nlosctl.pipeline.track.track_options import TrackOptions, track_options

__all__ = ["Motion", "track"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Motion:
    """How sources move, and which rows a state is given.

    ``gap`` is the longest time between rows of one track, as text with its unit; ``causal``: states given the rows
    until then; ``estimate_acceleration``: the density of the acceleration is estimated, not a parameter;
    ``associate``: the targets of snapshots are assigned to tracks.
    """

    gap: str | None = None
    causal: bool = False
    estimate_acceleration: bool = False
    associate: bool = False


def track(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
    motion: Motion | None = None,
) -> Any:
    """Find the paths of moving sources and write their states; return the run with its report.

    Raises DataError for faults of the data, UsageError for options that do not suit the data or contradict each other.
    """
    moves = motion or Motion()
    own, parameters = track_options(
        options.parameters,
        gap=moves.gap,
        causal=moves.causal,
        estimate_acceleration=moves.estimate_acceleration,
        associate=moves.associate,
    )
    options = dataclasses.replace(options, parameters=parameters, jobs=options.jobs or usable_jobs(0))
    with naming_importer(inputs):
        given = open_inputs(inputs, read.input_format)
    into_folders = [target for target in destination.wanted.values() if is_folder_target(target)]
    if into_folders and any(part.path is None for source in given for part in source.parts):
        raise UsageError("standard input has no parts: set `output` to a file, or save the input as one")
    with readable_again(given, read, options) as sources:
        of_fixes = [are_fixes(column_names(source), measured_names()) for source in sources]
        sources = [dataclasses.replace(one, parts=(one.parts[0].again(), *one.parts[1:])) for one in sources]
        if any(of_fixes) and not all(of_fixes):
            raise DataError("the inputs are estimates and measurements; track them one by one")
        if all(of_fixes):
            if into_folders:
                raise UsageError(
                    f"{into_folders[0]}: a track through estimates is written to a file; leave out the / at its end"
                )
            return _track_fixes(sources, read, own, options, write, destination)
        if own.association is not None:
            raise UsageError(
                f"{sources[0].name}: `associate` is for estimates of several targets; find those first, by "
                "identify-los with `estimates_out`, and with `carry` time_s where no `window` makes the snapshots"
            )
        return _track_measurements(sources, read, own, options, write, destination)


def _track_fixes(
    sources: Sequence[Input],
    read: InputOptions,
    own: TrackOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
) -> FixRun:
    """Write the states of tracks through fixes."""
    if options.parameters:
        raise UsageError(f"`parameters` {next(iter(options.parameters))}: a track through estimates has no method")
    if read.window is not None:
        raise UsageError("`window` makes snapshots of measurements, and the input is estimates; leave it out")
    if read.calibration is not None:
        raise UsageError(
            "`calibration` corrects measurements, and the input is estimates; localize with it, or leave it out"
        )
    run = FixRun(sources, read, own, write.carry)
    protected = [part.path for source in sources for part in source.parts if part.path is not None]
    check_targets(
        [None if write.report == "-" else write.report],
        tables=[*destination.targets.values()],
        overwrite=write.overwrite,
        inputs=protected,
    )
    if "flags" in destination.wanted:
        raise UsageError("`flags_out`: flags are of measurements, and the input is estimates")
    with OutputSet() as outputs:
        _write(run, partial(run.metadata, with_hash=write.hash), options.jobs, write, destination, protected, outputs)
    return run


def _track_measurements(
    sources: Sequence[Input],
    read: InputOptions,
    own: TrackOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
) -> MeasuredRun | PartOfTracks:
    """Write the states, and flags, of tracks through measurements; into folders a part file for each of the input."""
    by = tuple(read.by)
    used = None if "flags" in destination.wanted else carried_names((*write.carry, *by))
    read = dataclasses.replace(
        read,
        keep_times="track",
        by=() if read.window is None else by,
        extra_columns=used,
        use_threads=options.jobs != 1,
    )
    with open_measurements(sources, read, write, destination) as opened:
        require_columns(by, opened.reader)
        runs = method_runs(options.method, opened.reader.kind, "localize", options.parameters)
        if len(runs) != 1:
            raise UsageError(f"`method`: a track is found by one method. Got {len(runs)}.")
        run = MeasuredRun(opened.reader, runs[0], options, write, own, by, destination.wanted)
        if any(map(is_folder_target, destination.wanted.values())):
            return _write_folders(run, opened, options, write, destination)
        if write.resume:
            raise UsageError("`resume` continues a run into a folder: set `output` to FOLDER/, or leave `resume` out")
        with OutputSet() as outputs:
            opened.set_bad_rows_aside(write, outputs)
            metadata = partial(run.metadata, "track", opened.inputs, with_hash=write.hash)
            _write(run, metadata, options.jobs, write, destination, opened.protected, outputs)
    return run


def _write_folders(
    run: MeasuredRun, opened: Opened, options: SolveOptions, write: OutputOptions, destination: Destination
) -> PartOfTracks:
    """Write part files of the tables: the tracks are found first, then each part is read again."""
    if write.bad_rows is not None:
        opened.reader.set_bad_rows_aside(lambda rows: None)  # the parts write them
    found = run.solve(options.jobs, keeps=False)
    start = partial(PartOfTracks, whole=run, found=found)
    again = MeasurementReader(opened.inputs, opened.reader.options, survey=opened.reader.survey())
    parts = start(again)
    Execution("track", parts, start, opened, options, write, destination).complete()
    return parts


def _write(
    run: FixRun | MeasuredRun,
    metadata: Callable[[], Mapping[str, str]],
    jobs: int,
    write: OutputOptions,
    destination: Destination,
    protected: Sequence[Any],
    outputs: OutputSet,
) -> None:
    """Write all tables of a run and its report."""
    first = metadata()

    def sink(name: str, target: str) -> Any:
        if name in destination.sinks:
            return destination.sinks[name](run.schemas[name])
        return outputs.take(open_output(target, run.schemas[name], write, protected, first))

    sinks = {name: sink(name, target) for name, target in destination.wanted.items()}
    with destination.console.progress("track") as progress:
        write_tables(run.tables(jobs), sinks, metadata, lambda rows: progress(rows, None))
    write_report(write, run.report.as_dict(), outputs, destination.console)
