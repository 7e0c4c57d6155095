"""``nlosctl validate``: is a file of measurements right?"""

from __future__ import annotations

from nlosctl.cli.options.declarations import (
    BadRows,
    BearingStdDeg,
    Columns,
    ConfigFile,
    Crs,
    Debug,
    DoaStdDeg,
    DodStdDeg,
    InputFormat,
    Inputs,
    Json,
    Kind,
    MaxSnapshotRows,
    Origin,
    Overwrite,
    PathLengthStdM,
    Quiet,
    RangeStdM,
    SceneFile,
)
from nlosctl.cli.shared.reading import ReadWords, open_measurements
from nlosctl.cli.shared.terminal import Terminal, print_json, print_table

__all__ = ["validate"]


def validate(
    inputs: Inputs,
    scene: SceneFile = None,
    crs: Crs = None,
    origin: Origin = None,
    kind: Kind = None,
    column: Columns = [],  # noqa: B006 - typer copies it
    bearing_std_deg: BearingStdDeg = None,
    range_std_m: RangeStdM = None,
    dod_std_deg: DodStdDeg = None,
    doa_std_deg: DoaStdDeg = None,
    path_length_std_m: PathLengthStdM = None,
    bad_rows: BadRows = None,
    input_format: InputFormat = None,
    max_snapshot_rows: MaxSnapshotRows = 1_000_000,
    overwrite: Overwrite = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> int:
    """Check measurement files as the other commands would: columns, values, scene, order. Exit 0 if all is right."""
    terminal = Terminal(quiet=quiet)
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
        all_rows=True,
        max_snapshot_rows=max_snapshot_rows,
        bad_rows=bad_rows,
        overwrite=overwrite,
        config=config,
        extra_columns=(),
    )
    from nlosctl.io.writers.output_set import OutputSet

    with open_measurements(words) as opened, OutputSet() as outputs, terminal.progress("validate") as progress:
        reader = opened.reader
        if bad_rows is not None:
            opened.set_bad_rows_aside(bad_rows, outputs, overwrite=overwrite)
        for _ in reader.chunks():
            progress(reader.report.rows_in_all, None)
        found = {
            "kind": reader.kind,
            "rows": reader.report.rows_in_all,
            "snapshots": reader.report.snapshots,
            "sensors": len(reader.sensor_names),
            "bad_rows": reader.report.bad_rows,
            "scene_sensors": len(reader.scene.sensors),
            "scene_reflectors": len(reader.scene.reflectors),
            "columns": list(reader.column_names),
            "remarks": list(reader.report.remarks),
        }
    if json:
        print_json(found)
    else:
        print_table(
            [{"what": key.replace("_", " "), "value": _shown(value)} for key, value in found.items()], ["what", "value"]
        )
    return 1 if reader.report.bad_rows else 0


def _shown(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
