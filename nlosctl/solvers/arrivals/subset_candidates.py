"""Initial estimates of arrivals with outliers: the exact solutions of as many rows as unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.random_streams import choose_subsets
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.arrivals.closed_forms import bancroft, beside_plane
from nlosctl.solvers.arrivals.likelihood import AT_INFINITY
from nlosctl.solvers.arrivals.outlier_model import ArrivalOutlierModel
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.ranges.squared_ranges import principal_axes

__all__ = ["ArrivalCandidates"]

_FLAT = 1e-8
"""Sensors whose variance across a plane (a line) is below this share of the largest are in it."""


@dataclass(frozen=True)
class ArrivalCandidates:
    """Both positions and offsets by which all rows of a subset are direct, by `bancroft` or `beside_plane`.

    ``subsets`` (S, N) or (B, S, N) are those of as many rows as unknowns, ``at_height`` those of one row less, which
    take a measured height as exact. Those of sensors in a plane (on a line), marked by ``flat`` (B,), are beside it,
    ``axes`` are their principal axes, D of D arrays (B,). Sensors ``on_line`` (B,) in space have a circle of solutions.
    """

    model: ArrivalOutlierModel
    subsets: IntArray
    at_height: IntArray | None
    flat: BoolArray
    on_line: BoolArray
    axes: tuple[Point, ...]

    @classmethod
    def of(cls, batch: ArrivalBatch, model: ArrivalOutlierModel, most: int) -> ArrivalCandidates:
        """Return the candidates of a batch with its model; a random selection of ``most`` subsets if there are more."""
        unknowns, rows = model.mixture.dimension, model.arrivals
        size = rows.size_m()
        gram = SymmetricMatrix.gram(*(part / size[:, None] for part in rows.sensor))
        axes, spread = principal_axes(gram)
        at_height = None
        if rows.level is not None:
            at_height = choose_subsets(batch.seed, batch.measurements, unknowns - 1, most)
        subsets = choose_subsets(batch.seed, batch.measurements, unknowns, most)
        flat, on_line = (spread[axis] <= _FLAT * spread[0] for axis in (-1, 1))
        on_line &= len(spread) > 2
        return cls(model, subsets, at_height, flat, on_line, tuple(map(tuple, axes)))

    @property
    def count(self) -> int:
        """The number of candidates of each snapshot."""
        return 2 * int(self.subsets.shape[-2] + (0 if self.at_height is None else self.at_height.shape[-2]))

    def points(self, rows: IntArray) -> Candidates:
        """Return the candidates of some snapshots."""
        parts = [self._solve(rows, self.subsets, at_height=False)]
        if self.at_height is not None:
            parts.append(self._solve(rows, self.at_height, at_height=True))
        return Candidates.join(parts)

    def allowed(self, rows: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are in the search region."""
        return self.model.region.take(rows).contains(*point)

    def beyond(self, rows: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are outside the search region, but not at infinity."""
        squared = np.sum([part * part for part in point[:-1]], axis=0)
        near = squared <= ((AT_INFINITY * self.model.arrivals.size_m()[rows]) ** 2)[:, None]
        outside: BoolArray = near & ~self.model.region.base.take(rows).contains(*point[:-1])
        return outside

    def _solve(self, rows: IntArray, subsets: IntArray, *, at_height: bool) -> Candidates:
        arrivals = self.model.arrivals.take(rows)
        index = subsets if subsets.ndim == 2 else subsets[rows]
        index = np.broadcast_to(index, (rows.size, *index.shape[-2:]))
        size, count, taken = index.shape
        snapshot = np.arange(size)[:, None, None]
        scale = np.repeat(arrivals.size_m(), count)

        def chosen(values: FloatArray) -> FloatArray:
            return np.asfortranarray(values[snapshot, index].reshape(size * count, taken) / scale[:, None])

        sensor, arrival = [chosen(part) for part in arrivals.sensor], chosen(arrivals.arrival_m)
        first = arrival.min(axis=1, initial=np.inf) - 1.0  # not 0: equal arrivals would be singular
        arrival -= first[:, None]
        square = arrival * arrival
        if arrivals.height is not None:
            square -= chosen(arrivals.height) ** 2
        weight, z_m = np.ones(arrival.shape, order="F"), None
        if at_height and arrivals.level is not None:
            z_m = np.repeat(np.where(arrivals.level.known, arrivals.level.z_m, np.nan), count)
            square -= (sensor[2] - (z_m / scale)[:, None]) ** 2
            pair = bancroft(sensor[:2], arrival, square, weight)
        else:
            pair = bancroft(sensor, arrival, square, weight)
            flat = np.flatnonzero(np.repeat(self.flat[rows], count))
            if flat.size:
                axes = [[np.repeat(part[rows], count)[flat] for part in axis] for axis in self.axes]
                *places, times, squares, weights = (rows_of(part, flat) for part in (*sensor, arrival, square, weight))
                for point, beside in zip(pair, beside_plane(places, times, squares, weights, axes), strict=True):
                    for mine, theirs in zip(point, beside, strict=True):
                        mine[flat] = theirs
        points = []
        for *position, offset in pair:
            height = [] if z_m is None else [z_m]
            point = (*(part * scale for part in position), *height, (offset + first) * scale)
            points.append(tuple(part.reshape(size, count) for part in point))
        both = tuple(np.concatenate(parts, axis=1) for parts in zip(*points, strict=True))
        valid = np.logical_and.reduce([np.isfinite(part) for part in both])
        return Candidates(both, valid & (at_height | ~self.on_line[rows])[:, None])
