"""Linear fits of a point to lines: least squares and Stansfield (Song, Willett, Zhou 2013, Sections 2.2, 2.3).

In space a line is where two planes meet, that of the azimuth and that of the elevation: each is a row of the fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, add_measurements, column_blocks, gather_rows
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Sight
from nlosctl.models.space.sphere_lines import SphereLines

__all__ = [
    "InflatedCovariance",
    "LineFit",
    "WeightedLines",
    "fit_focused",
    "fit_least_squares",
    "fit_weighted",
    "inflate_near_sensors",
    "inflated_sandwich",
    "sandwich_covariance",
    "with_independent_errors",
]

InflatedCovariance = Callable[[IntArray, FloatArray], SymmetricMatrix]
"""A function of snapshots (N,) and square metres (N,): the covariance with all squared ranges so much larger."""


_NEAR = 3.0
"""A fix is near a sensor if it is at most this many standard deviations away."""

_ROUNDS = 2


@dataclass(frozen=True)
class LineFit(RowBlock):
    """Points about the local origin, as D arrays (B,), and the normal matrix that they solve."""

    point: tuple[FloatArray, ...]
    normal: SymmetricMatrix

    @property
    def x(self) -> FloatArray:
        """The first coordinate."""
        return self.point[0]

    @property
    def y(self) -> FloatArray:
        """The second coordinate."""
        return self.point[1]


@dataclass(frozen=True)
class WeightedLines(RowBlock):
    """Lines (B, M) weighted at a first fix (B, D): errors across them over std times width, and their derivatives."""

    lines: Sight
    first_m: FloatArray
    width_m: FloatArray
    residual: FloatArray
    slopes: tuple[FloatArray, ...]

    @classmethod
    def of(cls, lines: Sight, first: LineFit, width_m: FloatArray) -> WeightedLines | None:
        """Return the lines with the weights of `fit_weighted`; None where their planes are turned, by spheres."""
        if isinstance(lines, SphereLines):
            return None
        with ignoring_division():
            normals, offset = lines.planes(slice(None), 1.0 / (lines.std * width_m))
            slopes = normals[: lines.unknowns]
            across = [part * axis[:, None] for part, axis in zip(slopes, first.point, strict=True)]
            residual = np.asarray(sum(across[1:], across[0]) - offset)
        return cls(lines, np.stack(lines.absolute(*first.point), axis=1), width_m, residual, tuple(slopes))

    def spread(self, position_m: FloatArray) -> FloatArray:
        """Return how much wider (B, M) the lines' errors are at positions (B, D) than their weights state."""
        point = [position_m[:, axis] - self.lines.center[axis] for axis in range(self.lines.unknowns)]
        with ignoring_division():
            return np.asarray(self.lines.tube_width_m(*point) / self.width_m)


def fit_least_squares(lines: Sight) -> LineFit:
    """Return the point with the least sum of squared distances to the lines, equations (18), (19).

    The point is not finite where the lines are exactly parallel.
    """
    return fit_weighted(lines, None)


def fit_focused(lines: Sight, first: LineFit) -> LineFit:
    """Return Stansfield's fix with the width of each ray tube at ``first`` instead of its range.

    The same as Stansfield's where no row is seen on a circle. The point is not finite where ``first`` is not, or lies
    on a focus.
    """
    return fit_weighted(lines, lines.tube_width_m(*first.point))


def fit_weighted(lines: Sight, width_m: FloatArray | None) -> LineFit:
    """Return the fix of lines weighted by 1 / (std ``width_m``)^2, equation (15); equally if the widths are None.

    For Stansfield's fix the widths (B, M) are the ranges at the least-squares fix, in space the widths of the ray
    tubes. The point is not finite where a width is not.
    """
    size, unknowns = lines.std.shape[0], lines.unknowns
    normal, pull = SymmetricMatrix.full(size, 0.0, unknowns), [np.zeros(size) for _ in range(unknowns)]
    with ignoring_division():
        for at in column_blocks(lines.std.shape):
            weight = None if width_m is None else 1.0 / (lines.std[:, at] * width_m[:, at])
            normals, offset = lines.planes(at, weight)
            normal.add_gram(*normals[:unknowns])
            for total, part in zip(pull, normals, strict=False):
                add_measurements(total, part * offset)
    return LineFit(normal.solve(*pull), normal)


def with_independent_errors(lines: Sight, first: LineFit) -> Sight:
    """Return the lines with the planes of rows by spheres turned about their rays: independent errors at ``first``.

    Least squares does not depend on the turn; the weights of Stansfield's fit and covariances require it.
    """
    return lines.based_at(*first.point) if isinstance(lines, SphereLines) else lines


def sandwich_covariance(
    lines: Sight, fit: LineFit, weighed_m: FloatArray | None = None, extra_m2: FloatArray | None = None
) -> SymmetricMatrix:
    """Return the covariance (B,) of a fit whose weights need not match the errors of the lines.

    N^-1 M N^-1, with N the normal matrix and M that of the weighted lines' errors, std times spread at the fit. The
    weights are 1 (least squares), or 1 / (std ``weighed_m``)^2 with the ranges or spreads (B, K) taken at a first fix
    (Stansfield). With ``extra_m2`` (B,) the squared spreads at the fit are that much larger.
    """
    width_m = lines.tube_width_m(*fit.point)
    middle = SymmetricMatrix.full(fit.point[0].shape, 0.0, lines.unknowns)
    with ignoring_overflow():
        for at in column_blocks(width_m.shape):
            std, spread = lines.std[:, at], width_m[:, at]
            if extra_m2 is not None:
                spread = np.sqrt(spread * spread + extra_m2[:, None])
            spread = std * spread
            if weighed_m is not None:
                spread /= (std * weighed_m[:, at]) ** 2
            middle.add_gram(*(spread * part for part in lines.normals(at)[: lines.unknowns]))
    return fit.normal.inverse().congruence(middle)


def inflated_sandwich(lines: Sight, fit: LineFit, weighed_m: FloatArray | None = None) -> InflatedCovariance:
    """Return the sandwich with squared spreads increased, as a function of snapshots and increase."""

    def inflated(rows: IntArray, extra_m2: FloatArray) -> SymmetricMatrix:
        weighed = None if weighed_m is None else gather_rows(weighed_m, rows)
        return sandwich_covariance(lines.take(rows), fit.take(rows), weighed, extra_m2)

    return inflated


def inflate_near_sensors(
    covariance: SymmetricMatrix, nearest_m: FloatArray, inflated: InflatedCovariance
) -> SymmetricMatrix:
    """Return the covariances (B,) of fixes whose nearest origin is at ``nearest_m`` (B,), inflated where it is near.

    A bearing fixes a source to std times its range, and the range from a near sensor is as uncertain as the fix
    itself. There the squared range at the fix is replaced by its expectation: the square plus the larger eigenvalue of
    the covariance, in two passes. Other rows keep their bits.
    """
    with ignoring_overflow():
        squared_m2 = nearest_m * nearest_m
        near = np.flatnonzero(squared_m2 < _NEAR * _NEAR * covariance.trace)  # the larger eigenvalue is less
        larger = covariance.take(near).eigenvalues()[1]
        is_near = (squared_m2[near] < _NEAR * _NEAR * larger) & np.isfinite(larger)
        near, larger = near[is_near], larger[is_near]
        if not near.size:
            return covariance
        for _ in range(_ROUNDS):
            wider = inflated(near, larger)
            larger = wider.eigenvalues()[1]
    result = covariance.map(np.copy)
    result.put(near, wider)
    return result
