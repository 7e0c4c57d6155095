"""Heights of the targets: measured or held in three dimensions, in the plane those that make ranges slant.

Also what a run refuses in a dimension or of a geometry that is not exactly known, and what it remarks on them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Container, Iterator, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.fields import BoxField, Field
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError
from nlosctl.io.measurements.completion.geometry_stds import SENSOR_STD
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.pipeline.solve.method_runs import MethodRun

__all__ = [
    "by_height",
    "check_geometry",
    "geometry_remarks",
    "has_geometry_stds",
    "height_settings",
    "heights_remark",
    "refuse_dimension",
    "with_target_heights",
]

_HEIGHT, _HEIGHT_STD = "target_z_m", "target_z_std_m"
_NUMBERS = {2: "two", 3: "three"}


def height_settings(options: SolveOptions) -> dict[str, float]:
    """Return the settings of a target's height that are given, for the metadata of results."""
    heights = {_HEIGHT: options.target_z_m, _HEIGHT_STD: options.target_z_std_m}
    return {name: value for name, value in heights.items() if value is not None}


def with_target_heights(chunk: Chunk, dimension: int, options: SolveOptions) -> Chunk:
    """Return the chunk with the heights of its targets, from the settings or its own columns.

    In three dimensions those are the columns ``target_z_m`` and ``target_z_std_m``; in the plane ``sensor_height_m``,
    the height of each sensor above the plane of the targets. Raises UsageError without heights of all sensors, for a
    setting beside a column, and in the plane for other measurements than ranges.
    """
    height, std = options.target_z_m, options.target_z_std_m
    if height is not None and _HEIGHT in chunk.columns:
        raise UsageError(f"`target_z_m` is given, but the input has a column {_HEIGHT!r}; leave the option out")
    if height is None and (dimension == 3 or _HEIGHT not in chunk.columns):
        return chunk
    if dimension == 3:
        rows = int(chunk.offsets[-1])
        given = {_HEIGHT: np.full(rows, height), _HEIGHT_STD: np.full(rows, std or 0.0)}
        return dataclasses.replace(chunk, columns={**chunk.columns, **given})
    if std is not None:
        raise UsageError("`target_z_std_m` is for three dimensions; set `dimensions` to 3, or leave it out")
    return _with_sensor_heights(chunk, chunk.columns[_HEIGHT] if height is None else height)


def by_height(chunk: Chunk, snapshot: IntArray, row: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the snapshots (B,) and rows (B, K) of a block by what is known of the target's height.

    A batch is of targets without a height, with a measured one, or with one that is held exactly.
    """
    if _HEIGHT_STD not in chunk.columns or not row.shape[1]:
        yield snapshot, row
        return
    std = chunk.columns[_HEIGHT_STD][row[:, 0]]
    for alike in (np.isnan(std), std > 0.0, std == 0.0):
        if alike.any():
            yield snapshot[alike], row[alike]


def _with_sensor_heights(chunk: Chunk, target_z_m: Any) -> Chunk:
    if "bearing_rad" in chunk.columns or "range_m" not in chunk.columns:
        raise UsageError(
            "`target_z_m` is for files of ranges, whose heights make them slant ranges, or for three dimensions; "
            "leave it out, or set `dimensions` to 3"
        )
    if "sensor_z_m" not in chunk.columns:
        raise UsageError(
            "`target_z_m` needs the height of each sensor: a column 'sensor_z_m', or position = [x, y, z] in the scene"
        )
    height = chunk.columns["sensor_z_m"] - target_z_m
    if np.isnan(height).any():
        raise UsageError("`target_z_m` needs the height of each sensor, and the scene lacks some sensors; add them")
    return dataclasses.replace(chunk, columns={**chunk.columns, "sensor_height_m": height})


def refuse_dimension(runs: Sequence[MethodRun], dimension: int, field: Field) -> None:
    """Raise UsageError for a method that does not solve in this dimension, or a search region of another."""
    for run in runs:
        if dimension not in run.spec.dimensions:
            solved = "two dimensions" if dimension == 3 else "three dimensions"
            other = 5 - dimension
            raise UsageError(
                f"method {run.spec.name!r} solves in {solved}, and the input is of {_NUMBERS[dimension]}; "
                f"set `dimensions` to {other}, or choose another method (see 'nlosctl methods')"
            )
    if isinstance(field, BoxField) and field.zmin_m is not None and dimension == 2:
        raise UsageError(f"field {str(field)!r} has heights, but the input is of two dimensions; give four numbers")


def has_geometry_stds(scene: Scene, names: Container[str]) -> bool:
    """Return whether sensors or reflectors may not be exactly known; ``names`` are those of the columns."""
    return scene.is_uncertain or SENSOR_STD in names


def check_geometry(reader: MeasurementReader, runs: Sequence[MethodRun], options: SolveOptions) -> None:
    """Raise UsageError for a dimension, a motion, or a geometry not exactly known, that the run has no model of."""
    refuse_dimension(runs, reader.dimension, options.field)
    if reader.options.keep_times:
        from nlosctl.pipeline.solve.motion.moving_sources import check_motion

        check_motion(reader, runs, options)
    if has_geometry_stds(reader.scene, reader.schema.names):
        from nlosctl.pipeline.solve.shared_causes.method_checks import refuse_uncertain

        refuse_uncertain(reader, options)


def geometry_remarks(reader: MeasurementReader, runs: Sequence[MethodRun], options: SolveOptions) -> list[str]:
    """Return lines on heights that are not used, and on methods whose weights ignore what rows share."""
    remarks = heights_remark(reader, options)
    if has_geometry_stds(reader.scene, reader.schema.names):
        from nlosctl.pipeline.solve.shared_causes.method_checks import uncertain_remarks

        remarks += uncertain_remarks(reader, runs)
    return remarks


def heights_remark(reader: MeasurementReader, options: SolveOptions) -> list[str]:
    """Return a line if the input has sensor heights that are not used."""
    names = reader.column_names
    if reader.kind != "ranges" or reader.dimension == 3 or "sensor_z_m" not in names:
        return []
    if options.target_z_m is not None or _HEIGHT in names:
        return []
    return ["the column 'sensor_z_m' is not used without `target_z_m`: everything is taken as measured in one plane"]
