"""Outlier suppression: sets grown from random pairs and from the likeliest crossings; the estimates are ranked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, SeedArray, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.bearing_candidates import BearingCandidates
from nlosctl.solvers.mixture.initial_estimates import Mode, Scores
from nlosctl.solvers.mixture.modes import score_candidates
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.ranked_estimates import Misfit, RankedFixes
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.sequential.hypotheses import Hypotheses, grow_hypotheses, lone_hypotheses
from nlosctl.solvers.sequential.inlier_covariance import inlier_covariance
from nlosctl.solvers.sequential.starting_pairs import shuffled_pairs

__all__ = ["SuppressedFixes", "suppress_outliers"]


_STATES = 8192
"""Number of hypotheses per block: temporaries stay in cache."""

_POINTS = 1 << 18
"""Number of crossings scored at once."""

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
    def empty(cls, size: int, count: int, dimension: int) -> SuppressedFixes:
        """Return ``size`` snapshots of ``count`` rows without a fix."""
        shape = (size, _KEPT)
        fixes = RankedFixes(
            tuple(np.full(shape, np.nan) for _ in range(dimension)),
            np.full(shape, np.inf),
            SymmetricMatrix.full(shape, np.nan, dimension),
            np.zeros(shape, np.int64),
            Misfit.unknown(shape),
        )
        return cls(fixes, np.zeros((size, count), dtype=bool, order="F"), np.zeros(size, dtype=bool))

    def put(self, rows: IntArray, part: SuppressedFixes) -> None:
        """Fill in the fixes of some snapshots."""
        target, source = self.fixes, part.fixes
        for mine, values in zip((*target.point, target.cost), (*source.point, source.cost), strict=True):
            mine[rows] = values
        target.covariance.put(rows, source.covariance)
        target.n_used[rows] = source.n_used
        target.misfit.chi_square[rows] = source.misfit.chi_square
        target.misfit.degrees_of_freedom[rows] = source.misfit.degrees_of_freedom
        self.used[rows] = part.used
        self.candidates[rows] = part.candidates


def suppress_outliers(
    candidates: BearingCandidates,
    seed: SeedArray,
    *,
    bootstraps: IntArray,
    rivals: int,
    max_pairs: int,
    outside: OutsideSearch | None,
    **growth: Any,
) -> SuppressedFixes:
    """Return the ranked estimates of a block, grown from ``bootstraps`` (B,) random pairs and the likeliest crossings.

    ``rivals`` is the number of crossings, the likeliest by (23) of those apart from each other, that sets are grown
    from besides the random pairs. The number of pairs doubles until an estimate is in the search region. ``outside``
    notes the crossings outside of it. ``growth`` are the keywords of `grow_hypotheses`.
    """
    count = candidates.model.mixture.count
    result = SuppressedFixes.empty(seed.shape[0], count, candidates.model.mixture.dimension)
    if count == 1:
        every = np.arange(seed.shape[0])
        result.put(every, _rank(candidates, candidates.model, every, lone_hypotheses(candidates.model)))
        return result
    pairs = min(count * (count - 1) // 2, max_pairs)
    for wanted in np.unique(bootstraps).tolist():
        unsolved = np.flatnonzero(bootstraps == wanted)
        window = slice(0, wanted)
        while unsolved.size and window.start < pairs:
            extra = rivals if window.start == 0 else 0
            block = max(1, min(_STATES // (window.stop - window.start + extra), _POINTS // pairs))
            for start in range(0, unsolved.shape[0], block):
                rows = unsolved[start : start + block]
                model = candidates.model.take_rows(rows)
                first, second = _possible_first(model, *shuffled_pairs(seed[rows], count, max_pairs))
                first, second = first[:, window], second[:, window]
                if window.start == 0 and (extra or outside is not None):
                    more = _likeliest_pairs(candidates, rows, extra, outside)
                    first, second = (np.concatenate([a.T, b.T]).T for a, b in zip((first, second), more, strict=True))
                grown = grow_hypotheses(model, first, second, **growth)
                result.put(rows, _rank(candidates, model, rows, grown))
            unsolved = unsolved[~result.candidates[unsolved]]
            window = slice(window.stop, 2 * window.stop)
    return result


def follow_best(
    candidates: BearingCandidates, fixes: RankedFixes, outside: OutsideSearch | None
) -> tuple[Mode, BoolArray, BoolArray]:
    """Return the optima (B,) of the likelihood that the best fixes lead to, where they settled, and where they left.

    Where a fix leads out of the search region, ``outside`` notes its optimum. Where it leads nowhere, the second
    derivatives are the information of the fix's rows.
    """
    mixture, start = candidates.model.mixture, fixes.best_point
    end = minimize(mixture, *start)
    every = np.arange(start[0].shape[0])
    inside = candidates.allowed(every, *(part[:, None] for part in end.point))[:, 0]
    if outside is not None:
        outside.note_ends(end, mixture.least_cost, every, inside)
        outside.follow(mixture, fixes.cost[:, 0])
    hessian = end.hessian.where(end.converged, fixes.covariance.at(slice(None), 0).inverse())
    cost = np.where(end.converged, end.cost + mixture.least_cost, fixes.cost[:, 0])
    return Mode(end.point, cost, hessian), end.converged, end.converged & ~inside


def _likeliest_pairs(
    candidates: BearingCandidates, rows: IntArray, most: int, outside: OutsideSearch | None
) -> tuple[IntArray, IntArray]:
    """Return the pairs (b, ``most``) of the likeliest crossings that are apart; (0, 0) if there are fewer."""
    mixture = candidates.model.mixture
    scored = score_candidates(mixture, candidates.points, candidates.allowed, rows, candidates.count, outside)
    pairs = candidates.first.shape[-1]  # the ends of rays at their ranges, which follow, are not pairs
    scores = Scores(tuple(part[:, :pairs] for part in scored.point), scored.cost[:, :pairs])
    part = mixture.take_rows(rows)
    chosen = [np.zeros((rows.shape[0], most), dtype=np.int64, order="F") for _ in range(2)]
    for number in range(most):
        index, lowest = scores.lowest()
        some = np.flatnonzero(np.isfinite(lowest))
        if not some.size:
            break
        for pair, ends in zip(chosen, (candidates.first, candidates.second), strict=True):
            pair[some, number] = ends[index[some]] if ends.ndim == 1 else ends[rows[some], index[some]]
        point = scores.at(index)
        with ignoring_overflow():
            near = scores.squared_distance(part.responsibilities(*point)[1], *point) < _APART * _APART
        np.copyto(scores.cost, np.inf, where=near)
        scores.leave_out(index)
    return chosen[0], chosen[1]


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


def _rank(candidates: BearingCandidates, model: OutlierModel, rows: IntArray, grown: Hypotheses) -> SuppressedFixes:
    """Rank the estimates inside the search region by their likelihood (23); drop those near a better one."""
    state = grown.state
    inside = state.alive & candidates.allowed(rows, *state.point)
    with ignoring_overflow():
        cost = np.where(inside, model.mixture.score(*state.point), np.inf)
    size = cost.shape[0]
    result = SuppressedFixes.empty(size, model.mixture.count, model.mixture.dimension)
    result.candidates[:] = inside.any(axis=1)
    snapshot = np.arange(size)
    fixes = result.fixes
    for t in range(min(_KEPT, cost.shape[1])):
        index = np.argmin(cost, axis=1)
        valid = np.isfinite(cost[snapshot, index])
        if not valid.any():
            break
        at, index = snapshot[valid], index[valid]
        point = tuple(part[at, index] for part in state.point)
        for mine, values in zip(fixes.point, point, strict=True):
            mine[at, t] = values
        fixes.cost[at, t] = _exact_cost(model, at, *point)
        used = np.asfortranarray(grown.used[at, index])
        part = model.direct.take(at)
        fixes.covariance.put((at, t), inlier_covariance(part, used, *point))
        fixes.misfit.put((at, t), model.mixture.take(at), point, used)
        fixes.n_used[at, t] = np.count_nonzero(used, axis=1)
        if t == 0:
            result.used[at] = used
        cost[_near(state.point, fixes, t) | ~np.isfinite(cost)] = np.inf
        cost[at, index] = np.inf
    return result


def _exact_cost(model: OutlierModel, rows: IntArray, *point: FloatArray) -> FloatArray:
    mixture = model.mixture.take(rows)
    return mixture.evaluate(*point).cost + mixture.least_cost


def _near(point: Point, fixes: RankedFixes, t: int) -> BoolArray:
    """Return which estimates (B, M) are within some standard deviations of fix ``t``."""
    information = fixes.covariance.at(slice(None), t).inverse().at(slice(None), None)
    away = [part - fix[:, t, None] for part, fix in zip(point, fixes.point, strict=True)]
    near: BoolArray = information.quadratic_form(*away) < _APART * _APART
    return near
