"""``nlosctl validate``: check files of measurements."""

from __future__ import annotations

import dataclasses

from nlosctl.cli.options.declarations import ConfigFile, Debug, Inputs, Json, Quiet
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, print_json, print_table
from nlosctl.contract.run_options import InputOptions, OutputOptions

__all__ = ["validate"]


@takes_options()
def validate(
    inputs: Inputs,
    read: InputOptions,
    write: OutputOptions,
    *,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> int:
    """Check files of measurements: columns, values, scene, order of snapshots. Exit 1 if there is a fault."""
    from nlosctl.io.measurements.returned_ids import rejoined_remark
    from nlosctl.io.writers.output_set import OutputSet
    from nlosctl.jobs.files import Destination, open_measurements

    terminal = Terminal(quiet)
    read = dataclasses.replace(read, all_rows=True, extra_columns=())
    destination = Destination(protected=[config])
    with (
        open_measurements(inputs, read, write, destination) as opened,
        OutputSet() as outputs,
        terminal.progress("validate") as progress,
    ):
        reader = opened.reader
        opened.set_bad_rows_aside(write, outputs)
        for _ in reader.chunks():
            progress(reader.report.rows_in_all, None)
        result = {
            "kind": reader.kind,
            "rows": reader.report.rows_in_all,
            "snapshots": reader.report.snapshots,
            "sensors": len(reader.sensor_names),
            "bad_rows": reader.report.bad_rows,
            "scene_sensors": len(reader.scene.sensors),
            "scene_reflectors": len(reader.scene.reflectors),
            "columns": list(reader.column_names),
            "remarks": [
                *reader.report.remarks,
                *(rejoined_remark(reader.report.rejoined) if reader.report.rejoined else ()),
            ],
        }
    if json:
        print_json(result)
    else:
        rows = [{"what": key.replace("_", " "), "value": _shown(value)} for key, value in result.items()]
        print_table(rows, ["what", "value"])
    return 1 if reader.report.bad_rows else 0


def _shown(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
