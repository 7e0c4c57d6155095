"""``nlosctl identify-los``: unlabelled echoes to direct ones, and the targets that they are of."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options import (
    Add,
    AllRows,
    BadRows,
    BlockSize,
    Carry,
    Columns,
    ConfigFile,
    Crs,
    Debug,
    Ellipse,
    Engine,
    EstimatesOut,
    Format,
    Hash,
    InputFormat,
    Inputs,
    Jobs,
    MaxSnapshotRows,
    Methods,
    Origin,
    Output,
    Overwrite,
    Params,
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

__all__ = ["identify_los"]


def identify_los(
    inputs: Inputs,
    method: Methods = ["assignment"],  # noqa: B006 - typer copies it
    param: Params = [],  # noqa: B006
    sweep: Sweeps = [],  # noqa: B006
    output: Output = "-",
    estimates_out: EstimatesOut = None,
    alternatives: Annotated[
        int, typer.Option("--alternatives", min=1, metavar="N", help="At most N estimates per snapshot and target.")
    ] = 1,
    field: SearchField = "sensors:1",
    target_z_m: TargetZM = None,
    scene: SceneFile = None,
    crs: Crs = None,
    origin: Origin = None,
    column: Columns = [],  # noqa: B006
    range_std_m: RangeStdM = None,
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
    """Tell direct echoes of several targets from all others, and how many targets there are; a flag per range.

    A snapshot holds any number of ranges of each sensor, in any order. Without -o a terminal shows a preview, a pipe
    gets CSV. Exit codes: 0 done, 1 bad data or files, 2 the words of the command line, 3 under --strict when some
    snapshot got no target, 130 interrupted.
    """
    from nlosctl.contract.fields import parse_field
    from nlosctl.pipeline.parameters import method_runs
    from nlosctl.pipeline.run import MeasurementRun, RunSettings
    from nlosctl.pipeline.workers import usable_jobs

    terminal = Terminal(quiet=quiet, verbose=verbose)
    jobs = usable_jobs(jobs)
    words = ReadWords(
        inputs=inputs,
        input_format=input_format,
        kind="ranges",
        scene=scene,
        crs=crs,
        origin=origin,
        columns=column,
        range_std_m=range_std_m,
        all_rows=all_rows,
        max_snapshot_rows=max_snapshot_rows,
        bad_rows=bad_rows,
        overwrite=overwrite,
        one_thread=jobs == 1,
        config=config,
        tables=(output, estimates_out),
        outputs=(None if report == "-" else report,),
    )
    with open_measurements(words) as opened:
        runs = method_runs(
            method, opened.reader.kind, "identify-los", key_values(param, "--param"), key_values(sweep, "--sweep")
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
            want_flags=True,
        )
        run = MeasurementRun(opened.reader, runs, settings)
        for line in run.plan():
            terminal.detail(line)
        outputs = Outputs(
            tables={"flags": output, "estimates": estimates_out},
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
        solve_and_write(run, opened, outputs, "identify-los", terminal)
    return exit_code(run, strict=strict)
