"""Sums of squared residuals over stated std, and of their degrees of freedom, over the snapshots of a chunk."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Estimates
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.completion.references import FORM, Form
from nlosctl.io.measurements.completion.sensor_keys import sensor_texts
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.solve.learned_options import pass_batches
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.stds.row_squares import row_squares, weighted_rows, with_std_factors, with_unknown_factor
from nlosctl.pipeline.solve.stds.unknown_std import StdFactor

__all__ = ["ResidualSums"]

_NO_REFERENCE_ROW = "`estimate_std` of sensors needs the row of each reference, whose difference is 0; add these rows"

_POOLED = (Status.OK, Status.AMBIGUOUS)


@dataclass(frozen=True, kw_only=True)
class ResidualSums:
    """The sums of squared residuals over stated std, and their degrees of freedom, over a chunk.

    Keys are the number of the run and the name of the sensor, None for the file.
    """

    kind: str
    dimension: int
    scene: Scene
    runs: tuple[tuple[int, MethodRun, bool], ...]
    options: SolveOptions

    def __call__(self, chunk: Chunk) -> ExactSums:
        """Return the sums over a chunk; raises UsageError for sensors where a reference has no row of its own."""
        sums = ExactSums()
        forms = chunk.columns.get(FORM, np.empty(0))
        if any(by_sensor for *_, by_sensor in self.runs) and (forms == Form.WITHOUT_REFERENCE).any():
            raise UsageError(_NO_REFERENCE_ROW)
        codes, names = sensor_texts(chunk)
        factors = {number: _row_factors(run, chunk) for number, run, _ in self.runs}
        keys = {number: [(number, name) for name in names] if by_sensor else [] for number, _, by_sensor in self.runs}
        for own in keys.values():
            sums.add_groups(own, np.empty(0, dtype=np.int64), np.empty((0, 2)))
        for row, batch in pass_batches(chunk, self.kind, self.scene, self.options, self.dimension):
            for number, run, by_sensor in self.runs:
                if row.shape[1] < run.spec.minimum_measurements or not _can_solve(run.spec, batch):
                    continue
                if not by_sensor:
                    sums.add((number, None), _file_sums(run, batch))
                    continue
                pairs = np.stack(_row_sums(run, batch, factors[number][row]), axis=-1).reshape(-1, 2)
                sums.add_groups(keys[number], codes[row].ravel(), pairs)
        return sums


def _can_solve(spec: MethodSpec, batch: Any) -> bool:
    """Return whether a method reads all that a batch has; one that does not is refused in the run."""
    return getattr(batch, "reference_xy_m", None) is None or "reference" in spec.reads


def _row_factors(run: MethodRun, chunk: Chunk) -> FloatArray:
    """Return the current factors (N,) of the rows."""
    rows = run.std.row_factors(chunk) if run.std is not None else None
    file = None if run.std is None else run.std.file
    return np.full(chunk.left_out.shape, 1.0 if file is None else file.value) if rows is None else rows[0]


def _file_sums(run: MethodRun, batch: Any) -> FloatArray:
    """Return the squares and degrees of freedom (B, 2) of each snapshot with a fix and spare scalars, else zeros."""
    spec, std = run.spec, run.std
    file = None if std is None else std.file
    if spec.direct_rows is not None and file is not None:
        factors = np.full(next(iter(_stds(batch))).shape, file.value)
        rows = weighted_rows(spec, run.options, batch, factors)
        return np.stack([sum_measurements(rows.squares), np.maximum(rows.spare, 0.0)], axis=1)
    starts = spec.direct_rows is not None  # a starting value only: outliers make any status of `ml`
    if starts:
        spec = registry.resolve("ml", spec.kind, "localize")
    scaled = with_unknown_factor(batch) if file is None else with_std_factors(batch, file.value)
    estimates = spec.solve(scaled, run.options if spec is run.spec else spec.options()).estimates
    chosen = _with_spare_scalars(estimates) if starts else _pooled(estimates)
    return _in_batch(estimates, batch.size, _squares_of_fits(estimates, file), chosen)


def _squares_of_fits(estimates: Estimates, file: StdFactor | None) -> FloatArray:
    """Return the squared residuals over stated std of each estimate, by the factor that scaled them, None: its own."""
    assert estimates.chi_square is not None  # noqa: S101 - part of the contract of such methods
    if file is not None:
        return estimates.chi_square * file.value**2
    return estimates.columns["std_factor"] ** 2 * estimates.columns["std_dof"]


def _stds(batch: Any) -> Iterator[FloatArray]:
    return (getattr(batch, name) for name in batch.STDS)


def _in_batch(estimates: Estimates, size: int, squares: FloatArray, chosen: IntArray) -> FloatArray:
    assert estimates.degrees_of_freedom is not None  # noqa: S101 - part of the contract of such methods
    sums = np.zeros((size, 2))
    sums[estimates.row[chosen]] = np.stack([squares, estimates.degrees_of_freedom], axis=1)[chosen]
    return sums


def _pooled(estimates: Estimates) -> IntArray:
    """Return the indices of the usual fixes with spare scalars: a wrong minimum would ruin a pooled factor."""
    spare = _with_spare_scalars(estimates)
    return spare[np.isin(estimates.status[spare], _POOLED)]


def _with_spare_scalars(estimates: Estimates) -> IntArray:
    """Return the indices of the best fixes with spare scalars."""
    assert estimates.degrees_of_freedom is not None  # noqa: S101 - part of the contract of such methods
    best = np.isfinite(estimates.position_m[:, 0]) & (estimates.alternative == 0)
    return np.flatnonzero(best & (estimates.degrees_of_freedom > 0))


def _row_sums(run: MethodRun, batch: Any, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the squared residual over stated std (B, K) of each row of fixes with spare scalars, and its degrees."""
    spec = run.spec
    if spec.direct_rows is not None:
        rows = weighted_rows(spec, run.options, batch, factors)
        spare = (rows.spare > 0.0)[:, None]
        return np.where(spare, rows.squares, 0.0), np.where(spare, rows.degrees, 0.0)
    scaled = with_std_factors(batch, factors)
    estimates = spec.solve(scaled, run.options).estimates
    chosen = _pooled(estimates)
    position = np.full((batch.size, estimates.position_m.shape[1]), np.nan)
    position[estimates.row[chosen]] = estimates.position_m[chosen]
    weight = np.asfortranarray(np.broadcast_to(np.isfinite(position[:, :1]), factors.shape).astype(np.float64))
    rows = row_squares(spec, run.options, scaled, position, weight, factors)
    return rows.squares, rows.degrees
