"""``nlosctl detect-ip``: triplets to direct and indirect paths."""

from __future__ import annotations

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
    Details,
    DoaStdDeg,
    DodStdDeg,
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
    PathLengthStdM,
    Quiet,
    Report,
    Resume,
    Scheduler,
    Seed,
    Sweeps,
    Verbose,
    key_values,
)
from nlosctl.cli.reading import ReadWords, added_columns, open_measurements
from nlosctl.cli.solving import Outputs, exit_code, solve_and_write
from nlosctl.cli.terminal import Terminal

__all__ = ["detect_ip"]


def detect_ip(
    inputs: Inputs,
    method: Methods = ["chi2"],  # noqa: B006 - typer copies it
    param: Params = [],  # noqa: B006
    sweep: Sweeps = [],  # noqa: B006
    output: Output = "-",
    estimates_out: EstimatesOut = None,
    details: Details = False,
    crs: Crs = None,
    origin: Origin = None,
    column: Columns = [],  # noqa: B006
    dod_std_deg: DodStdDeg = None,
    doa_std_deg: DoaStdDeg = None,
    path_length_std_m: PathLengthStdM = None,
    all_rows: AllRows = False,
    ellipse: Ellipse = None,
    add: Add = "",
    carry: Carry = [],  # noqa: B006
    bad_rows: BadRows = None,
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
    """Flag indirect paths among triplets of departure, arrival and path length; a row per path.

    A path is direct if it goes from the transmitter over the target to the receiver and over nothing else. Without -o
    a terminal shows a preview, a pipe gets CSV. Exit codes: 0 done, 1 bad data or files, 2 the words of the command
    line, 130 interrupted.
    """
    from nlosctl.pipeline.parameters import method_runs, require_estimates
    from nlosctl.pipeline.run import MeasurementRun, RunSettings
    from nlosctl.pipeline.workers import usable_jobs

    terminal = Terminal(quiet=quiet, verbose=verbose)
    jobs = usable_jobs(jobs)
    words = ReadWords(
        inputs=inputs,
        input_format=input_format,
        kind="triplets",
        crs=crs,
        origin=origin,
        columns=column,
        dod_std_deg=dod_std_deg,
        doa_std_deg=doa_std_deg,
        path_length_std_m=path_length_std_m,
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
            method, opened.reader.kind, "detect-ip", key_values(param, "--param"), key_values(sweep, "--sweep")
        )
        if estimates_out is not None:
            require_estimates(runs)
        settings = RunSettings(
            seed=seed,
            jobs=jobs,
            block_size=block_size,
            carry=tuple(carry),
            ellipse=ellipse,
            add=added_columns(add),
            want_estimates=estimates_out is not None,
            want_flags=True,
            want_details=details,
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
        solve_and_write(run, opened, outputs, "detect-ip", terminal)
    return exit_code(run)
