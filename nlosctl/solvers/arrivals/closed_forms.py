"""Closed forms for arrival times: Bancroft's, mirror images, and sensors in a plane (a line). Initial estimates.

Squaring t - c = |x - a| makes the arrivals linear in (x, c) for a given q = |x|^2 - c^2 (Bancroft, IEEE TAES 21(1),
1985, 56; Schau, Robinson, IEEE TASSP 35(8), 1987, 1223):

    -2 a.x + 2 t c = t^2 - |a|^2 - h^2 - q        h: the sensor's height over the plane of the source, if that is known

and q itself solves a quadratic. For sensors in a plane (in space) or on a line (in the plane) q is one more linear
unknown instead, and the distance from the plane is that of q = |p|^2 + d^2 - c^2, either sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements, sum_products
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.ranges.squared_ranges import principal_axes

__all__ = ["bancroft", "beside_plane", "far_away", "initial_estimates"]

_FAR = 100.0
_FARTHEST = 1e5

Points = list[tuple[FloatArray, ...]]


def initial_estimates(rows: ArrivalRows) -> Points:
    """Return points, each as D arrays (B,) about the local origins, NaN where a point does not exist.

    Both of Bancroft's and the pair beside the plane (line) that fits the sensors best, the mirror images of the former
    in it, and a point far away where a plane wave would come from. With a measured height also all of them, and
    Bancroft's for that height, at the height.
    """
    size = rows.size_m()
    weight = 1.0 / (rows.std_m * rows.std_m)
    weight = weight / sum_measurements(weight)[:, None]
    sensor = [part / size[:, None] for part in rows.sensor]
    arrival = rows.arrival_m / size[:, None]
    # Not about 0, as the sensors are: D + 1 rows of equal weight would make Bancroft's equations singular.
    arrival = arrival - (sum_measurements(arrival) / arrival.shape[1])[:, None] + 1.0
    square = arrival * arrival
    if rows.height is not None:
        square = square - (rows.height / size[:, None]) ** 2
    axes, _ = principal_axes(SymmetricMatrix.gram(*sensor))
    points = [point[:-1] for point in bancroft(sensor, arrival, square, weight)]
    points += [_mirror(point, axes[-1]) for point in points]
    points += [point[:-1] for point in beside_plane(sensor, arrival, square, weight, axes)]
    points += [far_away(sensor, arrival, weight)]
    if rows.level is not None:
        z = np.where(rows.level.known, rows.level.z_m, np.nan) / size
        lower = square - (sensor[2] - z[:, None]) ** 2
        points += [(*point[:-1], z) for point in bancroft(sensor[:2], arrival, lower, weight)]
        points += [(*point[:2], z) for point in points[:7]]
    return [_within(point, size) for point in points]


def _within(point: tuple[FloatArray, ...], size: FloatArray) -> tuple[FloatArray, ...]:
    """Return points in metres, those at more than `_FARTHEST` array sizes as NaN."""
    with ignoring_overflow():
        near = _sum([part * part for part in point]) <= _FARTHEST * _FARTHEST
        return tuple(np.where(near, part * size, np.nan) for part in point)


def bancroft(sensor: Sequence[FloatArray], arrival: FloatArray, square: FloatArray, weight: FloatArray) -> Points:
    """Return the two points (x, c), D + 1 arrays (B,), with q = |x|^2 - c^2; without a real q twice the nearest.

    ``sensor`` are D arrays (B, K), ``square`` (B, K) is t^2 - h^2, ``weight`` (B, K) that of each row.
    """
    root = np.sqrt(weight)
    columns = [*(-2.0 * root * part for part in sensor), 2.0 * root * arrival]
    right = root * (square - _sum([part * part for part in sensor]))
    with ignoring_overflow():
        normal = SymmetricMatrix.gram(*columns)
        base = normal.solve(*(sum_products(part, right) for part in columns))
        lean = normal.solve(*(sum_products(part, root) for part in columns))
        a = _minkowski(lean, lean)
        b = -2.0 * _minkowski(base, lean) - 1.0
        c = _minkowski(base, base)
        root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
        k = -0.5 * (b + np.where(b < 0.0, -root, root))
        return [tuple(one - q * other for one, other in zip(base, lean, strict=True)) for q in (c / k, k / a)]


def beside_plane(
    sensor: Sequence[FloatArray],
    arrival: FloatArray,
    square: FloatArray,
    weight: FloatArray,
    axes: Sequence[Sequence[FloatArray]],
) -> Points:
    """Return the two points (x, c) at either side of the plane (line) of the sensors, which need not be exactly in it.

    Arguments as of `bancroft`; ``axes`` are the unit vectors of the sensors' principal axes, the normal last.
    """
    flat = [_sum([part * along[:, None] for part, along in zip(sensor, axis, strict=True)]) for axis in axes[:-1]]
    root = np.sqrt(weight)
    columns = [*(-2.0 * root * part for part in flat), 2.0 * root * arrival, root]
    right = root * (square - _sum([part * part for part in sensor]))
    with ignoring_overflow():
        normal = SymmetricMatrix.gram(*columns)
        *place, offset, q = normal.solve(*(sum_products(part, right) for part in columns))
        squared = q + offset * offset - _sum([part * part for part in place])
        aside = np.sqrt(np.maximum(squared, 0.0))
        return [
            (
                *(
                    _sum([axis[i] * part for axis, part in zip(axes, (*place, side), strict=True)])
                    for i in range(len(axes))
                ),
                offset,
            )
            for side in (aside, -aside)
        ]


def far_away(sensor: Sequence[FloatArray], arrival: FloatArray, weight: FloatArray) -> tuple[FloatArray, ...]:
    """Return points at a hundred array sizes in the direction from which a plane wave fits the arrivals best.

    ``sensor`` are D arrays (B, K) in array sizes; the ``weight`` (B, K) of a snapshot's rows sums to 1.
    """
    root = np.sqrt(weight)
    middle = [root * (part - sum_products(weight, part)[:, None]) for part in sensor]
    with ignoring_overflow():
        normal = SymmetricMatrix.gram(*middle)
        slope = normal.solve(*(sum_products(part, root * arrival) for part in middle))
        steepness = np.sqrt(_sum([part * part for part in slope]))
        return tuple(-_FAR * part / steepness for part in slope)


def _mirror(point: tuple[FloatArray, ...], normal: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """Return the image of points in the plane (line) through the local origin across a unit normal."""
    twice = 2.0 * _sum([part * along for part, along in zip(point, normal, strict=True)])
    return tuple(part - twice * along for part, along in zip(point, normal, strict=True))


def _minkowski(left: tuple[FloatArray, ...], right: tuple[FloatArray, ...]) -> FloatArray:
    """Return x.x' - c c' of pairs of (x, c)."""
    return _sum([one * other for one, other in zip(left[:-1], right[:-1], strict=True)]) - left[-1] * right[-1]


def _sum(terms: Sequence[FloatArray]) -> FloatArray:
    return reduce(np.add, terms)
