"""``nlosctl bound``: the Cramer-Rao bound, per snapshot or over a map."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Annotated

import typer

from nlosctl.cli.options import (
    AllRows,
    BadRows,
    BearingStdDeg,
    Columns,
    ConfigFile,
    Crs,
    Debug,
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
    SceneFile,
)
from nlosctl.cli.reading import ReadWords, open_measurements, open_output
from nlosctl.cli.terminal import Preview, Terminal, write_report

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
    from nlosctl.pipeline.bounding import BoundSettings, bounds_at_truth, bounds_on_map, parse_map, result_schema
    from nlosctl.pipeline.provenance import describe_inputs, file_metadata

    terminal = Terminal(quiet=quiet)
    grid = None if map is None else parse_map(map)
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
        outputs=(output, None if report == "-" else report),
    )
    settings = BoundSettings(noise=noise, use_ranges=use_ranges)
    positions = bounded = 0
    with open_measurements(words) as opened:
        reader = opened.reader
        tables = bounds_at_truth(reader, settings) if grid is None else bounds_on_map(reader, grid, settings)
        described = describe_inputs(opened.inputs, {}, with_hash=False)
        metadata = file_metadata(
            "bound", {"map": map, "noise": noise, "use_ranges": use_ranges, "inputs": described}, reader.scene
        )
        preview = Preview.wanted(output, format)
        with ExitStack() as stack:
            writer = preview or stack.enter_context(
                open_output(
                    output,
                    result_schema(reader, grid),
                    format_name=format,
                    overwrite=overwrite,
                    inputs=opened.paths,
                    metadata=metadata,
                )
            )
            progress = stack.enter_context(terminal.progress("bound"))
            for table in tables:
                writer.write(table)
                positions += table.num_rows
                bounded += table.num_rows - table.column("rms_m").null_count
                progress(positions, None)
        if preview is not None:
            preview.show()
    what = "snapshots" if grid is None else "positions"
    terminal.note(f"bound of {reader.kind}: {bounded} of {positions} {what} have one")
    if report is not None:
        write_report(report, {"kind": reader.kind, "map": map, what: positions, "bounded": bounded})
