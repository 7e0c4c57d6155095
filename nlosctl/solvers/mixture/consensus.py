"""Do the rows agree better than outliers would? The evidence of a mode against that of "no source"."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from math import log, pi, tau

import numpy as np
from scipy.special import ndtr

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import rows_of, sum_measurements
from nlosctl.geometry.eigensystems import eigensystem
from nlosctl.geometry.regions import Region
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.space_row_terms import DirectDirections
from nlosctl.solvers.mixture.initial_estimates import Mode
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.ranked_estimates import Misfit, RankedFixes
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = [
    "Rival",
    "bonus_of_agreement",
    "find_rival",
    "log_evidence",
    "loose_odds",
    "outlier_gain",
    "rival_mass",
    "shared_outliers_mass",
    "volume_with",
]

_BEYOND_EDGE = 2.0
"""A fix on the edge of the search region stays if the mode outside is at most this many nats more likely."""

_FAR = 10.0
"""The source is far from a fix at so many standard deviations: a normalized squared error of 100."""

_SHARED = 0.5
"""The share of outliers of sensors near each other that are of one cause."""

_CHANCE = 2
"""This many rows always agree on some point."""

_PLANE = 2

_LEVERAGE = 0.5
"""Without a row of less leverage, its share of the information in its direction, the fix is not far away."""

_MOST_GAIN = 50.0
"""More than so many nats are as good as certain."""

_SELDOM = 0.015
"""Rows that all agree by chance with a smaller probability need less evidence, with a larger one more."""

_LESS_EVIDENCE = 2.8
"""So much less in nats at most."""


def outlier_gain(field_of_view_rad: float) -> float:
    """Return by how much outliers are rarer if no source exists than in the mixture of a source.

    The default field of view of 180 degrees, as published, is the half circle of directions that are in front of the
    sensor. Without a source a bearing points anywhere, so that its density is that of the full circle. A narrower field
    of view is that of the sensor itself: no bearing comes from outside it.
    """
    return tau / field_of_view_rad if field_of_view_rad >= pi else 1.0


def log_evidence(
    mixture: Mixture,
    cost: FloatArray,
    probability: FloatArray,
    hessian: SymmetricMatrix,
    volume: FloatArray,
    gain: FloatArray | float = 1.0,
) -> FloatArray:
    """Return the logarithm of the evidence of modes (B,) over that of "no source" (every row is an outlier), in nats.

    The evidence of a mode is its likelihood times its share of the search region: the volume of the Gaussian with the
    second derivatives ``hessian`` (B,) of the cost, over the region's ``volume`` (B,), at most 1. ``cost`` (B,) and
    ``probability`` (B, K) to be direct are those at the mode, with rows in the mixture's order. Outliers are rarer by
    ``gain`` in both hypotheses than the mixture assumes. NaN where there is no mode.
    """
    evidence = -cost - mixture.log_nlos
    group = np.zeros(cost.shape)
    for k in range(mixture.count):
        group += probability[:, k]
        closes: BoolArray | bool = True if mixture.last is None else mixture.last[:, k]
        evidence += np.where(closes, np.log1p((gain - 1.0) * group), 0.0)
        group = np.where(closes, 0.0, group)
    with ignoring_overflow(), ignoring_division():
        share = 0.5 * mixture.dimension * log(tau) - 0.5 * np.log(hessian.determinant) - np.log(volume)
    return evidence + np.where(share < 0.0, share, 0.0)


def bonus_of_agreement(
    mixture: Mixture, probability: FloatArray, log_chance: FloatArray, always_agree: int = _CHANCE
) -> FloatArray:
    """Return by how much the `log_evidence` (B,) grows if no row is an outlier, less what is not needed then, in nats.

    ``probability`` (B, K): that the rows, one of each sensor, are direct. ``log_chance`` (B,) is the logarithm of the
    mean probability that a row agrees with a position by chance: all rows beyond ``always_agree`` do so the more
    seldom, the less evidence is needed for as few of such snapshots to have a consensus.
    """
    with ignoring_division():
        gain = sum_measurements(np.log(probability)) - mixture.count * np.log1p(-mixture.obstructed)
    seldom = np.minimum(2.0 * (log(_SELDOM) - (mixture.count - always_agree) * log_chance), _LESS_EVIDENCE)
    return np.asarray(gain + seldom)


def rival_mass(fixes: RankedFixes, region_volume: FloatArray, gain: FloatArray | float = 1.0) -> FloatArray:
    """Return the posterior mass (B,) of all other modes of each snapshot in units of the best's: peaks times volumes.

    A volume is at most that (B,) of the search region. Outliers are rarer by ``gain`` than in the fixes' costs.
    """
    count = fixes.cost.shape[1]
    log_gain = np.broadcast_to(np.log(gain), region_volume.shape)[:, None]
    with ignoring_overflow():
        unit = tau ** (0.5 * len(fixes.point))
        volume = np.minimum(unit * np.sqrt(fixes.covariance.determinant), region_volume[:, None])
        mass = np.exp(fixes.cost[:, :1] - fixes.cost + (fixes.n_used - fixes.n_used[:, :1]) * log_gain)
        mass *= volume / volume[:, :1]
    total = np.zeros(region_volume.shape)
    for t in range(1, count):
        total += np.where(mass[:, t] > 0.0, mass[:, t], 0.0)
    return total


def shared_outliers_mass(
    mixture: Mixture, rows: DirectDirections, fixes: RankedFixes, region_volume: FloatArray
) -> FloatArray:
    """Return the `rival_mass` (B,) if rows of sensors near each other count once, times their share.

    Two receivers a few steps apart see the image of a source in the same wall: their directions agree on it as well as
    on the source. For each mode counts the row of them that speaks most for it.
    """
    several = np.flatnonzero(np.isfinite(fixes.cost[:, 1:]).any(axis=1))
    near = rows.near_sensors(several, *fixes.best_point)
    shared = np.asarray(near.any(axis=(1, 2)))
    several, near, mass = several[shared], near[shared], np.zeros(region_volume.shape)
    fixes = fixes.take(several)
    cost = fixes.cost.copy()
    number, index = np.nonzero(np.isfinite(cost))
    share, _ = mixture.take(several[number]).responsibilities(*(axis[number, index] for axis in fixes.point))
    gain = -np.log1p(-np.minimum(share, 1.0 - np.finfo(np.float64).eps))
    order = np.arange(gain.shape[1])
    above = (gain[:, None] > gain[:, :, None]) | ((gain[:, None] == gain[:, :, None]) & (order < order[:, None]))
    cost[number, index] += sum_measurements(np.where((near[number] & above).any(axis=2), gain, 0.0))
    mass[several] = _SHARED * rival_mass(replace(fixes, cost=cost), region_volume[several])
    return mass


def loose_odds(
    mixture: Mixture,
    point: Point,
    covariance: SymmetricMatrix,
    probability: FloatArray,
    used: BoolArray,
    volume: FloatArray,
) -> FloatArray:
    """Return the odds (B,) that a row of fixes (B,) is an outlier that keeps them far from the source.

    Without a row the cost is that of the others at their own optimum, and the volume of the mode larger, at most
    that (B,) of the search region: together the odds of that row to be an outlier. Times the probability that the
    source is then more than `_FAR` standard deviations from the fix, by the ``covariance`` (B,) of all rows. By the
    quadratic model of the cost; summed over the rows ``used`` (B, K), which are direct with a ``probability`` (B, K),
    if they have leverage.
    0 for fixes on one or two rows, which agree by chance: that is for the evidence to judge.
    """
    odds = np.zeros(volume.shape)
    with ignoring_overflow(), ignoring_division():
        information = covariance.inverse()
        for k in range(mixture.count):
            row, weight = mixture.rows.derivatives(k, *point), probability[:, k]
            some = np.flatnonzero(used[:, k] & (weight * _trace_of_product(row.gauss, covariance) > _LEVERAGE))
            gradient, gauss = rows_of(row.gradient, some), row.gauss.take(some)
            left_out = RowDerivatives(row.half_chi_square[some], gradient, gauss, gauss)
            gain, far = _leave_out(left_out, weight[some], information.take(some), volume[some])
            log_odds = np.minimum(gain, _MOST_GAIN) - mixture.log_direct[some, k]
            of_row = mixture.obstructed[some] * np.exp(log_odds) * far
            odds[some] += np.where(np.isfinite(of_row), of_row, 0.0)
    return np.where(np.count_nonzero(used, axis=1) > _CHANCE, odds, 0.0)


def _leave_out(
    row: RowDerivatives, weight: FloatArray, information: SymmetricMatrix, volume: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gain in log evidence (B,) from leaving out a row, and the probability that the source is then far."""
    others = information + row.gauss * -weight
    determinant, spread = _limited_inverse(others, volume)
    pull = [weight * slope for slope in row.gradient]
    gain = weight * row.half_chi_square + 0.5 * spread.quadratic_form(*pull)
    gain += 0.5 * np.log(np.maximum(information.determinant / determinant, 1.0))
    shift = np.sqrt(information.quadratic_form(*_times(spread, pull)))
    scale = np.sqrt(np.maximum(_trace_of_product(information, spread) - (len(pull) - 1.0), 1.0))
    return gain, ndtr((shift - _FAR) / scale) + ndtr((-shift - _FAR) / scale)


def _limited_inverse(matrix: SymmetricMatrix, volume: FloatArray) -> tuple[FloatArray, SymmetricMatrix]:
    """Return determinants and inverses of matrices (B,) that may be singular, whose Gaussians have at most a volume."""
    if matrix.dimension == _PLANE:
        determinant = np.maximum(matrix.determinant, (tau / volume) ** 2)
        return determinant, SymmetricMatrix(matrix.yy, -matrix.xy, matrix.xx) * (1.0 / determinant)
    values, directions = eigensystem(matrix)
    least = tau / volume ** (2.0 / matrix.dimension)
    values = tuple(np.maximum(value, least) for value in values)
    inverse = SymmetricMatrix.full(volume.shape, 0.0, matrix.dimension)
    for value, direction in zip(values, directions, strict=True):
        inverse += SymmetricMatrix.outer(*direction, weight=1.0 / value)
    return reduce(np.multiply, values), inverse


def _times(matrix: SymmetricMatrix, vector: list[FloatArray]) -> list[FloatArray]:
    """Return ``matrix v`` for vectors v, given as D arrays."""
    indices = range(matrix.dimension)
    return [reduce(np.add, [matrix.entry(i, j) * vector[j] for j in indices]) for i in indices]


def _trace_of_product(one: SymmetricMatrix, other: SymmetricMatrix) -> FloatArray:
    total = one.xx * other.xx
    for i in range(1, one.dimension):
        for j in range(i):
            total = total + 2.0 * one.entry(i, j) * other.entry(i, j)
        total = total + one.entry(i, i) * other.entry(i, i)
    return total


@dataclass(frozen=True)
class Rival:
    """Which snapshots (B,) have a better point outside the search region, and fixes and probabilities with it first."""

    better: BoolArray
    fixes: RankedFixes
    probability: FloatArray


def find_rival(
    mixture: Mixture,
    outside: Mode,
    fixes: RankedFixes,
    probability: FloatArray,
    *,
    is_convincing: Callable[[IntArray, FloatArray], BoolArray],
    at_boundary: BoolArray,
    margin: float = 0.0,
    unordered: BoolArray | None = None,
    ambiguous_rows: int = 0,
) -> Rival:
    """Return where the mode ``outside`` (B,) the search region beats the best fix inside: it is more likely.

    By more than ``margin`` nats; a fix at the edge of the region stays if the mode outside is about as likely.
    ``is_convincing(rows, probability)`` returns which modes outside of some snapshots (N,), where each row is direct
    with a probability (N, K), also have the evidence that a fix needs, in a region so large that they are inside. In
    ``unordered`` (B,) snapshots, where mirror images are as likely as the source, the mode needs more than
    ``ambiguous_rows`` more rows than the best fix.
    """
    rows = np.flatnonzero(outside.cost < fixes.cost[:, 0] - np.where(at_boundary, _BEYOND_EDGE, margin))
    point, cost = rows_of(outside.point, rows), outside.cost[rows]
    own, _ = mixture.take(rows).responsibilities(*point)
    count = np.count_nonzero(own > 0.5, axis=1)
    wins = (count > 0) & is_convincing(rows, own)
    if unordered is not None:
        wins &= ~unordered[rows] | (count > fixes.n_used[rows, 0] + ambiguous_rows)
    rows, own, count, cost = rows[wins], own[wins], count[wins], cost[wins]
    point = tuple(part[wins] for part in point)
    better = np.zeros(at_boundary.shape, dtype=bool)
    better[rows] = True
    if not rows.size:
        return Rival(better, fixes, probability)
    n_used, columns = fixes.n_used.copy(), [part.copy() for part in (fixes.cost, *fixes.point)]
    n_used[rows, 0] = count
    for column, values in zip(columns, (cost, *point), strict=True):
        column[rows, 0] = values
    misfit = Misfit(fixes.misfit.chi_square.copy(), fixes.misfit.degrees_of_freedom.copy())
    misfit.put((rows, np.zeros_like(rows)), mixture.take(rows), point, own > 0.5)
    probability = probability.copy(order="F")
    probability[rows] = own
    fixes = replace(fixes, cost=columns[0], n_used=n_used, point=tuple(columns[1:]), misfit=misfit)
    return Rival(better, fixes, probability)


def volume_with(region: Region, point: Point) -> FloatArray:
    """Return the volumes (B,) of cubes about the middles of the regions that reach to points (B,)."""
    bounds = zip(point, *region.bounds_m, strict=True)
    sides = [2.0 * np.abs(part - 0.5 * (least + most)) for part, least, most in bounds]
    side = reduce(np.maximum, sides)
    return np.maximum(region.volume, reduce(np.multiply, [side] * len(point)))
