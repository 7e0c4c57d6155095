"""Further columns of estimates: coordinates on earth, the error ellipse, and the columns that ``add`` asks for.

A column that ``add`` asks for is declared in `nlosctl.contract.tables` and computed by its entry in `ADDED`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.contract.scene import EarthFrame
from nlosctl.contract.tables import ADDED_COLUMNS, ELLIPSE, TRUTH_HEIGHT
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.evaluation.consistency import squared_mahalanobis, uncertain_coordinates
from nlosctl.geometry.ellipses import (
    circular_error_probable,
    ellipse_threshold,
    ellipsoid_threshold,
    error_ellipse,
    spherical_error_probable,
)
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.layouts import TRUTH_NAMES, ChunkEstimates
from nlosctl.io.scenes.places import errors_in
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.models.information import UNIT_INFORMATION
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.solve_chunk import ChunkSolution, ChunkSolver, dense_batch, dense_blocks
from nlosctl.pipeline.solve.target_heights import by_height

__all__ = ["ADDED", "AddedColumn", "check_added", "further_columns", "optional_columns"]

_BLOCK_SIZE = 4096
_CONDITION_LIMIT = 1e12

Runs = Sequence[MethodRun]


@dataclass(frozen=True)
class AddedColumn:
    """How a column of ``add`` is computed.

    ``compute(solver, chunk, solution)`` returns the values (E,) of the solution's estimates, NaN where there is no
    value. ``fault(reader, runs)`` returns why the column can't be computed for this run, empty if it can.
    """

    compute: Callable[[ChunkSolver, Chunk, ChunkSolution], FloatArray]
    fault: Callable[[MeasurementReader, Runs], str] = lambda reader, runs: ""
    needs_flags: bool = False


def optional_columns(ellipse: float | None, add: Sequence[str], dimension: int) -> frozenset[str]:
    """Return the names of the columns that ``ellipse`` and ``add`` ask for; raises UsageError for an unknown name."""
    for name in add:
        if name not in ADDED_COLUMNS:
            near = did_you_mean(name, ADDED_COLUMNS)
            raise UsageError(f"`add` {name}: no such column{near}; there are: {', '.join(ADDED_COLUMNS)}")
    names = {ADDED_COLUMNS[name].name for name in add}
    of_ellipse = {column.name for column in ELLIPSE if dimension == 3 or not column.of_space}
    return frozenset(names if ellipse is None else names | of_ellipse)


def check_added(add: Sequence[str], reader: MeasurementReader, runs: Runs) -> None:
    """Raise UsageError if a column of ``add`` can't be computed for this input or these methods."""
    for name in add:
        if ADDED_COLUMNS[name].of_space and reader.dimension == 2:
            raise UsageError(f"`add` {name}: is of three dimensions, and the input is of two; leave it out")
        fault = ADDED[name].fault(reader, runs)
        if fault:
            raise UsageError(f"`add` {name}: {fault}")


def further_columns(
    solver: ChunkSolver, chunk: Chunk, solution: ChunkSolution, ellipse: float | None, add: Sequence[str]
) -> Mapping[str, FloatArray]:
    """Return the columns (E,) of a chunk's estimates that the frame of the scene, ``ellipse`` and ``add`` ask for."""
    estimates = solution.estimates
    if estimates is None:
        return {}
    columns: dict[str, FloatArray] = {}
    if solver.scene.frame is not None:
        columns |= _on_earth(solver.scene.frame, estimates)
    if ellipse is not None:
        columns |= _ellipse(estimates, ellipse)
    return columns | {ADDED_COLUMNS[name].name: ADDED[name].compute(solver, chunk, solution) for name in add}


def _on_earth(frame: EarthFrame, estimates: ChunkEstimates) -> dict[str, FloatArray]:
    lat, lon = plane_of(frame).to_earth(estimates.position_m[:, 0], estimates.position_m[:, 1])
    height = {"height_m": estimates.position_m[:, 2]} if frame.on_ellipsoid else {}
    return {"lat_deg": lat, "lon_deg": lon, **height}


def _ellipse(estimates: ChunkEstimates, probability: float) -> dict[str, FloatArray]:
    """Return the ellipse in x and y, and in space the interval of the height, each with the ``probability``."""
    one_sigma = error_ellipse(_horizontal(estimates))
    degrees = estimates.columns.get("std_dof")
    scale = np.sqrt(ellipse_threshold(probability, degrees))
    height: dict[str, FloatArray] = {}
    if estimates.position_m.shape[1] == 3:
        squared = ellipsoid_threshold(probability, np.ones(len(estimates.status), dtype=np.int64), degrees)
        height = {"half_height_m": np.sqrt(squared * estimates.covariance_m2[:, 5])}
    return {
        **height,
        "semi_major_m": scale * one_sigma.semi_major_m,
        "semi_minor_m": scale * one_sigma.semi_minor_m,
        "orientation_rad": one_sigma.orientation_rad,
        "ellipse_probability": np.where(np.isnan(one_sigma.semi_major_m), np.nan, probability),
    }


def _horizontal(estimates: ChunkEstimates) -> SymmetricMatrix:
    """Return the covariances of x and y."""
    return SymmetricMatrix(*estimates.covariance_m2.T[:3])


def _cep50(solver: ChunkSolver, chunk: Chunk, solution: ChunkSolution) -> FloatArray:
    assert solution.estimates is not None  # noqa: S101 - columns are of estimates
    one_sigma = error_ellipse(_horizontal(solution.estimates))
    radius = circular_error_probable(one_sigma.semi_major_m, one_sigma.semi_minor_m)
    degrees = solution.estimates.columns.get("std_dof")
    return radius if degrees is None else radius * np.sqrt(ellipse_threshold(0.5, degrees) / ellipse_threshold(0.5))


def _sep50(solver: ChunkSolver, chunk: Chunk, solution: ChunkSolution) -> FloatArray:
    assert solution.estimates is not None  # noqa: S101 - columns are of estimates
    covariance = solution.estimates.covariance_m2
    radius = spherical_error_probable(SymmetricMatrix(*covariance.T))
    degrees = solution.estimates.columns.get("std_dof")
    if degrees is None:
        return radius
    unknowns = uncertain_coordinates(covariance)
    return radius * np.sqrt(ellipsoid_threshold(0.5, unknowns, degrees) / ellipsoid_threshold(0.5, unknowns))


def _gdop(solver: ChunkSolver, chunk: Chunk, solution: ChunkSolution, part: str = "whole") -> FloatArray:
    """Return sqrt(trace(G^-1)), where G sums u u^T over the rows that an estimate rests on; or a ``part`` of the trace.

    u is the unit vector across a row's line of position, or along its range (times cos(elevation) for slant ranges):
    the root of the trace of the covariance for errors of 1 m in each row, for ranges the usual definition. NaN without
    a position, or if the rows leave a direction undetermined. In space an elevation is a further row, across the ray in
    its vertical plane.
    """
    estimates = solution.estimates
    assert estimates is not None  # noqa: S101 - columns are of estimates
    values = np.full(estimates.snapshot.shape, np.nan)
    for number, flags in enumerate(solution.flags):
        mine = np.flatnonzero((estimates.method == number) & np.isfinite(estimates.position_m[:, 0]))
        for rank in np.unique(estimates.alternative[mine]).tolist():
            chosen = mine[estimates.alternative[mine] == rank]
            _write_gdop(solver, chunk, estimates, chosen, flags.used, values, part)
    return values


def _write_gdop(
    solver: ChunkSolver,
    chunk: Chunk,
    estimates: ChunkEstimates,
    chosen: IntArray,
    used: BoolArray,
    values: FloatArray,
    part: str,
) -> None:
    """Write the GDOP of the ``chosen`` estimates, at most one of each snapshot, to ``values`` (E,)."""
    estimate_of = np.full(chunk.offsets.shape[0] - 1, -1, dtype=np.int64)
    estimate_of[estimates.snapshot[chosen]] = chosen
    blocks = dense_blocks(chunk.offsets, used & ~chunk.left_out, _BLOCK_SIZE)
    for snapshot, row in (part for block in blocks for part in by_height(chunk, *block)):
        index = estimate_of[snapshot]
        exists = index >= 0
        if not row.shape[1] or not exists.any():
            continue
        batch: Any = dense_batch(solver.kind, chunk.columns, row, scene=solver.scene, dimension=solver.dimension)
        if not batch.height_held:  # a measured height is no row
            batch = replace(batch, target_z_m=None, target_z_std_m=None)
        position = np.where(exists[:, None], estimates.position_m[index], np.nan)
        geometry = UNIT_INFORMATION[solver.kind](batch, *position.T)
        values[index[exists]] = _dilution(geometry, part)[exists]


def _dilution(geometry: SymmetricMatrix, part: str) -> FloatArray:
    """Return the root (B,) of the trace of the inverse, or of the horizontal or vertical part of it."""
    with ignoring_division():
        smaller, larger = geometry.eigenvalues()
        regular = (smaller * _CONDITION_LIMIT > larger) & np.isfinite(larger)
        if part == "vertical" and geometry.dimension == 2:  # the height is held
            return np.where(regular, 0.0, np.nan)
        if geometry.dimension == 2:
            trace = geometry.trace / geometry.determinant
        else:
            variances = geometry.inverse().diagonal
            chosen = {"whole": variances, "horizontal": variances[:2], "vertical": variances[2:]}[part]
            trace = np.sum(chosen, axis=0)
        return np.where(regular, np.sqrt(trace), np.nan)


def _gdop_fault(reader: MeasurementReader, runs: Runs) -> str:
    if reader.options.keep_times:
        return "is of a source at rest; leave out one of it and motion=velocity"
    if reader.kind in UNIT_INFORMATION and all(run.spec.job == "localize" for run in runs):
        return ""
    return f"there for 'localize' of {' and '.join(UNIT_INFORMATION)}, where a snapshot is of one source"


def _nees(solver: ChunkSolver, chunk: Chunk, solution: ChunkSolution) -> FloatArray:
    assert solution.estimates is not None  # noqa: S101 - columns are of estimates
    estimates = solution.estimates
    position, truth, frame = estimates.position_m, estimates.truth_m(chunk), solver.scene.frame
    error = position - truth if frame is None else errors_in(frame, position, truth)
    return squared_mahalanobis(error, estimates.covariance_m2)


def _nees_fault(reader: MeasurementReader, runs: Runs) -> str:
    if "truth_target" in reader.column_names:
        return "needs one true position per snapshot, but the rows are of several targets (truth_target)"
    names = (*TRUTH_NAMES, TRUTH_HEIGHT.name)[: reader.dimension]
    missing = [name for name in names if name not in reader.column_names]
    return f"needs the true position, but the input has no column {missing[0]!r}" if missing else ""


ADDED = {
    "cep50": AddedColumn(_cep50),
    "sep50": AddedColumn(_sep50),
    "gdop": AddedColumn(_gdop, _gdop_fault, needs_flags=True),
    "hdop": AddedColumn(partial(_gdop, part="horizontal"), _gdop_fault, needs_flags=True),
    "vdop": AddedColumn(partial(_gdop, part="vertical"), _gdop_fault, needs_flags=True),
    "nees": AddedColumn(_nees, _nees_fault),
}
"""The columns that ``add`` can request, by its names."""
