"""Initial estimates of ranges with outliers: crossings of two circles, or of three spheres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.random_streams import choose_subsets
from nlosctl.models.ranges.spheres import RangeSpheres
from nlosctl.solvers.bearings.ray_crossings import Candidates, choose_pairs
from nlosctl.solvers.mixture.range_rows import RangeOutlierModel
from nlosctl.solvers.ranges.circle_crossings import MOST_CROSSINGS, cross_circle_pairs
from nlosctl.solvers.ranges.sphere_crossings import cross_at_height, cross_triples

__all__ = ["RangeCandidates"]


@dataclass(frozen=True)
class RangeCandidates:
    """Initial estimates: both crossings of the circles of all pairs of rows that may both be direct.

    ``first`` and ``second`` (P,) or (B, P) are the pairs. In space both crossings of the spheres of all ``triples``
    (T, 3) or (B, T, 3), and with a measured height those of the pairs at that height. ``degenerate`` (B,) marks
    snapshots whose sensors are all at one point, or whose scalars are fewer than the unknowns.
    """

    model: RangeOutlierModel
    first: IntArray
    second: IntArray
    triples: IntArray | None
    degenerate: BoolArray

    @classmethod
    def of(cls, batch: RangeBatch, model: RangeOutlierModel, max_pairs: int) -> RangeCandidates:
        """Return the candidates of a grouped batch with its model."""
        rows = model.circles
        first, second = choose_pairs(batch.seed, batch.measurements, max_pairs)
        triples = None
        if isinstance(rows, RangeSpheres):
            triples = choose_subsets(batch.seed, batch.measurements, 3, max_pairs)
        return cls(model, first, second, triples, rows.single_origin() | (rows.degrees_of_freedom < 0))

    @property
    def count(self) -> int:
        """The number of candidates of each snapshot."""
        rows = self.model.circles
        if self.triples is not None:
            pairs = 0 if rows.level is None else int(self.first.shape[-1])
            return 2 * (int(self.triples.shape[-2]) + pairs)
        each = 2 if isinstance(rows, RangeSpheres) or rows.circles is None else MOST_CROSSINGS
        return each * int(self.first.shape[-1])

    def points(self, rows: IntArray) -> Candidates:
        """Return the candidates of some snapshots; ranges that never agree have one where they do most nearly."""
        first, second = (index if index.ndim == 1 else index[rows] for index in (self.first, self.second))
        circles = self.model.circles.take(rows)
        if isinstance(circles, RangeSpheres):
            return self._in_space(circles, rows, first, second)
        points = cross_circle_pairs(circles, first, second)
        each = points.shape[-2]
        point = tuple(np.concatenate([points[..., n, axis] for n in range(each)], axis=1) for axis in (0, 1))
        may = self._may_be_direct(rows, first, second)
        return Candidates(point, np.isfinite(point[0]) & np.concatenate([may] * each, axis=1))

    def _in_space(self, spheres: RangeSpheres, rows: IntArray, first: IntArray, second: IntArray) -> Candidates:
        """Return the crossings of triples of spheres, and of pairs at a measured height."""
        parts = []
        if self.triples is not None and self.triples.shape[-2]:
            triples = self.triples if self.triples.ndim == 2 else self.triples[rows]
            may = self._may_be_direct(rows, triples[..., 0], triples[..., 1])
            may &= self._may_be_direct(rows, triples[..., 1], triples[..., 2])
            may &= self._may_be_direct(rows, triples[..., 0], triples[..., 2])
            parts.append((cross_triples(spheres, triples), may))
        if spheres.level is not None:
            at_height = cross_at_height(spheres, first, second)
            parts.append((at_height, self._may_be_direct(rows, first, second)))
        return Candidates.join(
            [Candidates(point, np.isfinite(point[0]) & np.concatenate([may, may], axis=1)) for point, may in parts]
        )

    def _may_be_direct(self, rows: IntArray, first: IntArray, second: IntArray) -> BoolArray:
        """Return which pairs (b, P) of rows may both be direct."""
        index = [rows[:, None], first], [rows[:, None], second]
        share, leader = self.model.share, self.model.leader
        one, other = (tuple(part) for part in index)
        may: BoolArray = (share[one] > 0.0) & (share[other] > 0.0) & (leader[one] != leader[other])
        return may

    def allowed(self, rows: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are in the search region."""
        return self.model.region.take(rows).contains(*point)
