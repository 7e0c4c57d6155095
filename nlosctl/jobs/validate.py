"""Job: check measurements without solving them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.io.measurements.returned_ids import rejoined_remark
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.io.paths.inputs import Input
from nlosctl.io.writers.output_set import OutputSet
from nlosctl.jobs.console import Console, Silent
from nlosctl.jobs.files import Destination, open_measurements

__all__ = ["validate"]


def validate(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    write: OutputOptions,
    *,
    protected: Sequence[str | None] = (),
    console: Console | None = None,
) -> dict[str, Any]:
    """Return kind, counts, columns and remarks of measurements; raises DataError for faults that are not set aside."""
    read = dataclasses.replace(read, all_rows=True, unlabelled="marked")
    with (
        open_measurements(inputs, read, write, Destination(protected=protected)) as opened,
        OutputSet() as outputs,
        (console or Silent()).progress("validate") as progress,
    ):
        reader = opened.reader
        opened.set_bad_rows_aside(write, outputs)
        for _ in reader.chunks():
            progress(reader.report.rows_in_all, None)
        return {
            "kind": reader.kind,
            "rows": reader.report.rows_taken,
            "snapshots": reader.report.snapshots,
            "sensors": len(reader.sensor_names),
            "bad_rows": reader.report.bad_rows,
            "scene_sensors": len(reader.scene.sensors),
            "scene_reflectors": len(reader.scene.reflectors),
            "columns": list(reader.column_names),
            "remarks": [
                *reader.report.remarks,
                *window_remarks(reader.report.windows, read.window),
                *(rejoined_remark(reader.report.rejoined) if reader.report.rejoined else ()),
            ],
        }
