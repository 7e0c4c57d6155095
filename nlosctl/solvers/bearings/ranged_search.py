"""Where the likelihood of bearings with ranges has its optima: initial estimates and polar coordinates."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division, ignoring_invalid
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.bearings import SightLines
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.solvers.bearings.multistart import pairwise_crossings
from nlosctl.solvers.bearings.ray_crossings import end_rays
from nlosctl.solvers.optimization.polar_coordinates import Pole
from nlosctl.solvers.ranges.search import cross_pairs, every_pair, surest_pairs

__all__ = ["THOROUGH_UP_TO", "mean_end", "starting_points", "surest_sensor"]

THOROUGH_UP_TO = 4
"""Up to this many rows every crossing is tried; of more rows those with the circle of the surest range."""


def mean_end(lines: SightLines, range_m: FloatArray, std_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean (B,) of the ends of rays at their ranges (B, K), weighted by their spread; NaN without any."""
    ends = end_rays(lines, range_m)
    spread = lines.std_rad * range_m
    weight = np.where(ends.valid, 1.0 / (spread * spread + std_m * std_m), 0.0)
    with ignoring_division():
        total = sum_measurements(weight)
        x, y = (sum_measurements(np.where(ends.valid, weight * part, 0.0)) / total for part in ends.point)
    return x, y


def starting_points(lines: SightLines, range_m: FloatArray, std_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return x and y (P, B) of the ends of rays at their ranges (B, K) and the crossings of circles and of lines."""
    known = np.isfinite(range_m)
    std_m = np.where(known, std_m, np.inf)
    circles = RangeCircles(
        lines.center_x, lines.center_y, lines.origin_x, lines.origin_y, np.where(known, range_m, np.nan), std_m, None
    )
    few = range_m.shape[1] <= THOROUGH_UP_TO
    ends = end_rays(lines, range_m)
    with ignoring_invalid():
        crossings = cross_pairs(circles, *(every_pair(circles) if few else surest_pairs(circles)))
    if not few:
        return crossings
    parts = [(ends.point[0].T, ends.point[1].T), crossings]
    if range_m.shape[1] > 1:
        parts.append(pairwise_crossings(lines))
    x, y = (np.concatenate(part) for part in zip(*parts, strict=True))
    return x, y


def surest_sensor(lines: SightLines, range_m: FloatArray, std_m: FloatArray, x: FloatArray, y: FloatArray) -> Pole:
    """Return as poles (B,) the origins whose range or bearing is the surest for a source about x, y (B,).

    In polar coordinates about it both its circle and its ray are straight.
    """
    distance = lines.range_m(x, y)
    across = np.where(np.isfinite(distance), lines.std_rad * distance, np.inf)
    row = np.argmin(np.minimum(np.where(np.isfinite(range_m), std_m, np.inf), across), axis=1)
    at = np.arange(row.shape[0]), row
    radius = np.where(np.isfinite(range_m[at]), range_m[at], distance[at])
    radius = np.where(np.isfinite(radius) & (radius > 0.0), radius, 1.0)
    return Pole(lines.origin_x[at], lines.origin_y[at], radius)
