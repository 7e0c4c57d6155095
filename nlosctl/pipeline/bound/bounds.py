"""The Cramér-Rao bound of each snapshot at its truth, or of one set of measurements over a map of positions."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Sensor
from nlosctl.contract.tables import TRUTH_HEIGHT
from nlosctl.errors import DataError, UsageError
from nlosctl.evaluation.bounds import Bounds, SpaceBounds, bounds_of
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.evaluation_arrays import boolean_codes
from nlosctl.io.results.layouts import MEAN_OF_ROWS, TRUTH_NAMES, truth_positions
from nlosctl.io.results.tables import MEAN_TIME, bound_schema, bound_table
from nlosctl.models.information import INFORMATION, Information
from nlosctl.models.shared_causes.causes import SharedCauses
from nlosctl.pipeline.bound.map_grid import POSITIONS_AT_ONCE, MapGrid
from nlosctl.pipeline.solve.reference_rows import alike_blocks
from nlosctl.pipeline.solve.reflected_ranges import refuse_circle_ranges, refuse_reflected_ranges
from nlosctl.pipeline.solve.shared_causes.chunk_causes import batch_causes
from nlosctl.pipeline.solve.shared_causes.correlated_bound import information_with_causes
from nlosctl.pipeline.solve.solve_chunk import dense_batch, dense_blocks
from nlosctl.pipeline.solve.target_heights import with_target_heights

__all__ = ["bounds_at_truth", "bounds_on_map", "first_chunk", "map_sensors", "result_schema"]


_INFORMATION_PER_VARIANCE = {"gaussian": 1.0, "laplace": 2.0}
"""Fisher information of a location, times the variance: 1 for Gaussian errors, 2 for Laplacian ones.

Of the rows: the error of a measured height is Gaussian.
"""


def result_schema(reader: MeasurementReader, grid: MapGrid | None) -> Any:
    """Return the Arrow schema of the bounds."""
    by = None if reader.options.window is None else reader.options.by
    names: tuple[str, ...] = ()
    if reader.options.keep_times:
        from nlosctl.pipeline.bound.moving_bound import velocity_names

        names = (MEAN_TIME, *velocity_names(reader.dimension))
    return bound_schema(reader.table_schema if grid is None else None, reader.dimension, by, names)


def bounds_at_truth(reader: MeasurementReader, options: SolveOptions) -> Iterator[Any]:
    """Yield tables with the bound of each snapshot at its truth, in input order.

    The bound is null without a truth, or if too few rows have a free path to it. Rows that do not follow their stated
    path (``truth_los`` false) have no information and are not used. Raises DataError for an input without truth.
    """
    schema = result_schema(reader, None)
    model = INFORMATION[_supported(reader)]
    if reader.options.keep_times:
        yield from _moving_bounds(reader, options, schema)
        return
    for chunk in reader.chunks():
        truth = _truth(chunk, reader.dimension)
        arrays = _no_bounds(truth)
        if chunk.windows is not None:
            arrays[MEAN_TIME] = chunk.windows.time_s
        chunk = _as_modelled(chunk, reader, options)
        kept = ~chunk.left_out & _may_be_direct(chunk)
        for snapshot, row in dense_blocks(chunk.offsets, kept, POSITIONS_AT_ONCE):
            if row.shape[1]:
                for mine, rows in alike_blocks(chunk, snapshot, row):
                    batch = _without_ranges(_batch(reader, chunk, rows), options)
                    batch, point = _in_axes_of_bound(batch, reader, truth[mine])
                    causes = batch_causes(chunk.columns, rows, batch, reader.options.calibration)
                    information = model.at(batch, *point.T)
                    information = information_with_causes(information, reader.kind, batch, point, causes, options.noise)
                    _write_bounds(arrays, mine, information, options)
        yield bound_table(arrays, schema, chunk.snapshot, chunk.table, chunk.offsets[:-1])


def _moving_bounds(reader: MeasurementReader, options: SolveOptions, schema: Any) -> Iterator[Any]:
    """Yield that of sources that move within a snapshot, at their true positions at the mean time."""
    from nlosctl.pipeline.bound.moving_bound import moving_information, refuse_scene, true_velocity, velocity_names
    from nlosctl.pipeline.solve.motion.moving_sources import at_mean_time, refuse_motion, with_row_times

    _supported(reader)
    refuse_scene(reader)
    refuse_motion(reader, options)
    for chunk in reader.chunks():
        chunk = with_row_times(_as_modelled(chunk, reader, options), reader)
        truth, velocity = _truth(at_mean_time(chunk), reader.dimension), true_velocity(chunk, reader.dimension)
        arrays = _no_bounds(truth) | {MEAN_TIME: chunk.columns[MEAN_OF_ROWS][chunk.offsets[:-1]]}
        arrays |= {name: np.full(len(truth), np.nan) for name in velocity_names(reader.dimension)}
        kept = ~chunk.left_out & _may_be_direct(chunk)
        for snapshot, row in dense_blocks(chunk.offsets, kept, POSITIONS_AT_ONCE):
            if row.shape[1]:
                batch = _without_ranges(_batch(reader, chunk, row), options)
                scale = _INFORMATION_PER_VARIANCE[options.noise]
                information, of_velocity = moving_information(batch, truth[snapshot], velocity[snapshot], scale)
                _write_bounds(arrays, snapshot, information, dataclasses.replace(options, noise="gaussian"))
                for name, values in of_velocity.items():
                    arrays[name][snapshot] = values
        yield bound_table(arrays, schema, chunk.snapshot, chunk.table, chunk.offsets[:-1])


def _batch(reader: MeasurementReader, chunk: Chunk, row: IntArray) -> Any:
    return dense_batch(reader.kind, chunk.columns, row, scene=reader.scene, dimension=reader.dimension)


def _in_axes_of_bound(batch: Any, reader: MeasurementReader, point: FloatArray) -> tuple[Any, FloatArray]:
    """Return a batch and points (B, D): of places on earth in three dimensions in local east, north and up."""
    if reader.scene.frame is None or not reader.scene.frame.on_ellipsoid:
        return batch, point
    from nlosctl.pipeline.solve.earth_centred import seen_from  # only for places on earth

    return seen_from(batch, reader.scene.frame, point)


def _truth(chunk: Chunk, dimension: int) -> FloatArray:
    for name in [*TRUTH_NAMES, TRUTH_HEIGHT.name][:dimension]:
        if name not in chunk.table.column_names:
            raise DataError(
                f"{chunk.source}: no column {name!r}; a bound needs the truth, or `map` for a grid of positions"
            )
    return truth_positions(chunk.table, chunk.offsets[:-1], dimension)


def _may_be_direct(chunk: Chunk) -> BoolArray:
    if "truth_los" not in chunk.table.column_names:
        return np.ones(chunk.table.num_rows, dtype=bool)
    return np.asarray(boolean_codes(chunk.table.column("truth_los")) != 0)


def first_chunk(reader: MeasurementReader) -> Chunk:
    """Return the first chunk, for a map; raises DataError for an input without rows."""
    chunk = next(iter(reader.chunks()), None)
    if chunk is None:
        raise DataError("no snapshot to take sensors and paths from")
    return chunk


def map_sensors(chunk: Chunk, reader: MeasurementReader) -> tuple[Sensor, ...]:
    """Return the sensors of the first snapshot's rows that take part; one at several positions has names #2, ..."""
    lasting = (dataclasses.replace(sensor, start=None, end=None) for sensor in reader.scene.sensors)
    known = {(sensor.name, sensor.position): sensor for sensor in lasting}
    found: dict[tuple[str, tuple[float, float]], Sensor] = {}
    counts: Counter[str] = Counter()
    for row in np.flatnonzero(~chunk.left_out[: chunk.offsets[1]]).tolist():
        name = reader.sensor_names[chunk.columns["sensor"][row]]
        position = (float(chunk.columns["sensor_x_m"][row]), float(chunk.columns["sensor_y_m"][row]))
        if (name, position) not in found:
            counts[name] += 1
            unique = name if counts[name] == 1 else f"{name}#{counts[name]}"
            height = float(chunk.columns["sensor_z_m"][row]) if reader.dimension == 3 else None
            found[name, position] = known.get((name, position), Sensor(name=unique, position=position, z_m=height))
    return tuple(found.values())


def bounds_on_map(reader: MeasurementReader, chunk: Chunk, grid: MapGrid, options: SolveOptions) -> Iterator[Any]:
    """Yield tables with the bound at each vertex, for the sensors, paths and stds of the first snapshot of a chunk."""
    schema = result_schema(reader, grid)
    model = INFORMATION[_supported(reader)]
    chunk = _as_modelled(chunk, reader, options)
    single, causes = _first_snapshot(reader, chunk)
    single = _without_ranges(single, options)
    height = () if reader.dimension == 2 else (_map_height_m(single),)
    for x, y in grid.blocks():
        point = np.stack([x, y, *(np.full(x.shape, z) for z in height)], axis=1)
        arrays = _no_bounds(point)
        batch = model.seen_from(single, *point.T)
        if not isinstance(batch, BearingBatch):
            batch, point = _in_axes_of_bound(batch, reader, point)
        information = information_with_causes(
            model.at(batch, *point.T),
            reader.kind,
            batch,
            point,
            causes.take(np.zeros(x.size, dtype=np.int64)),
            options.noise,
        )
        _write_bounds(arrays, slice(None), information, options)
        yield bound_table(arrays, schema)


def _map_height_m(single: Any) -> float:
    """Return the height of a map's positions in space: the measured or known one of the first snapshot."""
    if single.target_z_m is None:
        raise UsageError(
            "`map` in three dimensions needs the height of its positions: set `target_z_m`, "
            "and `target_z_std_m` unless the estimator knows it exactly"
        )
    return float(single.target_z_m[0])


def _as_modelled(chunk: Chunk, reader: MeasurementReader, options: SolveOptions) -> Chunk:
    """Return the chunk with the heights of its sensors above the source, if ``target_z_m`` is given.

    Raises UsageError for ranges by circles that are slant, or beside bearings.
    """
    chunk = with_target_heights(chunk, reader.dimension, options)
    if options.noise == "laplace" and reader.options.speed_std_m_s:
        raise UsageError("`speed_std_m_s` is for the bound of gaussian errors; leave it out, or `noise` laplace")
    if reader.scene.has_circles and reader.kind == "bearings" and options.use_ranges:
        refuse_circle_ranges(chunk, reader.scene)
    elif reader.scene.has_circles and reader.kind == "ranges":
        refuse_reflected_ranges(chunk, reader.kind, reader.scene, ())
    return chunk


def _supported(reader: MeasurementReader) -> str:
    if "truth_target" in reader.schema.names:
        raise DataError("the rows are of several targets (truth_target); a bound is of one source")
    if reader.kind not in INFORMATION:
        raise UsageError(f"a bound exists for {', '.join(INFORMATION)}, not for {reader.kind}")
    return reader.kind


def _first_snapshot(reader: MeasurementReader, chunk: Chunk) -> tuple[Any, SharedCauses]:
    """Return a batch of the first snapshot, and what is not exactly known of it."""
    kept = ~chunk.left_out
    kept[chunk.offsets[1] :] = False
    for _, row in dense_blocks(chunk.offsets[:2], kept[: chunk.offsets[1]], 1):
        if row.shape[1]:
            batch = _batch(reader, chunk, row)
            return batch, batch_causes(chunk.columns, row, batch, reader.options.calibration)
    raise DataError(f"{chunk.source}: the first snapshot has no row that is used; a map takes its sensors from it")


def _no_bounds(position_m: FloatArray) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of positions (B, D) without a bound: NaN."""
    size, dimension = position_m.shape
    arrays: dict[str, npt.NDArray[Any]] = dict(zip(("x_m", "y_m", "z_m"), position_m.T, strict=False))
    arrays["n_used"] = np.zeros(size, dtype=np.int64)
    fields = dataclasses.fields(Bounds if dimension == 2 else SpaceBounds)
    return arrays | {field.name: np.full(size, np.nan) for field in fields}


def _write_bounds(
    arrays: dict[str, npt.NDArray[Any]], index: Any, information: Information, options: SolveOptions
) -> None:
    bounds = bounds_of(information.with_rows_scaled(_INFORMATION_PER_VARIANCE[options.noise]))
    for name, values in vars(bounds).items():
        arrays[name][index] = values
    if "bound_zz_m2" in arrays and not isinstance(bounds, SpaceBounds):  # a height that is exactly known
        for name in ("bound_xz_m2", "bound_yz_m2", "bound_zz_m2"):
            arrays[name][index] = np.where(np.isnan(bounds.rms_m), np.nan, 0.0)
    arrays["n_used"][index] = information.n_used


def _without_ranges(batch: Any, options: SolveOptions) -> Any:
    """Return the batch without the ranges of bearings if they are not used."""
    if options.use_ranges or not isinstance(batch, BearingBatch):
        return batch
    return dataclasses.replace(batch, range_m=None, range_std_m=None)
