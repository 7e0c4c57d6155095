"""Spots of a posterior, its modes and further crossings of rows, and the masses of what a posterior consists of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.regions import Disc
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.mixture.initial_estimates import Mode, Scores, choose_starts, leave_out_slope
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes

__all__ = ["HalfAxes", "RowCandidates", "Spots", "component_masses", "further_spots", "mode_spots", "total_mass"]


_LARGEST_SPOT = 0.5
"""Largest standard deviation of a spot, in units of the disc's radius."""

_FURTHER = 8
_FURTHER_NATS = 14.0
_TIE_DIGITS = 5
"""So many crossings that are not modes, costlier than the best mode by at most so many nats, have a spot. Of costs that
agree to so many decimals (all pairs of rows that agree with no other row) the nearest to the best mode come first."""


class RowCandidates(Protocol):
    """The crossings of the rows of B snapshots, and the search region."""

    @property
    def count(self) -> int:
        """The number of crossings of each snapshot."""
        ...

    def points(self, rows: IntArray) -> Candidates:
        """Return the crossings of some snapshots."""
        ...

    def allowed(self, rows: IntArray, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are in the search region."""
        ...


class HalfAxes(NamedTuple):
    """Half-axes (B, S) of spots in metres, and cosine and sine of the short one's direction."""

    short: FloatArray
    long: FloatArray
    cosine: FloatArray
    sine: FloatArray

    def points(self, number: int, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return offsets (B, P) from one spot of points u, v (P,) in units of its short and long half-axis."""
        short, long = self.short[:, number, None] * u, self.long[:, number, None] * v
        cosine, sine = self.cosine[:, number, None], self.sine[:, number, None]
        return cosine * short - sine * long, sine * short + cosine * long


@dataclass(frozen=True)
class Spots:
    """Points (B, S) with their cost, infinite where missing, and its second derivatives."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix

    def join(self, other: Spots) -> Spots:
        """Return these spots and others beside them."""
        pairs = zip(self.hessian, other.hessian, strict=True)
        hessian = SymmetricMatrix(*(np.concatenate(pair, axis=1) for pair in pairs))
        parts = ((self.x, other.x), (self.y, other.y), (self.cost, other.cost))
        x, y, cost = (np.concatenate(pair, axis=1) for pair in parts)
        return Spots(x, y, cost, hessian)

    def half_axes(self, disc: Disc) -> HalfAxes:
        """Return the half-axes of one standard deviation; the short one points to the side of the disc's centre."""
        tiny, largest = np.finfo(np.float64).tiny, _LARGEST_SPOT * disc.radius[:, None]
        with ignoring_overflow():
            smaller, larger = self.hessian.eigenvalues()
            turn = 0.5 * np.arctan2(2.0 * self.hessian.xy, self.hessian.xx - self.hessian.yy)
            short = np.minimum(1.0 / np.sqrt(np.maximum(larger, tiny)), largest)
            long = np.minimum(1.0 / np.sqrt(np.maximum(smaller, tiny)), largest)
            cosine, sine = np.cos(turn), np.sin(turn)
            sign = np.where(cosine * (disc.x[:, None] - self.x) + sine * (disc.y[:, None] - self.y) < 0.0, -1.0, 1.0)
        return HalfAxes(short, long, cosine * sign, sine * sign)


def mode_spots(modes: Modes, rows: IntArray) -> Spots:
    """Return the modes of some snapshots."""
    most = max(1, int(np.isfinite(modes.cost[rows]).sum(axis=1).max(initial=0)))
    at = rows, slice(0, most)
    return Spots(modes.x[at], modes.y[at], modes.cost[at], modes.hessian.at(*at))


def further_spots(
    mixture: Mixture, modes: Spots, rows: IntArray, candidates: RowCandidates, reach: FloatArray
) -> Spots:
    """Return crossings outside the basins of the modes (B, T), with the information of their direct rows."""
    points = candidates.points(rows)
    with ignoring_overflow():
        cost = mixture.score(points.x, points.y)
        cost[~(points.valid & candidates.allowed(rows, points.x, points.y))] = np.inf
        away = np.hypot(points.x - modes.x[:, :1], points.y - modes.y[:, :1])
        cost = np.round(cost, _TIE_DIGITS) + 10.0**-_TIE_DIGITS * away / (away + reach[:, None])
    scores = Scores(points.x, points.y, cost)
    for t in range(modes.cost.shape[1]):
        known = np.isfinite(modes.cost[:, t])
        x, y, cost = (np.where(known, part[:, t], np.nan) for part in (modes.x, modes.y, modes.cost))
        leave_out_slope(scores, Mode(x, y, cost, modes.hessian.at(slice(None), t)))
    starts = choose_starts(mixture, np.arange(rows.shape[0]), scores, modes.cost[:, 0] + _FURTHER_NATS, _FURTHER)
    shape = rows.shape[0], _FURTHER
    spots = Spots(np.zeros(shape), np.zeros(shape), np.full(shape, np.inf), SymmetricMatrix.full(shape, 1.0))
    at = starts.snapshot, starts.index
    chosen = mixture.take(starts.snapshot)
    spots.x[at], spots.y[at] = starts.x, starts.y
    spots.cost[at] = chosen.score(starts.x[:, None], starts.y[:, None])[:, 0]
    spots.hessian.put(at, chosen.responsibilities(starts.x, starts.y)[1])
    return spots


def component_masses(mixture: Mixture, disc: Disc, spots: Spots, axes: HalfAxes) -> FloatArray:
    """Return the posterior masses (B, 1 + K + S) where no row is direct, each row alone, and of each spot.

    They are in units of the likelihood at the first spot. The first two are of the whole disc; those of rows that have
    no ridge are 0.
    """
    ridge = mixture.rows.ridges(disc)
    area = np.pi * disc.radius**2
    with ignoring_overflow():
        outliers = np.exp(spots.cost[:, 0] + mixture.log_nlos + mixture.groups * np.log(mixture.obstructed))[:, None]
        on_ridges = outliers * np.exp(mixture.log_direct) / mixture.obstructed[:, None] / ridge
        in_spots = np.exp(np.minimum(spots.cost[:, :1] - spots.cost, 0.0)) * (2.0 * np.pi) * axes.short * axes.long
        return np.concatenate(
            [
                outliers * area[:, None],
                np.where(ridge > 0.0, on_ridges, 0.0),
                np.where(np.isfinite(spots.cost), in_spots, 0.0),
            ],
            axis=1,
        )


def total_mass(mass: FloatArray) -> FloatArray:
    """Return the sums (B, 1) over the components, one after the other."""
    return np.cumsum(mass, axis=1)[:, -1:]
