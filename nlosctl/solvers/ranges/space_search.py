"""The two best optima of ranges in space, and whether they are two."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_invalid
from nlosctl.geometry.blocks import max_measurements
from nlosctl.models.ranges.spheres import RangeSpheres
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.problem import Problem
from nlosctl.solvers.ranges.ends import End, TwoBest
from nlosctl.solvers.ranges.squared_ranges import SquaredRangeFit, fit_squared_ranges

__all__ = ["are_merged", "find_space_optima"]

_PATIENCE = 20
"""Refused steps after which a descent is given up."""

_BARRIER = 0.5
"""Mirror images are one broad optimum unless the point half way between them costs so many nats more."""

_IMAGES = 1e-6
"""Optima are mirror images of each other in a plane of all sensors if their costs are equal up to this share."""


def find_space_optima(
    problem: Problem, rows: RangeSpheres, fit: SquaredRangeFit, max_iterations: int
) -> tuple[End, End]:
    """Return the two best optima of ``problem``, a cost of ranges in space, the second NaN where there is only one.

    The descents start from the squared-range fit and its mirror image in the plane that fits the sensors best (where
    they coincide, from points beside it, since on the plane no derivative leads away from it), and with a measured
    height from the fits of the circles at that height.
    """
    starts = [*_images(rows, fit)]
    if rows.level is not None:
        height = np.where(rows.level.known, rows.level.z_m, np.nan)
        squared = rows.range_m * rows.range_m - (rows.sensor[2] - height[:, None]) ** 2
        flat = fit_squared_ranges(rows.sensor[:2], squared, 1.0 / (rows.std_m * rows.std_m))
        starts += [(*flat.point, height), (*flat.mirror, height)]
    every = np.arange(rows.range_m.shape[0])
    ends = []
    for start in starts:
        minimum = minimize(problem, *start, max_iterations=max_iterations, patience=_PATIENCE)
        ends.append(End(minimum.point, minimum.cost, minimum.converged))
    optima = TwoBest(ends[0])
    for end in ends[1:]:
        optima.note(every, end, rows.information(*end.point))
    return optima.best, optima.other


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


def are_merged(rows: RangeSpheres, one: tuple[FloatArray, ...], other: tuple[FloatArray, ...]) -> BoolArray:
    """Return where (B,) two optima are images of each other, and the likelihood half way between them is about theirs.

    So it is for sensors in a plane and a source in it, whose distance from the plane the ranges don't determine.
    """
    points = (one, other, tuple(0.5 * (mine + theirs) for mine, theirs in zip(one, other, strict=True)))
    costs = [rows.half_chi_squares(*(part[:, None] for part in point))[:, 0] for point in points]
    with ignoring_invalid():
        merged: BoolArray = costs[2] - np.minimum(costs[0], costs[1]) < _BARRIER
        merged &= np.abs(costs[0] - costs[1]) <= _IMAGES * (1.0 + costs[0])
    return merged
