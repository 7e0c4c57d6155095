"""Linear fits of a point to lines: least squares and Stansfield (Song, Willett, Zhou 2013, Sections 2.2, 2.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.blocks import max_measurements, sum_measurements
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.bearings import SightLines

__all__ = [
    "LineFit",
    "fit_focused",
    "fit_least_squares",
    "fit_stansfield",
    "sandwich_covariance",
    "stansfield_covariance",
]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LineFit:
    """Points (B,) about the local origin, and the normal matrix that they solve."""

    x: FloatArray
    y: FloatArray
    normal: Symmetric2x2


def fit_least_squares(lines: SightLines) -> LineFit:
    """Return the point with the least sum of squared distances to the lines, equations (18), (19).

    x and y are not finite where the lines are exactly parallel.
    """
    return _solve(lines.sine, -lines.cosine, lines)


def fit_stansfield(lines: SightLines, first: LineFit) -> LineFit:
    """Return Stansfield's fix: lines weighted by 1 / (std range)^2, the ranges taken at ``first``; equation (15).

    x and y are not finite where ``first`` is not.
    """
    return _solve_weighted(lines.range_m(first.x, first.y), lines)


def fit_focused(lines: SightLines, first: LineFit) -> LineFit:
    """Return Stansfield's fix with the spread of each ray tube at ``first`` in place of its range.

    The same as Stansfield's where no row is seen on a circle. x and y are not finite where ``first`` is not, or lies
    on a focus.
    """
    return _solve_weighted(lines.spread_m(first.x, first.y), lines)


def sandwich_covariance(lines: SightLines, fit: LineFit, first: LineFit | None = None) -> Symmetric2x2:
    """Return the covariance (B,) of a fit whose weights do not match the errors of the lines.

    N^-1 M N^-1, with N the normal matrix and M that of the weighted lines' errors, std times spread at the fit. The
    weights are 1 (least squares), or 1 / (std range at ``first``)^2 (Stansfield).
    """
    spread = lines.std_rad * lines.spread_m(fit.x, fit.y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if first is not None:
            range_m = lines.range_m(first.x, first.y)
            spread /= (lines.std_rad * range_m) ** 2
        normal_x, normal_y = spread * lines.sine, -spread * lines.cosine
        middle = Symmetric2x2(
            sum_measurements(normal_x * normal_x),
            sum_measurements(normal_x * normal_y),
            sum_measurements(normal_y * normal_y),
        )
    return fit.normal.inverse().congruence(middle)


def stansfield_covariance(lines: SightLines, fit: LineFit, first: LineFit) -> Symmetric2x2:
    """Return the covariance (B,) of Stansfield's fix: the inverse normal matrix, or the sandwich on circles.

    Where a snapshot has rows on a circle its weights do not match the errors of the lines.
    """
    matched = fit.normal.inverse()
    if lines.focusing is None:
        return matched
    focused = max_measurements(lines.focusing.strength) != 0.0
    sandwich = sandwich_covariance(lines, fit, first)
    return Symmetric2x2(
        *(np.where(focused, a, b) for a, b in zip(vars(sandwich).values(), vars(matched).values(), strict=True))
    )


def _solve_weighted(spread_m: FloatArray, lines: SightLines) -> LineFit:
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = 1.0 / (lines.std_rad * spread_m)
        return _solve(weight * lines.sine, -weight * lines.cosine, lines)


def _solve(normal_x: FloatArray, normal_y: FloatArray, lines: SightLines) -> LineFit:
    offset = normal_x * lines.origin_x + normal_y * lines.origin_y
    normal = Symmetric2x2(
        sum_measurements(normal_x * normal_x),
        sum_measurements(normal_x * normal_y),
        sum_measurements(normal_y * normal_y),
    )
    x, y = normal.solve(sum_measurements(normal_x * offset), sum_measurements(normal_y * offset))
    return LineFit(x, y, normal)
