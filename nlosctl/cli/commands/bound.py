"""``nlosctl bound``: the Cramer-Rao bound, per snapshot or over a map."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.declarations import (
    AllRows,
    BadRows,
    BearingStdDeg,
    Columns,
    ConfigFile,
    Crs,
    Debug,
    Engine,
    Format,
    InputFormat,
    Inputs,
    Kind,
    MaxSnapshotRows,
    Origin,
    Output,
    Overwrite,
    Quiet,
    Report,
    Resume,
    SceneFile,
    Scheduler,
)
from nlosctl.cli.shared.reading import ReadWords, open_measurements
from nlosctl.cli.shared.solving import Outputs, solve_and_write
from nlosctl.cli.shared.terminal import Terminal
from nlosctl.errors import UsageError

__all__ = ["bound"]


def bound(
    inputs: Inputs,
    map: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="XMIN,XMAX,YMIN,YMAX,STEP",
            help="Positions on a grid, in metres, for the sensors, paths and stds of the first snapshot.",
        ),
    ] = None,
    noise: Annotated[
        str, typer.Option("--noise", metavar="NAME", help="Distribution of the errors: gaussian or laplace.")
    ] = "gaussian",
    use_ranges: Annotated[
        bool, typer.Option("--use-ranges/--no-ranges", help="Count the ranges that a file of bearings has too.")
    ] = True,
    output: Output = "-",
    scene: SceneFile = None,
    crs: Crs = None,
    origin: Origin = None,
    kind: Kind = None,
    column: Columns = [],  # noqa: B006 - typer copies it
    bearing_std_deg: BearingStdDeg = None,
    all_rows: AllRows = False,
    bad_rows: BadRows = None,
    format: Format = None,
    input_format: InputFormat = None,
    overwrite: Overwrite = False,
    resume: Resume = False,
    engine: Engine = "local",
    scheduler: Scheduler = None,
    max_snapshot_rows: MaxSnapshotRows = 1_000_000,
    report: Report = None,
    quiet: Quiet = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> None:
    """Tell the Cramer-Rao bound: the least covariance an unbiased estimate can have, with its ellipse and CEP50.

    For each snapshot at its truth (truth_x_m, truth_y_m), or with --map over a grid of positions. Errors are Gaussian
    (or Laplacian) with the stated stds; ranges beside bearings join in. Only rows that can see the position as the
    scene is take part; null where they give no bound.
    """
    from nlosctl.io.writers.output_set import is_folder_target
    from nlosctl.pipeline.bound.bound_run import BoundRun
    from nlosctl.pipeline.bound.bounds import BoundSettings, parse_map

    terminal = Terminal(quiet=quiet)
    grid = None if map is None else parse_map(map)
    if grid is not None and is_folder_target(output):
        raise UsageError("--map makes one table, not one for each part of the input; give -o a file")
    words = ReadWords(
        inputs=inputs,
        input_format=input_format,
        kind=kind,
        scene=scene,
        crs=crs,
        origin=origin,
        columns=column,
        bearing_std_deg=bearing_std_deg,
        all_rows=all_rows,
        max_snapshot_rows=max_snapshot_rows,
        bad_rows=bad_rows,
        overwrite=overwrite,
        config=config,
        tables=(output,),
        outputs=(None if report == "-" else report,),
    )
    destinations = Outputs(
        tables={"bound": output},
        format=format,
        overwrite=overwrite,
        resume=resume,
        engine=engine,
        scheduler=scheduler,
        bad_rows=bad_rows,
        report=report,
    )
    with open_measurements(words) as opened:
        run = BoundRun(opened.reader, BoundSettings(noise=noise, use_ranges=use_ranges), grid, map)
        solve_and_write(run, opened, destinations, "bound", terminal)
