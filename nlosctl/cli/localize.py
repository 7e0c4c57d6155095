"""``nlosctl localize``: measurements to estimates."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nlosctl.cli.options import (
    AllRows,
    BadRows,
    BearingStdDeg,
    BlockSize,
    Carry,
    Columns,
    ConfigFile,
    Debug,
    Format,
    Hash,
    InputFormat,
    Inputs,
    Jobs,
    Kind,
    MaxSnapshotRows,
    Output,
    Overwrite,
    Params,
    Quiet,
    RangeStdM,
    Report,
    SceneFile,
    Seed,
    Verbose,
    key_values,
)
from nlosctl.cli.reading import Opened, ReadWords, open_measurements, open_output
from nlosctl.cli.terminal import Preview, Terminal, write_report
from nlosctl.errors import UsageError

if TYPE_CHECKING:
    from nlosctl.io.write import TableWriter
    from nlosctl.pipeline.run import MeasurementRun

__all__ = ["localize"]

_UNANSWERED = 3


def localize(
    inputs: Inputs,
    method: Annotated[
        list[str], typer.Option("--method", "-m", metavar="NAME", help="Method (see 'nlosctl methods'). Repeatable.")
    ] = ["ml"],  # noqa: B006 - typer copies it
    param: Params = [],  # noqa: B006
    output: Output = "-",
    flags_out: Annotated[
        str | None, typer.Option("--flags-out", metavar="FILE", help="Write the flags: a row per measurement.")
    ] = None,
    alternatives: Annotated[
        int, typer.Option("--alternatives", min=1, metavar="N", help="At most N estimates per snapshot and target.")
    ] = 1,
    scene: SceneFile = None,
    kind: Kind = None,
    column: Columns = [],  # noqa: B006
    bearing_std_deg: BearingStdDeg = None,
    range_std_m: RangeStdM = None,
    all_rows: AllRows = False,
    carry: Carry = [],  # noqa: B006
    bad_rows: BadRows = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit 3 when some snapshot got no estimate.")] = False,
    format: Format = None,
    input_format: InputFormat = None,
    overwrite: Overwrite = False,
    seed: Seed = 0,
    jobs: Jobs = 0,
    block_size: BlockSize = 4096,
    max_snapshot_rows: MaxSnapshotRows = 1_000_000,
    report: Report = None,
    hash: Hash = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> int:
    """Estimate positions from bearings, with covariances and a status for every snapshot.

    Without -o a terminal shows a preview, a pipe gets CSV. Exit codes: 0 done, 1 bad data or files, 2 the words of
    the command line, 3 under --strict when some snapshot got no estimate, 130 interrupted.
    """
    from nlosctl.pipeline.parameters import method_runs
    from nlosctl.pipeline.run import MeasurementRun, RunSettings
    from nlosctl.pipeline.workers import usable_jobs

    terminal = Terminal(quiet=quiet, verbose=verbose)
    jobs = usable_jobs(jobs)
    words = ReadWords(
        inputs=inputs,
        input_format=input_format,
        kind=kind,
        scene=scene,
        columns=column,
        bearing_std_deg=bearing_std_deg,
        range_std_m=range_std_m,
        all_rows=all_rows,
        max_snapshot_rows=max_snapshot_rows,
        bad_rows=bad_rows,
        overwrite=overwrite,
        one_thread=jobs == 1,
    )
    with open_measurements(words) as opened:
        runs = method_runs(method, opened.reader.kind, "localize", key_values(param, "--param"))
        settings = RunSettings(
            seed=seed,
            jobs=jobs,
            block_size=block_size,
            alternatives=alternatives,
            carry=tuple(carry),
            want_flags=flags_out is not None,
        )
        run = MeasurementRun(opened.reader, runs, settings)
        _write(run, opened, Outputs(output, flags_out, format, overwrite, hash), terminal)
    for line in run.report.lines():
        terminal.note(line)
    if report is not None:
        write_report(report, run.report.as_dict())
    return _UNANSWERED if strict and run.report.unanswered else 0


@dataclass(frozen=True)
class Outputs:
    """Where the tables go."""

    estimates: str
    flags: str | None
    format: str | None
    overwrite: bool
    with_hash: bool


def _write(run: MeasurementRun, opened: Opened, outputs: Outputs, terminal: Terminal) -> None:
    if outputs.flags == outputs.estimates:
        raise UsageError(f"-o and --flags-out both name {outputs.flags!r}; give two names")
    preview = Preview.wanted(outputs.estimates, outputs.format)
    metadata = run.metadata("localize", opened.inputs, with_hash=outputs.with_hash)
    with ExitStack() as stack:

        def open_sink(target: str, schema: Any, format: str | None) -> TableWriter:
            return stack.enter_context(
                open_output(
                    target,
                    schema,
                    format_name=format,
                    overwrite=outputs.overwrite,
                    inputs=opened.paths,
                    metadata=metadata,
                )
            )

        estimates = preview or open_sink(outputs.estimates, run.estimates_schema, outputs.format)
        flags = None if outputs.flags is None else open_sink(outputs.flags, run.flags_schema, None)
        progress = stack.enter_context(terminal.progress("localize"))
        rows = 0
        for tables in run.tables():
            estimates.write(tables.estimates)
            if flags is not None:
                flags.write(tables.flags)
            rows += tables.rows
            progress(rows, None)
        closing = run.metadata("localize", opened.inputs, with_hash=outputs.with_hash)
        for sink in (estimates, flags):
            if sink is not None:
                sink.set_metadata(closing)
    if preview is not None:
        preview.show()
