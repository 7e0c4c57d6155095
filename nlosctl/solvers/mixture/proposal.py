"""The proposal of a block of mixtures: a density like the posterior of the position, from which points are taken.

Its components are a disc about the search region (every row is an outlier), a ridge for each row (that row alone
is direct: the sector along a ray, the ring of a range) and a spot for each mode and each further crossing (several rows
are). Points come from a low-discrepancy sequence in each component, so that nothing is random.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.regions import Disc, Region
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.spots import RowCandidates, component_masses, further_spots, mode_spots, total_mass

__all__ = ["MOST_POINTS", "Proposal", "make_proposal"]


MOST_POINTS = 4096
"""Largest number of points of a snapshot."""

_LEAST_SHARE = 0.01
"""A component has at least this share of the points; those of a tenth of it have none."""

_PLASTIC = 1.3247179572447460
"""The points of the sequence have the fractional parts of j / _PLASTIC and j / _PLASTIC^2 as coordinates."""


@dataclass(frozen=True)
class Proposal(RowBlock):
    """Densities of B snapshots about their local origins; components are the disc, K ridges, S spots.

    ``share`` (B, 1 + K + S) is the share of points of each component. A spot is a Student distribution with four
    degrees of freedom about ``x``, ``y`` (B, S), of half-axes ``short_m`` and ``long_m``; ``cosine`` and ``sine`` are
    of the short one's direction. ``ridge`` (B, K) is the density of a row's ridge where its chi-square is zero.
    """

    mixture: Mixture
    disc: Disc
    share: FloatArray
    ridge: FloatArray
    x: FloatArray
    y: FloatArray
    short_m: FloatArray
    long_m: FloatArray
    cosine: FloatArray
    sine: FloatArray

    def sample(self, first: int, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y (B, P) of ``count`` points after the ``first``, and each component's share in them."""
        size, components = self.share.shape
        rows = self.ridge.shape[1]
        number = np.floor(self.share * count).astype(np.int64)
        number[:, 1 + rows] += count - number.sum(axis=1)  # the best mode has the remainder
        start = np.cumsum(number, axis=1) - number
        x, y = np.empty(size * count), np.empty(size * count)
        for columns, place in (
            (slice(0, 1), self._in_disc),
            (slice(1, 1 + rows), self._on_ridge),
            (slice(1 + rows, components), self._in_spot),
        ):
            repeats = number[:, columns]
            shape, repeats = repeats.shape, repeats.ravel()
            snapshot, of_kind = (np.repeat(part.ravel(), repeats) for part in np.indices(shape))
            step = np.arange(snapshot.shape[0]) - np.repeat(np.cumsum(repeats) - repeats, repeats)
            index = step + np.repeat(np.floor(first * self.share[:, columns]).astype(np.int64).ravel(), repeats)
            at = snapshot * count + np.repeat(start[:, columns].ravel(), repeats) + step
            x[at], y[at] = place(snapshot, of_kind, index)
        return x.reshape(size, count), y.reshape(size, count), number / count

    def density(self, x: FloatArray, y: FloatArray, direct: list[FloatArray], share: FloatArray) -> FloatArray:
        """Return the density (B, P) at points; ``direct`` are the rows' terms there, as `Mixture.score` gives them."""
        rows = len(direct)
        density = np.repeat((share[:, 0] / (np.pi * self.disc.radius**2))[:, None], x.shape[1], axis=1)
        with ignoring_overflow():
            to_ratio = np.exp(-self.mixture.log_direct)
        ridge = np.where(share[:, 1 : rows + 1] > 0.0, share[:, 1 : rows + 1] * self.ridge, 0.0)
        for k in range(rows):
            if ridge[:, k].any():
                ratio = np.where(ridge[:, k] > 0.0, to_ratio[:, k], 0.0)[:, None] * direct[k]
                density += ridge[:, k, None] * self.mixture.rows.on_ridge(k, x, y, ratio)
        for spot in range(self.x.shape[1]):
            some = np.flatnonzero(share[:, rows + 1 + spot])
            if some.size:
                part = self._spot_density(some, spot, x, y, share[some, rows + 1 + spot])
                if some.size == x.shape[0]:
                    density += part
                else:
                    density[some] += part
        return density

    def _spot_density(self, some: IntArray, spot: int, x: FloatArray, y: FloatArray, share: FloatArray) -> FloatArray:
        short, long, cosine, sine = (part[some, spot] for part in (self.short_m, self.long_m, self.cosine, self.sine))
        if some.size < x.shape[0]:
            x, y = x[some], y[some]
        dx, dy = x - self.x[some, spot][:, None], y - self.y[some, spot][:, None]
        across = (cosine / short)[:, None] * dx
        across += (sine / short)[:, None] * dy
        across *= across
        dy *= (cosine / long)[:, None]
        dy -= (sine / long)[:, None] * dx
        dy *= dy
        across += dy
        across *= 0.25
        across += 1.0
        density: FloatArray = (share / (2.0 * np.pi * short * long))[:, None] / (across * across * across)
        return density

    def _in_disc(self, snapshot: IntArray, component: IntArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
        table = _sequence()
        toward = np.arctan2(self.y[:, 0] - self.disc.y, self.x[:, 0] - self.disc.x)
        radius = self.disc.radius[snapshot] * np.sqrt(table.u[index])
        angle = toward[snapshot] + 2.0 * np.pi * table.v[index]
        return self.disc.x[snapshot] + radius * np.cos(angle), self.disc.y[snapshot] + radius * np.sin(angle)

    def _on_ridge(self, snapshot: IntArray, component: IntArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
        table = _sequence()
        return self.mixture.rows.sample_ridge(self.disc, snapshot, component, table.normal[index], table.v[index])

    def _in_spot(self, snapshot: IntArray, component: IntArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
        at, table = (snapshot, component), _sequence()
        short, long = table.student_x[index] * self.short_m[at], table.student_y[index] * self.long_m[at]
        cosine, sine = self.cosine[at], self.sine[at]
        return self.x[at] + cosine * short - sine * long, self.y[at] + sine * short + cosine * long


class _Sequence(NamedTuple):
    """A low-discrepancy sequence u, v in the unit square, and what its points are in other distributions.

    ``normal`` is u as a standard normal deviate, ``student_x`` and ``student_y`` are the point of a bivariate Student
    distribution with four degrees of freedom.
    """

    u: FloatArray
    v: FloatArray
    normal: FloatArray
    student_x: FloatArray
    student_y: FloatArray


@cache
def _sequence() -> _Sequence:
    index = np.arange(1, MOST_POINTS + 1)
    u, v = (0.5 + index / _PLASTIC) % 1.0, (0.5 + index / _PLASTIC**2) % 1.0
    radius, angle = 2.0 * np.sqrt(1.0 / np.sqrt(1.0 - u) - 1.0), 2.0 * np.pi * v
    return _Sequence(u, v, ndtri(u), radius * np.cos(angle), radius * np.sin(angle))


def make_proposal(
    mixture: Mixture, modes: Modes, region: Region, rows: IntArray, candidates: RowCandidates | None
) -> Proposal:
    """Return the proposal of the snapshots ``rows``, all with a mode; without ``candidates`` only modes have spots.

    A component's share is the square root of its mass, and of its second moment about the best mode.
    """
    mixture = mixture.take(rows)
    disc = Disc.about(region, rows)
    spots = mode_spots(modes, rows)
    if candidates is not None:
        spots = spots.join(further_spots(mixture, spots, rows, candidates, disc.radius))
    axes = spots.half_axes(disc)
    exists = np.isfinite(spots.cost)
    mass = component_masses(mixture, disc, spots, axes)
    with ignoring_overflow():
        dx, dy = spots.x - spots.x[:, :1], spots.y - spots.y[:, :1]
        squared_size = axes.short * axes.short + axes.long * axes.long + dx * dx + dy * dy
        wide = np.repeat((0.25 * np.pi * disc.radius**2)[:, None], 1 + mixture.count, axis=1)
        moment = mass * np.concatenate([wide, np.where(exists, squared_size, 0.0)], axis=1)
    share = _share(mass) + _share(moment)
    share = np.where(share > 0.2 * _LEAST_SHARE, np.maximum(share, 2.0 * _LEAST_SHARE), 0.0)
    share = share / total_mass(share)
    used = int(np.flatnonzero(share.any(axis=0)).max(initial=mixture.count + 1)) - mixture.count

    def fill(values: FloatArray, other: float) -> FloatArray:
        return np.where(exists, values, other)[:, :used]

    return Proposal(
        mixture, disc, share[:, : 1 + mixture.count + used], mixture.rows.ridges(disc), fill(spots.x, 0.0),
        fill(spots.y, 0.0), fill(axes.short, 1.0), fill(axes.long, 1.0), fill(axes.cosine, 1.0), fill(axes.sine, 0.0),
    )  # fmt: skip


def _share(amount: FloatArray) -> FloatArray:
    root = np.sqrt(np.where(np.isfinite(amount), amount, 0.0))
    return root / np.maximum(total_mass(root), np.finfo(np.float64).tiny)
