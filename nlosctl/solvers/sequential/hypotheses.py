"""Outlier suppression: grow a set of rows that agree, from many pairs (Ananthasubramaniam and Madhow, Section IV-B)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians, sqrt

import numpy as np
from scipy.special import erf

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.row_terms import squared_tube_ratio
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.sequential.polar_updates import (
    SourceState,
    bootstrap_state,
    ranged_state,
    select_rays,
    update_bearings,
    update_ranges,
)

__all__ = ["Hypotheses", "bearing_threshold_rad", "grow_hypotheses", "lone_hypotheses", "range_threshold_m"]


_VALUES = 1 << 16
"""Number of hypotheses times rows at once: temporaries stay in cache."""


@dataclass(frozen=True)
class Hypotheses:
    """Estimates (B, M), one from each pair, and the rows (K arrays of (B, M)) that each rests on."""

    state: SourceState
    used: list[BoolArray]


@dataclass(frozen=True)
class Thresholds:
    """Largest residuals (B, K) of a row in a set; ``range_m`` is infinite in rows without a range, None without any."""

    bearing_rad: FloatArray
    range_m: FloatArray | None


def bearing_threshold_rad(std_rad: FloatArray, alpha: float, field_of_view_deg: float) -> FloatArray:
    """Return the angle at which a direct row is as likely as an outlier; (25) with alpha outside the root.

    0 where no angle is: an outlier is then always likelier.
    """
    ratio = (1.0 - alpha) * radians(field_of_view_deg) / (alpha * sqrt(2.0 * pi) * std_rad)
    ratio = ratio / erf(pi / (2.0 * sqrt(2.0) * std_rad))
    return std_rad * np.sqrt(2.0 * np.log(np.maximum(ratio, 1.0)))


def range_threshold_m(std_m: FloatArray, alpha: float, extent_m: FloatArray) -> FloatArray:
    """Return (25)'s analogue for a range whose outliers are uniform over ``extent_m``; infinite for NaN."""
    with ignoring_division():
        ratio = (1.0 - alpha) * extent_m / (alpha * sqrt(2.0 * pi) * std_m)
        threshold = std_m * np.sqrt(2.0 * np.log(np.maximum(ratio, 1.0)))
    return np.where(np.isnan(std_m), np.inf, threshold)


def grow_hypotheses(
    model: OutlierModel,
    first: IntArray,
    second: IntArray,
    *,
    alpha: float,
    field_of_view_deg: float,
    by_likelihood: bool,
    lognormal: bool,
) -> Hypotheses:
    """Return what grows from pairs ``first``, ``second`` (B, M): steps 1 to 5.

    In each step the row that fits best (its residual in standard deviations) is combined, and kept if all rows of
    the set then stay below their thresholds; or, ``by_likelihood``, if (23) does not get worse. Rows of one group
    (paths of one sensor) are never together in a set; a pair from one group is discarded.
    """
    state = _start(model, first, second, lognormal)
    snapshot, index = np.nonzero(state.alive)
    used = [np.zeros(first.shape, dtype=bool, order="F") for _ in range(model.mixture.count)]
    block = max(1, _VALUES // model.mixture.count)
    for start in range(0, snapshot.shape[0], block):
        at = snapshot[start : start + block], index[start : start + block]
        growth = _Growth.start(model.take(at[0]), first[at][:, None], second[at][:, None], lognormal)
        growth.run(alpha, field_of_view_deg, by_likelihood)
        growth.put(at, state, used)
    return Hypotheses(state, used)


def lone_hypotheses(model: OutlierModel) -> Hypotheses:
    """Return what snapshots of one row (B, 1) determine: the end of its ray at its range, where it has one."""
    nothing = np.full((model.minimum_range_m.shape[0], 1), np.nan)
    state = SourceState(nothing, nothing, SymmetricMatrix(nothing, nothing, nothing), np.isfinite(nothing))
    row = np.zeros(nothing.shape, dtype=np.int64)
    state = ranged_state(select_rays(model.lines, row, model.measured_m, model.range_std_m)) or state
    return Hypotheses(state, [state.alive])


def _start(model: OutlierModel, first: IntArray, second: IntArray, lognormal: bool) -> SourceState:
    """Return the crossings of pairs of rows (B, M) that may both be direct, combined with their ranges."""
    rows = [select_rays(model.lines, index, model.measured_m, model.range_std_m) for index in (first, second)]
    state = bootstrap_state(rows[0], rows[1])
    for row in rows:
        state = update_ranges(state, row, lognormal=lognormal)
    leaders = [np.take_along_axis(model.leader, index, axis=1) for index in (first, second)]
    share = [np.take_along_axis(model.share, index, axis=1) for index in (first, second)]
    alive = state.alive & (leaders[0] != leaders[1]) & (share[0] > 0.0) & (share[1] > 0.0)
    return SourceState(state.x, state.y, state.covariance, alive)


@dataclass
class _Growth:
    """All sets while they grow; lists have one array (B, M) for each row."""

    model: OutlierModel
    lognormal: bool
    state: SourceState
    used: list[BoolArray]
    left: list[BoolArray]
    bearing: list[FloatArray]
    range: list[FloatArray]
    cost: FloatArray | None = None

    @classmethod
    def start(cls, model: OutlierModel, first: IntArray, second: IntArray, lognormal: bool) -> _Growth:
        leaders = [np.take_along_axis(model.leader, index, axis=1) for index in (first, second)]
        state = _start(model, first, second, lognormal)
        count = model.mixture.count
        used = [(first == k) | (second == k) for k in range(count)]
        left = []
        for k in range(count):
            group = model.leader[:, k, None]
            left.append((leaders[0] != group) & (leaders[1] != group) & (model.share[:, k, None] > 0.0))
        growth = cls(model, lognormal, state, used, left, [], [])
        growth.bearing, growth.range = growth.residuals(state)
        return growth

    def run(self, alpha: float, field_of_view_deg: float, by_likelihood: bool) -> None:
        """Take steps until no set has a row left."""
        model, range_m = self.model, None
        if model.range_std_m is not None:
            range_m = range_threshold_m(model.range_std_m, alpha, model.extent_m[:, None])
        limits = Thresholds(bearing_threshold_rad(model.lines.std_rad, alpha, field_of_view_deg), range_m)
        for _ in range(model.mixture.count - 2):
            if not self.step(limits, by_likelihood):
                break

    def put(self, at: tuple[IntArray, IntArray], state: SourceState, used: list[BoolArray]) -> None:
        """Write these sets (N, 1) into those of a block (B, M)."""
        state.x[at], state.y[at] = self.state.x[:, 0], self.state.y[:, 0]
        state.covariance.put(at, self.state.covariance.at(slice(None), 0))
        state.alive[at] = self.state.alive[:, 0]
        for mine, all_used in zip(self.used, used, strict=True):
            all_used[at] = mine[:, 0]

    def residuals(self, state: SourceState) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the sizes of all rows' residuals: bearing (radians) and, where rows have ranges, range (metres).

        Bearings seen on a circle are scaled as if their ray tubes were not focused.
        """
        lines, measured = self.model.lines, self.model.measured_m
        bearing, ranges = [], []
        with ignoring_overflow():
            for k in range(self.model.mixture.count):
                cosine, sine = lines.cosine[:, k, None], lines.sine[:, k, None]
                dx, dy = state.x - lines.origin_x[:, k, None], state.y - lines.origin_y[:, k, None]
                bearing.append(np.abs(np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy)))
                if lines.focusing is not None:
                    bearing[k] *= np.sqrt(squared_tube_ratio(lines.focusing, k, np.sqrt(dx * dx + dy * dy)))
                if measured is not None:
                    ranges.append(np.abs(measured[:, k, None] - np.sqrt(dx * dx + dy * dy)))
        return bearing, ranges

    def step(self, limits: Thresholds, by_likelihood: bool) -> bool:
        """Combine the best of the rows left (steps 2-4), and take it from those left (step 5); False: none was left."""
        chosen, any_left = self._best_left()
        if not any_left.any():
            return False
        rows = select_rays(self.model.lines, chosen, self.model.measured_m, self.model.range_std_m)
        trial = update_ranges(update_bearings(self.state, rows), rows, lognormal=self.lognormal)
        bearing, ranges = self.residuals(trial)
        accepted = any_left & trial.alive
        if by_likelihood:
            accepted = self._likelier(trial, accepted)
        else:
            accepted &= self._within(limits, chosen, bearing, ranges)
        group = np.take_along_axis(self.model.leader, chosen, axis=1)
        for k in range(self.model.mixture.count):
            is_chosen = chosen == k
            self.used[k] |= is_chosen & accepted
            self.left[k] &= ~(is_chosen | (accepted & (self.model.leader[:, k, None] == group)))
            self.bearing[k] = np.where(accepted, bearing[k], self.bearing[k])
            if ranges:
                self.range[k] = np.where(accepted, ranges[k], self.range[k])
        self.state = trial.where(accepted, self.state)
        return True

    def _best_left(self) -> tuple[IntArray, BoolArray]:
        shape = self.state.x.shape
        chosen, least = np.zeros(shape, dtype=np.int64), np.full(shape, np.inf)
        for k, left in enumerate(self.left):
            residual = self.bearing[k] / self.model.lines.std_rad[:, k, None]
            if self.range and self.model.range_std_m is not None:
                scaled = self.range[k] / self.model.range_std_m[:, k, None]
                residual = np.where(np.isnan(scaled), residual, np.hypot(residual, np.nan_to_num(scaled)))
            with ignoring_invalid():
                better = left & (residual < least)
            np.copyto(least, residual, where=better)
            np.copyto(chosen, k, where=better)
        return chosen, np.isfinite(least)

    def _within(
        self, limits: Thresholds, chosen: IntArray, bearing: list[FloatArray], ranges: list[FloatArray]
    ) -> BoolArray:
        """Return where all rows of the set and the chosen one are below their thresholds; step 4."""
        within = np.ones(chosen.shape, dtype=bool)
        for k, used in enumerate(self.used):
            small = bearing[k] < limits.bearing_rad[:, k, None]
            if ranges and limits.range_m is not None:
                limit = limits.range_m[:, k, None]
                small &= (ranges[k] < limit) | np.isinf(limit)
            within &= small | ~(used | (chosen == k))
        return within

    def _likelier(self, trial: SourceState, possible: BoolArray) -> BoolArray:
        """Return where, of the ``possible``, (23) at the trial state is not worse than at the present one."""
        with ignoring_overflow():
            if self.cost is None:
                self.cost = _score(self.model.mixture, self.state)
            cost = _score(self.model.mixture, trial)
            better: BoolArray = possible & (cost <= self.cost)
        self.cost = np.where(better, cost, self.cost)
        return better


def _score(mixture: Mixture, state: SourceState) -> FloatArray:
    return np.where(state.alive, mixture.score(state.x, state.y), np.inf)
