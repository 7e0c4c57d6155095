"""The estimates of outlier suppression: rounds of random pairs until one lies in the search field, ranked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, SeedArray, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.mixture.ranked_estimates import RankedFixes
from nlosctl.solvers.sequential.hypotheses import Hypotheses, grow_hypotheses
from nlosctl.solvers.sequential.starting_pairs import shuffled_pairs

__all__ = ["SuppressedFixes", "suppress_outliers"]


_STATES = 8192
"""So many hypotheses grow at once, that temporaries stay in the cache."""

_KEPT = 10
_APART = 3.0
"""Estimates closer than so many standard deviations are one: the order of the rows alone moves them by less."""


@dataclass(frozen=True)
class SuppressedFixes:
    """Ranked fixes (B, 10), the rows (B, K) that the best rests on, and whether any estimate was in the field (B,)."""

    fixes: RankedFixes
    used: BoolArray
    candidates: BoolArray

    @classmethod
    def nothing(cls, size: int, count: int) -> SuppressedFixes:
        """Return no fix for any of ``size`` snapshots of ``count`` rows."""
        shape = (size, _KEPT)
        fixes = RankedFixes(
            np.full(shape, np.nan),
            np.full(shape, np.nan),
            np.full(shape, np.inf),
            SymmetricMatrix.full(shape, np.nan),
            np.zeros(shape, np.int64),
        )
        return cls(fixes, np.zeros((size, count), dtype=bool, order="F"), np.zeros(size, dtype=bool))

    def put(self, rows: IntArray, part: SuppressedFixes) -> None:
        """Fill in the fixes of some snapshots."""
        mine, theirs = self.fixes, part.fixes
        mine.x[rows], mine.y[rows], mine.cost[rows] = theirs.x, theirs.y, theirs.cost
        mine.covariance.put(rows, theirs.covariance)
        mine.n_used[rows] = theirs.n_used
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
    """Return the ranked estimates of a block; where none was inside yet, as many further pairs as there were before."""
    count = model.mixture.count
    found = SuppressedFixes.nothing(seed.shape[0], count)
    pairs = min(count * (count - 1) // 2, max_pairs)
    open_rows = np.arange(seed.shape[0])
    some = slice(0, bootstraps)
    while open_rows.size and some.start < pairs:
        block = max(1, _STATES // (some.stop - some.start))
        for start in range(0, open_rows.shape[0], block):
            rows = open_rows[start : start + block]
            part = model if rows.shape[0] == seed.shape[0] else model.take(rows)
            one, other = _possible_first(part, *shuffled_pairs(seed[rows], count, max_pairs))
            grown = grow_hypotheses(
                part,
                np.asfortranarray(one[:, some]),
                np.asfortranarray(other[:, some]),
                alpha=alpha,
                field_of_view_deg=field_of_view_deg,
                by_likelihood=by_likelihood,
                lognormal=lognormal,
            )
            found.put(rows, _rank(part, grown))
        open_rows = open_rows[~found.candidates[open_rows]]
        some = slice(some.stop, 2 * some.stop)
    return found


def _possible_first(model: OutlierModel, first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pairs (B, P) with those in front that may both be direct: not of one group, and of some share."""
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
    """Return the estimates inside the search field by their likelihood (23), without those near a better one."""
    state = grown.state
    inside = state.alive & model.region.contains(state.x, state.y)
    with ignoring_overflow():
        cost = np.where(inside, model.mixture.score(state.x, state.y), np.inf)
    size = cost.shape[0]
    found = SuppressedFixes.nothing(size, model.mixture.count)
    found.candidates[:] = inside.any(axis=1)
    snapshot = np.arange(size)
    fixes = found.fixes
    for t in range(min(_KEPT, cost.shape[1])):
        index = np.argmin(cost, axis=1)
        here = np.isfinite(cost[snapshot, index])
        if not here.any():
            break
        rows, index = snapshot[here], index[here]
        fixes.x[rows, t], fixes.y[rows, t] = state.x[rows, index], state.y[rows, index]
        fixes.covariance.put((rows, t), state.covariance.at(rows, index))
        fixes.cost[rows, t] = _exact_cost(model, rows, fixes.x[rows, t], fixes.y[rows, t])
        used = np.stack([part[rows, index] for part in grown.used], axis=1)
        fixes.n_used[rows, t] = np.count_nonzero(used, axis=1)
        if t == 0:
            found.used[rows] = used
        cost[_near(state.x, state.y, fixes, t) | ~np.isfinite(cost)] = np.inf
        cost[rows, index] = np.inf
    return found


def _exact_cost(model: OutlierModel, rows: IntArray, x: FloatArray, y: FloatArray) -> FloatArray:
    mixture = model.mixture.take(rows)
    return mixture.evaluate(x, y).cost + mixture.least_cost


def _near(x: FloatArray, y: FloatArray, fixes: RankedFixes, t: int) -> BoolArray:
    """Return which estimates (B, M) are within some standard deviations of fix ``t``."""
    information = fixes.covariance.at(slice(None), t).inverse().at(slice(None), None)
    dx, dy = x - fixes.x[:, t, None], y - fixes.y[:, t, None]
    near: BoolArray = information.quadratic_form(dx, dy) < _APART * _APART
    return near
