"""Linear fits of a point to lines: least squares and Stansfield (Song, Willett, Zhou 2013, Sections 2.2, 2.3).

In space a line is where two planes meet, that of the azimuth and that of the elevation: each is a row of the fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, gather_rows, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Sight
from nlosctl.models.space.sphere_lines import SphereLines

__all__ = [
    "InflatedCovariance",
    "LineFit",
    "fit_focused",
    "fit_least_squares",
    "fit_stansfield",
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


def fit_least_squares(lines: Sight) -> LineFit:
    """Return the point with the least sum of squared distances to the lines, equations (18), (19).

    The point is not finite where the lines are exactly parallel.
    """
    return _solve(lines.normals(), lines)


def fit_stansfield(lines: Sight, first: LineFit) -> LineFit:
    """Return Stansfield's fix: lines weighted by 1 / (std range)^2, the ranges taken at ``first``; equation (15).

    In space 1 / (std width)^2 with the width of each ray tube. The point is not finite where ``first`` is not.
    """
    return _solve_weighted(lines.stansfield_width_m(*first.point), lines)


def fit_focused(lines: Sight, first: LineFit) -> LineFit:
    """Return Stansfield's fix with the width of each ray tube at ``first`` instead of its range.

    The same as Stansfield's where no row is seen on a circle. The point is not finite where ``first`` is not, or lies
    on a focus.
    """
    return _solve_weighted(lines.tube_width_m(*first.point), lines)


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
    spread = lines.tube_width_m(*fit.point)
    if extra_m2 is not None:
        spread = np.sqrt(spread * spread + extra_m2[:, None])
    spread = lines.std * spread
    with ignoring_overflow():
        if weighed_m is not None:
            spread /= (lines.std * weighed_m) ** 2
        middle = SymmetricMatrix.gram(*(spread * part for part in lines.normals()[: lines.unknowns]))
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
        larger = covariance.eigenvalues()[1]
        near = np.flatnonzero((nearest_m * nearest_m < _NEAR * _NEAR * larger) & np.isfinite(larger))
        if not near.size:
            return covariance
        larger = larger[near]
        for _ in range(_ROUNDS):
            wider = inflated(near, larger)
            larger = wider.eigenvalues()[1]
    result = covariance.map(np.copy)
    result.put(near, wider)
    return result


def _solve_weighted(tube_width_m: FloatArray, lines: Sight) -> LineFit:
    with ignoring_division():
        weight = 1.0 / (lines.std * tube_width_m)
        return _solve(tuple(weight * part for part in lines.normals()), lines)


def _solve(normals: tuple[FloatArray, ...], lines: Sight) -> LineFit:
    offset, normals = lines.offsets(normals), normals[: lines.unknowns]
    normal = SymmetricMatrix.gram(*normals)
    return LineFit(normal.solve(*(sum_measurements(part * offset) for part in normals)), normal)
