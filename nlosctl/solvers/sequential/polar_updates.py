"""Sequential estimation: a position and its covariance, started by a pair of rays and updated row by row.

Ananthasubramaniam and Madhow, Section III. A bearing seen on a circle has the variance of its ray tube's width at
the state, over the range. Equation numbers are theirs; where the print is in error the corrected
form is used: sigma squared in (8)-(10), the transposed gain of (7), (13) pointing from the receiver to the source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.row_terms import tube_width_m

__all__ = [
    "SelectedRays",
    "SourceState",
    "bootstrap_state",
    "ranged_state",
    "select_rays",
    "update_bearings",
    "update_ranges",
]


@dataclass(frozen=True)
class SourceState:
    """Positions (B, M) about the local origin and their covariance; ``alive`` where there is one."""

    x: FloatArray
    y: FloatArray
    covariance: SymmetricMatrix
    alive: BoolArray

    @property
    def point(self) -> Point:
        """The positions as two arrays."""
        return self.x, self.y

    def where(self, first: BoolArray, other: SourceState) -> SourceState:
        """Return these states where ``first``, the others elsewhere."""
        return SourceState(
            np.where(first, self.x, other.x),
            np.where(first, self.y, other.y),
            self.covariance.where(first, other.covariance),
            np.where(first, self.alive, other.alive),
        )


@dataclass(frozen=True)
class SelectedRays:
    """One row for each of the states (B, M): its ray, and its range with the standard deviation (NaN without).

    Those two are None if no row of the batch has a range, the focusing of rays seen on a circle if no row is.
    """

    origin_x: FloatArray
    origin_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    std_rad: FloatArray
    measured_m: FloatArray | None
    range_std_m: FloatArray | None
    focusing: tuple[FloatArray, FloatArray] | None = None

    def variance(self, range_m: FloatArray) -> FloatArray:
        """Return the variance of the bearing of points at a range: smaller where a circle focuses the ray tube."""
        std = self.std_rad
        if self.focusing is not None:
            std = std * tube_width_m(range_m, *self.focusing) / range_m
        return std * std


def select_rays(
    lines: SightLines, row: IntArray, measured_m: FloatArray | None = None, range_std_m: FloatArray | None = None
) -> SelectedRays:
    """Return the rows of indices ``row`` (B, M) in each snapshot."""

    def pick(array: FloatArray) -> FloatArray:
        return np.take_along_axis(array, row, axis=1)

    return SelectedRays(
        pick(lines.origin_x),
        pick(lines.origin_y),
        pick(lines.cosine),
        pick(lines.sine),
        pick(lines.std_rad),
        None if measured_m is None else pick(measured_m),
        None if range_std_m is None else pick(range_std_m),
        None if lines.focusing is None else (pick(lines.focusing.first_leg_m), pick(lines.focusing.strength)),
    )


def bootstrap_state(first: SelectedRays, second: SelectedRays) -> SourceState:
    """Return the crossing of two rays, (15), with the covariance that follows from (16); not alive behind a ray.

    It is worked out in the first receiver's polar frame and turned to the common one by (12).
    """
    dx, dy = second.origin_x - first.origin_x, second.origin_y - first.origin_y
    sine = first.sine * second.cosine - first.cosine * second.sine  # sin(theta_1 - theta_2)
    cosine = first.cosine * second.cosine + first.sine * second.sine
    with ignoring_overflow():
        range_1 = (dy * second.cosine - dx * second.sine) / sine  # (15)
        range_2 = (dy * first.cosine - dx * first.sine) / sine
        variance_1, variance_2 = first.variance(range_1), second.variance(range_2)
        by_1, by_2 = -range_1 * cosine / sine, range_2 / sine  # (16), first line
        polar = SymmetricMatrix(by_1 * by_1 * variance_1 + by_2 * by_2 * variance_2, by_1 * variance_1, variance_1)
        covariance = _to_cartesian(polar, range_1, first.cosine, first.sine)
        alive = (range_1 > 0.0) & (range_2 > 0.0) & np.isfinite(covariance.trace)
        return SourceState(
            first.origin_x + range_1 * first.cosine, first.origin_y + range_1 * first.sine, covariance, alive
        )


def ranged_state(rows: SelectedRays) -> SourceState | None:
    """Return the ends of rays at their measured ranges, exact in each row's polar frame; dead in rows without a range.

    None where no row of the batch has a range.
    """
    if rows.measured_m is None or rows.range_std_m is None:
        return None
    range_m, std = rows.measured_m, rows.range_std_m
    polar = SymmetricMatrix(std * std, np.zeros_like(std), rows.variance(range_m))
    return SourceState(
        rows.origin_x + range_m * rows.cosine,
        rows.origin_y + range_m * rows.sine,
        _to_cartesian(polar, range_m, rows.cosine, rows.sine),
        np.isfinite(range_m) & np.isfinite(std),
    )


def update_bearings(state: SourceState, rows: SelectedRays) -> SourceState:
    """Return the states updated by each row's bearing in its own polar frame, (8)-(14); dead where the range turns."""
    with ignoring_overflow():
        range_m, cosine, sine, polar = _to_polar(state, rows)  # (13), (14)
        innovation = np.arctan2(
            rows.sine * cosine - rows.cosine * sine, rows.cosine * cosine + rows.sine * sine
        )  # wrapped to (-pi, pi]
        variance = rows.variance(range_m)
        total = polar.yy + variance
        left = variance / total
        updated = SymmetricMatrix(polar.xx - polar.xy * polar.xy / total, polar.xy * left, polar.yy * left)  # (10)
        return _from_polar(
            state, rows, range_m + polar.xy * innovation / total, polar.yy * innovation / total, cosine, sine, updated
        )  # (8)


def update_ranges(state: SourceState, rows: SelectedRays, *, lognormal: bool) -> SourceState:
    """Return the states updated by each row's range, (6) with A = [1 0]; unchanged in rows without one.

    Section V-A. With ``lognormal`` the innovation is that of the range's logarithm.
    """
    if rows.measured_m is None or rows.range_std_m is None:
        return state
    known = np.isfinite(rows.measured_m)
    with ignoring_overflow():
        range_m, cosine, sine, polar = _to_polar(state, rows)
        innovation, std = rows.measured_m - range_m, rows.range_std_m
        if lognormal:
            innovation = range_m * np.log(rows.measured_m / range_m)
            std = std * range_m / rows.measured_m
        variance = std * std
        total = polar.xx + variance
        left = variance / total
        updated = SymmetricMatrix(polar.xx * left, polar.xy * left, polar.yy - polar.xy * polar.xy / total)
        moved = _from_polar(
            state, rows, range_m + polar.xx * innovation / total, polar.xy * innovation / total, cosine, sine, updated
        )
    return moved if known.all() else moved.where(known, state)


def _to_polar(state: SourceState, rows: SelectedRays) -> tuple[FloatArray, FloatArray, FloatArray, SymmetricMatrix]:
    """Return range, direction cosine and sine, and the covariance of range and bearing; (13), (14)."""
    dx, dy = state.x - rows.origin_x, state.y - rows.origin_y
    range_m = np.sqrt(dx * dx + dy * dy)
    cosine, sine = dx / range_m, dy / range_m
    covariance = state.covariance
    along_x = covariance.xx * cosine + covariance.xy * sine
    along_y = covariance.xy * cosine + covariance.yy * sine
    across_x = covariance.xy * cosine - covariance.xx * sine
    across_y = covariance.yy * cosine - covariance.xy * sine
    polar = SymmetricMatrix(
        along_x * cosine + along_y * sine,
        (along_y * cosine - along_x * sine) / range_m,
        (across_y * cosine - across_x * sine) / (range_m * range_m),
    )
    return range_m, cosine, sine, polar


def _from_polar(
    state: SourceState,
    rows: SelectedRays,
    range_m: FloatArray,
    turn_rad: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    polar: SymmetricMatrix,
) -> SourceState:
    """Return the states at ``range_m`` in the direction turned by ``turn_rad``; (11), (12)."""
    turn_cosine, turn_sine = np.cos(turn_rad), np.sin(turn_rad)
    new_cosine = cosine * turn_cosine - sine * turn_sine
    new_sine = sine * turn_cosine + cosine * turn_sine
    return SourceState(
        rows.origin_x + range_m * new_cosine,
        rows.origin_y + range_m * new_sine,
        _to_cartesian(polar, range_m, new_cosine, new_sine),
        state.alive & (range_m > 0.0),
    )


def _to_cartesian(polar: SymmetricMatrix, range_m: FloatArray, cosine: FloatArray, sine: FloatArray) -> SymmetricMatrix:
    """Return T Sigma T^T of (12): the covariance of range and bearing turned to x and y."""
    mixed, across = polar.xy * range_m, polar.yy * (range_m * range_m)
    return SymmetricMatrix(
        polar.xx * cosine * cosine - 2.0 * mixed * cosine * sine + across * sine * sine,
        (polar.xx - across) * cosine * sine + mixed * (cosine * cosine - sine * sine),
        polar.xx * sine * sine + 2.0 * mixed * cosine * sine + across * cosine * cosine,
    )
