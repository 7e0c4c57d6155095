"""The rows of methods that trust them all, for paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch, RangeBatch
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock
from nlosctl.models.bearings import SightLines
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.sight import bearing_lines
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.joint_range_bearing import range_columns
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.mixture.range_rows import DirectRanges
from nlosctl.solvers.optimization.problem import RowDerivatives
from nlosctl.solvers.tracking.path_rows import PathRows

__all__ = ["trusted_bearings", "trusted_ranges"]


@dataclass(frozen=True)
class _SeenFromAnywhere(RowBlock):
    """Rays in the plane, wherever they are seen from."""

    direct: DirectBearings

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` and its derivatives."""
        return self.direct.terms(k, *point)

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row."""
        return self.direct.scalars()


@dataclass(frozen=True)
class _Directions(RowBlock):
    """Rays in space, wherever they are seen from."""

    lines: SpaceLines

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` and its derivatives."""
        lines, at = self.lines, slice(k, k + 1)
        whole = lines.whole(point)
        half, gradient, gauss, _ = lines.expansion(at, whole, lines.row_path(at, whole))
        matrix = gauss.map(lambda part: part[:, 0])
        return RowDerivatives(half[:, 0], tuple(part[:, 0] for part in gradient), matrix, matrix)

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: azimuth, elevation, range."""
        count: IntArray = 1 + (self.lines.angles.has_elevation > 0.0).astype(np.int64)
        return count if self.lines.measured_m is None else count + np.isfinite(self.lines.measured_m)


def trusted_bearings(batch: BearingBatch, *, use_ranges: bool, lognormal: bool) -> PathRows:
    """Return bearings, in the plane or in space, with their ranges; raises UsageError for geodesics."""
    lines = bearing_lines(batch)
    ranges = range_columns(batch, use_ranges)
    if isinstance(lines, SpaceLines):
        lines = lines if ranges is None else lines.with_ranges(*ranges, lognormal=lognormal)
        return PathRows.trusted(_Directions(lines), lines.center, lambda *point: lines.residuals(batch, *point))
    if not isinstance(lines, SightLines):
        raise UsageError("azimuths of geodesics have no tracks; give the measurements in a plane")
    direct = DirectBearings.of(lines, np.zeros(batch.size), *(ranges or (None, None)), lognormal=lognormal)
    return PathRows.trusted(_SeenFromAnywhere(direct), lines.center, lambda *point: lines.residuals(batch, *point))


def trusted_ranges(batch: RangeBatch) -> PathRows:
    """Return ranges in the plane or in space."""
    circles = range_rows(batch)
    return PathRows.trusted(
        DirectRanges(circles), circles.center, lambda *point: {"residual_m": circles.residual_m(*point)}
    )
