"""Methods on rows whose offsets are not exactly known: rows of one sensor correlate, and sensors calibrated together.

A method solves the rows with the variance of their offsets added to their own. A fix of least squares then moves to
where A'R^-1 r = 0 under the covariance R of all rows, and its covariance becomes (A'R^-1 A)^-1. The fix of any other
method stays; its covariance grows by the sandwich of its rows' weights with R.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.contract.calibration import OFFSETS, Calibration
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.results import Estimates, Flags, Solution, has_covariance
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.io.measurements.completion.calibrated_rows import OFFSET_ENTRY
from nlosctl.io.measurements.reader import Chunk
from nlosctl.models.bearings import sight_lines
from nlosctl.models.information import Information
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS
from nlosctl.pipeline.solve.method_runs import BlockSolver, MethodRun
from nlosctl.pipeline.solve.stds.row_squares import uses_ranges
from nlosctl.solvers.optimization.correlated_rows import (
    correlated_equations,
    inverse_or_nan,
    refine_positions,
    rescaled_covariance,
    sandwich_of_weights,
)
from nlosctl.solvers.optimization.split_batches import take_snapshots

__all__ = ["information_with_offsets", "shared_errors", "solver_with_offsets", "with_own_variances"]

_STDS = {"bearings": "bearing_std_rad", "ranges": "range_std_m", "arrivals": "arrival_std_m"}
_CORRELATED_KINDS = ("bearings", "ranges")
"""Kinds whose rows correlate; for others each row has its own variance alone."""

_MOST_NUMBERS = 1 << 22
"""So many entries of row covariances are in memory at a time."""

_FAR = 3.0
"""A fix within so many stds of a sensor, or that correlations would move so far, stays where the method found it."""


def solver_with_offsets(solve: BlockSolver, run: MethodRun, chunk: Chunk, calibration: Calibration) -> BlockSolver:
    """Return a method on a chunk after a calibration, as a function of batches and their rows (B, K)."""
    covariance, entries = calibration.correlated(), chunk.columns[OFFSET_ENTRY]

    def solve_rows(batch: Any, row: IntArray) -> Solution:
        shared = shared_errors(covariance, entries[row])
        if not shared.any():
            return solve(batch, row)
        wider = with_own_variances(batch, calibration.kind, shared)
        solution = solve(wider, row)
        if batch.dimension != 2 or calibration.kind not in _CORRELATED_KINDS:
            return solution
        return _Correlated(run.spec, run.options, calibration.kind).solution(solution, batch, wider, shared)

    return solve_rows


def shared_errors(covariance: FloatArray, entries: IntArray) -> FloatArray:
    """Return the errors (B, K, K) of rows per standard normal cause, by the entries (B, K) of their offsets, -1: none.

    Their products are the covariances of the offsets (E, E) of the rows.
    """
    whole = np.pad(covariance, (0, 1))
    rows = whole[entries[:, :, None], entries[:, None, :]]
    if not rows.any():
        return np.zeros(rows.shape)
    values, vectors = np.linalg.eigh(rows)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def with_own_variances(batch: Any, kind: str, shared: FloatArray) -> Any:
    """Return the batch with the variance of each row's shared errors (B, K, M) added to that of its own."""
    name = _STDS[kind]
    variance = np.sum(shared * shared, axis=2)
    std = getattr(batch, name)
    return dataclasses.replace(batch, **{name: np.asfortranarray(np.sqrt(std * std + variance))})


def _is_plain(batch: Any, position_m: FloatArray, covariance: FloatArray, refined_m: FloatArray) -> BoolArray:
    """Return which fixes (B,) are far from every sensor, and stay near where they were, in their stds."""
    away = position_m[:, None, :] - batch.sensor_xy_m
    nearest = np.min(away[..., 0] ** 2 + away[..., 1] ** 2, axis=1)
    moved = np.sum((refined_m - position_m) ** 2, axis=1)
    variance = covariance[:, 0, 0] + covariance[:, 1, 1]
    return np.asarray((nearest > _FAR**2 * variance) & (moved < _FAR**2 * variance))


def information_with_offsets(
    information: Information, batch: Any, point: FloatArray, entries: IntArray, calibration: Calibration
) -> Information:
    """Return the information of snapshots about points (B, D) with rows whose offsets share their errors.

    Of rows that can see the point; beyond the plane the offsets are taken as exact.
    """
    shared = shared_errors(calibration.correlated(), entries)
    if not shared.any() or batch.dimension != 2 or calibration.kind not in _CORRELATED_KINDS:
        return information
    rows: Any = sight_lines(batch) if calibration.kind == "bearings" else range_rows(batch)
    local = (part - middle for part, middle in zip(point.T, rows.center, strict=False))
    hidden = rows.unseen(*local)
    name = _STDS[calibration.kind]
    seen = dataclasses.replace(batch, **{name: np.where(hidden, np.inf, getattr(batch, name))})
    with_ranges = calibration.kind == "bearings" and batch.range_m is not None
    with ignoring_division():
        scalars = SCALED_RESIDUALS[calibration.kind](seen, point, with_ranges=with_ranges)
    matrix, _, _ = correlated_equations(scalars, shared)
    parts = SymmetricMatrix(*(matrix[:, i, j] for i in range(2) for j in range(i + 1)))
    return dataclasses.replace(information, matrix=parts)


@dataclasses.dataclass(frozen=True)
class _Correlated:
    """What correlations of rows change in the solutions of a method."""

    spec: MethodSpec
    options: Any
    kind: str

    @property
    def minimizes(self) -> bool:
        """Whether the fix minimizes the chi-square of Gaussian errors of all rows."""
        plain = (
            getattr(self.options, "range_noise", "gaussian") == getattr(self.options, "law", "gaussian") == "gaussian"
        )
        return self.spec.cost == LEAST_HALF_CHI_SQUARE and plain

    def solution(self, solution: Solution, batch: Any, wider: Any, shared: FloatArray) -> Solution:
        """Return the solution of the rows with their own stds (``batch``), by that with ``wider`` ones."""
        estimates = solution.estimates
        certain = np.flatnonzero(has_covariance(estimates.status))
        size = max(_MOST_NUMBERS // shared[0].size, 1)
        for start in range(0, certain.shape[0], size):
            estimates = self._changed(estimates, certain[start : start + size], batch, wider, shared)
        if solution.flags is None or not self.minimizes:
            return dataclasses.replace(solution, estimates=estimates)
        return dataclasses.replace(solution, estimates=estimates, flags=self._flags(solution.flags, estimates, batch))

    def _changed(self, estimates: Estimates, chosen: IntArray, batch: Any, wider: Any, shared: FloatArray) -> Estimates:
        """Return the estimates, those ``chosen`` as the correlations make them."""
        row = estimates.row[chosen]
        mine, wide, errors = take_snapshots(batch, row), take_snapshots(wider, row), shared[row]
        position = estimates.position_m[chosen]
        given = SymmetricMatrix(*estimates.covariance_m2[chosen].T).dense()
        name = _STDS[self.kind]
        share = (getattr(mine, name) / getattr(wide, name)) ** 2
        weight = np.ones(share.shape, order="F")
        if self.spec.direct_rows is not None:
            weight = np.nan_to_num(self.spec.direct_rows(wide, self.options, position)[1])
        information, sandwich = sandwich_of_weights(self._scalars(wide, position), weight, share, errors)
        before, after, cost = inverse_or_nan(information), sandwich, None
        if self.minimizes:
            refined, square = refine_positions(lambda point: self._scalars(mine, point), position, errors)
            near = _is_plain(mine, position, given, refined)[:, None]
            position = np.where(near, refined, position)
            product, _, square = correlated_equations(self._scalars(mine, position), errors)
            after = np.where(near[:, :, None], inverse_or_nan(product), sandwich)
            cost = 0.5 * square
        changed = rescaled_covariance(given, before, after)
        known = np.isfinite(changed).all(axis=(1, 2))
        chosen, changed = chosen[known], changed[known]
        covariance = estimates.covariance_m2.copy()
        covariance[chosen] = np.stack([changed[:, i, j] for i in range(2) for j in range(i + 1)], axis=1)
        replaced: dict[str, Any] = {"covariance_m2": covariance}
        if cost is not None:
            for field, values in (("position_m", position), ("cost", cost), ("chi_square", 2.0 * cost)):
                array = getattr(estimates, field)
                if array is not None:
                    array = array.copy()
                    array[chosen] = values[known]
                    replaced[field] = array
        return dataclasses.replace(estimates, **replaced)

    def _scalars(self, batch: Any, position_m: FloatArray) -> Any:
        return SCALED_RESIDUALS[self.kind](batch, position_m, with_ranges=uses_ranges(self.spec, self.options))

    def _flags(self, flags: Flags, estimates: Estimates, batch: Any) -> Flags:
        """Return the flags with the residuals at the positions of the best estimates."""
        best = np.flatnonzero((estimates.alternative == 0) & has_covariance(estimates.status))
        row = estimates.row[best]
        mine = take_snapshots(batch, row)
        residuals = {}
        for scalar in self._scalars(mine, estimates.position_m[best]):
            if scalar.per_offset is not None:
                name = "residual_rad" if OFFSETS[self.kind].column == "bearing_rad" else "residual_m"
                residuals[name] = -scalar.residual / scalar.per_offset
            elif mine.range_std_m is not None:
                residuals["residual_m"] = np.where(scalar.measured > 0.0, scalar.residual * mine.range_std_m, np.nan)
        columns = dict(flags.columns)
        for name in residuals.keys() & columns.keys():
            values = np.array(columns[name], dtype=np.float64)
            values[row] = residuals[name]
            columns[name] = values
        return dataclasses.replace(flags, columns=columns)
