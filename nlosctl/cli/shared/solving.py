"""What the commands share that make tables of measurements: run, write the tables, tell the summary."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from nlosctl.cli.options.declarations import key_values
from nlosctl.cli.options.groups import SolvingOptions
from nlosctl.cli.shared.reading import Opened, ReadWords, added_columns, open_measurements, open_output
from nlosctl.cli.shared.terminal import Preview, Terminal, tell, tell_report, write_report
from nlosctl.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from nlosctl.contract.methods import Job
    from nlosctl.pipeline.engine.folder_run import Engine
    from nlosctl.pipeline.engine.writing import ChunkTables, Run
    from nlosctl.pipeline.solve.run import MeasurementRun
    from nlosctl.pipeline.solve.settings import RunSettings

__all__ = ["Outputs", "reading_words", "run_methods", "run_settings", "solve_and_write"]

_NOTHING_TO_DO = 1
_UNANSWERED = 3
_ENGINES = ("local", "dask")


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """Where the tables go, by their names, None if not wanted; the first is what the command is for."""

    tables: Mapping[str, str | None]
    format: str | None
    overwrite: bool
    resume: bool = False
    engine: str = "local"
    scheduler: str | None = None
    bad_rows: str | None = None
    with_hash: bool = False
    jobs: int = 1
    report: str | None

    @property
    def wanted(self) -> dict[str, str]:
        """The tables that are wanted."""
        return {name: target for name, target in self.tables.items() if target is not None}


def reading_words(inputs: Sequence[str], options: SolvingOptions, *tables: str | None) -> ReadWords:
    """Return what the options that all solving commands share say of the inputs; ``tables`` will be written."""
    from nlosctl.pipeline.engine.workers import usable_jobs

    return ReadWords(
        inputs=inputs,
        input_format=options.input_format,
        crs=options.crs,
        origin=options.origin,
        columns=options.column,
        all_rows=options.all_rows,
        max_snapshot_rows=options.max_snapshot_rows,
        bad_rows=options.bad_rows,
        overwrite=options.overwrite,
        one_thread=usable_jobs(options.jobs) == 1,
        config=options.config,
        tables=(options.output, *tables),
        outputs=(None if options.report == "-" else options.report,),
    )


def run_settings(options: SolvingOptions) -> RunSettings:
    """Return what the options that all solving commands share say of the run."""
    from nlosctl.pipeline.engine.workers import usable_jobs
    from nlosctl.pipeline.solve.settings import RunSettings

    return RunSettings(
        seed=options.seed,
        jobs=usable_jobs(options.jobs),
        block_size=options.block_size,
        carry=tuple(options.carry),
        ellipse=options.ellipse,
        add=added_columns(options.add),
    )


def run_methods(
    job: Job,
    methods: Sequence[str],
    words: ReadWords,
    settings: RunSettings,
    tables: Mapping[str, str | None],
    options: SolvingOptions,
    *,
    strict: bool = False,
) -> int:
    """Solve what ``words`` name by the methods, write the ``tables``, and return how the command ends."""
    from nlosctl.pipeline.solve.method_runs import method_runs, require_estimates
    from nlosctl.pipeline.solve.run import MeasurementRun

    terminal = Terminal(quiet=options.quiet, verbose=options.verbose)
    outputs = Outputs(
        tables=tables,
        format=options.format,
        overwrite=options.overwrite,
        resume=options.resume,
        engine=options.engine,
        scheduler=options.scheduler,
        bad_rows=options.bad_rows,
        with_hash=options.hash,
        jobs=settings.jobs,
        report=options.report,
    )
    given, swept = key_values(options.param, "--param"), key_values(options.sweep, "--sweep")
    with open_measurements(words) as opened:
        runs = method_runs(methods, opened.reader.kind, job, given, swept)
        if settings.want_estimates:
            require_estimates(runs)
        run = MeasurementRun(opened.reader, runs, settings)
        for line in run.plan():
            terminal.detail(line)
        solve_and_write(run, opened, outputs, job, terminal)
    return _exit_code(run, strict=strict)


def solve_and_write(run: Run, opened: Opened, outputs: Outputs, command: str, terminal: Terminal) -> None:
    """Run to the end, write all tables, tell the summary on standard error and in the report file."""
    from nlosctl.io.writers.output_set import is_folder_target

    _check_engine(outputs)
    if any(is_folder_target(target) for target in outputs.wanted.values()):
        _write_folders(run, opened, outputs, command, terminal)
    elif outputs.resume:
        raise UsageError("--resume goes on with a folder of parts: give -o FOLDER/ (a single file is made in one go)")
    else:
        _write_files(run, opened, outputs, command, terminal)
    for line in run.report.lines():
        terminal.note(line)
    tell_report(outputs.report, run.report.as_dict())


def _write_files(run: Run, opened: Opened, outputs: Outputs, command: str, terminal: Terminal) -> None:
    from nlosctl.io.writers.output_set import OutputSet
    from nlosctl.pipeline.engine.writing import write_tables

    main, *_ = outputs.wanted
    preview = Preview.wanted(outputs.wanted[main], outputs.format)

    def metadata() -> dict[str, str]:
        return run.metadata(command, opened.inputs, with_hash=outputs.with_hash)

    with OutputSet() as whole, ExitStack() as stack:

        def open_sink(name: str, target: str) -> Any:
            return whole.take(
                open_output(
                    target,
                    run.schemas[name],
                    format_name=outputs.format,
                    overwrite=outputs.overwrite,
                    inputs=opened.paths,
                    metadata=first,
                )
            )

        first = metadata()
        sinks = {
            name: preview if preview is not None and name == main else open_sink(name, target)
            for name, target in outputs.wanted.items()
        }
        if outputs.bad_rows is not None:
            opened.set_bad_rows_aside(outputs.bad_rows, whole, overwrite=outputs.overwrite)
        progress = stack.enter_context(terminal.progress(command))
        tables = stack.enter_context(_tables(run, opened, outputs))
        write_tables(tables, sinks, metadata, lambda rows: progress(rows, None))
        write_report(outputs.report, run.report.as_dict(), whole)
    if preview is not None:
        preview.show()


@contextmanager
def _tables(run: Run, opened: Opened, outputs: Outputs) -> Iterator[Iterable[ChunkTables]]:
    """Give the tables of the run, made by the engine that is asked for."""
    if outputs.engine == "local":
        from nlosctl.pipeline.engine.sliced import tables_of

        yield tables_of(run, opened.inputs, outputs.jobs)
        return
    from nlosctl.io.parts.scratch import scratch_folder
    from nlosctl.pipeline.engine.gathered import gathered_tables

    engine, wanted = _engine(outputs), outputs.wanted
    with scratch_folder(next(iter(wanted.values()))) as scratch:
        yield gathered_tables(run, opened.inputs, list(wanted), engine, scratch)


def _engine(outputs: Outputs) -> Engine:
    if outputs.engine == "local":
        from nlosctl.pipeline.engine.folder_run import in_this_machine

        return in_this_machine(outputs.jobs)
    from nlosctl.pipeline.engine.dask_engine import dask_engine
    from nlosctl.pipeline.engine.workers import usable_jobs

    return dask_engine(outputs.scheduler, usable_jobs(outputs.jobs))


def _check_engine(outputs: Outputs) -> None:
    if outputs.engine not in _ENGINES:
        known = ", ".join(_ENGINES)
        raise UsageError(f"no engine {outputs.engine!r}{did_you_mean(outputs.engine, _ENGINES)}; there are: {known}")
    if outputs.scheduler is not None and outputs.engine != "dask":
        raise UsageError("--scheduler is of the engine dask: say --engine dask too")


def _write_folders(run: Run, opened: Opened, outputs: Outputs, command: str, terminal: Terminal) -> None:
    from nlosctl.io.paths.locations import format_named
    from nlosctl.io.writers.output_set import OutputSet, is_folder_target
    from nlosctl.pipeline.engine.folder_run import FolderRun
    from nlosctl.pipeline.engine.parts import BAD_ROWS

    roots = outputs.wanted
    if outputs.bad_rows is not None:
        roots[BAD_ROWS] = outputs.bad_rows
    files = [target for target in roots.values() if not is_folder_target(target)]
    if files:
        raise UsageError(f"{files[0]}: other tables go into a folder, part by part; give this one a folder too (NAME/)")
    writer = FolderRun(
        run,
        command,
        opened.inputs,
        roots,
        format=None if outputs.format is None else format_named(outputs.format),
        with_hash=outputs.with_hash,
    )
    engine = _engine(outputs)
    if outputs.engine != "local":
        from nlosctl.pipeline.engine.shared_parts import sharing_long_parts

        engine = sharing_long_parts(engine)
    with terminal.progress(command) as progress:
        writer.write(
            engine,
            resume=outputs.resume,
            overwrite=outputs.overwrite,
            progress=lambda rows: progress(rows, None),
        )
    with OutputSet() as whole:
        write_report(outputs.report, run.report.as_dict(), whole)


def _exit_code(run: MeasurementRun, *, strict: bool = False) -> int:
    """Return how the command ends after a run: 1 where every row was bad, 3 where ``strict`` misses an estimate."""
    if not run.report.snapshots:
        tell("nlosctl: nothing to do: every row is bad")
        return _NOTHING_TO_DO
    return _UNANSWERED if strict and run.report.unanswered else 0
