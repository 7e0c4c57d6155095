"""Outlier suppression: grow a set of rows that agree, from many pairs (Ananthasubramaniam and Madhow, Section IV-B)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians, sqrt
from typing import Any

import numpy as np
from scipy.special import erf

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.bearings.row_terms import tube_width_m
from nlosctl.solvers.bearings.space_crossings import ends_at_height, ends_of_ranges
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.sequential.growing_sets import GrowingSets, SetState, may_pair, put_states
from nlosctl.solvers.sequential.polar_updates import (
    SourceState,
    bootstrap_state,
    ranged_state,
    select_rays,
    update_bearings,
    update_ranges,
)
from nlosctl.solvers.sequential.space_sets import SpaceSets, SpaceState, start_in_space

__all__ = ["Hypotheses", "bearing_threshold_rad", "grow_hypotheses", "lone_hypotheses", "range_threshold_m"]


_VALUES = 1 << 16
"""Number of hypotheses times rows at once: temporaries stay in cache."""


@dataclass(frozen=True)
class Hypotheses:
    """Estimates (B, M), one from each pair, and the rows (B, M, K) that each rests on."""

    state: SetState
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
    in_space = not isinstance(model.lines, SightLines)
    state: Any = start_in_space(model, first, second) if in_space else _start(model, first, second, lognormal)
    snapshot, index = np.nonzero(state.alive)
    used = np.zeros((*first.shape, model.mixture.count), dtype=bool)
    block = max(1, _VALUES // model.mixture.count)
    for start in range(0, snapshot.shape[0], block):
        at = snapshot[start : start + block], index[start : start + block]
        part, pair = model.take(at[0]), (first[at][:, None], second[at][:, None])
        sets: GrowingSets
        if in_space:
            sets = SpaceSets.start(part, *pair)
        else:
            sets = _PlaneSets.start(part, *pair, _limits(part, alpha, field_of_view_deg), lognormal=lognormal)
        sets.run(by_likelihood=by_likelihood)
        put_states(at, sets.state, state)
        used[at] = sets.used
    return Hypotheses(state, used)


def lone_hypotheses(model: OutlierModel) -> Hypotheses:
    """Return what snapshots of one row (B, 1) determine: the end of its ray at its range, or at a measured height."""
    if not isinstance(model.lines, SightLines):
        return _lone_in_space(model)
    nothing = np.full((model.minimum_range_m.shape[0], 1), np.nan)
    state = SourceState(nothing, nothing, SymmetricMatrix(nothing, nothing, nothing), np.isfinite(nothing))
    row = np.zeros(nothing.shape, dtype=np.int64)
    state = ranged_state(select_rays(model.lines, row, model.measured_m, model.range_std_m)) or state
    return Hypotheses(state, state.alive[..., None])


def _lone_in_space(model: OutlierModel) -> Hypotheses:
    shape = model.minimum_range_m.shape[0], 1
    found = None if model.measured_m is None else ends_of_ranges(model.lines, model.measured_m)
    if found is None and model.has_height:
        found = ends_at_height(model.lines)
    if found is None:
        nowhere = tuple(np.zeros(shape) for _ in range(model.mixture.dimension))
        found = Candidates(nowhere, np.zeros(shape, dtype=bool))
    information = SymmetricMatrix.full(shape, np.nan, model.mixture.dimension)
    return Hypotheses(SpaceState(found.point, information, found.valid), found.valid[..., None])


def _start(model: OutlierModel, first: IntArray, second: IntArray, lognormal: bool) -> SourceState:
    """Return the crossings of pairs of rows (B, M) that may both be direct, combined with their ranges."""
    rows = [select_rays(model.lines, index, model.measured_m, model.range_std_m) for index in (first, second)]
    state = bootstrap_state(rows[0], rows[1])
    for row in rows:
        state = update_ranges(state, row, lognormal=lognormal)
    return SourceState(state.x, state.y, state.covariance, state.alive & may_pair(model, first, second))


@dataclass
class _PlaneSets(GrowingSets):
    """Sets in the plane, updated in the polar frames of their rows."""

    lines: SightLines | None = None
    limits: Thresholds | None = None
    lognormal: bool = False

    @classmethod
    def start(
        cls, model: OutlierModel, first: IntArray, second: IntArray, limits: Thresholds, *, lognormal: bool
    ) -> _PlaneSets:
        """Return sets that begin with pairs of rows ``first``, ``second`` (N, 1) of their models."""
        shape, lines = model.leader.shape, _along_rows(model.lines)
        used, left = np.zeros_like(model.leader, dtype=bool), np.ones(shape, dtype=bool)
        state = _start(model, first, second, lognormal)
        sets = cls(model, state, used, left, np.full(shape, np.inf), lines=lines, limits=limits, lognormal=lognormal)
        sets.prepare(first, second)
        return sets

    def updated(self, chosen: IntArray) -> SourceState:
        """Return the states updated by the bearings and ranges of the rows ``chosen`` (N, 1)."""
        rows = select_rays(self.model.lines, chosen, self.model.measured_m, self.model.range_std_m)
        return update_ranges(update_bearings(self.state, rows), rows, lognormal=self.lognormal)

    def residuals(self, state: SourceState) -> Residuals:
        """Return the sizes of all rows' residuals: bearing (radians) and, where rows have ranges, range (metres).

        Bearings seen on a circle are scaled as if their ray tubes were not focused.
        """
        lines, measured, ranges = self._lines, self.model.measured_m, None
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

    def below_limits(self, residuals: Residuals) -> BoolArray:
        """Return which rows (N, K) are below their thresholds (25)."""
        assert self.limits is not None  # noqa: S101 - set by `start`
        return residuals.below(self.limits)

    def in_stds(self, residuals: Residuals) -> FloatArray:
        """Return the sizes (N, K) of residuals in standard deviations, those of bearing and range together."""
        misfit: FloatArray = residuals.bearing_rad / self._lines.std_rad
        if residuals.range_m is not None and self.model.range_std_m is not None:
            scaled = residuals.range_m / self.model.range_std_m
            misfit = np.where(np.isnan(scaled), misfit, np.hypot(misfit, np.nan_to_num(scaled)))
        return misfit

    @property
    def _lines(self) -> SightLines:
        assert self.lines is not None  # noqa: S101 - set by `start`
        return self.lines


def _limits(model: OutlierModel, alpha: float, field_of_view_deg: float) -> Thresholds:
    """Return the thresholds (25) of all rows."""
    range_m = None
    if model.range_std_m is not None:
        range_m = range_threshold_m(model.range_std_m, alpha, model.extent_m[:, None])
    return Thresholds(bearing_threshold_rad(model.lines.std_rad, alpha, field_of_view_deg), range_m)


def _along_rows(lines: SightLines) -> SightLines:
    """Return lines (N, K) whose memory runs along the longer axis: along the rows where there are more than sets."""
    size, count = lines.std_rad.shape
    if size >= count:
        return lines
    names = ("origin_x", "origin_y", "cosine", "sine", "std_rad")
    arrays: dict[str, Any] = {name: np.ascontiguousarray(getattr(lines, name)) for name in names}
    return replace(lines, **arrays)
