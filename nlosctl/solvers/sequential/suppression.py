"""Outlier suppression: rounds of random pairs until an estimate is in the search region; the estimates are ranked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, SeedArray, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.mixture.ranked_estimates import Misfit, RankedFixes
from nlosctl.solvers.sequential.hypotheses import Hypotheses, grow_hypotheses
from nlosctl.solvers.sequential.starting_pairs import shuffled_pairs

__all__ = ["SuppressedFixes", "suppress_outliers"]


_STATES = 8192
"""Number of hypotheses per block: temporaries stay in cache."""

_KEPT = 10
_APART = 3.0
"""Estimates closer than this, in standard deviations, are one: the order of the rows moves them by less."""


@dataclass(frozen=True)
class SuppressedFixes:
    """Ranked fixes (B, 10), the rows (B, K) that the best one uses, and whether any estimate was in the region (B,)."""

    fixes: RankedFixes
    used: BoolArray
    candidates: BoolArray

    @classmethod
    def empty(cls, size: int, count: int) -> SuppressedFixes:
        """Return ``size`` snapshots of ``count`` rows without a fix."""
        shape = (size, _KEPT)
        fixes = RankedFixes(
            np.full(shape, np.nan),
            np.full(shape, np.nan),
            np.full(shape, np.inf),
            SymmetricMatrix.full(shape, np.nan),
            np.zeros(shape, np.int64),
            Misfit.unknown(shape),
        )
        return cls(fixes, np.zeros((size, count), dtype=bool, order="F"), np.zeros(size, dtype=bool))

    def put(self, rows: IntArray, part: SuppressedFixes) -> None:
        """Fill in the fixes of some snapshots."""
        target, source = self.fixes, part.fixes
        target.x[rows], target.y[rows], target.cost[rows] = source.x, source.y, source.cost
        target.covariance.put(rows, source.covariance)
        target.n_used[rows] = source.n_used
        target.misfit.chi_square[rows] = source.misfit.chi_square
        target.misfit.degrees_of_freedom[rows] = source.misfit.degrees_of_freedom
        self.used[rows] = part.used
        self.candidates[rows] = part.candidates


def suppress_outliers(
    model: OutlierModel,
    seed: SeedArray,
    *,
    bootstraps: int,
    alpha: float,
    field_of_view_deg: float,
    by_likelihood: bool,
    lognormal: bool,
    max_pairs: int,
) -> SuppressedFixes:
    """Return the ranked estimates of a block; the number of pairs doubles until one is in the search region."""
    count = model.mixture.count
    result = SuppressedFixes.empty(seed.shape[0], count)
    pairs = min(count * (count - 1) // 2, max_pairs)
    unsolved = np.arange(seed.shape[0])
    window = slice(0, bootstraps)
    while unsolved.size and window.start < pairs:
        block = max(1, _STATES // (window.stop - window.start))
        for start in range(0, unsolved.shape[0], block):
            rows = unsolved[start : start + block]
            part = model if rows.shape[0] == seed.shape[0] else model.take(rows)
            first, second = _possible_first(part, *shuffled_pairs(seed[rows], count, max_pairs))
            grown = grow_hypotheses(
                part,
                np.asfortranarray(first[:, window]),
                np.asfortranarray(second[:, window]),
                alpha=alpha,
                field_of_view_deg=field_of_view_deg,
                by_likelihood=by_likelihood,
                lognormal=lognormal,
            )
            result.put(rows, _rank(part, grown))
        unsolved = unsolved[~result.candidates[unsolved]]
        window = slice(window.stop, 2 * window.stop)
    return result


def _possible_first(model: OutlierModel, first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pairs (B, P), first those that may both be direct: of different groups, each of positive share."""
    leaders, shares = (
        [np.take_along_axis(values, index, axis=1) for index in (first, second)]
        for values in (model.leader, model.share)
    )
    impossible = (leaders[0] == leaders[1]) | (shares[0] <= 0.0) | (shares[1] <= 0.0)
    if not impossible.any():
        return first, second
    order = np.argsort(impossible, axis=1, kind="stable")
    return np.take_along_axis(first, order, axis=1), np.take_along_axis(second, order, axis=1)


def _rank(model: OutlierModel, grown: Hypotheses) -> SuppressedFixes:
    """Rank the estimates inside the search region by their likelihood (23); drop those near a better one."""
    state = grown.state
    inside = state.alive & model.region.contains(state.x, state.y)
    with ignoring_overflow():
        cost = np.where(inside, model.mixture.score(state.x, state.y), np.inf)
    size = cost.shape[0]
    result = SuppressedFixes.empty(size, model.mixture.count)
    result.candidates[:] = inside.any(axis=1)
    snapshot = np.arange(size)
    fixes = result.fixes
    for t in range(min(_KEPT, cost.shape[1])):
        index = np.argmin(cost, axis=1)
        valid = np.isfinite(cost[snapshot, index])
        if not valid.any():
            break
        rows, index = snapshot[valid], index[valid]
        fixes.x[rows, t], fixes.y[rows, t] = state.x[rows, index], state.y[rows, index]
        fixes.covariance.put((rows, t), state.covariance.at(rows, index))
        fixes.cost[rows, t] = _exact_cost(model, rows, fixes.x[rows, t], fixes.y[rows, t])
        used = np.stack([part[rows, index] for part in grown.used], axis=1)
        fixes.n_used[rows, t] = np.count_nonzero(used, axis=1)
        part = model.mixture.rows.take(rows)
        fixes.misfit.put((rows, t), part, fixes.x[rows, t], fixes.y[rows, t], used)
        if t == 0:
            result.used[rows] = used
        cost[_near(state.x, state.y, fixes, t) | ~np.isfinite(cost)] = np.inf
        cost[rows, index] = np.inf
    return result


def _exact_cost(model: OutlierModel, rows: IntArray, x: FloatArray, y: FloatArray) -> FloatArray:
    mixture = model.mixture.take(rows)
    return mixture.evaluate(x, y).cost + mixture.least_cost


def _near(x: FloatArray, y: FloatArray, fixes: RankedFixes, t: int) -> BoolArray:
    """Return which estimates (B, M) are within some standard deviations of fix ``t``."""
    information = fixes.covariance.at(slice(None), t).inverse().at(slice(None), None)
    dx, dy = x - fixes.x[:, t, None], y - fixes.y[:, t, None]
    near: BoolArray = information.quadratic_form(dx, dy) < _APART * _APART
    return near
