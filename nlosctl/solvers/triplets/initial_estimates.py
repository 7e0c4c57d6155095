"""Initial estimates of single paths in the plane, and the suprema of their likelihood on the nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.models.triplets import PathRows

__all__ = ["plane_crossings", "plane_starts", "plane_suprema"]


def plane_starts(rows: PathRows) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield initial estimates (N,): the midpoint of points 2 and 3, and both.

    Where there is no ellipse they are on a longer one.
    """
    rays = rows.rays
    longer = replace(rays, path_length_m=np.maximum(rays.path_length_m, rays.baseline_m + rows.path_length_std_m))
    x2, y2, x3, y3 = (longer.coordinate(point, axis).value_m for point in (2, 3) for axis in ("x", "y"))
    yield 0.5 * (x2 + x3), 0.5 * (y2 + y3)
    yield x2, y2
    yield x3, y3


def plane_crossings(rows: PathRows) -> tuple[FloatArray, FloatArray]:
    """Return point 1 (N,); NaN where the lines are nearly parallel or meet behind, where it is uninformative."""
    rays = rows.rays
    x, y = rays.coordinate(1, "x").value_m, rays.coordinate(1, "y").value_m
    with ignoring_overflow():
        usable = ~rays.meets_behind & (x * x + y * y < 100.0 * rays.path_length_m**2)
    return np.where(usable, x, np.nan), np.where(usable, y, np.nan)


def plane_suprema(rows: PathRows) -> Iterator[tuple[IntArray, tuple[FloatArray, FloatArray], FloatArray]]:
    """Yield rows (N,) with targets on a transmitter or receiver, and their costs; for paths shorter than baselines.

    The likelihood may have its supremum there without reaching it: the angle at that node is then any.
    """
    rays, half = rows.rays, 0.5 * rows.rays.baseline_m
    length = (rays.path_length_m - rays.baseline_m) / rows.path_length_std_m
    at_tx = np.arctan2(rays.doa_sine, -rays.doa_cosine) / rows.doa_std_rad
    at_rx = np.arctan2(rays.dod_sine, rays.dod_cosine) / rows.dod_std_rad
    apart = np.flatnonzero(half > 0.0)
    for angle, x in ((at_tx, -half), (at_rx, half)):
        cost = 0.5 * (length * length + angle * angle)
        yield apart, (x[apart], np.zeros(apart.shape)), cost[apart]
