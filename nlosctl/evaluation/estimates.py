"""Scores of position estimates, accumulated chunk by chunk."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.results import has_covariance, is_fix
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import nees_interval, squared_mahalanobis, uncertain_coordinates
from nlosctl.evaluation.error_statistics import error_percentiles, ratio, rmse_std_error, rows_by_group
from nlosctl.evaluation.settling import TrackErrors
from nlosctl.evaluation.summaries import EstimateSummary
from nlosctl.geometry.ellipses import ellipse_threshold, ellipsoid_threshold

__all__ = ["EstimateRows", "EstimateScores", "FitTally", "nearest_alternatives"]

Key = Hashable

_PERCENTS = (50.0, 90.0, 95.0, 99.0)
_SMALL_P_VALUE = 1e-3
_PROBABILITIES = (0.50, 0.90, 0.95, 0.99)


@dataclass(frozen=True, kw_only=True)
class EstimateRows:
    """N estimates: position and truth (N, D), covariance (N, D (D + 1) / 2) as xx, xy, yy and in space xz, yz, zz.

    ``status`` (N,) are ``Status`` numbers.

    Metres and square metres; NaN for an absent value. ``used_share``, ``fit_p_value`` and ``std_dof`` (N,), the degrees
    of freedom of estimated standard deviations, are None where the table has no such column; ``time_s`` (N,) where they
    are not states of tracks.
    """

    position_m: FloatArray
    covariance_m2: FloatArray
    status: npt.NDArray[np.uint8]
    truth_m: FloatArray
    used_share: FloatArray | None = None
    fit_p_value: FloatArray | None = None
    std_dof: FloatArray | None = None
    time_s: FloatArray | None = None

    @property
    def answered(self) -> BoolArray:
        """Which rows (N,) have a fix: by their status, and their position is finite."""
        return is_fix(self.status) & np.isfinite(self.position_m).all(axis=1)

    @property
    def error_m(self) -> FloatArray:
        """The distances (N,) from the truth: infinite without a fix, NaN without a truth."""
        offset = self.position_m - self.truth_m
        distance = np.hypot(offset[:, 0], offset[:, 1])
        for height in offset.T[2:]:
            distance = np.hypot(distance, height)
        distance = np.where(self.answered, distance, np.inf)
        return np.where(np.isfinite(self.truth_m).all(axis=1), distance, np.nan)

    def take(self, rows: IntArray) -> EstimateRows:
        """Return the rows with these indices."""
        return EstimateRows(
            position_m=self.position_m[rows],
            covariance_m2=self.covariance_m2[rows],
            status=self.status[rows],
            truth_m=self.truth_m[rows],
            used_share=None if self.used_share is None else self.used_share[rows],
            fit_p_value=None if self.fit_p_value is None else self.fit_p_value[rows],
            std_dof=None if self.std_dof is None else self.std_dof[rows],
            time_s=None if self.time_s is None else self.time_s[rows],
        )


def nearest_alternatives(error_m: FloatArray, alternative: IntArray, *keys: npt.NDArray[np.generic]) -> IntArray:
    """Return the index of the row nearest to the truth among rows with equal ``keys``; indices in ascending order.

    ``error_m`` and ``alternative`` (N,), and each key (N,) (snapshot, method, target, as numbers or text). Ties go to
    the first alternative. All alternatives of a target must be among the N rows.
    """
    if error_m.size == 0:
        return np.zeros(0, dtype=np.int64)
    codes = [np.unique(key, return_inverse=True)[1] for key in keys]
    order = np.lexsort((alternative, error_m, *codes))
    first = np.ones(order.shape, dtype=bool)
    first[1:] = False
    for code in codes:
        first[1:] |= np.diff(code[order]) != 0
    return np.sort(order[first])


class EstimateScores:
    """Estimates against truth, by group, in one pass.

    Stores sums, counts, and one error of 8 bytes per row for the percentiles. Sums are accumulated row by row, so that
    results do not depend on how the rows were cut into chunks.
    """

    def __init__(self) -> None:
        self._groups: dict[Key, _Tally] = {}

    def add(self, rows: EstimateRows, group: IntArray | None = None, keys: Sequence[Key] = ("",)) -> None:
        """Add rows; ``group`` (N,) holds the index of each row's key in ``keys`` of this call. None: the first key.

        Keys are any hashable values (a method, or a method and a sweep value). Of several alternatives of a target,
        pass only the row to score (alternative 0, or `nearest_alternatives`).
        """
        if group is None:
            self._tally(keys[0]).add(rows)
            return
        for key, mask in rows_by_group(group, keys):
            self._tally(key).add(rows.take(np.flatnonzero(mask)))

    def result(self) -> dict[Key, EstimateSummary]:
        """Return the summary of each group, in order of first appearance."""
        return {key: tally.summary() for key, tally in self._groups.items()}

    def overall(self) -> EstimateSummary:
        """Return the summary of all rows of all groups."""
        total = _Tally()
        for tally in self._groups.values():
            total.include(tally)
        return total.summary()

    def _tally(self, key: Key) -> _Tally:
        return self._groups.setdefault(key, _Tally())


@dataclass
class FitTally:
    """Sums over fixes: shares of rows used, and p-values of the fit, with how many have them."""

    shares: float = 0.0
    with_share: int = 0
    small: int = 0
    with_p_value: int = 0

    def add(self, answered: BoolArray, used_share: FloatArray | None, p_value: FloatArray | None) -> None:
        """Add those of estimates (N,) that are ``answered``; NaN or None where a value is unknown."""
        if used_share is not None:
            known = used_share[answered & ~np.isnan(used_share)]
            self.shares, self.with_share = _running_sum(self.shares, known), self.with_share + known.size
        if p_value is not None:
            known = p_value[answered & ~np.isnan(p_value)]
            self.small += int(np.count_nonzero(known < _SMALL_P_VALUE))
            self.with_p_value += known.size

    def include(self, other: FitTally) -> None:
        """Add the sums of another group."""
        for name in self.__dataclass_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))

    @property
    def mean_used_share(self) -> float:
        """The mean share of rows used; NaN without a fix."""
        return ratio(self.shares, self.with_share)

    @property
    def share_p_below_0001(self) -> float:
        """The share of fixes whose p-value is below 0.001, of those that have one; NaN without one."""
        return ratio(self.small, self.with_p_value)


@dataclass
class _Tally:
    """The running sums of one group."""

    without_truth: int = 0
    bad_covariances: int = 0
    nees_rows: int = 0
    dimension: int = 2
    nees_degrees: int = 0
    with_std_dof: int = 0
    statuses: IntArray = field(default_factory=lambda: np.zeros(len(Status), dtype=np.int64))
    inside: IntArray = field(default_factory=lambda: np.zeros(len(_PROBABILITIES), dtype=np.int64))
    answered: int = 0
    fit: FitTally = field(default_factory=FitTally)
    sums: FloatArray = field(default_factory=lambda: np.zeros(9))
    errors: list[FloatArray] = field(default_factory=list)
    tracks: list[TrackErrors] = field(default_factory=list)

    def add(self, rows: EstimateRows) -> None:
        has_truth = np.isfinite(rows.truth_m).all(axis=1)
        self.without_truth += int(np.count_nonzero(~has_truth))
        rows = rows.take(np.flatnonzero(has_truth))
        error = rows.error_m
        answered = rows.answered
        offset = (rows.position_m - rows.truth_m)[answered]
        promised = answered & has_covariance(rows.status)
        squared = squared_mahalanobis(rows.position_m[promised] - rows.truth_m[promised], rows.covariance_m2[promised])
        proper = np.isfinite(squared)
        usable, degrees = squared[proper], None if rows.std_dof is None else rows.std_dof[promised][proper]
        unknowns = uncertain_coordinates(rows.covariance_m2[promised])[proper]
        self.dimension = rows.position_m.shape[1]
        self.nees_degrees += int(unknowns.sum())
        self.errors.append(error)
        if rows.time_s is not None:
            self.tracks = self.tracks or [TrackErrors()]
            self.tracks[0].add(rows.time_s, error, rows.covariance_m2)
        self.fit.add(answered, rows.used_share, rows.fit_p_value)
        self.answered += int(np.count_nonzero(answered))
        self.statuses += np.bincount(rows.status, minlength=len(Status))
        self.bad_covariances += squared.size - usable.size
        self.nees_rows += usable.size
        self.with_std_dof += 0 if degrees is None else int(np.count_nonzero(~np.isnan(degrees)))
        limits = [ellipse_threshold(p, degrees) for p in _PROBABILITIES]
        if self.dimension == 3:
            limits = [ellipsoid_threshold(p, unknowns, degrees) for p in _PROBABILITIES]
        self.inside += [int(np.count_nonzero(usable <= limit)) for limit in limits]
        distance = error[answered]
        summed = [offset[:, 0], offset[:, 1], distance, distance**2, distance**4, usable]
        if self.dimension == 3:
            summed += [offset[:, 2], offset[:, 2] ** 2, offset[:, 0] ** 2 + offset[:, 1] ** 2]
        for index, values in enumerate(summed):
            self.sums[index] = _running_sum(self.sums[index], values)

    def include(self, other: _Tally) -> None:
        self.without_truth += other.without_truth
        self.bad_covariances += other.bad_covariances
        self.nees_rows += other.nees_rows
        self.nees_degrees += other.nees_degrees
        self.dimension = other.dimension
        self.with_std_dof += other.with_std_dof
        self.answered += other.answered
        self.fit.include(other.fit)
        self.statuses = self.statuses + other.statuses
        self.inside = self.inside + other.inside
        self.sums = self.sums + other.sums
        self.errors.extend(other.errors)
        self.tracks.extend(other.tracks)

    def summary(self) -> EstimateSummary:
        errors = np.concatenate(self.errors) if self.errors else np.zeros(0)
        bias_x, bias_y, mean, mean_square, mean_fourth = (ratio(total, self.answered) for total in self.sums[:5])
        median, p90, p95, p99 = error_percentiles(errors, _PERCENTS)
        judged = 0 if self.with_std_dof else self.nees_rows  # of estimated std the mean NEES is no judge
        low, high = nees_interval(judged, degrees=self.nees_degrees)
        inside_50, inside_90, inside_95, inside_99 = (int(number) for number in self.inside)
        return EstimateSummary(
            rows=errors.size,
            without_truth=self.without_truth,
            answered=self.answered,
            fix_rate=ratio(self.answered, errors.size),
            mean_used_share=self.fit.mean_used_share,
            share_p_below_0001=self.fit.share_p_below_0001,
            rmse_m=math.sqrt(mean_square),
            rmse_std_error_m=rmse_std_error(self.answered, mean_square, mean_fourth),
            bias_x_m=bias_x,
            bias_y_m=bias_y,
            **self._heights(),
            settling_time_s=float(np.max([track.settling_time_s() for track in self.tracks])) if self.tracks else None,
            mean_m=mean,
            median_m=median,
            p90_m=p90,
            p95_m=p95,
            p99_m=p99,
            nees=ratio(self.sums[5], judged),
            nees_low=low,
            nees_high=high,
            nees_rows=self.nees_rows,
            bad_covariances=self.bad_covariances,
            statuses={status.word: int(self.statuses[status]) for status in Status if self.statuses[status]},
            inside_50=inside_50,
            inside_90=inside_90,
            inside_95=inside_95,
            inside_99=inside_99,
            coverage_50=ratio(inside_50, self.nees_rows),
            coverage_90=ratio(inside_90, self.nees_rows),
            coverage_95=ratio(inside_95, self.nees_rows),
            coverage_99=ratio(inside_99, self.nees_rows),
        )

    def _heights(self) -> dict[str, float]:
        """Return the figures that only positions in space have."""
        if self.dimension == 2:
            return {}
        bias, vertical, horizontal = (ratio(total, self.answered) for total in self.sums[6:])
        roots = {"horizontal_rmse_m": math.sqrt(horizontal), "vertical_rmse_m": math.sqrt(vertical)}
        return {**roots, "bias_z_m": bias}


def _running_sum(start: float, values: FloatArray) -> float:
    """Return ``start`` plus all values, added one by one in order, so that bits do not depend on the chunks."""
    return float(np.cumsum(np.concatenate([[start], values]))[-1])
