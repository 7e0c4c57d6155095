"""Methods on rows that share errors: offsets, sensors and mirrors whose values are not exactly known.

A method solves the rows with the variance of their shared errors added to their own. A fix of least squares then moves
to where A'R^-1 r = 0 under the covariance R of all rows, and its covariance becomes (A'R^-1 A)^-1. The fix of any other
method stays; its covariance grows by the sandwich of its rows' weights with R.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.results import Estimates, Solution, has_covariance, has_position
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk
from nlosctl.models.shared_causes.causes import SharedCauses
from nlosctl.models.shared_causes.joint_rows import JointRows, joint_rows
from nlosctl.models.sight import has_geodesics
from nlosctl.pipeline.solve.method_runs import BlockSolver, MethodRun
from nlosctl.pipeline.solve.shared_causes.chunk_causes import batch_causes
from nlosctl.pipeline.solve.shared_causes.correlated_results import (
    Changes,
    changed_estimates,
    changed_flags,
    dense_covariances,
)
from nlosctl.pipeline.solve.shared_causes.widened_rows import share_without_position, widened
from nlosctl.pipeline.solve.stds.row_squares import uses_ranges
from nlosctl.solvers.optimization.correlated_rows import (
    correlated_equations,
    covariance_by_gain,
    covariance_of_fix,
    least_square,
    linear_fix,
    refine_positions,
    rescaled_covariance,
    sandwich_of_weights,
)
from nlosctl.solvers.optimization.split_batches import take_snapshots

__all__ = ["solver_with_causes"]

_MOST_NUMBERS = 1 << 22
"""So many entries of row covariances are in memory at a time."""

_NEAR = 3.0
"""A fix within so many stds of a sensor stays where the method found it."""

_FAR = 6.0
"""A fix that correlations would move so many stds, stays."""

_USED = 0.5
"""A robust method uses rows that are direct with a larger probability."""

_PLAIN_PASSES, _ROBUST_PASSES = 1, 2
"""So often errors that depend on the position are taken at the position found so far, from that without any."""


def solver_with_causes(solve: BlockSolver, run: MethodRun, chunk: Chunk, calibration: Any) -> BlockSolver:
    """Return a method on a chunk, as a function of batches and their rows (B, K), whose rows may share errors."""
    if run.spec.kind == "triplets":
        return solve

    def solve_rows(batch: Any, row: IntArray) -> Solution:
        causes = batch_causes(chunk.columns, row, batch, calibration)
        if not causes.any_error:
            return solve(batch, row)
        return _Correlated(run.spec, run.options, batch, causes).solution(lambda wider: solve(wider, row))

    return solve_rows


@dataclasses.dataclass(frozen=True)
class _Correlated:
    """A method on a batch whose rows share errors."""

    spec: MethodSpec
    options: Any
    batch: Any
    causes: SharedCauses

    @property
    def minimizes(self) -> bool:
        """Whether the fix minimizes the chi-square of Gaussian errors of all rows."""
        plain = (
            getattr(self.options, "range_noise", "gaussian") == getattr(self.options, "law", "gaussian") == "gaussian"
        )
        return self.spec.cost == LEAST_HALF_CHI_SQUARE and plain

    def rows(self, index: IntArray, position_m: FloatArray) -> JointRows:
        """Return the rows of some snapshots (N,) at positions (N, D)."""
        batch, causes = self.batch, self.causes
        if index.shape[0] != batch.size or not bool((index == np.arange(batch.size)).all()):
            batch, causes = take_snapshots(batch, index), causes.take(index)
        with_ranges = uses_ranges(self.spec, self.options)
        return joint_rows(self.spec.kind, batch, causes, position_m, with_ranges=with_ranges)

    def solution(self, solve: Callable[[Any], Solution]) -> Solution:
        """Return the solution of the batch by a function that solves batches of independent rows."""
        passes, position = 1, np.full((self.batch.size, self.batch.dimension), np.nan)
        if self.causes.depend_on_position:
            passes += _PLAIN_PASSES if self.spec.direct_rows is None else _ROBUST_PASSES
        share = np.ones((0, 0))
        for number in range(passes):
            wider = self.batch
            if number or passes == 1:
                wider, share = widened(self.spec.kind, self.batch, self._own_shares(position))
            found = dataclasses.replace(wider, want_flags=wider.want_flags and number == passes - 1)
            solution = solve(found)
            estimates = solution.estimates
            best = np.flatnonzero((estimates.alternative == 0) & has_position(estimates.status))
            position[estimates.row[best]] = estimates.position_m[best]
        return self._correlated(solution, wider, share)

    def _own_shares(self, position_m: FloatArray) -> FloatArray:
        """Return each scalar's own variance (B, S) as a share of all its variance, at positions (B, D).

        Without a position, of the errors that do not depend on it. Raises UsageError for those of geodesics that do.
        """
        if has_geodesics(self.batch):
            if self.causes.depend_on_position:
                raise UsageError(
                    "positions of sensors that are not exactly known have no model for azimuths alone on the earth in "
                    "three dimensions; set `dimensions` to 2, or leave out their standard deviations"
                )
            return share_without_position(self.spec.kind, self.batch, self.causes)
        every = np.arange(self.batch.size)
        scalars = self.rows(every[:1], position_m[:1]).residual.shape[1]
        share = np.empty((every.size, scalars))
        size = max(_MOST_NUMBERS // scalars**2, 1)
        for start in range(0, every.size, size):
            part = every[start : start + size]
            share[part] = self.rows(part, position_m[part]).own_share
        lost = np.flatnonzero(np.isnan(position_m[:, 0]))
        if lost.size:
            plain = share_without_position(self.spec.kind, take_snapshots(self.batch, lost), self.causes.take(lost))
            share[lost, : plain.shape[1]] = plain[:, :scalars]
        return share

    def _correlated(self, solution: Solution, wider: Any, share: FloatArray) -> Solution:
        """Return a solution as correlations make it; of ``wider`` rows a ``share`` (B, S) of variance is their own."""
        estimates = solution.estimates
        certain = np.flatnonzero(has_covariance(estimates.status))
        if has_geodesics(self.batch) or not certain.size:
            return solution
        size = max(_MOST_NUMBERS // share.shape[1] ** 2, 1)
        parts = []
        for start in range(0, certain.shape[0], size):
            chosen = certain[start : start + size]
            parts.append(self._changes(estimates, chosen, wider, share))
        changes = Changes.join(parts)
        estimates = changed_estimates(estimates, changes, self.batch, self.options, ranks=self.minimizes)
        if solution.flags is None or not (self.minimizes or self.spec.line_rows is not None):
            return dataclasses.replace(solution, estimates=estimates)
        flags = changed_flags(self.spec.kind, solution.flags, estimates, self.batch)
        return dataclasses.replace(solution, estimates=estimates, flags=flags)

    def _changes(self, estimates: Estimates, chosen: IntArray, wider: Any, share: FloatArray) -> Changes:
        """Return how the correlations change the estimates ``chosen``."""
        row, position = estimates.row[chosen], estimates.position_m[chosen]
        share = share[row]
        direct = np.ones(self.causes.sensors.sensor[row].shape)
        if self.spec.direct_rows is not None:
            direct = np.nan_to_num(self.spec.direct_rows(take_snapshots(wider, row), self.options, position)[1])
        rows = self.rows(row, position)
        before, after = sandwich_of_weights(rows, rows.of_rows(direct, 1.0) * share)
        if self.minimizes:
            return self._refined(estimates, chosen, before, after)
        lines = None
        if self.spec.line_rows is not None:
            lines = self.spec.line_rows(take_snapshots(self.batch, row), self.options)
        if lines is not None:
            return self._of_lines(estimates, chosen, before, after, lines)
        given = dense_covariances(estimates, chosen, rows)
        square = None
        if self.spec.direct_rows is not None:
            square = least_square(rows.only(rows.of_rows(direct, 1.0) > _USED))
        return Changes(chosen, position, rescaled_covariance(given, before, after), square)

    def _of_lines(
        self, estimates: Estimates, chosen: IntArray, before: FloatArray, sandwich: FloatArray, lines: Any
    ) -> Changes:
        """Return the changes of weighted linear fits of ``lines``: the weights are those of all rows' covariance."""
        row, start = estimates.row[chosen], estimates.position_m[chosen]
        at_first = self.rows(row, lines.first_m)
        weighted = dataclasses.replace(at_first, residual=lines.residual, slopes=lines.slopes)
        fixed, gain = linear_fix(weighted, lines.first_m)
        after = covariance_by_gain(self.rows(row, fixed), gain, lines.spread(fixed))
        near = np.isfinite(after).all(axis=(1, 2)) & self._is_plain(row, start, sandwich, fixed)
        position = np.where(near[:, None], fixed, start)
        rows = self.rows(row, position)
        given = rescaled_covariance(dense_covariances(estimates, chosen, rows), before, sandwich)
        covariance = np.where(near[:, None, None], after, given)
        square = correlated_equations(rows)[2]
        return Changes(chosen, position, covariance, square, 0.5 * square)

    def _refined(self, estimates: Estimates, chosen: IntArray, before: FloatArray, sandwich: FloatArray) -> Changes:
        """Return the changes of fixes that minimize the chi-square."""
        row, start = estimates.row[chosen], estimates.position_m[chosen]
        refined, settled = refine_positions(lambda index, point: self.rows(row[index], point), start)
        near = settled & self._is_plain(row, start, sandwich, refined)
        position = np.where(near[:, None], refined, start)
        rows = self.rows(row, position)
        inverse, step = covariance_of_fix(rows)
        after = np.where(near[:, None, None], inverse, sandwich)
        covariance = rescaled_covariance(dense_covariances(estimates, chosen, rows), before, after)
        square = correlated_equations(rows)[2]
        return Changes(chosen, position, covariance, square, 0.5 * square, step if rows.nuisances else None)

    def _is_plain(self, row: IntArray, start: FloatArray, covariance: FloatArray, refined: FloatArray) -> BoolArray:
        """Return which fixes (N,) are far from every sensor, and stay near where they were, in their stds."""
        own = self.batch.sensor_xy_m[row]
        away = refined[:, None, :2] - own
        nearest = np.min(away[..., 0] ** 2 + away[..., 1] ** 2, axis=1)
        if refined.shape[1] == 3:
            nearest = np.min(np.sum(away**2, axis=2) + (refined[:, None, 2] - self.batch.sensor_z_m[row]) ** 2, axis=1)
        moved = np.sum((refined - start) ** 2, axis=1)
        variance = np.trace(covariance[:, : start.shape[1], : start.shape[1]], axis1=1, axis2=2)
        return np.asarray((nearest > _NEAR**2 * variance) & (moved < _FAR**2 * variance))
