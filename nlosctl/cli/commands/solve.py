"""``nlosctl localize``, ``detect-ip`` and ``identify-los``: measurements to estimates and flags."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from nlosctl.cli.options.declarations import ConfigFile, Debug, FailIf, Inputs, Quiet, Strict, Verbose
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, preview_sinks, print_message
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions

if TYPE_CHECKING:
    from nlosctl.contract.methods import Job

__all__ = ["detect_ip", "identify_los", "localize"]

_NOTHING_TO_DO = 1
_UNANSWERED = 3
_CONDITION_MET = 4


@takes_options(method=("ml",))
def localize(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    strict: Strict = False,
    fail_if: FailIf = [],  # noqa: B006 - typer copies it
    config: ConfigFile = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> int:
    """Estimate positions from measurements, with a covariance and a status for each snapshot.

    'nlosctl schema bearings' lists the columns that a file needs. Without -o a terminal shows a preview and a pipe gets
    CSV. Exit codes: 0 done, 1 bad data or files, 2 usage error, 3 with --strict if a snapshot has no fix, 4 a
    --fail-if condition is met (fix_rate, used_share, share_p_below_0001), 130 interrupted.
    """
    targets = {"estimates": write.output, "flags": write.flags_out, "trace": write.trace_out}
    terminal = Terminal(quiet, verbose)
    return _solve("localize", inputs, read, options, write, targets, config, terminal, fail_if, strict=strict)


@takes_options(method=("chi2",))
def detect_ip(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    fail_if: FailIf = [],  # noqa: B006 - typer copies it
    config: ConfigFile = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> int:
    """Flag indirect paths among triplets of departure, arrival and path length; a row per path.

    A direct path goes from the transmitter to the target to the receiver, without further reflections. Without -o a
    terminal shows a preview and a pipe gets CSV. Exit codes: 0 done, 1 bad data or files, 2 usage error, 4 a --fail-if
    condition is met (answered_rate: share of rows with a p-value), 130 interrupted.
    """
    targets = {"flags": write.output, "estimates": write.estimates_out}
    read = dataclasses.replace(read, kind="triplets")
    return _solve("detect-ip", inputs, read, options, write, targets, config, Terminal(quiet, verbose), fail_if)


@takes_options(method=("assignment",))
def identify_los(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    strict: Strict = False,
    fail_if: FailIf = [],  # noqa: B006 - typer copies it
    config: ConfigFile = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> int:
    """Identify line-of-sight echoes or bearings of an unknown number of targets; a flag per row.

    A snapshot has any number of ranges or bearings per sensor, in any order; a file with both is read as ranges.
    Without -o a terminal shows a preview and a pipe gets CSV. Exit codes: 0 done, 1 bad data or files, 2 usage error, 3
    with --strict if a snapshot has no target, 4 a --fail-if condition is met (fix_rate: share of snapshots with
    a target; used_share, share_p_below_0001), 130 interrupted.
    """
    targets = {"flags": write.output, "estimates": write.estimates_out}
    terminal = Terminal(quiet, verbose)
    return _solve("identify-los", inputs, read, options, write, targets, config, terminal, fail_if, strict=strict)


def _solve(
    job: Job,
    inputs: Sequence[str],
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    targets: Mapping[str, str | None],
    config: str | None,
    terminal: Terminal,
    fail_if: Sequence[str],
    *,
    strict: bool = False,
) -> int:
    """Run a job, print its summary and return the exit code."""
    from nlosctl.jobs.files import Destination
    from nlosctl.jobs.solve import check_conditions, met_conditions, solve

    main, *_ = targets
    check_conditions(fail_if, job, options.method)
    with preview_sinks(main, write) as sinks:
        destination = Destination(targets=targets, sinks=sinks, protected=[config], console=terminal)
        run = solve(job, inputs, read, options, write, destination)
    report = run.report
    terminal.show_report(report.lines(), report.as_dict(), write)
    if not report.snapshots:
        print_message("nlosctl: nothing to do: every row is bad")
        return _NOTHING_TO_DO
    reasons = met_conditions(fail_if, job, run)
    for reason in reasons:
        print_message(f"nlosctl: {reason}")
    return _CONDITION_MET if reasons else _UNANSWERED if strict and report.unanswered else 0
