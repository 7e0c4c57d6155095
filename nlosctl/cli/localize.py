"""``nlosctl localize``: measurements to estimates."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options import (
    Add,
    AllRows,
    BadRows,
    BearingStdDeg,
    BlockSize,
    Carry,
    Columns,
    ConfigFile,
    Crs,
    Debug,
    DoaStdDeg,
    DodStdDeg,
    Ellipse,
    Engine,
    Format,
    Hash,
    InputFormat,
    Inputs,
    Jobs,
    Kind,
    MaxSnapshotRows,
    Methods,
    Origin,
    Output,
    Overwrite,
    Params,
    PathLengthStdM,
    Quiet,
    RangeStdM,
    Report,
    Resume,
    SceneFile,
    Scheduler,
    SearchField,
    Seed,
    Sweeps,
    TargetZM,
    Verbose,
    key_values,
)
from nlosctl.cli.reading import ReadWords, added_columns, open_measurements
from nlosctl.cli.solving import Outputs, exit_code, solve_and_write
from nlosctl.cli.terminal import Terminal

__all__ = ["localize"]


def localize(
    inputs: Inputs,
    method: Methods = ["ml"],  # noqa: B006 - typer copies it
    param: Params = [],  # noqa: B006
    sweep: Sweeps = [],  # noqa: B006
    output: Output = "-",
    flags_out: Annotated[
        str | None, typer.Option("--flags-out", metavar="FILE", help="Write the flags: a row per measurement.")
    ] = None,
    trace_out: Annotated[
        str | None,
        typer.Option("--trace-out", metavar="FILE", help="Write the state after each sensor (sequential methods)."),
    ] = None,
    alternatives: Annotated[
        int, typer.Option("--alternatives", min=1, metavar="N", help="At most N estimates per snapshot and target.")
    ] = 1,
    scene: SceneFile = None,
    crs: Crs = None,
    origin: Origin = None,
    kind: Kind = None,
    column: Columns = [],  # noqa: B006
    bearing_std_deg: BearingStdDeg = None,
    range_std_m: RangeStdM = None,
    dod_std_deg: DodStdDeg = None,
    doa_std_deg: DoaStdDeg = None,
    path_length_std_m: PathLengthStdM = None,
    field: SearchField = "sensors:1",
    target_z_m: TargetZM = None,
    all_rows: AllRows = False,
    ellipse: Ellipse = None,
    add: Add = "",
    carry: Carry = [],  # noqa: B006
    bad_rows: BadRows = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit 3 when some snapshot got no estimate.")] = False,
    format: Format = None,
    input_format: InputFormat = None,
    overwrite: Overwrite = False,
    resume: Resume = False,
    engine: Engine = "local",
    scheduler: Scheduler = None,
    seed: Seed = 0,
    jobs: Jobs = 0,
    block_size: BlockSize = 8192,
    max_snapshot_rows: MaxSnapshotRows = 1_000_000,
    report: Report = None,
    hash: Hash = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> int:
    """Estimate positions from measurements, with covariances and a status for every snapshot.

    The columns that a file needs: 'nlosctl schema bearings'. Without -o a terminal shows a preview, a pipe gets CSV.
    Exit codes: 0 done, 1 bad data or files, 2 the words of the command line, 3 under --strict when some snapshot got
    no estimate, 130 interrupted.
    """
    from nlosctl.contract.fields import parse_field
    from nlosctl.io.result_tables import carried_names
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
        crs=crs,
        origin=origin,
        columns=column,
        bearing_std_deg=bearing_std_deg,
        range_std_m=range_std_m,
        dod_std_deg=dod_std_deg,
        doa_std_deg=doa_std_deg,
        path_length_std_m=path_length_std_m,
        all_rows=all_rows,
        max_snapshot_rows=max_snapshot_rows,
        bad_rows=bad_rows,
        overwrite=overwrite,
        one_thread=jobs == 1,
        config=config,
        extra_columns=None if flags_out is not None else carried_names(carry),
        tables=(output, flags_out, trace_out),
        outputs=(None if report == "-" else report,),
    )
    with open_measurements(words) as opened:
        runs = method_runs(
            method, opened.reader.kind, "localize", key_values(param, "--param"), key_values(sweep, "--sweep")
        )
        settings = RunSettings(
            seed=seed,
            jobs=jobs,
            block_size=block_size,
            alternatives=alternatives,
            carry=tuple(carry),
            ellipse=ellipse,
            add=added_columns(add),
            field=parse_field(field),
            target_z_m=target_z_m,
            want_flags=flags_out is not None,
            want_trace=trace_out is not None,
        )
        run = MeasurementRun(opened.reader, runs, settings)
        for line in run.plan():
            terminal.detail(line)
        outputs = Outputs(
            tables={"estimates": output, "flags": flags_out, "trace": trace_out},
            format=format,
            overwrite=overwrite,
            resume=resume,
            engine=engine,
            scheduler=scheduler,
            bad_rows=bad_rows,
            with_hash=hash,
            jobs=jobs,
            report=report,
        )
        solve_and_write(run, opened, outputs, "localize", terminal)
    return exit_code(run, strict=strict)
