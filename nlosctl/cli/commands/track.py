"""``nlosctl track``: measurements or estimates at times to the paths of moving sources."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Inputs, Quiet, Strict, Verbose
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, preview_sinks
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions

__all__ = ["track"]

_UNANSWERED = 3


@takes_options(method=("ml",))
def track(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    gap: Annotated[
        str | None,
        typer.Option("--gap", metavar="TIME", rich_help_panel="Method", help="Longest time within a track, as 60s."),
    ] = None,
    causal: Annotated[
        bool, typer.Option("--causal", rich_help_panel="Method", help="Each state given the rows until then: a filter.")
    ] = False,
    estimate_acceleration: Annotated[
        bool,
        typer.Option("--estimate-acceleration", rich_help_panel="Method", help="Estimate acceleration_psd (m2/s3)."),
    ] = False,
    associate: Annotated[
        bool,
        typer.Option("--associate", rich_help_panel="Method", help="Assign the targets of each snapshot to tracks."),
    ] = False,
    strict: Strict = False,
    config: ConfigFile = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> int:
    """Estimate the paths of moving sources, with velocities, from measurements or estimates at times.

    The input has a column time_s or time. The motion is one of nearly constant velocity: white acceleration of the
    density -p acceleration_psd=Q (m2/s3), or an estimated one. There is a row for each snapshot. Columns named by --by
    separate tracks. Exit codes: 0 done, 1 bad data or files, 2 usage error, 3 with --strict if a state is not known,
    130 interrupted.
    """
    from nlosctl.jobs.files import Destination
    from nlosctl.jobs.track import Motion
    from nlosctl.jobs.track import track as find_paths

    terminal = Terminal(quiet, verbose)
    motion = Motion(gap=gap, causal=causal, estimate_acceleration=estimate_acceleration, associate=associate)
    targets = {"estimates": write.output, "flags": write.flags_out}
    with preview_sinks("estimates", write) as sinks:
        destination = Destination(targets=targets, sinks=sinks, protected=[config], console=terminal)
        report = find_paths(inputs, read, options, write, destination, motion).report
    terminal.show_report(report.lines(), report.as_dict(), write)
    return _UNANSWERED if strict and report.unanswered else 0
