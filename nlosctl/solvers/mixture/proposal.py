"""The proposal of a block of mixtures: a density like the posterior of the position, from which points are taken.

Its components are a ball about the search region (every row is an outlier), a ridge for each row (that row alone is
direct: the sector along a ray, the ring of a range) and a spot for each mode and each further crossing (several rows
are). Points come from a low-discrepancy sequence in each component, so that nothing is random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, reduce
from math import gamma, pi
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri, ndtri

from nlosctl.arrays import FloatArray, IntArray, Point, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, rows_of
from nlosctl.geometry.regions import Ball, Region
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.spots import (
    HalfAxes,
    RowCandidates,
    component_masses,
    further_spots,
    mode_spots,
    total_mass,
)

__all__ = ["MOST_POINTS", "Proposal", "make_proposal"]


MOST_POINTS = 4096
"""Largest number of points of a snapshot."""

_LEAST_SHARE = 0.01
"""A component has at least this share of the points; those of a tenth of it have none."""

_RATIOS = {2: 1.3247179572447460, 3: 1.2207440846057596, 4: 1.1673039782614187}
"""The points of the sequence of D dimensions have the fractional parts of j / g, j / g^2 ... as coordinates; g is the
positive root of g^(D + 1) = g + 1."""

_FREEDOM = 4
"""Degrees of freedom of the Student distribution of a spot."""


@dataclass(frozen=True)
class Proposal(RowBlock):
    """Densities of B snapshots about their local origins; components are the ball, K ridges, S spots.

    ``share`` (B, 1 + K + S) is the share of points of each component. A spot is a Student distribution with four
    degrees of freedom about ``center``, D arrays (B, S), with the half-axes ``axes`` (B, S). ``ridge`` (B, K) is the
    density of a row's ridge where its chi-square is zero.
    """

    mixture: Mixture
    ball: Ball
    share: FloatArray
    ridge: FloatArray
    center: Point
    axes: HalfAxes

    def sample(self, first: int, count: int) -> tuple[Point, FloatArray]:
        """Return ``count`` points (B, P) after the ``first``, and each component's share in them."""
        size, components = self.share.shape
        rows = self.ridge.shape[1]
        number = np.floor(self.share * count).astype(np.int64)
        number[:, 1 + rows] += count - number.sum(axis=1)  # the best mode has the remainder
        start = np.cumsum(number, axis=1) - number
        point = tuple(np.empty(size * count) for _ in self.center)
        for columns, place in (
            (slice(0, 1), self._in_ball),
            (slice(1, 1 + rows), self._on_ridge),
            (slice(1 + rows, components), self._in_spot),
        ):
            repeats = number[:, columns]
            shape, repeats = repeats.shape, repeats.ravel()
            snapshot, of_kind = (np.repeat(part.ravel(), repeats) for part in np.indices(shape))
            step = np.arange(snapshot.shape[0]) - np.repeat(np.cumsum(repeats) - repeats, repeats)
            index = step + np.repeat(np.floor(first * self.share[:, columns]).astype(np.int64).ravel(), repeats)
            at = snapshot * count + np.repeat(start[:, columns].ravel(), repeats) + step
            for part, values in zip(point, place(snapshot, of_kind, index), strict=True):
                part[at] = values
        return tuple(part.reshape(size, count) for part in point), number / count

    def density(self, point: Point, direct: list[FloatArray], share: FloatArray) -> FloatArray:
        """Return the density (B, P) at points; ``direct`` are the rows' terms there, as `Mixture.score` gives them."""
        rows = len(direct)
        density = np.repeat((share[:, 0] / self.ball.volume)[:, None], point[0].shape[1], axis=1)
        with ignoring_overflow():
            to_ratio = np.exp(-self.mixture.log_direct)
        ridge = np.where(share[:, 1 : rows + 1] > 0.0, share[:, 1 : rows + 1] * self.ridge, 0.0)
        for k in range(rows):
            if ridge[:, k].any():
                ratio = np.where(ridge[:, k] > 0.0, to_ratio[:, k], 0.0)[:, None] * direct[k]
                density += ridge[:, k, None] * self.mixture.rows.on_ridge(k, ratio, *point)
        for spot in range(self.center[0].shape[1]):
            some = np.flatnonzero(share[:, rows + 1 + spot])
            if some.size:
                part = self._spot_density(some, spot, point, share[some, rows + 1 + spot])
                if some.size == density.shape[0]:
                    density += part
                else:
                    density[some] += part
        return density

    def _spot_density(self, some: IntArray, spot: int, point: Point, share: FloatArray) -> FloatArray:
        axes, dimension = self.axes.at(some, spot), len(point)
        if some.size < point[0].shape[0]:
            point = tuple(part[some] for part in point)
        offset = [part - middle[some, spot][:, None] for part, middle in zip(point, self.center, strict=True)]
        across = axes.at(slice(None), None).squared_distance(*offset)
        across *= 1.0 / _FREEDOM
        across += 1.0
        unit = (_FREEDOM * pi) ** (0.5 * dimension) * gamma(0.5 * _FREEDOM) / gamma(0.5 * (_FREEDOM + dimension))
        steep = across * across * across
        if dimension > 2:
            steep *= np.sqrt(across) if dimension == 3 else across
        density: FloatArray = (share / reduce(np.multiply, axes.lengths, unit))[:, None] / steep
        return density

    def _in_ball(self, snapshot: IntArray, component: IntArray, index: IntArray) -> Point:
        """Return points (N,) uniform in the balls, from the direction of the first spot."""
        radius, uniform = self.ball.radius[snapshot], _sequence(len(self.center)).uniform
        radius = radius * uniform[0][index] ** (1.0 / len(self.center))
        toward = [part[:, 0] - middle for part, middle in zip(self.center, self.ball.center, strict=True)]
        turned = unit_vectors([part[index] for part in uniform[1:]], rows_of(tuple(toward), snapshot))
        return tuple(middle[snapshot] + radius * part for middle, part in zip(self.ball.center, turned, strict=True))

    def _on_ridge(self, snapshot: IntArray, component: IntArray, index: IntArray) -> Point:
        table = _sequence(len(self.center))
        normal, uniform = (tuple(part[index] for part in parts) for parts in (table.normal, table.uniform))
        return self.mixture.rows.sample_ridge(self.ball, snapshot, component, normal, uniform)

    def _in_spot(self, snapshot: IntArray, component: IntArray, index: IntArray) -> Point:
        at, student = component * self.share.shape[0] + snapshot, _sequence(len(self.center)).student

        def each(parts: Point) -> Point:
            return tuple(np.take(part.T, at) for part in parts)

        axes = HalfAxes(each(self.axes.lengths), tuple(each(direction) for direction in self.axes.directions))
        return axes.points(each(self.center), *(part[index] for part in student))


class _Sequence(NamedTuple):
    """A low-discrepancy sequence in the unit cube, D arrays (P,), and what its points are in other distributions.

    ``normal`` are its numbers as standard normal deviates, ``student`` is the point of a Student distribution of D
    dimensions with four degrees of freedom.
    """

    uniform: Point
    normal: Point
    student: Point


@cache
def _sequence(dimension: int) -> _Sequence:
    index, ratio = np.arange(1, MOST_POINTS + 1), _RATIOS[dimension]
    uniform = tuple((0.5 + index / ratio ** (i + 1)) % 1.0 for i in range(dimension))
    if dimension == 2:
        radius = 2.0 * np.sqrt(1.0 / np.sqrt(1.0 - uniform[0]) - 1.0)
    else:  # the squared radius over D has Fisher's distribution
        radius = np.sqrt(dimension * fdtri(dimension, _FREEDOM, uniform[0]))
    student = tuple(radius * part for part in unit_vectors(uniform[1:]))
    return _Sequence(uniform, tuple(map(ndtri, uniform)), student)


def unit_vectors(uniform: Sequence[FloatArray], pole: Point | None = None) -> Point:
    """Return unit vectors (N,) from D - 1 uniform numbers each, equally distributed over all directions.

    Numbers near zero give vectors near the ``pole`` (N,), in the plane on its left; by default the first axis, in space
    the third. A pole that turns about the third axis turns the vectors; of four dimensions only its first two
    coordinates count.
    """
    if len(uniform) == 1:
        angle = 2.0 * np.pi * uniform[0]
        angle = angle if pole is None else np.arctan2(pole[1], pole[0]) + angle
        return np.cos(angle), np.sin(angle)
    if len(uniform) == 3:  # the squared length of the first two coordinates is uniform
        flat, rest = np.sqrt(1.0 - uniform[0]), np.sqrt(uniform[0])
        pairs = unit_vectors(uniform[1:2], pole), unit_vectors(uniform[2:])
        return *(flat * part for part in pairs[0]), *(rest * part for part in pairs[1])
    height, turn = 1.0 - 2.0 * uniform[0], 2.0 * np.pi * uniform[1]
    across = np.sqrt(1.0 - height * height)
    local = across * np.cos(turn), across * np.sin(turn), height
    if pole is None:
        return local
    px, py, pz = pole
    level, length = np.hypot(px, py), reduce(np.hypot, pole)
    with ignoring_division():
        sine, cosine = np.where(length > 0.0, level / length, 0.0), np.where(length > 0.0, pz / length, 1.0)
        x, y = np.where(level > 0.0, px / level, 1.0), np.where(level > 0.0, py / level, 0.0)
    ahead = sine * height - cosine * local[0]  # in the upright plane of the pole; the rest is on its left
    return x * ahead - y * local[1], y * ahead + x * local[1], cosine * height + sine * local[0]


def make_proposal(
    mixture: Mixture, modes: Modes, region: Region, rows: IntArray, candidates: RowCandidates | None
) -> Proposal:
    """Return the proposal of the snapshots ``rows``, all with a mode; without ``candidates`` only modes have spots.

    A component's share is the square root of its mass, and of its second moment about the best mode.
    """
    mixture = mixture.take(rows)
    ball = Ball.about(region, rows)
    spots = mode_spots(modes, rows)
    if candidates is not None:
        spots = spots.join(further_spots(mixture, spots, rows, candidates, ball.radius))
    axes = spots.half_axes(ball)
    exists = np.isfinite(spots.cost)
    mass = component_masses(mixture, ball, spots, axes)
    with ignoring_overflow():
        away = [part - part[:, :1] for part in spots.point]
        squared_size = reduce(np.add, [part * part for part in (*axes.lengths, *away)])
        wide = np.repeat((0.25 * np.pi * ball.radius**2)[:, None], 1 + mixture.count, axis=1)
        moment = mass * np.concatenate([wide, np.where(exists, squared_size, 0.0)], axis=1)
    share = _share(mass) + _share(moment)
    share = np.where(share > 0.2 * _LEAST_SHARE, np.maximum(share, 2.0 * _LEAST_SHARE), 0.0)
    share = share / total_mass(share)
    used = int(np.flatnonzero(share.any(axis=0)).max(initial=mixture.count + 1)) - mixture.count

    def fill(values: FloatArray, other: float) -> FloatArray:
        return np.where(exists, values, other)[:, :used]

    return Proposal(
        mixture,
        ball,
        share[:, : 1 + mixture.count + used],
        mixture.rows.ridges(ball),
        tuple(fill(part, 0.0) for part in spots.point),
        HalfAxes(
            tuple(fill(part, 1.0) for part in axes.lengths),
            tuple(
                tuple(fill(part, 1.0 if i == j else 0.0) for j, part in enumerate(direction))
                for i, direction in enumerate(axes.directions)
            ),
        ),
    )


def _share(amount: FloatArray) -> FloatArray:
    root = np.sqrt(np.where(np.isfinite(amount), amount, 0.0))
    return root / np.maximum(total_mass(root), np.finfo(np.float64).tiny)
