"""``nlosctl posterior``: the probability of the position on a grid of cells."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Inputs, Quiet, Snapshot
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, preview_sinks
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions

__all__ = ["posterior"]


@takes_options(method=("ml",))
def posterior(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    snapshot: Snapshot = None,
    all: Annotated[bool, typer.Option("--all", rich_help_panel="Method", help="Make a map of each snapshot.")] = False,
    combine: Annotated[
        bool, typer.Option("--combine", rich_help_panel="Method", help="Make one map of all: one source, at rest.")
    ] = False,
    cell: Annotated[
        float | None,
        typer.Option(
            "--cell",
            metavar="M",
            rich_help_panel="Geometry",
            help="Side of a cell in metres; default: about a hundredth of the region.",
        ),
    ] = None,
    max_cells: Annotated[
        int,
        typer.Option("--max-cells", metavar="N", rich_help_panel="Geometry", help="Largest number of cells of a map."),
    ] = 1_000_000,
    config: ConfigFile = None,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Compute the posterior of the position on a grid: the probability of each cell, and its highest-density region.

    The likelihood is that of the method, ml or mixture-ml; the prior is flat over the search region, times a Gaussian
    with -p prior_x_m, prior_y_m and prior_std_m or columns of these names. The map is of one snapshot, of each (--all),
    or of one source that all measure (--combine). Exit codes: 0 done, 1 bad data or files, 2 usage error, 130
    interrupted.
    """
    from nlosctl.jobs.files import Destination
    from nlosctl.jobs.posterior import posterior as make_maps
    from nlosctl.jobs.posterior import posterior_options

    maps = posterior_options(snapshot=snapshot, all=all, combine=combine, cell=cell, max_cells=max_cells)
    terminal = Terminal(quiet)
    with preview_sinks("posterior", write) as sinks:
        destination = Destination(
            targets={"posterior": write.output}, sinks=sinks, protected=[config], console=terminal
        )
        report = make_maps(inputs, maps, read, options, write, destination).report
    terminal.show_report(report.lines(), report.as_dict(), write)
