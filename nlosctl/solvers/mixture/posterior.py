"""The posterior of a position, integrated over the search region: second moments, and which rows are direct.

The prior is flat within the region. Points of a proposal that resembles the posterior are weighted by posterior over
proposal (importance sampling with the balance heuristic, of low-discrepancy points).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from math import sqrt
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, StatusArray, ignoring_division, ignoring_overflow
from nlosctl.contract.results import has_covariance, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.regions import Ball, Region
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.proposal import MOST_POINTS, Proposal, make_proposal
from nlosctl.solvers.mixture.spots import RowCandidates, component_masses, mode_spots, total_mass

__all__ = ["Weighted", "direct_probability", "posterior_covariance", "share_direct", "sum_points", "weighted_points"]


_FIRST = 128
"""A snapshot has at first so many points; half as many are added until its second moment settles."""

_SETTLED = 0.06
"""The trace of the second moment has settled if its standard error would be at most this share were the points
random; it is about a quarter of that."""

_POINTS_OF_ROWS = 32
_POINTS_OF_AMBIGUOUS = 128
"""Numbers of sampled points for the probabilities of the rows, the second where several modes carry mass."""


class _Rule(NamedTuple):
    """Points (P,) for means over a standard normal distribution of D dimensions, and their weights over its density."""

    point: Point
    weight: FloatArray

    @classmethod
    def of(cls, point: Point, weight: FloatArray) -> _Rule:
        """Return the rule of points and weights."""
        return cls(point, weight * np.exp(0.5 * reduce(np.add, [part**2 for part in point])))

    @classmethod
    def in_plane(cls) -> _Rule:
        """Return Stroud's rule of 12 points and degree 7 (E2 r2 7-1)."""
        s, t = sqrt((9.0 - 3.0 * sqrt(5.0)) / 4.0), sqrt((9.0 + 3.0 * sqrt(5.0)) / 4.0)
        u = np.array([sqrt(6.0), -sqrt(6.0), 0.0, 0.0, s, s, -s, -s, t, t, -t, -t])
        v = np.array([0.0, 0.0, sqrt(6.0), -sqrt(6.0), s, -s, s, -s, t, -t, t, -t])
        return cls.of((u, v), np.repeat([5.0, 20.0 + 8.0 * sqrt(5.0), 20.0 - 8.0 * sqrt(5.0)], 4) / 180.0)

    @classmethod
    def in_space(cls) -> _Rule:
        """Return the rule of 14 points and degree 5 on the axes and in the corners of a cube."""
        on_axes = sqrt(2.5) * np.concatenate([np.eye(3), -np.eye(3)])
        corners = sqrt(5.0) * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        point = tuple(np.concatenate([on_axes, corners]).T.copy())
        return cls.of(point, np.repeat([0.16, 0.005], [6, 8]))


_RULES = {2: _Rule.in_plane(), 3: _Rule.in_space()}

_DOMINANT = 0.9
_NEGLIGIBLE = 1e-3
"""A mode of more than the first share of the mass dominates; modes of less than the second, in units of the best one's
mass, do not change a probability."""

_POINTS = 32768
"""Number of points at once, so that temporaries stay in the cache."""


def posterior_covariance(
    mixture: Mixture,
    modes: Modes,
    region: Region,
    candidates: RowCandidates,
    inliers: SymmetricMatrix,
    status: StatusArray,
) -> SymmetricMatrix:
    """Return the second moments (B, T) of the posterior about each mode, in square metres.

    Each is of the whole posterior, so that the moment about the best mode includes the chance that the source is near
    another mode, on a single ray, or anywhere. ``inliers`` (B, T) replaces those that are not positive definite.
    """
    with_mode = np.flatnonzero(np.isfinite(modes.cost[:, 0]) & has_covariance(status))
    moments = np.full((_count_moments(mixture.dimension), modes.cost.shape[0]), np.nan)
    for rows in _sections(with_mode, max(_FIRST, candidates.count)):
        moments[:, rows] = _settle(make_proposal(mixture, modes, region, rows, candidates), modes, rows, candidates)
    with ignoring_division():
        ratios = [(part / moments[0])[:, None] for part in moments[1:]]
    mean, second = ratios[: mixture.dimension], iter(ratios[mixture.dimension :])
    away = [part - part[:, :1] for part in modes.point]  # moments are about the best mode: shift them
    parts = []
    for i, right in enumerate(away):
        for j, left in enumerate(away[:i]):
            parts.append(next(second) - left * mean[i] - right * mean[j] + left * right)
        parts.append(next(second) - 2.0 * right * mean[i] + right * right)
    about = SymmetricMatrix(*parts)
    with ignoring_overflow():
        definite = (about.determinant > 0.0) & (about.trace > 0.0)
    return about.where(definite, inliers)


def direct_probability(
    mixture: Mixture, modes: Modes, region: Region, candidates: RowCandidates, at_best: FloatArray, status: StatusArray
) -> FloatArray:
    """Return each row's probability (B, K) to be direct, integrated over the position.

    Where one mode dominates, by a rule of few points about it, else by sampled points: where the status is ambiguous,
    or outliers depend on the position. ``at_best`` (B, K), the probability at the best fix, stays where that has no
    position or no consensus, so that no flag is written, or where it is outside the region.
    """
    probability = at_best.copy(order="F")
    integrated = np.isfinite(modes.cost[:, 0]) & has_position(status)
    integrated &= (status != Status.NO_CONSENSUS) & (status != Status.OUTSIDE_FIELD)
    ambiguous = status == Status.AMBIGUOUS
    sampled = integrated.copy()
    if mixture.outliers is None:
        for rows in _sections(np.flatnonzero(integrated & ~ambiguous), _RULES[mixture.dimension].weight.shape[0]):
            about_best, dominates = _by_rule(mixture.take(rows), modes, region, rows, candidates)
            probability[rows[dominates]] = about_best[dominates]
            sampled[rows[dominates]] = False
    for points, among in ((_POINTS_OF_ROWS, ~ambiguous), (_POINTS_OF_AMBIGUOUS, ambiguous)):
        chosen = np.flatnonzero(sampled & among)
        for rows, part, weighted in weighted_points(mixture, modes, region, candidates, chosen, points):
            mass = sum_points(weighted.weight)
            for k, share in enumerate(share_direct(part, weighted.direct)):
                mean = sum_points(share, weighted.weight) / np.where(mass > 0.0, mass, 1.0)
                probability[rows, k] = np.where(mass > 0.0, mean, probability[rows, k])
    return probability


def _by_rule(
    mixture: Mixture, modes: Modes, region: Region, rows: IntArray, candidates: RowCandidates
) -> tuple[FloatArray, BoolArray]:
    """Return the probabilities (B, K) of some snapshots, and in which the best mode dominates.

    They are means over the best mode and those at other modes, weighted by mass; a row alone has its mass too.
    """
    spots, ball, rule = mode_spots(modes, rows), Ball.about(region, rows), _RULES[mixture.dimension]
    axes = spots.half_axes(ball)
    offset = axes.at(slice(None), 0, None).points([np.zeros(1)] * mixture.dimension, *rule.point)
    point = [middle[:, :1] + part for middle, part in zip(spots.point, offset, strict=True)]
    direct: list[FloatArray] = []
    with ignoring_overflow():
        weight = np.exp(spots.cost[:, :1] - mixture.score(*point, terms=direct)) * rule.weight
    weight[~(candidates.allowed(rows, *point) & np.isfinite(weight))] = 0.0
    mass, best = component_masses(mixture, ball, spots, axes), 1 + mixture.count
    scale = mass[:, best].copy()
    mass[:, best] *= sum_points(weight)
    total = total_mass(mass)
    with ignoring_division():
        probability = np.stack(
            [
                sum_points(share, weight) * scale + mass[:, 1 + k]
                for k, share in enumerate(share_direct(mixture, direct))
            ],
            axis=1,
        )
        for other in range(1, spots.cost.shape[1]):
            some = np.flatnonzero(mass[:, best + other] > _NEGLIGIBLE * mass[:, best])
            there, _ = mixture.take(some).responsibilities(*(part[some, other] for part in spots.point))
            probability[some] += there * mass[some, best + other, None]
        probability /= total
        return probability, mass[:, best] > _DOMINANT * total[:, 0]


def weighted_points(
    mixture: Mixture, modes: Modes, region: Region, candidates: RowCandidates, rows: IntArray, points: int
) -> Iterator[tuple[IntArray, Mixture, Weighted]]:
    """Yield some of the snapshots ``rows`` at a time, their mixtures, and weighted points of their posteriors."""
    for part in _sections(rows, points):
        proposal = make_proposal(mixture, modes, region, part, None)
        yield part, proposal.mixture, _weigh(proposal, modes, part, candidates, 0, points)


def share_direct(mixture: Mixture, terms: list[FloatArray]) -> list[FloatArray]:
    """Return the rows' probabilities to be direct at points, from their terms (B, P) there."""
    obstructed = mixture.obstructed[:, None]
    if mixture.last is None:
        return [term / (term + obstructed) for term in terms]
    evidence: list[FloatArray] = []
    group = obstructed
    for k, term in enumerate(terms):
        evidence.append(term + group)
        group = np.where(mixture.last[:, k, None], obstructed, evidence[k])
    for k in range(mixture.count - 2, -1, -1):
        evidence[k] = np.where(mixture.last[:, k, None], evidence[k], evidence[k + 1])
    return [term / total for term, total in zip(terms, evidence, strict=True)]


def _count_moments(dimension: int) -> int:
    """Return the number of moments from the zeroth to the second."""
    return 1 + dimension + dimension * (dimension + 1) // 2


def _sections(rows: IntArray, points: int) -> Iterator[IntArray]:
    step = max(1, _POINTS // points)
    for first in range(0, rows.shape[0], step):
        yield rows[first : first + step]


def _settle(proposal: Proposal, modes: Modes, rows: IntArray, candidates: RowCandidates) -> FloatArray:
    """Return mass and moments up to the second (M, B) about the best mode, with as many points as each needs."""
    dimension = proposal.mixture.dimension
    moments, squares = np.zeros((_count_moments(dimension), rows.shape[0])), np.zeros((3, rows.shape[0]))
    diagonal = [dimension + (i + 1) * (i + 2) // 2 for i in range(dimension)]
    moving, count = np.arange(rows.shape[0]), 0
    while moving.size and count < MOST_POINTS:
        new = min(max(_FIRST, count // 2), MOST_POINTS - count)
        part = proposal if moving.size == rows.shape[0] else proposal.take(moving)
        weighted = _weigh(part, modes, rows[moving], candidates, count, new)
        added, scatter = weighted.moments()
        moments[:, moving] += added
        squares[:, moving] += scatter
        count += new
        mass, trace = moments[0, moving], reduce(np.add, [moments[i, moving] for i in diagonal])
        with ignoring_division():
            mean = trace / mass
            of_trace, of_both, of_mass = squares[:, moving]
            variance = of_trace - 2.0 * mean * of_both + mean * mean * of_mass
            moving = moving[~(variance <= (_SETTLED * trace) ** 2)]
    return moments


@dataclass(frozen=True)
class Weighted:
    """Points (B, P) about the best mode with their weights, and the rows' terms there."""

    away: Point
    weight: FloatArray
    direct: list[FloatArray]

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Return mass and moments up to the second (M, B), and sums (3, B) for the variance of their ratio.

        These are sums of squared weights times the squared distance from the best mode to the powers 2, 1 and 0.
        """
        weighed = [self.weight * part for part in self.away]
        moments = [sum_points(self.weight), *map(sum_points, weighed)]
        moments += [sum_points(weighed[j], part) for i, part in enumerate(self.away) for j in range(i + 1)]
        for mine, part in zip(weighed, self.away, strict=True):
            mine *= part
        for other in weighed[1:]:
            weighed[0] += other
        x = weighed[0]
        squares = [sum_points(x, x), sum_points(x, self.weight), sum_points(self.weight, self.weight)]
        return np.stack(moments), np.stack(squares)


def _weigh(
    proposal: Proposal, modes: Modes, rows: IntArray, candidates: RowCandidates, first: int, count: int
) -> Weighted:
    """Return ``count`` points after the ``first`` of some snapshots, weighted by posterior over proposal."""
    point, share = proposal.sample(first, count)
    direct: list[FloatArray] = []
    with ignoring_overflow():
        cost = proposal.mixture.score(*point, terms=direct)
        np.subtract(modes.cost[rows, :1], cost, out=cost)
        weight = np.exp(cost)
        weight /= proposal.density(point, direct, share)
    outside = ~(candidates.allowed(rows, *point) & np.isfinite(weight))
    away = tuple(part - mode[rows, :1] for part, mode in zip(point, modes.point, strict=True))
    for values in (weight, *away):
        values[outside] = 0.0
    return Weighted(away, weight, direct)


def sum_points(values: FloatArray, other: FloatArray | None = None) -> FloatArray:
    """Return the sums (B,) over the points of values, or of products of two; the same bits in any block."""
    if other is None:
        return np.asarray(np.einsum("bp->b", values))
    return np.asarray(np.einsum("bp,bp->b", values, other))
