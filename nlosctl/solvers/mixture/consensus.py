"""Do the rows agree better than outliers would? The evidence of a mode against that of "no source"."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi, tau

import numpy as np
from scipy.special import ndtr

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import rows_of, sum_measurements
from nlosctl.geometry.regions import Region
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.initial_estimates import Mode
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.mixture.ranked_estimates import Misfit, RankedFixes
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["Rival", "bonus_of_agreement", "find_rival", "log_evidence", "loose_odds", "outlier_gain", "rival_mass"]

_BEYOND_EDGE = 2.0
"""A fix on the edge of the search region stays if the mode outside is at most this many nats more likely."""

_FAR = 10.0
"""The source is far from a fix at so many standard deviations: a normalized squared error of 100."""

_CHANCE = 2
"""This many rows always agree on some point."""

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
    area_m2: FloatArray,
    gain: FloatArray | float = 1.0,
) -> FloatArray:
    """Return the logarithm of the evidence of modes (B,) over that of "no source" (every row is an outlier), in nats.

    The evidence of a mode is its likelihood times its share of the search region: the volume of the Gaussian with the
    second derivatives ``hessian`` (B,) of the cost, over ``area_m2`` (B,), at most 1. ``cost`` (B,) and ``probability``
    (B, K) to be direct are those at the mode, with rows in the mixture's order. Outliers are rarer by ``gain`` in both
    hypotheses than the mixture assumes. NaN where there is no mode.
    """
    evidence = -cost - mixture.log_nlos
    group = np.zeros(cost.shape)
    for k in range(mixture.count):
        group += probability[:, k]
        closes: BoolArray | bool = True if mixture.last is None else mixture.last[:, k]
        evidence += np.where(closes, np.log1p((gain - 1.0) * group), 0.0)
        group = np.where(closes, 0.0, group)
    with ignoring_overflow(), ignoring_division():
        share = log(tau) - 0.5 * np.log(hessian.determinant) - np.log(area_m2)
    return evidence + np.where(share < 0.0, share, 0.0)


def bonus_of_agreement(mixture: Mixture, probability: FloatArray, log_chance: FloatArray) -> FloatArray:
    """Return by how much the `log_evidence` (B,) grows if no row is an outlier, less what is not needed then, in nats.

    ``probability`` (B, K): that the rows, one of each sensor, are direct. ``log_chance`` (B,) is the logarithm of the
    mean probability that a row agrees with a position by chance: all rows beyond two do so the more seldom, the less
    evidence is needed for as few of such snapshots to have a consensus.
    """
    with ignoring_division():
        gain = sum_measurements(np.log(probability)) - mixture.count * np.log1p(-mixture.obstructed)
    seldom = np.minimum(2.0 * (log(_SELDOM) - (mixture.count - _CHANCE) * log_chance), _LESS_EVIDENCE)
    return np.asarray(gain + seldom)


def rival_mass(fixes: RankedFixes, area_m2: FloatArray, gain: FloatArray | float = 1.0) -> FloatArray:
    """Return the posterior mass (B,) of all other modes of each snapshot in units of the best's: peaks times volumes.

    A volume is at most the area (B,) of the search region. Outliers are rarer by ``gain`` than in the fixes' costs.
    """
    count = fixes.cost.shape[1]
    log_gain = np.broadcast_to(np.log(gain), area_m2.shape)[:, None]
    with ignoring_overflow():
        volume = np.minimum(tau * np.sqrt(fixes.covariance.determinant), area_m2[:, None])
        mass = np.exp(fixes.cost[:, :1] - fixes.cost + (fixes.n_used - fixes.n_used[:, :1]) * log_gain)
        mass *= volume / volume[:, :1]
    total = np.zeros(area_m2.shape)
    for t in range(1, count):
        total += np.where(mass[:, t] > 0.0, mass[:, t], 0.0)
    return total


def loose_odds(
    mixture: Mixture,
    x: FloatArray,
    y: FloatArray,
    covariance: SymmetricMatrix,
    probability: FloatArray,
    used: BoolArray,
    area_m2: FloatArray,
) -> FloatArray:
    """Return the odds (B,) that a row of fixes x, y (B,) is an outlier that keeps them far from the source.

    Without a row the cost is that of the others at their own optimum, and the volume of the mode larger, at most the
    area (B,) of the search region: together the odds of that row to be an outlier. Times the probability that the
    source is then more than `_FAR` standard deviations from the fix, by the ``covariance`` (B,) of all rows. By the
    quadratic model of the cost; summed over the rows ``used`` (B, K), which are direct with a ``probability`` (B, K),
    if they have leverage.
    0 for fixes on one or two rows, which agree by chance: that is for the evidence to judge.
    """
    odds = np.zeros(x.shape)
    with ignoring_overflow(), ignoring_division():
        information = covariance.inverse()
        for k in range(mixture.count):
            row, weight = mixture.rows.derivatives(k, x, y), probability[:, k]
            some = np.flatnonzero(used[:, k] & (weight * _trace_of_product(row.gauss, covariance) > _LEVERAGE))
            gradient, gauss = rows_of(row.gradient, some), row.gauss.take(some)
            left_out = RowDerivatives(row.half_chi_square[some], gradient, gauss, gauss)
            gain, far = _leave_out(left_out, weight[some], information.take(some), area_m2[some])
            log_odds = np.minimum(gain, _MOST_GAIN) - mixture.log_direct[some, k]
            of_row = mixture.obstructed[some] * np.exp(log_odds) * far
            odds[some] += np.where(np.isfinite(of_row), of_row, 0.0)
    return np.where(np.count_nonzero(used, axis=1) > _CHANCE, odds, 0.0)


def _leave_out(
    row: RowDerivatives, weight: FloatArray, information: SymmetricMatrix, area_m2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gain in log evidence (B,) from leaving out a row, and the probability that the source is then far."""
    others = information + row.gauss * -weight
    determinant = np.maximum(others.determinant, (tau / area_m2) ** 2)
    spread = SymmetricMatrix(others.yy, -others.xy, others.xx) * (1.0 / determinant)
    u, v = (weight * slope for slope in row.gradient)
    gain = weight * row.half_chi_square + 0.5 * spread.quadratic_form(u, v)
    gain += 0.5 * np.log(np.maximum(information.determinant / determinant, 1.0))
    shift = np.sqrt(information.quadratic_form(spread.xx * u + spread.xy * v, spread.xy * u + spread.yy * v))
    scale = np.sqrt(np.maximum(_trace_of_product(information, spread) - 1.0, 1.0))
    return gain, ndtr((shift - _FAR) / scale) + ndtr((-shift - _FAR) / scale)


def _trace_of_product(one: SymmetricMatrix, other: SymmetricMatrix) -> FloatArray:
    return one.xx * other.xx + 2.0 * one.xy * other.xy + one.yy * other.yy


@dataclass(frozen=True)
class Rival:
    """Which snapshots (B,) have a better point outside the search region, and fixes and probabilities with it first."""

    better: BoolArray
    fixes: RankedFixes
    probability: FloatArray


def find_rival(
    model: OutlierModel,
    outside: Mode,
    fixes: RankedFixes,
    probability: FloatArray,
    *,
    at_boundary: BoolArray,
    unordered: BoolArray | None,
    ambiguous_rows: int,
    least_evidence: float,
    gain: float,
) -> Rival:
    """Return where the mode ``outside`` (B,) the search region beats the best fix inside: it is more likely.

    It must also have the evidence that a fix needs, in a region so large that it is inside. In ``unordered`` (B,)
    snapshots, where mirror images are as likely as the source, it needs more than ``ambiguous_rows`` more rows than the
    best fix; a fix at the edge of the region stays if the mode outside is about as likely.
    """
    margin = np.where(at_boundary, _BEYOND_EDGE, 0.0)
    rows = np.flatnonzero(outside.cost < fixes.cost[:, 0] - margin)
    mixture, x, y, cost = model.mixture.take(rows), outside.x[rows], outside.y[rows], outside.cost[rows]
    own, _ = mixture.responsibilities(x, y)
    count = np.count_nonzero(own > 0.5, axis=1)
    area = _area_with(model.region.take(rows), x, y)
    evidence = log_evidence(mixture, cost, own, outside.hessian.take(rows), area, gain)
    wins = (count > 0) & (evidence >= least_evidence)
    if unordered is not None:
        wins &= ~unordered[rows] | (count > fixes.n_used[rows, 0] + ambiguous_rows)
    rows, own, count, x, y, cost = (part[wins] for part in (rows, own, count, x, y, cost))
    better = np.zeros(at_boundary.shape, dtype=bool)
    better[rows] = True
    if not rows.size:
        return Rival(better, fixes, probability)
    columns = {name: getattr(fixes, name).copy() for name in ("x", "y", "cost", "n_used")}
    for name, values in (("x", x), ("y", y), ("cost", cost), ("n_used", count)):
        columns[name][rows, 0] = values
    misfit = Misfit(fixes.misfit.chi_square.copy(), fixes.misfit.degrees_of_freedom.copy())
    misfit.put((rows, np.zeros_like(rows)), model.mixture.take(rows).rows, x, y, own > 0.5)
    probability = probability.copy(order="F")
    probability[rows] = own
    return Rival(better, replace(fixes, misfit=misfit, **columns), probability)


def _area_with(region: Region, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the areas (B,) of squares about the middles of the regions that reach to points x, y (B,)."""
    xmin, xmax, ymin, ymax = region.bounds_m
    reach = np.maximum(np.abs(x - 0.5 * (xmin + xmax)), np.abs(y - 0.5 * (ymin + ymax)))
    return np.maximum(region.area_m2, 4.0 * reach * reach)
