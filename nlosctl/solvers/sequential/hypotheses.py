"""Outlier suppression: grow a set of rows that agree, from many pairs (Ananthasubramaniam and Madhow, Section IV-B)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians, sqrt
from typing import Any

import numpy as np
from scipy.special import erf

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.contract.step_progress import note_step
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.row_terms import tube_width_m
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.sequential.polar_updates import (
    SourceState,
    bootstrap_state,
    ranged_state,
    select_rays,
    update_bearings,
    update_ranges,
)
from nlosctl.solvers.sequential.set_scores import SetScores

__all__ = ["Hypotheses", "bearing_threshold_rad", "grow_hypotheses", "lone_hypotheses", "range_threshold_m"]


_VALUES = 1 << 16
"""Number of hypotheses times rows at once: temporaries stay in cache."""


@dataclass(frozen=True)
class Hypotheses:
    """Estimates (B, M), one from each pair, and the rows (B, M, K) that each rests on."""

    state: SourceState
    used: BoolArray


@dataclass(frozen=True)
class Thresholds:
    """Largest residuals (N, K) of a row in a set; ``range_m`` is infinite in rows without a range, None without any."""

    bearing_rad: FloatArray
    range_m: FloatArray | None


@dataclass(frozen=True)
class Residuals:
    """Sizes (N, K) of the residuals of all rows; ``range_m`` is NaN in rows without a range, None without any."""

    bearing_rad: FloatArray
    range_m: FloatArray | None

    def below(self, limits: Thresholds) -> BoolArray:
        """Return which residuals (N, K) are below their thresholds."""
        below = np.asarray(self.bearing_rad < limits.bearing_rad)
        if self.range_m is not None and limits.range_m is not None:
            below &= (self.range_m < limits.range_m) | np.isinf(limits.range_m)
        return below


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
    used = np.zeros((*first.shape, model.mixture.count), dtype=bool)
    block = max(1, _VALUES // model.mixture.count)
    for start in range(0, snapshot.shape[0], block):
        at = snapshot[start : start + block], index[start : start + block]
        growth = _Growth.start(model.take(at[0]), first[at][:, None], second[at][:, None], lognormal)
        growth.run(alpha, field_of_view_deg, by_likelihood)
        growth.put(at, state)
        used[at] = growth.used
    return Hypotheses(state, used)


def lone_hypotheses(model: OutlierModel) -> Hypotheses:
    """Return what snapshots of one row (B, 1) determine: the end of its ray at its range, where it has one."""
    nothing = np.full((model.minimum_range_m.shape[0], 1), np.nan)
    state = SourceState(nothing, nothing, SymmetricMatrix(nothing, nothing, nothing), np.isfinite(nothing))
    row = np.zeros(nothing.shape, dtype=np.int64)
    state = ranged_state(select_rays(model.lines, row, model.measured_m, model.range_std_m)) or state
    return Hypotheses(state, state.alive[..., None])


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
    """N sets while they grow, each with a model of K rows of its own; the state's arrays are (N, 1), all others (N, K).

    ``misfit`` is the residual of a row that is left in standard deviations, infinite in rows that are not.
    """

    model: OutlierModel
    lines: SightLines
    lognormal: bool
    state: SourceState
    used: BoolArray
    left: BoolArray
    misfit: FloatArray
    scores: SetScores | None = None
    cost: FloatArray | None = None

    @classmethod
    def start(cls, model: OutlierModel, first: IntArray, second: IntArray, lognormal: bool) -> _Growth:
        leaders = [np.take_along_axis(model.leader, index, axis=1) for index in (first, second)]
        state = _start(model, first, second, lognormal)
        used = np.zeros_like(model.leader, dtype=bool)
        for index in (first, second):
            np.put_along_axis(used, index, True, axis=1)
        left = (leaders[0] != model.leader) & (leaders[1] != model.leader) & (model.share > 0.0)
        growth = cls(model, _along_rows(model.lines), lognormal, state, used, left, np.full(left.shape, np.inf))
        growth.note_misfits(growth.residuals(state), np.True_)
        return growth

    def run(self, alpha: float, field_of_view_deg: float, by_likelihood: bool) -> None:
        """Take steps until no set has a row left."""
        model, range_m = self.model, None
        if model.range_std_m is not None:
            range_m = range_threshold_m(model.range_std_m, alpha, model.extent_m[:, None])
        limits = Thresholds(bearing_threshold_rad(self.lines.std_rad, alpha, field_of_view_deg), range_m)
        for step in range(model.mixture.count - 2):
            note_step(step, model.mixture.count)
            if not self.step(limits, by_likelihood):
                break

    def put(self, at: tuple[IntArray, IntArray], state: SourceState) -> None:
        """Write these states (N, 1) into those of a block (B, M)."""
        state.x[at], state.y[at] = self.state.x[:, 0], self.state.y[:, 0]
        state.covariance.put(at, self.state.covariance.at(slice(None), 0))
        state.alive[at] = self.state.alive[:, 0]

    def residuals(self, state: SourceState) -> Residuals:
        """Return the sizes of all rows' residuals: bearing (radians) and, where rows have ranges, range (metres).

        Bearings seen on a circle are scaled as if their ray tubes were not focused.
        """
        lines, measured, ranges = self.lines, self.model.measured_m, None
        with ignoring_overflow():
            dx, dy = state.x - lines.origin_x, state.y - lines.origin_y
            bearing = np.abs(np.arctan2(lines.sine * dx - lines.cosine * dy, lines.cosine * dx + lines.sine * dy))
            if lines.focusing is not None:
                range_m = np.sqrt(dx * dx + dy * dy)
                ratio = range_m / tube_width_m(range_m, lines.focusing.first_leg_m, lines.focusing.strength)
                bearing *= np.sqrt(ratio * ratio)
            if measured is not None:
                ranges = np.abs(measured - np.sqrt(dx * dx + dy * dy))
        return Residuals(bearing, ranges)

    def note_misfits(self, residuals: Residuals, where: BoolArray | np.bool_) -> None:
        """Keep the residuals of the rows that are left, in standard deviations, of the sets ``where`` (N, 1)."""
        misfit = residuals.bearing_rad / self.lines.std_rad
        if residuals.range_m is not None and self.model.range_std_m is not None:
            scaled = residuals.range_m / self.model.range_std_m
            misfit = np.where(np.isnan(scaled), misfit, np.hypot(misfit, np.nan_to_num(scaled)))
        np.copyto(misfit, np.inf, where=np.isnan(misfit))
        np.copyto(self.misfit, misfit, where=where & self.left)

    def step(self, limits: Thresholds, by_likelihood: bool) -> bool:
        """Combine the best of the rows left (steps 2-4), and take it from those left (step 5); False: none was left."""
        chosen = np.argmin(self.misfit, axis=1)[:, None]
        any_left = np.isfinite(np.take_along_axis(self.misfit, chosen, axis=1))
        if not any_left.any():
            return False
        rows = select_rays(self.model.lines, chosen, self.model.measured_m, self.model.range_std_m)
        trial = update_ranges(update_bearings(self.state, rows), rows, lognormal=self.lognormal)
        residuals = self.residuals(trial)
        joined = self.used.copy()
        np.put_along_axis(joined, chosen, True, axis=1)
        accepted = any_left & trial.alive
        if by_likelihood:
            accepted = self._likelier(trial, accepted)
        else:
            accepted &= (residuals.below(limits) | ~joined).all(axis=1, keepdims=True)
        np.copyto(self.used, joined, where=accepted)
        np.put_along_axis(self.left, chosen, False, axis=1)
        np.put_along_axis(self.misfit, chosen, np.inf, axis=1)
        if self.model.mixture.last is not None:
            group = np.take_along_axis(self.model.leader, chosen, axis=1)
            rivals = accepted & (self.model.leader == group)
            self.left &= ~rivals
            np.copyto(self.misfit, np.inf, where=rivals)
        self.note_misfits(residuals, accepted)
        self.state = trial.where(accepted, self.state)
        return True

    def _likelier(self, trial: SourceState, possible: BoolArray) -> BoolArray:
        """Return where, of the ``possible``, (23) at the trial state is not worse than at the present one."""
        with ignoring_overflow():
            if self.scores is None or self.cost is None:
                self.scores = SetScores.of(self.model.mixture)
                self.cost = _score(self.scores, self.state)
            cost = _score(self.scores, trial)
            better: BoolArray = possible & (cost <= self.cost)
        self.cost = np.where(better, cost, self.cost)
        return better


def _score(scores: SetScores, state: SourceState) -> FloatArray:
    return np.where(state.alive, scores.at(state.x, state.y), np.inf)


def _along_rows(lines: SightLines) -> SightLines:
    """Return lines (N, K) whose memory runs along the longer axis: along the rows where there are more than sets."""
    size, count = lines.std_rad.shape
    if size >= count:
        return lines
    names = ("origin_x", "origin_y", "cosine", "sine", "std_rad")
    arrays: dict[str, Any] = {name: np.ascontiguousarray(getattr(lines, name)) for name in names}
    return replace(lines, **arrays)
