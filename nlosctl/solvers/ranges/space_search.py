"""The two best optima of ranges in space."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_invalid
from nlosctl.geometry.blocks import max_measurements
from nlosctl.models.ranges.spheres import RangeSpheres
from nlosctl.solvers.optimization.problem import Problem
from nlosctl.solvers.optimization.two_optima import End, find_best_two
from nlosctl.solvers.ranges.squared_ranges import SquaredRangeFit, fit_squared_ranges

__all__ = ["find_space_optima"]

_PLAUSIBLE = 10.0
"""Half a chi-square of at most this plus two per degree of freedom is that of a good fit."""

_EQUAL = 1e-9
"""Costs that differ by a smaller share are equal."""


def find_space_optima(
    problem: Problem, rows: RangeSpheres, fit: SquaredRangeFit, max_iterations: int
) -> tuple[End, End]:
    """Return the two best optima of ``problem``, a cost of ranges in space, the second NaN where there is only one.

    The descents start from the squared-range fit and its mirror image in the plane that fits the sensors best (where
    they coincide, from points beside it, since on the plane no derivative leads away from it), and with a measured
    height from the fits of the circles at that height. Of mirror images, whose costs are equal, the lower is the first:
    that under a ceiling. Beside a good fit, points that are a thousand nats worse are not followed.
    """
    starts = [*_images(rows, fit)]
    if rows.level is not None:
        height = np.where(rows.level.known, rows.level.z_m, np.nan)
        squared = rows.range_m * rows.range_m - (rows.sensor[2] - height[:, None]) ** 2
        flat = fit_squared_ranges(rows.sensor[:2], squared, 1.0 / (rows.std_m * rows.std_m))
        starts += [(*flat.point, height), (*flat.mirror, height)]
    plausible = _PLAUSIBLE + 2.0 * rows.degrees_of_freedom.astype(np.float64)
    one, other = find_best_two(problem, rows, starts, max_iterations, plausible)
    return _lower_first(one, other)


def _lower_first(one: End, other: End) -> tuple[End, End]:
    """Return two optima (B,), the lower one first where their costs are equal up to rounding: mirror images."""
    with ignoring_invalid():
        equal = np.abs(one.cost - other.cost) <= _EQUAL * (1.0 + one.cost)
        equal &= one.converged & other.converged
    rows = np.flatnonzero(equal & (one.point[2] > other.point[2]))
    first, second = one.take(rows), other.take(rows)
    one.put(rows, second)
    other.put(rows, first)
    other.cost[equal] = one.cost[equal]  # so that rounding does not choose later
    return one, other


def _images(rows: RangeSpheres, fit: SquaredRangeFit) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Return the fit and its mirror image, at least as far from the mirror as spheres that touch are uncertain."""
    height = sum(
        0.5 * (part - image) * normal for part, image, normal in zip(fit.point, fit.mirror, fit.normal, strict=True)
    )
    beside = np.sqrt(max_measurements(rows.range_m) * max_measurements(rows.std_m))
    with ignoring_invalid():
        shift = np.where(np.abs(height) < 0.1 * beside, beside, 0.0)
    return (
        tuple(part + shift * normal for part, normal in zip(fit.point, fit.normal, strict=True)),
        tuple(part - shift * normal for part, normal in zip(fit.mirror, fit.normal, strict=True)),
    )
