"""``nlosctl bound``: the Cramér-Rao bound, per snapshot or over a map."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Inputs, Quiet
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, preview_sinks
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions

__all__ = ["bound"]


@takes_options()
def bound(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    map: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="XMIN,XMAX,YMIN,YMAX,STEP",
            rich_help_panel="Geometry",
            help="Grid of positions in metres, with the sensors of the first snapshot.",
        ),
    ] = None,
    config: ConfigFile = None,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Compute the Cramér-Rao lower bound on the covariance of any unbiased estimator, with its ellipse and CEP50.

    The bound is that of each snapshot at its true position (truth_x_m, truth_y_m), or with --map over a grid of
    positions. Errors are Gaussian (or Laplacian) with the stated standard deviations; ranges of a file of bearings are
    included. Only rows whose path exists at a position count; where they do not determine it, the bound is null.
    """
    from nlosctl.jobs.bound import bound
    from nlosctl.jobs.files import Destination

    terminal = Terminal(quiet)
    with preview_sinks("bound", write) as sinks:
        destination = Destination(targets={"bound": write.output}, sinks=sinks, protected=[config], console=terminal)
        report = bound(inputs, map, read, options, write, destination).report
    terminal.show_report(report.lines(), report.as_dict(), write)
