"""Runs whose sources move within a snapshot: the times of their rows, their truth, and what they refuse.

A method estimates velocities if its estimates have the column ``time_s`` (`MethodSpec.all_estimate_columns`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.tables import OF_MOVING
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.layouts import MEAN_OF_ROWS
from nlosctl.io.results.snapshot_rows import elapsed_times, mean_times, mean_truth
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.target_heights import has_geometry_stds

__all__ = ["at_mean_time", "check_motion", "estimates_velocity", "refuse_motion", "with_row_times"]


def estimates_velocity(run: MethodRun) -> bool:
    """Return whether a run estimates velocities from the times of rows."""
    return OF_MOVING[0] in run.spec.all_estimate_columns(run.options)


def check_motion(reader: MeasurementReader, runs: Sequence[MethodRun], options: SolveOptions) -> None:
    """Raise UsageError if a run estimates velocities, and the input or another option has no model of motion."""
    if any(map(estimates_velocity, runs)):
        refuse_motion(reader, options)


def refuse_motion(reader: MeasurementReader, options: SolveOptions) -> None:
    """Raise UsageError if the input or an option has no model of motion."""
    frame, motion = reader.scene.frame, "motion=velocity"
    if frame is not None and frame.on_ellipsoid:
        raise UsageError(f"{motion} on the earth is of two dimensions; set `dimensions` to 2")
    if options.estimate_std is not None:
        raise UsageError(f"{motion} needs stated standard deviations; leave out one of it and `estimate_std`")
    if reader.options.calibration is not None:
        raise UsageError(
            f"{motion} has no model of errors that rows share: apply the calibration first (convert `calibration`)"
        )
    if has_geometry_stds(reader.scene, reader.schema.names):
        raise UsageError(f"{motion} takes sensors and reflectors as exactly known; leave out their standard deviations")
    if reader.dimension == 3 and (options.target_z_m is not None or "target_z_m" in reader.column_names):
        raise UsageError(f"{motion} in three dimensions estimates the height: leave out target_z_m")


def with_row_times(chunk: Chunk, reader: MeasurementReader) -> Chunk:
    """Return a chunk that has ticks with the columns ``elapsed_s``, see `Batch`, and `MEAN_OF_ROWS`."""
    column = "time_s" if "time_s" in reader.column_names else "time"
    mean = np.repeat(mean_times(chunk, column), np.diff(chunk.offsets))
    times = {"elapsed_s": elapsed_times(chunk, column), MEAN_OF_ROWS: mean}
    return dataclasses.replace(chunk, columns={**chunk.columns, **times})


def at_mean_time(chunk: Chunk) -> Chunk:
    """Return a chunk whose rows have the true positions at the mean time of their snapshot."""
    means = mean_truth(chunk)
    names = chunk.table.column_names
    table = chunk.table
    for name, column in means.items():
        table = table.set_column(names.index(name), name, column)
    return dataclasses.replace(chunk, table=table)
