"""Candidates of a block of bearings within the search region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import Scene
from nlosctl.models.obstacles import hidden_by_walls
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.ray_crossings import Candidates, choose_pairs, end_rays
from nlosctl.solvers.bearings.row_crossings import cross_rows
from nlosctl.solvers.bearings.space_crossings import ends_at_height, ends_of_ranges
from nlosctl.solvers.mixture.outlier_model import OutlierModel

__all__ = ["BearingCandidates"]


@dataclass(frozen=True)
class BearingCandidates:
    """Initial estimates: crossings of all pairs that may both be direct, and the ends of rays that have a range.

    ``first`` and ``second`` (P,) or (B, P) are the pairs of rows; ``range_m`` (B, K) is NaN in rows without one, None
    where no row has one.
    """

    model: OutlierModel
    first: IntArray
    second: IntArray
    range_m: FloatArray | None
    scene: Scene | None
    sensor_x: FloatArray
    sensor_y: FloatArray

    @classmethod
    def of(
        cls, batch: BearingBatch, model: OutlierModel, *, max_pairs: int, exclude_behind_walls: bool
    ) -> BearingCandidates:
        """Return the candidates of a grouped batch with its model."""
        first, second = choose_pairs(batch.seed, batch.measurements, max_pairs)
        return cls(
            model,
            first,
            second,
            model.measured_m,
            batch.scene if exclude_behind_walls else None,
            batch.sensor_xy_m[..., 0] - model.lines.center[0][:, None],
            batch.sensor_xy_m[..., 1] - model.lines.center[1][:, None],
        )

    @property
    def count(self) -> int:
        """The number of candidates of each snapshot."""
        lists = (self.range_m is not None) + (self.model.has_height)
        return int(self.first.shape[-1]) + lists * self.model.mixture.count

    def points(self, rows: IntArray) -> Candidates:
        """Return the candidates of some snapshots."""
        lines = self.model.lines.take(rows)
        share, leader = self.model.share[rows], self.model.leader[rows]
        first, second = (index if index.ndim == 1 else index[rows] for index in (self.first, self.second))
        crossings = cross_rows(lines, first, second)
        if first.ndim == 1:
            may = (share[:, first] > 0.0) & (share[:, second] > 0.0) & (leader[:, first] != leader[:, second])
        else:
            snapshot = np.arange(rows.shape[0])[:, None]
            may = (share[snapshot, first] > 0.0) & (share[snapshot, second] > 0.0)
            may &= leader[snapshot, first] != leader[snapshot, second]
        parts = [Candidates(crossings.point, crossings.valid & may)]
        if self.range_m is not None:
            ends = (ends_of_ranges if isinstance(lines, SpaceLines) else end_rays)(lines, self.range_m[rows])
            parts.append(Candidates(ends.point, ends.valid & (share > 0.0)))
        if self.model.has_height:
            ends = ends_at_height(lines)
            parts.append(Candidates(ends.point, ends.valid & (share > 0.0)))
        return Candidates.join(parts)

    def allowed(self, rows: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are in the search region, and not hidden if that matters."""
        return self._unhidden(rows, point, self.model.region.take(rows).contains(*point))

    def beyond(self, rows: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are outside the region, and not hidden if that matters."""
        return self._unhidden(rows, point, ~self.model.region.take(rows).contains(*point))

    def _unhidden(self, rows: IntArray, point: Point, among: BoolArray) -> BoolArray:
        if self.scene is not None:
            x, y = point[:2]  # walls are upright
            center_x, center_y = (part[rows] for part in self.model.lines.center[:2])
            among &= ~hidden_by_walls(self.scene, self.sensor_x[rows], self.sensor_y[rows], x, y, center_x, center_y)
        return among
