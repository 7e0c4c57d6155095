"""``nlosctl calibrate``: measurements to the offsets of their sensors."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Inputs, Quiet, Truth, Verbose
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions

__all__ = ["calibrate"]

PriorM = Annotated[
    float | None,
    typer.Option(
        "--offset-prior-m", metavar="M", rich_help_panel="Method", help="Std of a prior on each offset, in metres."
    ),
]
PriorDeg = Annotated[
    float | None,
    typer.Option(
        "--offset-prior-deg",
        metavar="DEG",
        rich_help_panel="Method",
        help="Std of a prior on each heading's offset, in degrees.",
    ),
]
Harmonics = Annotated[
    int,
    typer.Option(
        "--harmonics",
        metavar="H",
        min=0,
        rich_help_panel="Method",
        help="Orders of an array's deviation by the direction from its heading.",
    ),
]
TableOut = Annotated[
    str | None,
    typer.Option("--table-out", metavar="FILE", rich_help_panel="Output", help="Also write the offsets as a table."),
]


@takes_options(method=("ml",))
def calibrate(
    inputs: Inputs,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    *,
    truth: Truth = None,
    offset_prior_m: PriorM = None,
    offset_prior_deg: PriorDeg = None,
    harmonics: Harmonics = 0,
    table_out: TableOut = None,
    config: ConfigFile = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Estimate the offset of each sensor and the factor of its standard deviations, as a calibration (TOML).

    The positions of all snapshots are estimated with the offsets, or known: --truth FILE, or --truth columns for the
    truth columns of the input, which are not used otherwise. Bearings have an offset of the
    heading, ranges and arrivals one of their length: measured = true + offset. With --harmonics H bearings have a
    deviation of cosines and sines of 1 to H times the direction from the heading, from known positions or from a drive
    around one transmitter, which is one snapshot (--window all). What the measurements do not determine
    stays at zero and is named. The input is read several times. Exit codes: 0 done, 1 bad data or files, 2 usage error,
    130 interrupted.
    """
    from nlosctl.jobs.calibrate import Prior
    from nlosctl.jobs.calibrate import calibrate as estimate
    from nlosctl.jobs.files import Destination

    terminal = Terminal(quiet, verbose)
    destination = Destination(
        targets={"calibration": write.output, "table": table_out}, protected=[config], console=terminal
    )
    prior = Prior(offset_prior_m=offset_prior_m, offset_prior_deg=offset_prior_deg)
    report = estimate(inputs, read, options, write, destination, truth=truth, prior=prior, harmonics=harmonics)
    terminal.show_report(report.lines(), report.as_dict(), write)
